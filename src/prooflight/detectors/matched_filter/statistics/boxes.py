"""Tile sums aggregated to boxes of every size, and ghosts of a page's own detail."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    GHOST_BOXES_MM,
    LEAST_POWER,
    MODES,
    SIZES,
    SMALL,
    Sums,
    flicker,
    smooth_level,
    without_common,
)
from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.boxes import boxed, ghost_parts, own_of_cells, squares, t_of_boxes

LAGS_MM: Final = (3.0, 60.0)
DETAIL_MM: Final = 15.0
LEAST_DETAIL: Final = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Sums over square cells of tiles; boxes are 2 x 2 cells and overlap by half."""

    sums: NDArray[np.float32]
    """(4, at least modes, rows, columns): N, D, C and the edges' part of D."""
    size: int
    """Side of a box. [tiles]"""
    gains: NDArray[np.float32]
    """(rows,) share of C that is the lamp's flicker, to be subtracted from N."""
    level: NDArray[np.float32]
    """(rows, columns) share of a box's C that is a smooth change of light, to be subtracted from its N."""
    common: float
    """Standard deviation of any other change common to all light in a box."""

    def box_mm(self, sums: Sums, row: int, column: int) -> tuple[float, float, float, float]:
        """Return x, y, width and height of the box that begins at a cell."""
        side = self.size * sums.tile_mm
        return column * side / 2 + sums.left_mm, row * side / 2 + sums.top_mm, side, side

    def room(self, modes: int) -> NDArray[np.float32]:
        """Return an uninitialised array for the sums of cells of twice the side."""
        return unset((4, modes, *(-(-extent // 2) for extent in self.level.shape)))

    def doubled(self, sums: NDArray[np.float32], common: float) -> Cells:
        """Return cells of twice the side, whose sums are known; common: as there."""
        extents, size = sums.shape[-2:], 2 * self.size
        level = _of_middles(self.level, extents) if size <= SMALL else np.zeros(extents, np.float32)
        return Cells(sums=sums, size=size, gains=np.zeros(extents[0], np.float32), level=level, common=common)


def smallest_cells(sums: Sums, light: NDArray[np.floating]) -> Cells:
    """Return the cells for boxes of the first of ``SIZES``; light: ``Scatter.light``."""
    gains, level = flicker(sums), smooth_level(sums)
    return Cells(sums=sums.tiles, size=SIZES[0], gains=gains, level=level, common=float(light[0]))


def cells_of(sums: Sums, light: NDArray[np.floating]) -> Iterator[Cells]:
    """Yield cells for boxes of all ``SIZES`` in turn; light: ``Scatter.light``."""
    cells = smallest_cells(sums, light)
    yield cells
    for common in light[1:].tolist():
        cells = cells.doubled(_sums_of_boxes(cells)[:, : len(sums.modes), ::2, ::2].copy(), common)
        yield cells


def _of_middles(level: NDArray[np.float32], extents: Sequence[int]) -> NDArray[np.float32]:
    """Return the level of boxes of twice the side, (rows, columns)."""
    for axis, extent in enumerate(extents):
        level = level.take(np.minimum(2 * np.arange(extent) + 1, level.shape[axis] - 1), axis=axis)
    return level


def boxes(cells: Cells) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return N', D' and the edges' part of D' of all boxes, (modes, rows, columns) each."""
    maps = _sums_of_boxes(cells)[:, : len(MODES)]
    maps[0] -= maps[2] * cells.level
    return without_common(maps, cells.common)


def _sums_of_boxes(cells: Cells) -> NDArray[np.float32]:
    """Return the sums of 2 x 2 cells without the lamp's flicker; every other one each way is a larger cell."""
    maps = cells.sums.copy()
    maps[0] -= maps[2] * cells.gains[:, None]
    down = np.pad(maps, [(0, 0)] * 2 + [(0, 1)] * 2)
    return np.asarray(down[..., :-1, :-1] + down[..., 1:, :-1] + down[..., :-1, 1:] + down[..., 1:, 1:])


def own_of_tiles(
    cells: Cells, modes: Sequence[int]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return N', D' and the edges' part of D' of tiles, (modes, rows, columns) each.

    cells: ``smallest_cells``.
    """
    maps = unset((len(modes), 3, *cells.level.shape))
    for mode, out in zip(modes, maps, strict=True):
        own_of_cells(cells.sums, cells.gains, cells.level, np.float32(1 / cells.common**2), mode, out)
    return maps[:, 0], maps[:, 1], maps[:, 2]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ghosts:
    """Inputs of the search for ghosts of each ink's detail, on squares of 2 x 2 tiles."""

    own: NDArray[np.float32]
    """(inks, h, w) N' of each added ink."""
    power: NDArray[np.float32]
    edges: NDArray[np.float32]
    detail: NDArray[np.float32]
    """(inks, h, w) ink area less its local mean."""
    present: NDArray[np.bool_]
    """(inks,) whether an ink has any detail."""
    lags: NDArray[np.int64]
    """[squares]"""
    square_mm: float

    def bands(self, box_mm: tuple[float, float]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the bounds of boxes (height, width) that overlap by 3/4: rows (n, 2), columns (m, 2)."""
        bounds = []
        for extent_mm, extent in zip(box_mm, self.own.shape[1:], strict=True):
            side = max(round(extent_mm / self.square_mm), 1)
            begin = np.arange(0, extent, max(side // 4, 1)) - side // 2
            bounds.append(np.stack([begin, begin + side], axis=1).clip(0, extent))
        return bounds[0], bounds[1]

    def through(self, ink: int) -> list[EchoBoxes]:
        """Return an ink's ghosts at all lags, in boxes of each of ``GHOST_BOXES_MM``.

        The list is empty for an ink without detail.
        """
        if not self.present[ink]:
            return []
        bands = [self.bands(box_mm) for box_mm in GHOST_BOXES_MM]
        rows, columns = (np.unique(np.concatenate([band[axis] for band in bands])) for axis in (0, 1))
        above = np.zeros((self.detail.shape[2], self.lags[-1]), np.float32)
        detail = np.concatenate([above, self.detail[ink].T], axis=1)
        count = self.lags.size
        parts = np.empty((rows.size - 1, columns.size - 1, 3 * count), np.float32)
        ghost_parts(self.own[ink], self.power[ink], self.edges[ink], detail, count, rows, columns, parts)
        result = []
        for down, right in bands:
            sums = np.empty((len(down), len(right), 3 * count), np.float32)
            cuts = np.searchsorted(rows, down), np.searchsorted(columns, right)
            boxed(parts, *cuts, sums)
            middles = down.mean(axis=1) * self.square_mm, right.mean(axis=1) * self.square_mm
            result.append(
                EchoBoxes(
                    sums=sums.reshape(*sums.shape[:2], 3, count), rows_mm=middles[0], columns_mm=middles[1]
                )
            )
        return result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EchoBoxes:
    """Ghosts of one ink in boxes of one size."""

    sums: NDArray[np.float32]
    """(rows, columns, 3, lags) N', D' and edges, from the greatest lag down."""
    rows_mm: NDArray[np.float64]
    """Distance of the boxes' middles from the first tile."""
    columns_mm: NDArray[np.float64]

    def t(self, scatter: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return T, (rows, columns, lags), from the least lag up; 0 where there is no information."""
        rows, columns, _, lags = self.sums.shape
        t = np.empty((rows * columns, lags), np.float32)
        how = (*(np.float32(one) for one in scatter), np.float32(LEAST_POWER))
        t_of_boxes(self.sums.reshape(-1, 3, lags), *how, t)
        return t.reshape(rows, columns, lags)[..., ::-1]


def ghosts(sums: Sums) -> Ghosts:
    """Prepare tile sums and ink areas for ``Ghosts.through``."""
    halves = [extent // 2 for extent in sums.tiles.shape[-2:]]
    maps = _in_squares(sums.tiles[:, : INKS + 1], halves)
    own, power, edges = without_common(maps, sums.prior.place)
    square_mm = 2 * sums.tile_mm
    wide = round(DETAIL_MM / square_mm) | 1
    cover = _in_squares(sums.cover, halves) / np.float32(4)
    detail = np.stack([one - cv2.blur(one, (wide, wide)) for one in cover])
    first, last = (round(lag / square_mm) for lag in LAGS_MM)
    return Ghosts(
        own=own[1:],
        power=power[1:],
        edges=edges[1:],
        detail=detail,
        present=detail.std(axis=(1, 2)) > LEAST_DETAIL,
        lags=np.arange(first, min(last, halves[0] - 1) + 1),
        square_mm=square_mm,
    )


def _in_squares(maps: NDArray[np.float32], halves: list[int]) -> NDArray[np.float32]:
    """Return sums over 2 x 2 tiles of maps (..., rows, columns)."""
    out = np.empty((*maps.shape[:-2], *halves), np.float32)
    for images, target in zip(maps, out, strict=True) if maps.ndim > 3 else [(maps, out)]:
        squares(images, target)
    return out
