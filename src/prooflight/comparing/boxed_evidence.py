"""Tile sums added up to boxes of every size, and what is most and least among these; echoes of a page's own detail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.comparing.local_evidence import (
    COMMON,
    LEAST_POWER,
    MODES,
    SIZES,
    flicker,
    smooth_level,
    without_common,
)
from prooflight.comparing.summing.box_kernels import box_statistics, merged
from prooflight.comparing.summing.echo_kernels import echo_boxes, greatest_echo

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.comparing.local_evidence import Sums

SMALL: Final = 4
COMMON_NEAR: Final = 0.001
"""As ``COMMON``, within a few millimetres."""
QUANTILES_OF: Final = 4096
"""Places, at least half of them, that stand for all of a page."""
LAGS_MM: Final = (3.0, 60.0)
DETAIL_MM: Final = 15.0
LEAST_DETAIL: Final = 1e-3
INKS: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Sums of squares of tiles; boxes are 2 x 2 of them and overlap by half."""

    sums: NDArray[np.float32]
    """(4, at least MODES, rows, columns): N, D, C, the edges' part of D."""
    size: int
    """Side of a box. [tiles]"""
    gains: NDArray[np.float32]
    """(rows,) share of C that is the lamp's flicker, to be taken from N."""
    level: NDArray[np.float32]
    """(rows, columns) share of a box's C that is smooth change of light, to be taken from its N."""
    common: float
    """Standard deviation of what else moves all light in a box alike."""

    def box_mm(self, sums: Sums, row: int, column: int) -> tuple[float, float, float, float]:
        """x, y, width, height of the box that begins at a cell."""
        side = self.size * sums.tile_mm
        return column * side / 2 + sums.left_mm, row * side / 2 + sums.top_mm, side, side


