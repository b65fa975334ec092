"""Place of a streak across the page to a fraction of a pixel, by the light that each column sees of it.

A column sees a line without width at the distance u from its centre by the weight R(u) of its footprint. The page lies
slightly turned, stretched and warped, and columns are summed up by whole pixels (``line_sums``), so that a column of
the sums sees the line at distances that differ from line to line: its response is the mean of R over these. A streak of
width w has the mean of this over w. Of all places the one is taken whose response explains most of the columns'
likelihood, (sum R N)^2 / (2 sum R^2 D) with N and D as in ``extents``. The width is the least of which one pixel more
explains less: in a thin printed line the light changes at the line's other edge too, since the prediction has followed
the line's changed centre, and a response as wide as both was measured to lie 0.2 mm from the streak.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.statistics.local_evidence import segment_lines
from prooflight.kernels.residuals.moving import STRETCH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.extents import ColumnEvidence
    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.prediction.tables import SensorModel

AROUND: Final = 4
"""Columns beyond either side of a streak that are compared: the camera's footprint reaches over two. [pixels]"""
STEP: Final = 0.05
"""Distance of places that are tried: 0.01 mm, a tenth of what prints vary by. [pixels]"""
WIDEST: Final = 8
"""Greatest width, in whole pixels, that is tried; of a wider streak the middle of its columns is taken."""


def streak_centre(
    evidence: ColumnEvidence, where: PixelMap, sensors: Sequence[SensorModel], pixel_mm: float
) -> float:
    """Return the middle of a streak, as pixels of the page in its nominal place, the first pixel's centre being 0.

    Parameters
    ----------
    evidence
        Of the columns about the streak, over its rows.
    where
        Of the scan.
    sensors
        That the sums are of, with the footprint of binned pixels.
    pixel_mm
        Pitch of the binned pixels.
    """
    columns = evidence.columns
    seen, share = _seen_at(evidence, where)
    middle = float(seen @ share)
    if columns.stop - columns.start > WIDEST:
        return (columns.start + columns.stop - 1) / 2 + middle
    near = np.arange(max(columns.start - AROUND, 0), min(columns.stop + AROUND, evidence.push.size))
    push, power = evidence.push[near], evidence.power[near]
    places = np.arange(columns.start - 0.5, columns.stop - 0.5 + STEP / 2, STEP)
    off = places[:, None, None] - near[:, None] - (seen - middle)
    best, centre = -np.inf, (columns.start + columns.stop - 1) / 2
    for width in range(columns.stop - columns.start + 1):
        response = _response(sensors, off, width, pixel_mm) @ share
        explained = (response @ push) ** 2 / np.maximum(response**2 @ power, 1e-9)
        at = int(explained.argmax())
        if explained[at] > best:
            best, centre = float(explained[at]), float(places[at])
        elif width > 1:  # a pixel's width and none look alike
            break
    return centre + middle


def _seen_at(evidence: ColumnEvidence, where: PixelMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far to the right of itself a column of the sums sees the page, (n,), and the share of lines, (n,)."""
    lines, pixels = where.inside.shape
    moved = np.rint(where.slant())
    segment, rows = segment_lines(lines), evidence.rows
    down = np.arange(rows.start * segment, min(rows.stop * segment, lines))
    middle = (evidence.columns.start + evidence.columns.stop - 1) / 2
    across = np.clip(middle - moved[down], 0, pixels - 1) / STRETCH
    left = np.minimum(across.astype(np.intp), where.across.shape[1] - 2)
    nodes = np.arange(where.across.shape[0]) * STRETCH
    by_node = np.stack([np.interp(down, nodes, where.across[:, at]) for at in range(where.across.shape[1])])
    own = np.arange(down.size)
    part = across - left
    seen = (1 - part) * by_node[left, own] + part * by_node[left + 1, own] - moved[down]
    steps = np.rint(seen / STEP)
    bins, counts = np.unique(steps, return_counts=True)
    return bins * STEP, counts / down.size


def _response(
    sensors: Sequence[SensorModel], off: NDArray[np.float64], width: int, pixel_mm: float
) -> NDArray[np.float64]:
    """Return the mean light that sensors' columns see of a streak at distances ``off`` from their centres. [pixels]"""
    half = max(width, 2 * STEP) / 2
    total = np.zeros_like(off)
    for sensor in sensors:
        footprint = sensor.footprint
        at = np.linspace(-footprint.reach_mm, footprint.reach_mm, footprint.across.size) / pixel_mm
        right, left = (
            np.interp(off + side * half, at, footprint.across, left=0.0, right=1.0) for side in (1, -1)
        )
        total += (right - left) / (2 * half)
    return total / len(sensors)
