"""Extent of a defect: the rectangle of the page in which one amount of one mode explains the residuals best.

A mode of amount a in a cell with push N and power D (``local_evidence``) explains a N - a^2 D / 2 of the residuals'
log-likelihood. A defect of one amount in a rectangle is most likely where the sum of this over its cells is greatest. A
cell counts for it if its own amount is above a / 2, in proportion to what it knows: gaps between the lines of a text
know nothing of ink that is missing, and end no rectangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.statistics.local_evidence import BASELINE_MM, SEGMENTS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.detectors.matched_filter.statistics.statistic import Box, Observed

ADDED, GAINED = (tuple(f"{way}-{ink}" for ink in INK_LETTERS) for way in ("add", "gain"))
MODES_OF_EXTENT: Final = {
    "streak": ("light", "void", *ADDED, *GAINED),
    "spots-voids": ("light", "void"),
    "ghost-smear": ADDED,
    "scum": ADDED,
    "local-blur": ("blur",),
    "missing-content": ("void",),
    "missing-plane": GAINED,
}
"""Modes by which the places of a kind differ; kinds that are left out have no extent but that of their statistic."""
SIGN_OF_KIND: Final = {
    "ghost-smear": 1,
    "scum": 1,
    "local-blur": 1,
    "missing-content": 1,
    "missing-plane": -1,
}
"""Sign of a kind's amount, where it has only one."""
OF_THE_PAGE: Final = ("missing-plane",)
"""Kinds that may extend over the whole page."""
WIDER_MM: Final = (0.0, 5.0, 20.0)
"""Margins of places at which a rectangle begins: from within one line of a ghost's text no other would be reached."""
OF_LIGHT: Final = ("light", "void")
"""Modes that paper and lamp have as well."""
CLOUDS: Final = 3.0
"""Least amount of these modes in a defect. [standard deviations of good prints]"""
SLACK: Final = 0.01
"""Share of its evidence that either end of a rectangle may lack. assumed"""
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
    """Amount of the mode, by least squares over the rectangle. [-]"""
    likelihood: float
    """Logarithm of the likelihood ratio to a page without defect."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ColumnEvidence:
    """What the columns of a page say of a mode over the rows of a streak."""

    push: NDArray[np.float64]
    """(pixels,) N, less the level about each."""
    power: NDArray[np.float64]
    """(pixels,) D."""
    rows: slice
    """Segments of the page's height that the streak has."""
    columns: slice
    """Columns that it has."""


def column_evidence(streak: Extent, sums: Sums) -> ColumnEvidence:
    """Return what columns say of a streak, the whole width of the page."""
    grid = _columns(sums, streak.mode)
    rows, columns = sums.cells_of(streak.box, grid.push.shape, grid.cell_mm[::-1])
    push, power = grid.push[rows].sum(axis=0), grid.power[rows].sum(axis=0)
    return ColumnEvidence(push=push, power=power, rows=rows, columns=columns)


def extent_of(kind: str, seeds: Sequence[Box], sums: Sums, gains: NDArray[np.float64]) -> Extent | None:
    """Return the most likely extent of a defect; None: its kind has none, or it has no place.

    Parameters
    ----------
    kind : of the defect, which decides its modes.
    seeds : places at which to begin, that of the strongest statistic first. [mm]
    sums : of the scan.
    gains : (4, 3) ``Fit.gain``, which the residuals lack.

    A streak meets the first of its places: modes of ink see the clouds of the paper beside it, and such a rectangle
    of several millimetres was measured to be more likely than a narrow streak.
    """
    modes = [mode for mode in MODES_OF_EXTENT.get(kind, ()) if mode in sums.modes]
    grids = [_columns(sums, mode) if kind == "streak" else _tiles(sums, mode, gains) for mode in modes]
    places = [seed for seed in seeds if not math.isnan(seed[0])]
    if kind in OF_THE_PAGE:
        places.append((sums.left_mm, sums.top_mm, math.inf, math.inf))
    wider = [
        _wider(place, by_mm) for place in places for by_mm in WIDER_MM if not by_mm or kind != "spots-voids"
    ]
    extents = [grid.grown(seed) for grid in grids for seed in wider]
    sign = SIGN_OF_KIND.get(kind, 0)
    candidates = [one for one in extents if one is not None and one.amount * sign >= 0]
    if kind == "streak":
        candidates = [one for one in candidates if _meet(one.box, places[0])]
    return max(candidates, key=lambda one: one.likelihood, default=None)


