"""Extent of a defect: the rectangle of the page in which one amount of one mode explains the residuals best.

A mode of amount a in a cell with push N and power D (``local_evidence``) explains a N - a^2 D / 2 of the residuals'
log-likelihood. A defect of one amount in a rectangle is most likely where the sum of this over its cells is greatest. A
cell counts for it if its own amount is above a / 2, in proportion to what it knows: gaps between the lines of a text
know nothing of ink that is missing, and end no rectangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.detectors.matched_filter.statistics.local_evidence import BASELINE_MM, SEGMENTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.detectors.matched_filter.statistics.statistic import Box

ADDED: Final = ("add-C", "add-M", "add-Y", "add-K")
GAINED: Final = ("gain-C", "gain-M", "gain-Y", "gain-K")
MODES_OF_KIND: Final = {
    "streak": ("light", "void", *ADDED, *GAINED),
    "spots-voids": ("light", "void", *ADDED),
    "ghost-smear": ADDED,
    "scum": ADDED,
    "local-blur": ("blur",),
    "missing-content": ("void",),
    "missing-plane": GAINED,
}
"""Modes by which the places of a kind differ; kinds that are left out have no extent but that of their statistic."""
ROUNDS: Final = 12
"""Greatest number of times that rows, columns and amount are found from each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Rectangle of greatest likelihood."""

    mode: str
    """One of ``local_evidence.MODES``."""
    box: Box
    """x, y, width, height; on the scan, as the boxes of statistics. [mm]"""
    amount: float
    """Of the mode, by least squares over the rectangle. [-]"""
    likelihood: float
    """Logarithm of the likelihood ratio to a page without defect."""


def extent_of(kind: str, seeds: Sequence[Box], sums: Sums) -> Extent | None:
    """Return the most likely extent of a defect; None: its kind has none, or it has no place.

    seeds: places at which to begin; the modes are those of the kind.
    """
    modes = [mode for mode in MODES_OF_KIND.get(kind, ()) if mode in sums.modes]
    grids = [_columns(sums, mode) if kind == "streak" else _tiles(sums, mode) for mode in modes]
    found = [grid.grown(seed) for grid in grids for seed in seeds if not math.isnan(seed[0])]
    return max(filter(None, found), key=lambda one: one.likelihood, default=None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Grid:
    mode: str
    push: NDArray[np.float64]
    """(rows, columns) N of the cells."""
    power: NDArray[np.float64]
    """(rows, columns) D."""
    corner_mm: tuple[float, float]
    """x and y of the first cell."""
    cell_mm: tuple[float, float]
    """Width and height of a cell."""
    parts: bool = False
    """Whether a defect may end inside of a row, which are long then."""

    def grown(self, seed: Box) -> Extent | None:
        """Return the most likely rectangle that begins at a place; None: nothing is known there."""
        columns, rows = (
            _cells(seed[axis], seed[axis + 2], self.corner_mm[axis], self.cell_mm[axis], count)
            for axis, count in enumerate(self.push.shape[::-1])
        )
        for _ in range(ROUNDS):
            power = self.power[rows, columns].sum()
            if power <= 0:
                return None
            amount = self.push[rows, columns].sum() / power
            evidence = amount * (self.push - amount / 2 * self.power)
            before = rows, columns
            rows = _segment(evidence[:, columns].sum(axis=1), rows)
            columns = _segment(evidence[rows].sum(axis=0), columns)
            if (rows, columns) == before:
                break
        push, power = self.push[rows, columns].sum(), self.power[rows, columns].sum()
        if power <= 0:
            return None
        amount = float(push / power)
        top, bottom = self._ends(rows, columns, amount)
        left = self.corner_mm[0] + columns.start * self.cell_mm[0]
        box = left, top, (columns.stop - columns.start) * self.cell_mm[0], bottom - top
        return Extent(mode=self.mode, box=box, amount=amount, likelihood=float(push**2 / power / 2))

    def _ends(self, rows: slice, columns: slice, amount: float) -> tuple[float, float]:
        """Return top and bottom of a rectangle; long rows count by the share of the amount that they have."""
        begin, cell = self.corner_mm[1], self.cell_mm[1]
        top, bottom = begin + rows.start * cell, begin + rows.stop * cell
        if self.parts:
            power = self.power[:, columns].sum(axis=1)
            share = np.clip(self.push[:, columns].sum(axis=1) / np.maximum(power, 1e-9) / amount, 0, 1)
            before, after = share[max(rows.start - 1, 0)], share[min(rows.stop, len(share) - 1)]
            if rows.start > 0:
                top += cell * (1 - share[rows.start] - before)
            if rows.stop < len(share):
                bottom -= cell * (1 - share[rows.stop - 1] - after)
        return top, bottom


def _tiles(sums: Sums, mode: str) -> _Grid:
    push, power = sums.tiles[:2, sums.modes.index(mode)].astype(np.float64)
    corner_mm, cell_mm = (sums.left_mm, sums.top_mm), (sums.tile_mm, sums.tile_mm)
    return _Grid(mode=mode, push=push, power=power, corner_mm=corner_mm, cell_mm=cell_mm)


def _columns(sums: Sums, mode: str) -> _Grid:
    """Return columns by segments, less the level about each: streaks are narrow."""
    push, power = sums.columns[:2, sums.line_modes.index(mode)].astype(np.float64)
    wide = round(BASELINE_MM / sums.pixel_mm) | 1
    level, known = (ndimage.uniform_filter1d(one, wide, axis=1, mode="nearest") for one in (push, power))
    push = push - level / np.maximum(known, 1e-9) * power
    corner_mm, height_mm = (sums.left_mm, sums.top_mm), sums.tiles.shape[2] * sums.tile_mm
    cell_mm = sums.pixel_mm, height_mm / SEGMENTS
    return _Grid(mode=mode, push=push, power=power, corner_mm=corner_mm, cell_mm=cell_mm, parts=True)


def _segment(evidence: NDArray[np.float64], within: slice) -> slice:
    """Return the run of cells of greatest sum that holds the strongest cell of a slice."""
    peak = within.start + int(evidence[within].argmax())
    sums = np.concatenate([[0.0], np.cumsum(evidence)])
    return slice(int(sums[: peak + 1].argmin()), peak + 1 + int(sums[peak + 1 :].argmax()))


def _cells(begin_mm: float, extent_mm: float, first_mm: float, pitch_mm: float, count: int) -> slice:
    """Return the cells of a grid whose middles are in an interval, at least one."""
    first = math.ceil((begin_mm - first_mm) / pitch_mm - 0.5)
    last = math.ceil((min(begin_mm + extent_mm, first_mm + count * pitch_mm) - first_mm) / pitch_mm - 0.5)
    first = min(max(first, 0), count - 1)
    return slice(first, max(last, first + 1))
