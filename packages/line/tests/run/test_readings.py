from __future__ import annotations

from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight_line.run.sheets.readings import AHEAD_MOST, WRONG, Readings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_line.run.sheets.readings import Reading

NEAR = 8
SEEDS = st.integers(0, 2**32)
KNOWN_AHEAD = 16
"""Designs that are made ready ahead."""


@dataclass(frozen=True)
class Came:
    """One sheet: the page it shows, and in whose place it came."""

    shows: int | None
    place: int | None = None
    room: int = 0
    odd: bool = False
    """Whether something went wrong at it, or right before it."""


def in_order(*pages: int) -> list[Came]:
    return [Came(page, page) for page in pages]


@dataclass
class Run:
    """Readings of a run whose designs repeat every ``period`` pages, and are known so many pages ahead."""

    pages: int
    period: int = 10**6
    ahead: int = KNOWN_AHEAD
    readings: Readings = field(init=False)
    missing: list[int] = field(default_factory=list)
    seen: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.readings = Readings(pages=self.pages)
        self._make_ready()

    def _make_ready(self) -> None:
        due = self.readings.best.due
        self.seen |= set(range(due, min(due + self.ahead, self.pages)))

    def known(self, page: int) -> bool:
        return page in self.seen

    def showing(self, page: int) -> set[int]:
        """Known pages of its design that are thought of: near the places where the run may stand, or else the next."""
        due = self.readings.best.due
        like = [one for one in self.seen if one % self.period == page % self.period]
        near = {one for one in like if abs(one - due) <= NEAR}
        near |= set(like) & {one.due for one in self.readings.hypotheses}
        return near or set(sorted(like, key=lambda one: abs(one - due))[:1])

    def come(self, sheet: Came) -> Reading:
        pages = set() if sheet.shows is None else self.showing(sheet.shows)
        if pages:
            found = self.readings.of_page(pages, skipped=sheet.room, has_thumbnail=self.known)
        else:
            found = self.readings.of_stray("a stranger", has_thumbnail=self.known)
        self.missing += [page for page, _ in self.readings.go_on(found)]
        self._make_ready()
        return found[0]


def run_of(seed: int, *, pages: int = 60, apart: int = 0, furthest: int = 10**6) -> list[Came]:
    """Sheets of a run in which things go wrong; apart: least sheets in order behind each; furthest: wrong pages are at
    most so many pages off.
    """
    rng, sheets, page, quiet = Random(seed), list[Came](), 0, apart
    often = rng.choice([0.03, 0.1, 0.3, 0.6])
    while page < pages:
        kind = rng.choice(KINDS) if quiet >= apart and rng.random() < often else "fine"
        quiet = quiet + 1 if kind == "fine" else 0
        left = pages - page
        if kind == "wrong":
            others = range(max(page - furthest, 0), min(page + furthest + 1, pages))
            sheets.append(Came(rng.choice([other for other in others if other != page]), odd=True))
        elif kind in ("stranger", "insert"):
            sheets.append(Came(None, odd=True))
        elif kind == "double":
            sheets += [Came(page, page, odd=True), Came(page, odd=True)]
        elif kind == "swap" and left > 1:
            sheets += [Came(page + 1, page + 1, odd=True), Came(page, page, odd=True)]
            page += 1
        elif kind in ("missing", "gap") and left > 3:
            lost = rng.randint(1, 3)
            page += lost
            sheets.append(Came(page, page, room=lost if kind == "gap" else 0, odd=True))
        else:
            sheets.append(Came(page, page))
        page += kind != "insert"
    return sheets


KINDS = ["wrong", "stranger", "insert", "double", "swap", "missing", "gap"]


@given(seed=SEEDS)
def test_whatever_comes_each_page_in_its_place_is_known_and_one_sheet_in_order_is_enough(seed: int) -> None:
    """Pages all different, looks known 16 pages ahead alone: nothing of what came before is assumed."""
    run = Run(60)
    for sheet in run_of(seed):
        read = run.come(sheet)
        if sheet.place is not None:
            assert read.page == sheet.place
        if sheet.place is not None and not sheet.odd:
            assert run.readings.best.due == sheet.place + 1