def extended(
    kind: str,
    strongest: Sequence[tuple[str, Observed]],
    sums: Sums,
    gains: NDArray[np.float64],
    *,
    box_of: Callable[[Extent], Box] = lambda extent: extent.box,
) -> list[tuple[str, Observed]]:
    """Return families with their strongest statistics, each with the extent of the defect of a kind for its place.

    The first has that of the defect as a whole; the others follow the defect from their own place. box_of: returns the
    place of an extent, where that is known better than by its cells.
    """
    result = []
    for at, (cause, observed) in enumerate(strongest):
        seeds = [one.box for _, one in (strongest if at == 0 else [(cause, observed)])]
        extent = extent_of(kind, seeds, sums, gains) if at == 0 or not math.isnan(seeds[0][0]) else None
        result.append((cause, observed if extent is None else replace(observed, box=box_of(extent))))
    return result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Grid:
    mode: str
    push: NDArray[np.float64]
    """(rows, columns) N of the cells."""
    power: NDArray[np.float64]
    """(rows, columns) D."""
    sums: Sums
    cell_mm: tuple[float, float]
    """Width and height of a cell."""
    parts: bool = False
    """Whether a defect may end inside of a row, which are long then."""

    def grown(self, seed: Box) -> Extent | None:
        """Return the most likely rectangle that begins at a place; None: nothing is known there."""
        rows, columns = self.sums.cells_of(seed, self.push.shape, self.cell_mm[::-1])
        for _ in range(ROUNDS):
            power = self.power[rows, columns].sum()
            if power <= 0:
                return None
            amount = self.push[rows, columns].sum() / power
            before = rows, columns
            push, power = (one[:, columns].sum(axis=1) for one in (self.push, self.power))
            rows = _segment(amount * (push - amount / 2 * power), rows)
            push, power = (one[rows].sum(axis=0) for one in (self.push, self.power))
            columns = _segment(amount * (push - amount / 2 * power), columns)
            if (rows, columns) == before:
                break
        push, power = self.push[rows, columns].sum(), self.power[rows, columns].sum()
        amount = float(push / power) if power > 0 else 0.0
        least = CLOUDS * self.sums.prior.place if self.mode in OF_LIGHT else 0.0
        if abs(amount) <= least:
            return None
        top, bottom = self._ends(rows, columns, amount)
        left = self.sums.left_mm + columns.start * self.cell_mm[0]
        width, height = (columns.stop - columns.start) * self.cell_mm[0], bottom - top
        box = left, top, width, height
        return Extent(mode=self.mode, box=box, amount=amount, likelihood=float(push**2 / power / 2))

    def _ends(self, rows: slice, columns: slice, amount: float) -> tuple[float, float]:
        """Return top and bottom of a rectangle; long rows count by the share of the amount that they have."""
        begin, cell = self.sums.top_mm, self.cell_mm[1]
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


def _tiles(sums: Sums, mode: str, gains: NDArray[np.float64]) -> _Grid:
    push, power = sums.tiles[:2, sums.modes.index(mode)].astype(np.float64)
    if mode in GAINED:
        level, *tilts = gains[GAINED.index(mode)]
        across, along = (np.linspace(-1, 1, count) for count in push.shape[::-1])
        push += power * (level + tilts[0] * across + tilts[1] * along[:, None])
    return _Grid(
        mode=mode,
        push=push,
        power=power,
        sums=sums,
        cell_mm=(sums.tile_mm, sums.tile_mm),
    )


def _columns(sums: Sums, mode: str) -> _Grid:
    """Return columns by segments, less the level about each: streaks are narrow."""
    push, power = sums.columns[:2, sums.line_modes.index(mode)].astype(np.float64)
    wide = round(BASELINE_MM / sums.pixel_mm) | 1
    level, around = (ndimage.uniform_filter1d(one, wide, axis=1, mode="nearest") for one in (push, power))
    return _Grid(
        mode=mode,
        push=push - level / np.maximum(around, 1e-9) * power,
        power=power,
        sums=sums,
        cell_mm=(sums.pixel_mm, sums.tiles.shape[2] * sums.tile_mm / SEGMENTS),
        parts=True,
    )


def _wider(box: Box, by_mm: float) -> Box:
    x, y, width, height = box
    return x - by_mm, y - by_mm, width + 2 * by_mm, height + 2 * by_mm


def _meet(one: Box, other: Box) -> bool:
    """Return whether two boxes have a place across in common."""
    return one[0] < other[0] + other[2] and other[0] < one[0] + one[2]


def _segment(evidence: NDArray[np.float64], within: slice) -> slice:
    """Return the run of cells of greatest sum that holds the strongest cell of a slice."""
    peak = within.start + int(evidence[within].argmax())
    sums = np.concatenate([[0.0], np.cumsum(evidence)])
    low, high = sums[: peak + 1].min(), sums[peak + 1 :].max()
    # Of runs of almost the same sum the shortest: cells that know nothing change no sum.
    slack = SLACK * (high - low)
    first = np.flatnonzero(sums[: peak + 1] <= low + slack)[-1]
    return slice(int(first), peak + 1 + int(np.flatnonzero(sums[peak + 1 :] >= high - slack)[0]))
