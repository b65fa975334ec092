"""Sides to sheets to sets: the worst counts, and a misprint is of the page on which it lies."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.disposition import Disposition, without_gate
from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.sheets import (
    NEVER,
    Assembling,
    SetVerdict,
    SheetVerdict,
    assembled,
    page_verdicts,
    side_verdict,
    to_review,
)
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from collections.abc import Sequence

WORDS = ("good", "misprint", "not-inspected")
GONE = "gone"
PAGE_MM = (100.0, 140.0)


def plan_of(words: str, *, pages: int, copies: int = 1) -> SheetPlan:
    layout = Layout.parse(words)
    sides = layout.sides_of(pages)
    return SheetPlan(layout=layout, sides=sides, sheets=copies * sides // layout.sides, page_mm=PAGE_MM)


def region(x: float, y: float) -> Region:
    return Region(x_mm=x, y_mm=y, width_mm=5, height_mm=5, score=9.0, kind="spot")


@dataclass(frozen=True, kw_only=True)
class Side:
    """A side as it is recorded, without a gate; ``SideRow``."""

    sheet: int
    job_page: int | None
    verdict: Verdict
    faults: tuple[str, ...] = ()

    @property
    def disposition(self) -> Disposition:
        return without_gate(self.verdict, self.faults)[0]


def record(at: int, word: str, plan: SheetPlan, *, row: int | None = None, **more: Any) -> Side:
    name = plan.layout.side_name(plan.number_at(at))
    if word == GONE:
        verdict, faults = Verdict.skipped(name, "no sheet of it came"), ("missing",)
    elif word == "not-inspected":
        verdict, faults = Verdict.skipped(name, "there was no time"), ()
    else:
        verdict = Verdict(page=name, verdict=word, detector="matched_filter", kind="spot")  # type: ignore[arg-type]
        verdict, faults = replace(verdict, regions=more.pop("regions", ())), more.pop("faults", ())
    return Side(sheet=at if row is None else row, job_page=at, verdict=verdict, faults=faults)


def of_run(plan: SheetPlan, words: Sequence[str]) -> tuple[list[SheetVerdict], list[SetVerdict]]:
    found = list(assembled(plan, [record(at, word, plan) for at, word in enumerate(words)]))
    sheets = [one for one in found if isinstance(one, SheetVerdict)]
    return sheets, [one for one in found if isinstance(one, SetVerdict)]


@pytest.mark.parametrize(
    ("front", "back", "sheet", "why"),
    [
        ("good", "good", "good", ()),
        ("good", "misprint", "misprint", ("back: spot",)),
        ("misprint", "not-inspected", "misprint", ("front: spot", "back: there was no time")),
        ("not-inspected", "good", "not-inspected", ("front: there was no time",)),
        ("good", GONE, "not-inspected", (f"back: {NEVER}",)),
        (GONE, "misprint", "misprint", (f"front: {NEVER}", "back: spot")),
    ],
)
def test_a_sheet_is_as_bad_as_its_worse_side(front: str, back: str, sheet: str, why: tuple[str, ...]) -> None:
    (found,), _ = of_run(plan_of("sides=2", pages=2), [front, back])
    assert (found.verdict, found.why) == (sheet, why)
    assert [side.side for side in found.sides] == ["front", "back"]


orders = st.sampled_from(["alternate", "batch:2", "loop:3"])


@given(orders, st.lists(st.sampled_from([*WORDS, GONE]), min_size=24, max_size=24))
def test_no_verdict_is_better_than_any_part_of_it(order: str, words: list[str]) -> None:
    plan = plan_of(f"sides=2,order={order},n-up=2x1,pages-a-set=8", pages=16, copies=3)
    sheets, sets = of_run(plan, words)
    assert len(sheets) == 12
    assert len(sets) == 6
    for sheet in sheets:
        own = [words[at] for at in plan.positions(sheet.sheet)]
        bad = "misprint" in own
        assert sheet.verdict == ("misprint" if bad else "good" if set(own) == {"good"} else "not-inspected")
        assert sheet.missing == (set(own) == {GONE})
        assert sorted({page.page for side in sheet.sides for page in side.pages}) == list(
            plan.pages(sheet.sheet)
        )
    for one in sets:
        within = [sheets[at] for at in plan.sheets_of(one.set_number)]
        assert one.clean == all(sheet.clean for sheet in within)
        assert one.bad == tuple(sheet.sheet for sheet in within if sheet.verdict == "misprint")
        assert one.missing == tuple(sheet.sheet for sheet in within if sheet.missing)


@given(
    orders,
    st.lists(st.sampled_from([*WORDS, GONE, *["good"] * 6]), max_size=24),
    st.booleans(),
    st.integers(1, 30),
)
def test_rows_to_look_at_say_the_same_as_all_rows(
    order: str, words: list[str], sets: bool, patience: int
) -> None:
    """Whoever reads only what is not good comes to the same sheets, sets and counts, wherever the run ended."""
    plan = plan_of(f"sides=2,order={order}" + (",pages-a-set=4" if sets else ""), pages=8, copies=3)
    rows = [record(at, word, plan) for at, word in enumerate(words)]
    streamed = Assembling(plan, patience=patience)
    all_of_it = [one for row in rows for one in streamed.add(row)] + streamed.end()
    few = to_review(
        plan, [row for row in rows if row.verdict.verdict != "good"], passed=len(rows), ended=True
    )
    assert few.counts == streamed.counts
    assert [(one.sheet, one.verdict, one.why) for one in few.sheets] == [
        (one.sheet, one.verdict, one.why)
        for one in all_of_it
        if isinstance(one, SheetVerdict) and not one.clean
    ]
    assert list(few.sets) == [one for one in all_of_it if isinstance(one, SetVerdict) and not one.clean]


def test_a_run_that_goes_on_lacks_nothing_yet() -> None:
    plan = plan_of("sides=2,order=batch:2,pages-a-set=4", pages=8)
    found = to_review(plan, [record(0, "misprint", plan)], passed=3, ended=False)
    assert [one.sheet for one in found.sheets] == [0]
    assert found.sets == ()
    assert sum(found.counts.sheets.values()) == 1
    ended = to_review(plan, [record(0, "misprint", plan)], passed=3, ended=True)
    assert [(one.sheet, one.verdict) for one in ended.sheets] == [(0, "misprint"), (1, "not-inspected")]
    assert [one.complete for one in ended.sets] == [True]


def test_a_misprint_is_of_the_page_on_which_it_lies() -> None:
    plan = plan_of("sides=2,n-up=2x1,backs=turned,gutter=4", pages=4)
    right = record(1, "misprint", plan, regions=(region(150, 20),))
    side = side_verdict(plan, 0, 1, [right])
    # The back is turned: what lies right of the middle is the page laid at the left.
    assert [(one.page, one.verdict) for one in side.pages] == [(3, "misprint"), (4, "good")]
    front = side_verdict(plan, 0, 0, [record(0, "misprint", plan, regions=(region(150, 20),))])
    assert [(one.page, one.verdict) for one in front.pages] == [(1, "good"), (2, "misprint")]


@pytest.mark.parametrize("regions", [(), (region(101, 20),)], ids=["nowhere", "in the gutter"])
def test_where_no_place_is_known_every_page_of_the_side_is_one(regions: tuple[Region, ...]) -> None:
    plan = plan_of("n-up=2x1,gutter=8", pages=2)
    bad = record(0, "misprint", plan, regions=regions)
    found = page_verdicts(bad.verdict, (1, 2), plan.places(back=False))
    assert [one.verdict for one in found] == ["misprint", "misprint"]


def test_step_and_repeat_says_at_which_place() -> None:
    plan = plan_of("n-up=2x2,repeat=yes", pages=3)
    side = side_verdict(plan, 1, 0, [record(1, "misprint", plan, regions=(region(20, 200),))])
    assert [(one.page, one.place, one.verdict) for one in side.pages] == [
        (2, 1, "good"),
        (2, 2, "good"),
        (2, 3, "misprint"),
        (2, 4, "good"),
    ]


def test_sides_turned_to_fit_the_press_have_their_places_turned() -> None:
    plan = replace(plan_of("n-up=2x1", pages=2), laid_turned=True)
    assert [(place.x, place.y, place.width, place.height) for place in plan.places(back=False)] == [
        (0, 0, 140, 100),
        (0, 100, 140, 100),
    ]


def test_a_sheet_that_comes_again_or_late_leaves_its_set_incomplete() -> None:
    plan = plan_of("sides=2,pages-a-set=4", pages=8)
    rows = [record(at, "good", plan) for at in (0, 1)]
    rows += [record(1, "good", plan, row=2, faults=("repeated",)), record(3, "good", plan, row=3)]
    rows += [record(2, "good", plan, row=4, faults=("out-of-order",))]
    rows += [record(at, "good", plan, row=at + 1) for at in (4, 5, 6, 7)]
    found = list(assembled(plan, rows))
    sets = [one for one in found if isinstance(one, SetVerdict)]
    assert [(one.doubled, one.out_of_order, one.complete) for one in sets] == [
        ((0,), (1,), False),
        ((), (), True),
    ]
    assert Counter(one.verdict for one in sets) == {"good": 2}
    assert found[0].why == ("the back was captured twice",)  # type: ignore[union-attr]


def test_a_side_that_nobody_can_place_belongs_to_no_sheet() -> None:
    plan = plan_of("sides=2", pages=2)
    stranger = replace(record(0, "misprint", plan), job_page=None)
    assert list(assembled(plan, [stranger])) == []