@given(seed=SEEDS)
def test_pages_that_did_not_come_are_missing_in_the_end_and_no_others(seed: int) -> None:
    run, sheets = Run(60), run_of(seed, apart=3)
    for sheet in sheets:
        run.come(sheet)
    run.missing += [page for page, _ in run.readings.ended()]
    came = {sheet.place for sheet in sheets if sheet.place is not None}
    wrong = {sheet.shows for sheet in sheets if sheet.place is None}  # they came, if not in their place
    absent = set(range(60)) - came - wrong
    told = run.readings.missing | set(range(run.readings.best.due, 60))
    last = max(came, default=0)  # of what is wrong at the very end nobody can tell what it was
    assert {page for page in told if page < last} - wrong == {page for page in absent if page < last}
    assert {page for page in absent if page < last} <= set(run.missing)


@given(seed=SEEDS)
def test_designs_that_repeat_are_followed_all_the_same(seed: int) -> None:
    run = Run(60, period=10, ahead=60)
    for sheet in run_of(seed, apart=4, furthest=4):
        read = run.come(sheet)
        if sheet.place is not None:
            assert read.page == sheet.place


def dues(sheets: Sequence[Came], *, pages: int = 40, ahead: int = KNOWN_AHEAD) -> list[int]:
    """The page due behind each sheet."""
    run = Run(pages, ahead=ahead)
    found = []
    for sheet in sheets:
        run.come(sheet)
        found.append(run.readings.best.due)
    return found


def test_a_jump_is_believed_when_the_next_sheet_bears_it_out() -> None:
    assert dues([*in_order(0, 1), *in_order(10, 11, 12)]) == [1, 2, 3, 12, 13]
    assert dues([*in_order(0, 1), Came(10), *in_order(3, 4)]) == [1, 2, 3, 4, 5]
    assert AHEAD_MOST < 2 * WRONG  # the furthest jump is borne out by one sheet, against two that are wrong


def test_pages_that_may_come_are_those_due_by_every_likely_reading() -> None:
    run = Run(40)
    for sheet in in_order(0, 1):
        run.come(sheet)
    assert run.readings.likely_due() == (2,)
    run.come(Came(5))
    assert set(run.readings.likely_due()) == {2, 3, 6}
    assert run.readings.likely_due()[0] == 3
    for sheet in in_order(3, 4):
        run.come(sheet)
    assert run.readings.likely_due() == (5,)


def test_strange_sheets_between_decide_nothing() -> None:
    away = [*in_order(0, 1), Came(10), Came(None), Came(None)]
    assert dues([*away, *in_order(13, 14)])[-2:] == [14, 15]
    assert dues([*away, *in_order(5, 6)])[-2:] == [6, 7]


def test_two_wrong_pages_that_follow_each_other_mislead_no_longer_than_they_last() -> None:
    found = dues([*in_order(0, 1), Came(10), Came(11), *in_order(4, 5, 6)])
    assert found[-2:] == [6, 7]


@pytest.mark.parametrize(("sheets", "missing"), [([0, 1, 2, 4], {3}), ([0, 1, 2, 3, 4], set())])
def test_a_run_that_ends_behind_its_last_page_is_complete_but_for_what_was_passed(
    sheets: list[int], missing: set[int]
) -> None:
    run = Run(5)
    for sheet in in_order(*sheets):
        run.come(sheet)
    run.readings.ended()
    assert (run.readings.best.due, run.readings.missing) == (5, missing)


def test_a_wrong_page_at_the_very_end_leaves_nothing_to_come() -> None:
    run = Run(5)
    for sheet in [*in_order(0, 1, 2, 3), Came(1)]:
        run.come(sheet)
    assert run.readings.ended() == [(4, "a sheet that shows page 2 came instead of the page")]
    assert run.readings.best.due == 5


def test_a_job_whose_designs_lag_is_found_again_when_they_are_ready() -> None:
    """Looks of pages 2 to 6 were never known; page 7 comes where 5 is thought to be due."""
    run = Run(20, ahead=0)
    run.seen = {0, 1, *range(7, 20)}
    for sheet in [*in_order(0, 1), Came(None), Came(None), Came(None)]:
        run.come(sheet)
    assert [run.come(sheet).page for sheet in in_order(7, 8, 9)][2:] == [9]
    assert run.readings.best.due == 10