def cells_of(sums: Sums) -> Iterator[Cells]:
    """Cells for boxes of all ``SIZES`` in turn."""
    own, gains, level = sums.tiles, flicker(sums), smooth_level(sums)
    for size in SIZES:
        if size > SIZES[0]:
            extents = [-(-extent // 2) for extent in own.shape[-2:]]
            larger = np.empty((4, len(MODES), *extents), np.float32)
            merged(own, gains, larger)
            own, gains = larger, np.zeros(extents[0], np.float32)
            middle = [
                np.minimum(2 * np.arange(n) + 1, m - 1) for n, m in zip(extents, level.shape, strict=True)
            ]
            level = level[np.ix_(*middle)]
        near = size <= SMALL
        yield Cells(
            sums=own,
            size=size,
            gains=gains,
            level=level if near else np.zeros_like(level),
            common=COMMON_NEAR if near else COMMON,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Extremes:
    """T of one mode at all boxes of one size."""

    greatest: float
    at_greatest: tuple[int, int]
    """Row and column."""
    least: float
    at_least: tuple[int, int]
    energy: float
    """Mean of T^2, each at most 100, over places with information; NaN: there are none."""
    informed: int
    """Places with information."""
    drawn: NDArray[np.float32]
    """T at places with information: all, or some spread evenly, from half of ``QUANTILES_OF`` up to that."""


def extremes(cells: Cells, scatter: NDArray[np.float64]) -> list[Extremes]:
    """T of every mode; scatter (modes, 3)."""
    modes = len(scatter)
    values, places = np.empty((modes, 3), np.float32), np.empty((modes, 5), np.int64)
    counters, drawn = np.empty((modes, 3), np.int64), np.empty((modes, QUANTILES_OF), np.float32)
    box_statistics(
        cells.sums,
        cells.gains,
        cells.level,
        np.float32(1 / cells.common**2),
        scatter.astype(np.float32),
        np.float32(LEAST_POWER),
        values,
        places,
        counters,
        drawn,
    )
    return [
        Extremes(
            greatest=float(high),
            at_greatest=(int(at[0]), int(at[1])),
            least=float(low),
            at_least=(int(at[2]), int(at[3])),
            energy=float(squares) / int(at[4]) if at[4] else np.nan,
            informed=int(at[4]),
            drawn=drawn[mode, : counters[mode, 0]],
        )
        for mode, ((high, low, squares), at) in enumerate(zip(values, places, strict=True))
    ]


def boxes(cells: Cells) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """N', D' and the edges' part of D' at all boxes, (modes, rows, columns) each: what ``extremes`` looks through."""
    maps = cells.sums[:, : len(MODES)].copy()
    maps[0] -= maps[2] * cells.gains[:, None]
    down = np.pad(maps, [(0, 0)] * 2 + [(0, 1)] * 2)
    maps = down[..., :-1, :-1] + down[..., 1:, :-1] + down[..., :-1, 1:] + down[..., 1:, 1:]
    maps[0] -= maps[2] * cells.level
    return without_common(maps, cells.common)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Echoes:
    """What is needed to look for echoes of each ink's detail, on squares of 2 x 2 tiles."""

    own: NDArray[np.float32]
    """(inks, h, w) N' of each ink added."""
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
        """Where boxes (height, width) that overlap by three quarters begin and end: rows (n, 2), columns (m, 2)."""
        found = []
        for extent_mm, extent in zip(box_mm, self.own.shape[1:], strict=True):
            side = max(round(extent_mm / self.square_mm), 1)
            begin = np.arange(0, extent, max(side // 4, 1)) - side // 2
            found.append(np.stack([begin, begin + side], axis=1).clip(0, extent))
        return found[0], found[1]

    def greatest(
        self, ink: int, box_mm: tuple[float, float], scatter: NDArray[np.float64]
    ) -> tuple[float, tuple[float, float] | None]:
        """The greatest T over all lags, and the middle of its box (x, y) from the first tile [mm]; None: nothing."""
        if not self.present[ink]:
            return 0.0, None
        rows, columns = self.bands(box_mm)
        how = (*(np.float32(one) for one in scatter), np.float32(LEAST_POWER))
        best, row, column = greatest_echo(
            self.own[ink], self.power[ink], self.edges[ink], self.detail[ink], self.lags, rows, columns, *how
        )
        if row < 0:
            return 0.0, None
        x, y = columns[column].mean() * self.square_mm, rows[row].mean() * self.square_mm
        return float(best), (float(x), float(y))

    def boxes(self, ink: int, lag: int, box_mm: tuple[float, float]) -> NDArray[np.float32]:
        """N', D', edges of an echo ``lag`` squares down: (3, rows, columns)."""
        rows, columns = self.bands(box_mm)
        height, width = self.own.shape[1:]
        out = np.empty((3, len(rows), len(columns)), np.float32)
        running = np.empty((3, height + 1, width), np.float32)
        echo_boxes(
            self.own[ink],
            self.power[ink],
            self.edges[ink],
            self.detail[ink],
            lag,
            rows,
            columns,
            running,
            out,
        )
        return out


def echoes(sums: Sums) -> Echoes:
    """Tile sums and ink areas made ready for ``Echoes.greatest``."""
    halves = [extent // 2 for extent in sums.tiles.shape[-2:]]
    maps = _in_squares(sums.tiles[:, : INKS + 1], halves)
    own, power, edges = without_common(maps)
    square_mm = 2 * sums.tile_mm
    wide = round(DETAIL_MM / square_mm) | 1
    cover = _in_squares(sums.cover, halves) / np.float32(4)
    detail = np.stack([one - cv2.blur(one, (wide, wide)) for one in cover])
    first, last = (round(lag / square_mm) for lag in LAGS_MM)
    return Echoes(
        own=own[1:],
        power=power[1:],
        edges=edges[1:],
        detail=detail,
        present=detail.std(axis=(1, 2)) > LEAST_DETAIL,
        lags=np.arange(first, min(last, halves[0] - 1) + 1),
        square_mm=square_mm,
    )


def _in_squares(maps: NDArray[np.float32], halves: list[int]) -> NDArray[np.float32]:
    """Sums of 2 x 2."""
    rows, columns = halves
    cut = maps[..., : 2 * rows, : 2 * columns]
    down = cut[..., ::2, :] + cut[..., 1::2, :]
    return np.ascontiguousarray(down[..., ::2] + down[..., 1::2])
