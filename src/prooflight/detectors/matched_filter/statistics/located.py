"""Statistics with a place: boxes, streaks, waves, ghosts and stray energy.

They are of the whole page, and of places away from edges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.detectors.matched_filter.fit.binning import binned
from prooflight.detectors.matched_filter.statistics.boxes import Cells, ghosts
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    GHOST_BOXES_MM,
    QUARTER,
    SEGMENTS,
    SIZES,
    SPAN_SEGMENTS,
    SPANS,
    WIDTH_UNIT_MM,
    WIDTHS,
    Scatter,
    Sums,
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
    gain_steps,
    own_scatter,
    swapped_planes,
)
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    GOOD_PRINTS,
    NOWHERE,
    OWN_PAGE,
    Box,
    Observed,
    Reference,
    Statistic,
    mode_and_ink,
)

LEAST_BOXES: Final = 12
EVERY_LAG: Final = 8
"""Step between the lags of ghosts from which their scatter is estimated."""
OVERLAP: Final = 4
"""Factor by which boxes that overlap by half count as fewer."""
ENERGY: Final = np.array([2.0, 2.0, 0.0])
"""Variance of a pixel's squared residual, in units of its own variance."""
NOISE: Final = np.array([1.0, 1.0, 0.0])


def of_boxes(sums: Sums, cells: Cells, scatter: Scatter, *references: Reference) -> Iterator[Observed]:
    """Yield matched filters of every mode, at all boxes of every size, against each of ``references``.

    Against good prints their scatter is a statistic as well. Flat areas have no blur. cells: ``smallest_cells``.
    """
    for place in range(len(SIZES)):
        larger = cells.room(len(sums.modes))
        extremes = extremes_of_boxes(cells, scatter.boxes[:, place], overlap=OVERLAP, larger=larger)
        for (mode, ink), most in zip(map(mode_and_ink, sums.modes), extremes, strict=True):
            if mode == "blur" and FLAT_AREAS in references:
                continue
            for reference in references:
                for sign, (value, row, column) in zip("+-", most.against(reference), strict=True):
                    which = Statistic("box", mode, ink, sign, cells.size, "", reference)
                    yield Observed(statistic=which, value=value, box=cells.box_mm(sums, row, column))
            if GOOD_PRINTS in references:
                spread = Statistic("spread", mode, ink, "", cells.size)
                yield Observed(statistic=spread, value=float(np.log(most.energy + 0.1)))
        if place + 1 < len(SIZES):
            cells = cells.doubled(larger, float(scatter.light[place + 1]))


def of_streaks(sums: Sums, scatter: Scatter, *references: Reference) -> Iterator[Observed]:
    """Yield streaks of every mode, width and length against each of ``references``."""
    for w, s, maps in streaks(sums):
        width, span = WIDTHS[w], SPANS[s]
        extremes = extremes_of(maps, scatter.streaks[:, w, s], overlap=width)
        for (mode, ink), most in zip(map(mode_and_ink, sums.line_modes), extremes, strict=True):
            for reference in references:
                value, part, column = max(most.against(reference), key=itemgetter(0))
                which = Statistic("streak", mode, ink, "", width, span, reference)
                yield Observed(statistic=which, value=value, box=_streak_mm(sums, part, column, width, s))


def _streak_mm(sums: Sums, part: int, column: int, width: int, span: int) -> Box:
    height_mm, width_mm = sums.tiles.shape[2] * sums.tile_mm, width * WIDTH_UNIT_MM
    x = (column + 0.5) * sums.pixel_mm + sums.left_mm
    top = part * QUARTER / SEGMENTS * height_mm + sums.top_mm
    return x - width_mm / 2, top, width_mm, SPAN_SEGMENTS[span] / SEGMENTS * height_mm


class Waves(NamedTuple):
    """Rows of tiles of one mode, and waves along the travel in them."""

    mode: str
    own: NDArray[np.float32]
    power: NDArray[np.float32]
    edges: NDArray[np.float32]
    frequency: NDArray[np.float64]
    """[1/mm]"""
    waves: NDArray[np.float64]
    harmonics: NDArray[np.float64]
    """Waves with their harmonics."""


def waves_of(sums: Sums, scatter: Scatter) -> list[Waves]:
    """Return the waves of every mode."""
    result = []
    for name, of_bands, own, power, edges, beat in zip(sums.modes, scatter.bands, *rows(sums), strict=True):
        waves = periodogram(own, power, edges, beat, of_bands, sums.tile_mm)
        result.append(Waves(name, own, power, edges, *waves))
    return result


def of_bands(sums: Sums, seen: Sequence[Waves], scatter: Scatter) -> Iterator[Observed]:
    """Yield waves along the travel, and single rows, of every mode against good prints."""
    for one, scattered in zip(seen, scatter.bands, strict=True):
        band = Statistic("wave", *mode_and_ink(one.mode), reference=GOOD_PRINTS)
        yield Observed(statistic=band._replace(part="wave"), value=float(one.waves.max()))
        yield Observed(statistic=band._replace(part="harmonics"), value=float(one.harmonics.max()))
        t = t_statistic(one.own, one.power, one.edges, scattered)
        row = int(np.argmax(np.abs(t)))
        y = float(row * sums.tile_mm + sums.top_mm)
        box = (0.0, y, np.inf, sums.tile_mm)
        yield Observed(statistic=band._replace(part="row"), value=float(abs(t[row])), box=box)


