"""Statistics with a place: boxes, streaks, waves, ghosts and stray energy; on the whole page, and away from edges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from prooflight.detectors.matched_filter.fit.binning import binned
from prooflight.detectors.matched_filter.fit.nuisance import INKS
from prooflight.detectors.matched_filter.statistics.boxes import cells_of, ghosts
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    GHOST_BOXES_MM,
    LINE_MODES,
    MODES,
    SEGMENTS,
    SPAN_SEGMENTS,
    SPANS,
    WIDTH_UNIT_MM,
    WIDTHS,
    periodogram,
    rows,
    streaks,
    t_statistic,
)
from prooflight.detectors.matched_filter.statistics.page_scale import (
    PAIRS,
    above_neighbours,
    extremes_of,
    extremes_of_boxes,
    swapped_planes,
)
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Statistic

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, Sums
    from prooflight.detectors.matched_filter.statistics.statistic import Box

INK: Final = "CMYK"
LEAST_BOXES: Final = 12
EVERY_LAG: Final = 8
"""Of ghosts, for what they scatter by."""
OVERLAP: Final = 4
"""Boxes that overlap by half count as so many fewer."""
ENERGY: Final = np.array([2.0, 2.0, 0.0])
"""Variance of a pixel's squared residual in its own variance."""
NOISE: Final = np.array([1.0, 1.0, 0.0])
ONE_SIGMA: Final = 0.6827


def of_boxes(sums: Sums, scatter: Scatter) -> Iterator[Statistic]:
    """Matched filters of every mode at all boxes of every size: against good prints, and against this page's own."""
    for place, cells in enumerate(cells_of(sums)):
        size, extremes = cells.size, extremes_of_boxes(cells, scatter.boxes[:, place], overlap=OVERLAP)
        for name, most in zip(MODES, extremes, strict=True):
            box = [cells.box_mm(sums, int(row), int(column)) for row, column in most.places]
            yield Statistic(name=f"box/{name}+/{size}", value=most.high, box=box[0])
            yield Statistic(name=f"box/{name}-/{size}", value=-most.low, box=box[1])
            yield Statistic(name=f"apart/{name}+/{size}", value=most.own_high, box=box[2])
            yield Statistic(name=f"apart/{name}-/{size}", value=-most.own_low, box=box[3])
            yield Statistic(name=f"spread/{name}/{size}", value=float(np.log(most.energy + 0.1)))


def of_flat_boxes(flat: Sums, scatter: Scatter) -> Iterator[Statistic]:
    """The same against this page's own, where there are no edges."""
    for place, cells in enumerate(cells_of(flat)):
        extremes = extremes_of_boxes(cells, scatter.boxes[:, place], overlap=OVERLAP)
        for name, most in zip(MODES, extremes, strict=True):
            if name == "blur":
                continue
            box = [cells.box_mm(flat, int(row), int(column)) for row, column in most.places[2:]]
            yield Statistic(name=f"flat/{name}+/{cells.size}", value=most.own_high, box=box[0])
            yield Statistic(name=f"flat/{name}-/{cells.size}", value=-most.own_low, box=box[1])


def of_streaks(sums: Sums, scatter: Scatter, *, own: str, good: str = "") -> Iterator[Statistic]:
    """Streaks of every mode, width and length against this page's own scatter, and against good prints if named."""
    for w, s, maps in streaks(sums):
        width, span = WIDTHS[w], SPANS[s]
        extremes = extremes_of(maps, scatter.streaks[:, w, s], overlap=width)
        for name, most in zip(MODES[:LINE_MODES], extremes, strict=True):
            for family, high, low, place in (
                (good, most.high, most.low, 0),
                (own, most.own_high, most.own_low, 2),
            ):
                if family:
                    part, column = most.places[place + (high < -low)]
                    box = _streak_mm(sums, int(part), int(column), width, s)
                    yield Statistic(name=f"{family}/{name}/{width}/{span}", value=max(high, -low), box=box)


def _streak_mm(sums: Sums, part: int, column: int, width: int, span: int) -> Box:
    height_mm, width_mm = sums.tiles.shape[2] * sums.tile_mm, width * WIDTH_UNIT_MM
    x = (column + 0.5) * sums.pixel_mm + sums.left_mm
    top = part / SEGMENTS * height_mm + sums.top_mm
    return x - width_mm / 2, top, width_mm, SPAN_SEGMENTS[span] / SEGMENTS * height_mm


class Waves(NamedTuple):
    """Rows of tiles of one mode, and waves along the travel in them."""

    own: NDArray[np.float32]
    power: NDArray[np.float32]
    edges: NDArray[np.float32]
    frequency: NDArray[np.float64]
    """[1/mm]"""
    waves: NDArray[np.float64]
    together: NDArray[np.float64]
    """With their harmonics."""


