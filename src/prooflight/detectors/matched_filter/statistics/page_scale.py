"""Statistics scaled by the page's own scatter, swapped inks, and inks that are off in a part of the page."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    FLAT,
    HARMONICS,
    LEAST_POWER,
    MODES,
    Sums,
    without_common,
)
from prooflight.detectors.matched_filter.statistics.statistic import GOOD_PRINTS, Reference
from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.misplaced_planes import swap_sums
from prooflight.kernels.statistics.page_scale import (
    LEAST_SCALE,
    ONE_SIGMA,
    boxes_against_own,
    each_against_own,
)

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.statistics.boxes import Cells

NEIGHBOURS: Final = 81
"""Number of adjacent frequencies whose median is the level of the spectrum."""
MEDIAN_OF_WAVES: Final = 1.386
"""Median of chi-square with 2 degrees of freedom: 2 ln 2."""
PAIRS: Final = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
BLOCK_TILES: Final = 16
SWAP_SD: Final = 0.3
"""Prior standard deviation of a swapped share: wide, so that a poorly measured swap is not taken for none."""
SWAP_TOLERANCE: Final = 0.01
STEP_TOLERANCE: Final = 0.01
"""Tolerance of the change in an ink's gain between parts of a good page. (assumed: what the fit leaves of its
tilt)"""
LEAST_PART: Final = 0.1
"""Minimum share of a page's information on an ink that must be on either side of a step."""
MEDIAN_OF_SQUARES: Final = 0.455
"""Median of chi-square with 1 degree of freedom."""


class Most(NamedTuple):
    """Extremes of one map of T."""

    high: float
    low: float
    own_high: float
    """Greatest T relative to the page's own scatter."""
    own_low: float
    energy: float
    """Mean of T^2, each limited to 100."""
    places: NDArray[np.int64]
    """(4, 2) row and column of the four extremes."""

    def against(self, reference: Reference) -> tuple[tuple[float, int, int], tuple[float, int, int]]:
        """Return by how much the greatest is above 0 and the least below it, each with its row and column."""
        good = reference is GOOD_PRINTS
        most, least = (self.high, -self.low) if good else (self.own_high, -self.own_low)
        (row, column), (other_row, other_column) = (
            self.places[:2].tolist() if good else self.places[2:].tolist()
        )
        return (most, row, column), (least, other_row, other_column)


def extremes_of(maps: NDArray[np.float32], scatter: NDArray[np.float64], *, overlap: float) -> list[Most]:
    """Return the extremes of every mode's T, from N', D' and the edges' part of D', (3, modes, h, w).

    scatter (modes, 3); overlap: number of adjacent values that are not independent.
    """
    values, places = _nothing(len(scatter))
    each_against_own(
        maps, scatter.astype(np.float32), np.float32(LEAST_POWER), float(overlap), values, places
    )
    return _extremes(values, places)


def extremes_of_boxes(
    cells: Cells, scatter: NDArray[np.float64], *, overlap: float, larger: NDArray[np.float32] | None = None
) -> list[Most]:
    """Return the extremes of every mode's T over all boxes of 2 x 2 cells.

    larger: as ``Cells.room``, to which the sums of cells of twice the side are written on the way; None: nowhere.
    """
    values, places = _nothing(len(scatter))
    boxes_against_own(
        cells.sums,
        cells.gains,
        cells.level,
        np.float32(1 / cells.common**2),
        scatter.astype(np.float32),
        np.float32(LEAST_POWER),
        float(overlap),
        cells.room(len(scatter)) if larger is None else larger,
        values,
        places,
    )
    return _extremes(values, places)


