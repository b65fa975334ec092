"""Misprints over many runs, grouped by kind, ink and place, by number of sheets or by cost."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.detectors.cost import RunningCosts
    from prooflight_console.quality.index import SearchIndex
    from prooflight_console.quality.searching import SheetSearch

CELL_MM: Final = 50.0
"""Side of the squares of the page by which places are grouped. Assumed: a few sentences name them on an A3 sheet."""
MOST_CELLS: Final = 16
"""Largest number of squares along a side; longer pages have larger ones."""
MOST_GROUPS: Final = 12
CROSS: Final = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Misprints that have something in common."""

    name: str
    """Kind, letter of the ink, or empty for a place."""
    sheets: int
    cents: float
    """Cost of those whose press is known here. [cent]"""
    conditions: Mapping[str, str]
    """Fields of the search that selects exactly these sheets, among the misprints of the same runs and time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misprints:
    """Misprints of many runs."""

    sheets: int
    unpriced: int
    """Number of those whose press is not known here, so that they have no cost."""
    cents: float
    kinds: tuple[Group, ...]
    inks: tuple[Group, ...]
    """Groups by ink; a sheet with defects of several inks is in each of theirs."""
    places: tuple[Group, ...]
    """Groups by square of the page; a sheet is in each square into which a defect reaches."""


def misprints(
    index: SearchIndex, search: SheetSearch, costs: Mapping[str, RunningCosts], *, by_cost: bool = False
) -> Misprints:
    """Return the misprints that a search selects, in groups, the greatest first.

    A misprint that was accepted costs what the press file states for one that passes; any other costs a stop, as a
    false alarm does (``[costs]``). costs: by the digest of the press.
    """
    condition, values = search.condition(index)
    condition = f"{condition} AND s.verdict = 'misprint'"
    rows = index.query(
        "SELECT s.run_id, s.sheet, coalesce(s.kind, 'unknown'), s.accepted, r.digest FROM sheets s"
        f" JOIN runs r ON r.id = s.run_id WHERE {condition}",
        values,
    )
    cents = np.array([_cents(costs.get(digest), accepted) for *_, accepted, digest in rows], float)
    place = {(run_id, sheet): at for at, (run_id, sheet, *_) in enumerate(rows)}
    defects = index.query(
        "SELECT d.run_id, d.sheet, d.ink, d.x_mm, d.y_mm, d.width_mm, d.height_mm FROM defects d"
        f" WHERE (d.run_id, d.sheet) IN (SELECT s.run_id, s.sheet FROM sheets s WHERE {condition})",
        values,
    )
    of_kind: dict[str, set[int]] = defaultdict(set)
    for at, (_, _, kind, *_) in enumerate(rows):
        of_kind[kind].add(at)
    of_ink: dict[str, set[int]] = defaultdict(set)
    for run_id, sheet, ink, *_ in defects:
        of_ink[ink or CROSS].add(place[run_id, sheet])

    def grouped(groups: Mapping[Any, set[int]], field: str) -> tuple[Group, ...]:
        return _sorted(
            [_group(key, members, cents, {field: key}) for key, members in groups.items()], by_cost
        )

    unpriced = int(np.isnan(cents).sum())
    return Misprints(
        sheets=len(rows),
        unpriced=unpriced,
        cents=float(np.nansum(cents)),
        kinds=grouped(of_kind, "kind"),
        inks=grouped(of_ink, "ink"),
        places=_sorted(_places(defects, place, cents), by_cost),
    )


def _places(
    defects: list[tuple[Any, ...]], place: Mapping[tuple[int, int], int], cents: np.ndarray
) -> list[Group]:
    """Return the groups of all squares into which a defect reaches, edges included, as a search selects them."""
    if not defects:
        return []
    sheet = np.array([place[run_id, number] for run_id, number, *_ in defects])
    x, y, width, height = np.array([row[3:] for row in defects], float).T
    greatest = max(float((x + width).max()), float((y + height).max()), CELL_MM)
    cell = CELL_MM * math.ceil(greatest / (CELL_MM * MOST_CELLS))
    groups = []
    for column in range(math.ceil(greatest / cell)):
        across = (x <= (column + 1) * cell) & (x + width >= column * cell)
        if not across.any():
            continue
        for row in range(math.ceil(greatest / cell)):
            inside = across & (y <= (row + 1) * cell) & (y + height >= row * cell)
            if inside.any():
                numbers = (column * cell, row * cell, cell, cell)
                fields = {n: f"{v:g}" for n, v in zip(("x", "y", "width", "height"), numbers, strict=True)}
                groups.append(_group("", set(np.unique(sheet[inside]).tolist()), cents, fields))
    return groups


def _group(name: str, members: set[int], cents: np.ndarray, conditions: Mapping[str, str]) -> Group:
    total = float(np.nansum(cents[sorted(members)]))
    return Group(name=name, sheets=len(members), cents=total, conditions=conditions)


def _sorted(groups: list[Group], by_cost: bool) -> tuple[Group, ...]:
    groups.sort(key=lambda one: (one.cents if by_cost else one.sheets, one.sheets), reverse=True)
    return tuple(groups[:MOST_GROUPS])


def _cents(costs: RunningCosts | None, accepted: int) -> float:
    if costs is None:
        return math.nan
    return costs.missed_misprint_cents if accepted else costs.false_alarm_cents
