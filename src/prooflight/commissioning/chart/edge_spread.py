"""Footprint of one pixel from the edges of a chart's marks.

The camera's image of a step on paper is the integral of its line-spread function (ISO 12233's idea, with
edges at many places within a pixel instead of a slanted one). The line spread is taken as a box of the
pixel's pitch, the effect of any pixel and of a line's travel, blurred by two Gaussians: a narrow one for the
core and a wide one for the skirt of lens and paper. Three numbers, so that a few edges determine them; each
edge's own place is free, for paper is never quite where it should be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from prooflight.commissioning.chart.finding import DetectedChart, mark_edges
from prooflight.pages.sampling import Footprint

if TYPE_CHECKING:
    from prooflight.inks.chart_layout import Layout


EdgeSample = tuple["NDArray[np.float64]", "NDArray[np.float64]"]
"""Offsets of pixels' centres from an edge's expected place [pixels], and light there over paper's.

One entry a pixel.
"""
_REACH_PIXELS: Final = 4.0
_STEPS_PER_PIXEL: Final = 64
_SEEN_PIXELS: Final = 5.0  # either side of an edge
_SEEN_MM: Final = 0.9
_START: Final = (0.3, 1.2, 0.1)  # sigma of core and skirt [pixels], share of the skirt
_LOW, _HIGH = (0.02, 0.5, 0.0), (1.5, 4.0, 0.5)


def mark_samples(
    light: NDArray[np.float32], chart: DetectedChart, layout: Layout
) -> tuple[tuple[EdgeSample, ...], tuple[EdgeSample, ...]]:
    """Sample the marks' edges in one sensor's image (lines, pixels) of light over paper's.

    Return the edges across columns, and those across lines.
    """
    return _edges_along(light, chart, layout, 0), _edges_along(light, chart, layout, 1)


def footprint_of(
    across: Sequence[EdgeSample], along: Sequence[EdgeSample], pitch_mm: tuple[float, float]
) -> Footprint:
    """Fit the footprint of one sensor to edges of all scans; pitch_mm of columns and of lines."""
    # Both ways on one reach in millimetres, which is counted in columns.
    offsets = np.linspace(-_REACH_PIXELS, _REACH_PIXELS, round(2 * _REACH_PIXELS * _STEPS_PER_PIXEL) + 1)
    steps = [
        _step(offsets * pitch_mm[0] / pitch, _fitted(edges))
        for edges, pitch in zip((across, along), pitch_mm, strict=True)
    ]
    return Footprint(
        reach_mm=float(_REACH_PIXELS * pitch_mm[0]), across=_whole(steps[0]), along=_whole(steps[1])
    )


def _whole(cumulative: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale to 0..1."""
    return (cumulative - cumulative[0]) / (cumulative[-1] - cumulative[0])


def _edges_along(
    light: NDArray[np.float32], chart: DetectedChart, layout: Layout, axis: int
) -> tuple[EdgeSample, ...]:
    """Sample the edges that run across one axis of the scan (0: columns follow one another).

    Return offsets of pixel centres from the edge's expected place [pixels], and light there. Each sample is
    one pixel as it was read.
    """
    turned = abs(chart.to_pixel[0, 0]) < abs(chart.to_pixel[0, 1])
    edges = []
    lines, pixels = light.shape
    for normal, place, (low, high) in mark_edges(layout):
        if (normal != axis) != turned:
            continue
        ends = np.empty((2, 2))
        ends[:, normal], ends[:, 1 - normal] = place, (low, high)
        start, stop = ends @ chart.to_pixel[:, :2].T + chart.to_pixel[:, 2]
        other = 1 - axis
        first, last = sorted((start[other], stop[other]))
        rows = np.arange(np.ceil(first), np.floor(last) + 1)
        if not rows.size:
            continue
        across, down = stop[axis] - start[axis], stop[other] - start[other]
        crossing = start[axis] + (rows - start[other]) * across / down
        reach = int(min(_SEEN_PIXELS, _SEEN_MM / chart.pitch_mm[axis]))
        at = np.round(crossing).astype(np.intp)[:, None] + np.arange(-reach, reach + 1)
        row = np.broadcast_to(rows.astype(np.intp)[:, None], at.shape)
        column_index, line_index = (at, row) if axis == 0 else (row, at)
        inside = (column_index >= 0) & (column_index < pixels) & (line_index >= 0) & (line_index < lines)
        if inside.all():
            seen = light[line_index, column_index].ravel().astype(np.float64)
            edges.append(((at - crossing[:, None]).ravel(), seen))
    return tuple(edges)


def _fitted(edges: Sequence[EdgeSample]) -> NDArray[np.float64]:
    """Fit core, skirt and share to all edges, each with its own place and ends."""
    steps = []
    for offset, light in edges:
        dark, bright = np.percentile(light, (8, 92))
        rises = np.polyfit(offset, light, 1)[0] > 0
        level = (light - dark) / max(bright - dark, 1e-6)
        level = level if rises else 1 - level
        inside = np.abs(level - 0.5) < 0.45
        own = float(np.median(offset[inside] - (level[inside] - 0.5))) if inside.any() else 0.0
        # What a speck did to a pixel is worth no more than its neighbours say.
        steps.append((offset - own, level))

    def residual(values: NDArray[np.float64]) -> NDArray[np.float64]:
        left = []
        for offset, level in steps:
            fit = _step(offset, values[:3])
            slope = (_step(offset + 0.05, values[:3]) - _step(offset - 0.05, values[:3])) / 0.1
            # The edge's own place and ends are linear near where they are: solved for here.
            design = np.column_stack([fit, np.ones_like(fit), slope])
            left.append(level - design @ np.linalg.lstsq(design, level, rcond=None)[0])
        return np.concatenate(left)

    solution = least_squares(
        residual, _START, bounds=(_LOW, _HIGH), loss="soft_l1", f_scale=0.02, diff_step=1e-3
    )
    return np.asarray(solution.x[:3], dtype=np.float64)


def _step(offset: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cumulative line spread at offsets [pixels]: a box of one pixel, blurred."""
    core, skirt, share = values

    def blurred(sigma: float) -> NDArray[np.float64]:
        return _ramp(offset + 0.5, sigma) - _ramp(offset - 0.5, sigma)

    return np.asarray((1 - share) * blurred(core) + share * blurred(max(skirt, core)))


def _ramp(offset: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Return the integral of the normal distribution function."""
    u = offset / sigma
    return np.asarray(sigma * (u * ndtr(u) + np.exp(-0.5 * u * u) / np.sqrt(2 * np.pi)))