def _nothing(modes: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    return np.zeros((modes, 5), np.float32), np.zeros((modes, 4, 2), np.int64)


def _extremes(values: NDArray[np.float32], places: NDArray[np.int64]) -> list[Most]:
    return [Most._make((*numbers, where)) for numbers, where in zip(values.tolist(), places, strict=True)]


def flat_part(sums: Sums) -> Sums:
    """Return the sums of tiles, without the energy, and columns away from edges: only ink and light differ there."""
    of_modes = sums.tiles[:, : len(sums.modes)]
    flat = (sums.tiles[3, 0] <= FLAT * sums.tiles[1, 0]).astype(np.float32)
    tiles = np.multiply(of_modes, flat, out=unset(of_modes.shape))
    return replace(sums, tiles=tiles, columns=sums.flat_columns)


def above_neighbours(frequency: NDArray[np.float64], waves: NDArray[np.float64]) -> tuple[float, float]:
    """Return the greatest wave over the level of waves of similar length, alone and with its harmonics."""
    level = ndimage.median_filter(waves, NEIGHBOURS, mode="nearest") / MEDIAN_OF_WAVES
    ratio = waves / np.maximum(level, 0.7)
    first = round(frequency[0] / (frequency[1] - frequency[0]))
    index = first + np.arange(ratio.size)
    combined = np.zeros(ratio.size)
    for k in range(1, HARMONICS + 1):
        place = k * index - first
        within = place < ratio.size
        combined += np.where(within, ratio[np.minimum(place, ratio.size - 1)] - 2, 0)
    return float(ratio.max()), float(combined.max() / np.sqrt(HARMONICS))


def swapped_planes(sums: Sums) -> list[float]:
    """Return the share by which each of ``PAIRS`` is swapped over the page, over its standard deviation.

    Ink area a becomes a + s (b - a), and b the reverse. The standard deviation is estimated from the page's
    own blocks.
    """
    rows, columns = (extent // BLOCK_TILES for extent in sums.cover.shape[1:])
    blocks = np.empty((2, len(PAIRS), rows, columns), np.float32)
    prior_information = np.float32(1 / sums.prior.place**2)
    swap_sums(sums.tiles, sums.cover, np.array(PAIRS), prior_information, BLOCK_TILES, blocks)
    result = []
    for n, d in zip(*blocks.reshape(2, len(PAIRS), -1).astype(np.float64), strict=True):
        precision = float(d.sum()) + 1 / SWAP_SD**2
        share = float(n.sum()) / precision
        sd = float(np.sqrt(((n - share * d) ** 2).sum() + 1 / SWAP_SD**2)) / precision
        result.append(share / float(np.hypot(sd, SWAP_TOLERANCE)))
    return result


def own_scatter(t: NDArray[np.floating], *, least: int) -> float:
    """Return the scatter of T on its own page.

    It is 1 if fewer than ``least`` values are nonzero; a value of 0 has no information.
    """
    nonzero = np.abs(t[t != 0])
    if nonzero.size < least:
        return 1.0
    below, part = divmod(ONE_SIGMA * (nonzero.size - 1), 1)
    nonzero.partition(int(below))
    low, high = float(nonzero[int(below)]), float(nonzero[int(below) + 1 :].min())
    return max(low + part * (high - low), LEAST_SCALE)


class Step(NamedTuple):
    """Greatest step in an ink's gain."""

    t: float
    """Absolute difference of the gains on both sides, over its standard deviation."""
    at: float
    """Position of the step, as a share of the page's tiles."""


def gain_steps(sums: Sums) -> list[tuple[Step, Step]]:
    """Return each ink's greatest step in gain between left and right parts, and upper and lower parts.

    The standard deviation is estimated from the page's own blocks of ``BLOCK_TILES``, without changes common
    to all light.
    """
    modes = [MODES.index(name) for name in ("light", "gain-C", "gain-M", "gain-Y", "gain-K")]
    rows, columns = (extent // BLOCK_TILES for extent in sums.tiles.shape[-2:])
    if min(rows, columns) < 2:
        return [(Step(0.0, 0.5), Step(0.0, 0.5))] * INKS
    # First over lines: whole lines are summed in vectors, and without a copy.
    of_lines = [
        sums.tiles[:, mode, : rows * BLOCK_TILES].reshape(4, rows, BLOCK_TILES, -1).sum(axis=2)
        for mode in modes
    ]
    cut = np.stack(of_lines, axis=1)[..., : columns * BLOCK_TILES]
    blocks = cut.reshape(4, len(modes), rows, columns, BLOCK_TILES).sum(axis=-1)
    own, power, _ = without_common(blocks, sums.prior.place)
    return [
        (_step(n, d, axis=0), _step(n, d, axis=1))
        for n, d in zip(own[1:].astype(np.float64), power[1:].astype(np.float64), strict=True)
    ]


def _step(own: NDArray[np.float64], power: NDArray[np.float64], *, axis: int) -> Step:
    informative = power > LEAST_POWER
    if informative.sum() < 2:
        return Step(0.0, 0.5)
    mean = own[informative].sum() / power[informative].sum()
    squares = (own[informative] - mean * power[informative]) ** 2 / power[informative]
    doubt = max(float(np.median(squares)) / MEDIAN_OF_SQUARES, 1.0)
    of_lines = (own.sum(axis=axis), power.sum(axis=axis))
    before, sure = (np.cumsum(one)[:-1] for one in of_lines)
    after, rest = of_lines[0].sum() - before, of_lines[1].sum() - sure
    enough = np.minimum(sure, rest) > max(LEAST_PART * float(of_lines[1].sum()), LEAST_POWER)
    if not enough.any():
        return Step(0.0, 0.5)
    before, sure, after, rest = (one[enough] for one in (before, sure, after, rest))
    variance = doubt * (1 / sure + 1 / rest) + STEP_TOLERANCE**2
    t = np.abs(before / sure - after / rest) / np.sqrt(variance)
    most = int(np.argmax(t))
    return Step(float(t[most]), float((np.flatnonzero(enough)[most] + 1) / of_lines[0].size))
