"""Extent of a defect: the rectangle of the page in which one amount of one mode explains the residuals best.

A mode of amount a in a cell with push N and power D (``local_evidence``) explains a N - a^2 D / 2 of the residuals'
log-likelihood. A defect of one amount in a rectangle is most likely where the sum of this over its cells is greatest. A
cell counts for it if its own amount is above a / 2, in proportion to what it knows: gaps between the lines of a text
know nothing of ink that is missing, and end no rectangle.

The place of a streak is found to a fraction of a pixel. A column sees a line without width at the distance u from its
centre by the weight R(u) of its footprint. The page lies slightly turned, stretched and warped, and columns are summed
up by whole pixels (``line_sums``), so that a column of the sums sees the line at distances that differ from line to
line: its response is the mean of R over these. A streak of width w has the mean of this over w. Of all places the one
is taken whose response explains most of the columns' likelihood, (sum R N)^2 / (2 sum R^2 D). The width is the least of
which one pixel more explains less: in a thin printed line the light changes at the line's other edge too, since the
prediction has followed the line's changed centre, and a response as wide as both was measured to lie 0.2 mm from the
streak.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    BASELINE_MM,
    SEGMENTS,
    Sums,
    segment_lines,
)
from prooflight.kernels.residuals.moving import STRETCH

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.detectors.matched_filter.statistics.statistic import Box, Observed
    from prooflight.prediction.tables import SensorModel

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
