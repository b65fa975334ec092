"""Slanted straight lines: scratches and hairs, too weak in any single box, summed up along every slope.

Tiles are weighted as in one large matched filter: n = sum a / v with the information d = sum 1 / v, where a
is the amount and v its variance in a tile, from the scatter of good prints and this page's own scatter near
the tile. A tile counts up to ``MOST`` standard deviations, so that no single speck makes a line. T = n /
sqrt(d) along the line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.statistics.boxes import Cells, own_of_tiles
from prooflight.detectors.matched_filter.statistics.local_evidence import LEAST_POWER, Scatter, Sums
from prooflight.detectors.matched_filter.statistics.page_scale import own_scatter
from prooflight.detectors.matched_filter.statistics.statistic import (
    OWN_PAGE,
    Box,
    Observed,
    Statistic,
    mode_and_ink,
)
from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.streaks import limited_pushes, scales_about, slanted, tile_scores

SLANT_MODES: Final = ("add-K", "void")
"""Modes of a mark on the page and of missing ink, of ``MODES``."""
HEIGHTS: Final = (16, 32, 64)
"""Heights of lines, each twice the previous one: 8, 16 and 32 mm. [tiles]"""
STEEPEST: Final = 0.16
"""Minimum slope: lines closer to the direction of the page's sides, 9 degrees, are left to streaks and bands.
[-]"""
FIRST_SLOPES: Final = np.array([math.ceil(STEEPEST * height) for height in HEIGHTS])
"""Minimum lean of lines of each height. [columns]"""
MOST: Final = 6.0
"""Maximum standard deviations of a tile. (On designs of their own 4.5 and 8 did about as well, and better
than 2 and 3.)"""
LEAST_INFORMATION: Final = 1.0
"""Minimum information of a line; with less it counts as this. Its amount has a standard deviation of one
whole ink."""
MOST_OF_HALF: Final = 4.0
"""Maximum of a line's T^2 over the lesser half's; 2 if both halves are equal. A line is present all along; a
few dark letters in a row are not. (On designs of their own 3 and 6 did as well, and without it a tenth fewer
scratches were detected.)"""
LEAST_TILES: Final = 50
"""Minimum number of tiles from which a page's own scatter is estimated."""
CLIPPED: Final = 2.0
"""Limit of a tile's |t| in the mean of its window, in units of the scale, so that a line hardly raises it."""
MEAN_CLIPPED: Final = 0.781
"""Mean of min(|z|, ``CLIPPED``) of a normal z: sqrt(2 / pi) (1 - exp(-2)) + 4 (1 - Phi(2))."""
ROUNDS: Final = 3
"""Iterations for the scale, on which its own limit depends."""
PRIOR_TILES: Final = 25.0
"""Number of tiles with the whole page's scatter that are added to a window."""


class Lines(NamedTuple):
    """Extremes of one mode along lines, in four orientations: leaning right, left, and both transposed."""

    values: NDArray[np.float32]
    """(4, HEIGHTS, slopes, 2): greatest T, and the least with its sign reversed; 0: no such slope at this
    height."""
    places: NDArray[np.int64]
    """(4, HEIGHTS, slopes, 2, 2): strip and column of each, in the oriented page."""


def of_slants(sums: Sums, cells: Cells, scatter: Scatter) -> Iterator[Observed]:
    """Yield the greatest line of each mode, sign and height, and its excess over lines of other slopes.

    cells: ``smallest_cells``.
    """
    names = [name for name in SLANT_MODES if name in sums.modes]
    numbers = [sums.modes.index(name) for name in names]
    maps = own_of_tiles(cells, numbers)
    for name, mode, own, power, edges in zip(names, numbers, *maps, strict=True):
        lines = lines_of(*tile_contributions(own, power, edges, scatter.boxes[mode, 0]))
        for level, height in enumerate(HEIGHTS):
            allowed = slice(int(FIRST_SLOPES[level]), height)
            values = lines.values[:, level, allowed]
            for end, sign in enumerate("+-"):
                way, slope = np.unravel_index(int(values[..., end].argmax()), values.shape[:2])
                most = float(values[way, slope, end])
                place = lines.places[way, level, allowed][slope, end]
                box = _box_mm(sums, int(way), int(slope) + allowed.start, height, place)
                which = Statistic("slant", *mode_and_ink(name), sign, height)
                yield Observed(statistic=which, value=most, box=box)
                usual = float(np.median(values[..., end]))
                yield Observed(statistic=which._replace(reference=OWN_PAGE), value=most - usual, box=box)


def tile_contributions(
    own: NDArray[np.float32],
    power: NDArray[np.float32],
    edges: NDArray[np.float32],
    scatter: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return each tile's contribution to n and d, (rows, columns), from N', D' and the edges' part of D'.

    scatter (3,).
    """
    t, d = unset((2, *own.shape))
    tile_scores(own, power, edges, scatter.astype(np.float32), np.float32(LEAST_POWER), t, d)
    t /= np.float32(own_scatter(t[::2, ::2], least=LEAST_TILES))
    pushes = unset(t.shape)
    limited_pushes(t, scatter_about(t, d > 0), d, np.float32(MOST), pushes)
    return pushes, d


def scatter_about(t: NDArray[np.float32], informative: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the scatter of tiles about each one, relative to the page's, (rows, columns), at least 1.

    It is Huber's proposal 2 with the mean for the mean square: the mean of |t|, limited to ``CLIPPED`` times
    the scale, over windows of ``ABOUT``. t: relative to the page's scatter.
    """
    scale = unset(t.shape)
    limits = (np.float32(one) for one in (CLIPPED, MEAN_CLIPPED, PRIOR_TILES))
    scales_about(t, informative.view(np.uint8), *limits, ROUNDS, scale)
    return scale


def lines_of(push: NDArray[np.float32], power: NDArray[np.float32]) -> Lines:
    """Return the extremes of n / sqrt(d) along lines, from n and d of tiles (rows, columns)."""
    tallest = HEIGHTS[-1]
    values = np.empty((4, len(HEIGHTS), tallest, 2), np.float32)
    places = np.empty((4, len(HEIGHTS), tallest, 2, 2), np.int64)
    limits = HEIGHTS[0], FIRST_SLOPES, LEAST_INFORMATION, MOST_OF_HALF
    turned = cv2.transpose(push), cv2.transpose(power)
    for way in range(4):
        tiles = turned if way >= 2 else (push, power)
        slanted(*tiles, way % 2 == 1, *limits, values[way], places[way])
    return Lines(values, places)


def _box_mm(sums: Sums, way: int, slope: int, height: int, place: NDArray[np.int64]) -> Box:
    """Return x, y, width and height of a line's bounding box."""
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