def of_waves(seen: Sequence[Waves], reference: Reference) -> Iterator[Observed]:
    """Yield waves along the travel against others of similar length on this page."""
    for one in seen:
        wave, harmonics = above_neighbours(one.frequency, one.waves)
        which = Statistic("wave", *mode_and_ink(one.mode), reference=reference)
        yield Observed(statistic=which._replace(part="one"), value=wave)
        yield Observed(statistic=which._replace(part="harmonics"), value=harmonics)


def of_ghosts(sums: Sums, scatters: NDArray[np.float64], *references: Reference) -> Iterator[Observed]:
    """Yield ghosts of each ink's detail further down, against each of ``references``.

    A good page has some ghosts of its own.
    """
    seen = ghosts(sums)
    for ink in range(INKS):
        echoes = seen.through(ink)
        for b, (height, width) in enumerate(GHOST_BOXES_MM):
            value, usual, box = 0.0, 1.0, NOWHERE
            if echoes:
                t = echoes[b].t(scatters[ink, b])
                row, column, lag = np.unravel_index(int(t.argmax()), t.shape)
                value = max(float(t[row, column, lag]), 0.0)
                if value:
                    usual = own_scatter(t[..., ::EVERY_LAG], least=LEAST_BOXES)
                    middle = echoes[b].columns_mm[column] + sums.left_mm, echoes[b].rows_mm[row] + sums.top_mm
                    box = (float(middle[0]) - width / 2, float(middle[1]) - height / 2, width, height)
            for reference in references:
                over = value if reference is GOOD_PRINTS else value / usual
                which = Statistic("ghost", ink=INK_LETTERS[ink], size=b, reference=reference)
                yield Observed(statistic=which, value=over, box=box)


def of_swapped_planes(sums: Sums) -> Iterator[Observed]:
    """Yield a statistic for each pair of inks that may be swapped over the page."""
    for (one, other), t in zip(PAIRS, swapped_planes(sums), strict=True):
        both = INK_LETTERS[one] + INK_LETTERS[other]
        yield Observed(statistic=Statistic("swap", ink=both), value=abs(t))


def of_steps(sums: Sums) -> Iterator[Observed]:
    """Yield steps in each ink's gain between two parts of the page; the box is the smaller part."""
    height, width = (extent * sums.tile_mm for extent in sums.tiles.shape[-2:])
    for ink, (across, along) in zip(INK_LETTERS, gain_steps(sums), strict=True):
        which = Statistic("step", "gain", ink)
        left = sums.left_mm + (0.0 if across.at <= 0.5 else across.at * width)
        box = left, sums.top_mm, min(across.at, 1 - across.at) * width, height
        yield Observed(statistic=which._replace(part="across"), value=across.t, box=box)
        top = sums.top_mm + (0.0 if along.at <= 0.5 else along.at * height)
        box = sums.left_mm, top, width, min(along.at, 1 - along.at) * height
        yield Observed(statistic=which._replace(part="along"), value=along.t, box=box)


def of_energy(sums: Sums) -> Iterator[Observed]:
    """Yield squared residuals over their variance, regardless of their shape."""
    energy, pixels = sums.tiles[0, -1], sums.tiles[1, -1]
    share = np.maximum(sums.tiles[1, 0], np.float32(1e-9))
    np.divide(sums.tiles[3, 0], share, out=share)
    share *= pixels
    yield Observed(
        statistic=Statistic("energy", "page"),
        value=float(np.log(energy.sum() / max(pixels.sum(), 1.0) + 1e-3)),
    )
    maps, side = [energy, pixels, share], 1
    for size in (2, 8, 32):
        whole = Statistic("energy", size=size)
        excess = whole._replace(reference=OWN_PAGE)
        step, side = size // side, size
        maps = [binned(one, step)[: len(one) // step] * np.float32(step**2) for one in maps]
        if not maps[0].size:
            yield Observed(statistic=whole, value=0.0)
            yield Observed(statistic=excess, value=0.0)
            continue
        e, n, of_edges = maps
        full = n >= 0.5 * n.max()
        mean = np.where(full, e / np.maximum(n, 1), 0)
        row, column = np.unravel_index(int(np.argmax(mean)), mean.shape)
        energy_there = float(np.log(mean[row, column] + 1e-3))
        stray = np.stack([e - n, n * full, of_edges])[:, None]
        most = extremes_of(stray, ENERGY[None], overlap=1)[0]
        extent = size * sums.tile_mm
        for which, value, (down, right) in (
            (whole, energy_there, (row, column)),
            (excess, most.own_high, most.places[2]),
        ):
            box = float(right * extent + sums.left_mm), float(down * extent + sums.top_mm), extent, extent
            yield Observed(statistic=which, value=value, box=box)
