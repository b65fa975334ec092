"""Straight lines at a slant: scratches and hairs, of which no single box says much, added up along every slope.

Tiles are weighed as in one large matched filter, n = sum a / v with the information d = sum 1 / v, a the amount and v
its variance in a tile, by what good prints scatter and by what this page itself does about there. A tile counts up to
``MOST`` standard deviations, so that no speck makes a line. T = n / sqrt(d) along the line.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np

from prooflight.detectors.matched_filter.statistics.boxes import cells_of, own_of_tiles
from prooflight.detectors.matched_filter.statistics.local_evidence import LEAST_POWER
from prooflight.detectors.matched_filter.statistics.page_scale import own_scatter
from prooflight.detectors.matched_filter.statistics.statistic import (
    OWN_PAGE,
    Observed,
    Statistic,
    mode_and_ink,
)
from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.slants import slanted, tiles_known

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, Sums
    from prooflight.detectors.matched_filter.statistics.statistic import Box

SLANT_MODES: Final = ("add-K", "void")
"""Of a mark on the page, and of ink that is gone; of ``MODES``."""
HEIGHTS: Final = (16, 32, 64)
"""Of lines, each twice the one before: 8, 16 and 32 mm. [tiles]"""
STEEPEST: Final = 0.16
"""Lines nearer to the page's sides, 9 degrees, are left to streaks and bands. [-]"""
FIRST_SLOPES: Final = np.array([math.ceil(STEEPEST * height) for height in HEIGHTS])
"""Columns by which lines of each height lean at least, not to be too steep."""
MOST: Final = 6.0
"""Standard deviations. (On designs of their own 4.5 and 8 told more than 2 and 3, and about the same.)"""
LEAST_KNOWN: Final = 1.0
"""Information of a line, below which it counts for no more: its amount has a standard deviation of one whole ink."""
MOST_OF_HALF: Final = 4.0
"""Of T^2, a line's over the lesser half's; 2 where both say the same. A line is one all along; a few dark letters in a
row are not. (On designs of their own 3 and 6 told as much, and without it a tenth fewer scratches.)"""
LEAST_TILES: Final = 50
"""That say what a page scatters by itself."""
ABOUT: Final = 16
"""Side of the window about a tile that says what the page scatters there: 8 mm, of which a line takes 6 %. [tiles]"""
CLIPPED: Final = 2.0
"""Scales at which a tile's |t| is cut off in the mean of its window, so that a line hardly raises it."""
MEAN_CLIPPED: Final = 0.781
"""Mean of min(|z|, ``CLIPPED``) of a normal z: sqrt(2 / pi) (1 - exp(-2)) + 4 (1 - Phi(2))."""
ROUNDS: Final = 3
"""In which the scale is found that its own cutting off asks for."""
PRIOR_TILES: Final = 25.0
"""Tiles of a window whose scatter is taken from the whole page's."""


class Lines(NamedTuple):
    """Extremes of one mode along lines, in four ways to lay the page: leaning right, left, and both once turned."""

    values: NDArray[np.float32]
    """(4, HEIGHTS, slopes, 2): greatest T and least with its sign turned; 0: a slope that this height has not."""
    places: NDArray[np.int64]
    """(4, HEIGHTS, slopes, 2, 2): strip and column of each, in the page as it was laid."""


def of_slants(sums: Sums, scatter: Scatter) -> Iterator[Observed]:
    """The most telling line of each mode, sign and height; and by how much it is more so than lines of other slopes."""
    names = [name for name in SLANT_MODES if name in sums.modes]
    numbers = [sums.modes.index(name) for name in names]
    maps = own_of_tiles(next(cells_of(sums, scatter.light)), numbers)
    for name, mode, own, power, edges in zip(names, numbers, *maps, strict=True):
        lines = lines_of(*weighed(own, power, edges, scatter.boxes[mode, 0]))
        for level, height in enumerate(HEIGHTS):
            known = slice(int(FIRST_SLOPES[level]), height)
            values = lines.values[:, level, known]
            for end, sign in enumerate("+-"):
                way, slope = np.unravel_index(int(values[..., end].argmax()), values.shape[:2])
                most = float(values[way, slope, end])
                place = lines.places[way, level, known][slope, end]
                box = _box_mm(sums, int(way), int(slope) + known.start, height, place)
                which = Statistic("slant", *mode_and_ink(name), sign, height)
                yield Observed(statistic=which, value=most, box=box)
                usual = float(np.median(values[..., end]))
                yield Observed(statistic=which._replace(reference=OWN_PAGE), value=most - usual, box=box)