def waves_of(sums: Sums, scatter: Scatter) -> list[Waves]:
    """Of every mode."""
    found = []
    for mode, (own, power, edges) in enumerate(zip(*rows(sums), strict=True)):
        waves = periodogram(own, power, edges, scatter.bands[mode], sums.tile_mm)
        found.append(Waves(own, power, edges, *waves))
    return found


def of_bands(sums: Sums, seen: Sequence[Waves], scatter: Scatter) -> Iterator[Statistic]:
    """Waves along the travel of every mode against good prints, and single rows."""
    for mode, (name, one) in enumerate(zip(MODES, seen, strict=True)):
        yield Statistic(name=f"band/{name}/wave", value=float(one.waves.max()))
        yield Statistic(name=f"band/{name}/harmonics", value=float(one.together.max()))
        t = t_statistic(one.own, one.power, one.edges, scatter.bands[mode])
        row = int(np.argmax(np.abs(t)))
        y = float(row * sums.tile_mm + sums.top_mm)
        yield Statistic(name=f"band/{name}/row", value=float(abs(t[row])), box=(0.0, y, np.inf, sums.tile_mm))


def of_waves(seen: Sequence[Waves], *, family: str) -> Iterator[Statistic]:
    """Waves along the travel against others of about their length on this page."""
    for name, one in zip(MODES, seen, strict=True):
        wave, harmonics = above_neighbours(one.frequency, one.waves)
        yield Statistic(name=f"{family}/{name}/one", value=wave)
        yield Statistic(name=f"{family}/{name}/harmonics", value=harmonics)


def of_ghosts(sums: Sums, scatters: NDArray[np.float64], *, own: str, good: str = "") -> Iterator[Statistic]:
    """Ghosts of each ink's detail further down, against those that this page has anyway, and good prints if named."""
    seen = ghosts(sums)
    for ink in range(INKS):
        found = seen.through(ink)
        for b, (height, width) in enumerate(GHOST_BOXES_MM):
            value, usual, box = 0.0, 1.0, NOWHERE
            if found:
                t = found[b].t(scatters[ink, b])
                row, column, lag = np.unravel_index(int(t.argmax()), t.shape)
                value = max(float(t[row, column, lag]), 0.0)
                if value:
                    usual = _usual(t[..., ::EVERY_LAG])
                    middle = found[b].columns_mm[column] + sums.left_mm, found[b].rows_mm[row] + sums.top_mm
                    box = (float(middle[0]) - width / 2, float(middle[1]) - height / 2, width, height)
            if good:
                yield Statistic(name=f"{good}/{INK[ink]}/{b}", value=value, box=box)
            yield Statistic(name=f"{own}/{INK[ink]}/{b}", value=value / usual, box=box)


def _usual(t: NDArray[np.float32]) -> float:
    """What T of ghosts of an ink on this page scatters by; 0 is nothing known."""
    known = np.abs(t[t != 0])
    return max(float(np.quantile(known, ONE_SIGMA)), 0.5) if known.size >= LEAST_BOXES else 1.0


def of_swapped_planes(sums: Sums) -> Iterator[Statistic]:
    """Inks swapped over the page."""
    for (one, other), t in zip(PAIRS, swapped_planes(sums), strict=True):
        yield Statistic(name=f"swap/{INK[one]}{INK[other]}", value=abs(t))


def of_energy(sums: Sums) -> Iterator[Statistic]:
    """Squared residuals over their variance, in no one's shape."""
    energy, pixels = sums.tiles[0, -1], sums.tiles[1, -1]
    share = sums.tiles[3, 0] / np.maximum(sums.tiles[1, 0], 1e-9) * pixels
    yield Statistic(name="energy/page", value=float(np.log(energy.sum() / max(pixels.sum(), 1.0) + 1e-3)))
    maps, side = np.stack([energy, pixels, share]), 1
    for size in (2, 8, 32):
        step, side = size // side, size
        maps = binned(maps, step)[:, : maps.shape[1] // step] * np.float32(step**2)
        if not maps.size:
            yield Statistic(name=f"energy/{size}", value=0.0)
            yield Statistic(name=f"excess/{size}", value=0.0)
            continue
        e, n, of_edges = maps
        full = n >= 0.5 * n.max()
        mean = np.where(full, e / np.maximum(n, 1), 0)
        row, column = np.unravel_index(int(np.argmax(mean)), mean.shape)
        extent = size * sums.tile_mm
        box = (float(column * extent + sums.left_mm), float(row * extent + sums.top_mm), extent, extent)
        yield Statistic(name=f"energy/{size}", value=float(np.log(mean[row, column] + 1e-3)), box=box)
        stray = np.stack([e - n, n * full, of_edges])[:, None]
        most = extremes_of(stray, ENERGY[None], overlap=1)[0]
        row, column = most.places[2]
        box = (float(column * extent + sums.left_mm), float(row * extent + sums.top_mm), extent, extent)
        yield Statistic(name=f"excess/{size}", value=most.own_high, box=box)