def weighed(
    own: NDArray[np.float32],
    power: NDArray[np.float32],
    edges: NDArray[np.float32],
    scatter: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What tiles add to n and d, (rows, columns) each, from their N', D' and the edges' part of D'; scatter (3,)."""
    t, d = unset((2, *own.shape))
    tiles_known(own, power, edges, scatter.astype(np.float32), np.float32(LEAST_POWER), t, d)
    t /= np.float32(own_scatter(t[::2, ::2], least=LEAST_TILES))
    most = np.float32(MOST)
    pushes = np.clip(t / scatter_about(t, d > 0), -most, most) * np.sqrt(d)
    return np.asarray(pushes, np.float32), d


def scatter_about(t: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How many times as much tiles about each scatter as the page, (rows, columns), at least 1; t: over the page's.

    By Huber's proposal 2 with the mean for the mean square: the mean of |t|, cut off at ``CLIPPED`` times the scale.
    """
    size, prior = np.abs(t), np.float32(PRIOR_TILES)
    count = _in_windows(known.astype(np.float32)) + prior
    scale = np.ones_like(size)
    for _ in range(ROUNDS):
        cut = np.minimum(size, np.float32(CLIPPED) * scale)
        scale = np.maximum((_in_windows(cut) / np.float32(MEAN_CLIPPED) + prior) / count, np.float32(1))
    return scale


def _in_windows(tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums over the window about each tile; beyond the page is nothing."""
    summed = cv2.boxFilter(tiles, -1, (ABOUT, ABOUT), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(summed, np.float32)


def lines_of(push: NDArray[np.float32], power: NDArray[np.float32]) -> Lines:
    """Extremes of n / sqrt(d) along lines, from n and d of tiles (rows, columns)."""
    tallest = HEIGHTS[-1]
    values = np.empty((4, len(HEIGHTS), tallest, 2), np.float32)
    places = np.empty((4, len(HEIGHTS), tallest, 2, 2), np.int64)
    for way in range(4):
        n, d = (_laid(one, way) for one in (push, power))
        slanted(n, d, HEIGHTS[0], FIRST_SLOPES, LEAST_KNOWN, MOST_OF_HALF, values[way], places[way])
    return Lines(values, places)


def _laid(tiles: NDArray[np.float32], way: int) -> NDArray[np.float32]:
    """Turned by its diagonal for ways 2 and 3, left for right for 1 and 3; with whole strips of the tallest lines."""
    turned = tiles.T if way >= 2 else tiles
    rows, columns = turned.shape
    laid = np.zeros((rows + -rows % HEIGHTS[-1], columns), np.float32)
    laid[:rows] = turned[:, ::-1] if way % 2 else turned
    return laid


def _box_mm(sums: Sums, way: int, slope: int, height: int, place: NDArray[np.int64]) -> Box:
    """x, y, width, height of what encloses a line."""
    rows, columns = sums.tiles.shape[-2:]
    wide = rows if way >= 2 else columns
    top, left = int(place[0]) * height, int(place[1])
    if way % 2:
        left = wide - 1 - left - slope
    x, y, across, along = left, top, slope + 1, height
    if way >= 2:
        x, y, across, along = y, x, along, across
    mm = sums.tile_mm
    return x * mm + sums.left_mm, y * mm + sums.top_mm, across * mm, along * mm
