"""A sheet with two sides at the gate: decided when its last side was seen, and as bad as its worse side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.plant.test_deciding import decider, letters, record
from packages.line.tests.plant.test_reprinting import listed

from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.plant.gate.gate import SheetSides
from prooflight_line.plant.gate.log import LoggedDecisions
from prooflight_line.plant.gate.reconciling import reconciled
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_line.plant.gate.deciding import SheetDecision

SHEETS = 6


def plan_of(order: str) -> SheetPlan:
    return SheetPlan(layout=Layout.parse(f"sides=2,order={order}"), sides=4, sheets=SHEETS)


def decided(plan: SheetPlan, words: Sequence[str]) -> list[SheetDecision]:
    """words: by position; `gone`: the side did not come."""
    together, own, found = SheetSides(plan), decider(), []
    for at, word in enumerate(words):
        gone = word == "gone"
        seen = record(at, "not-inspected" if gone else word, ("missing",) if gone else ())
        told = together.add(seen, came=not gone)
        assert (told is None) == (not together.is_due(at))
        if told is not None:
            found.append(own.decide(told.record, came=told.came))
    return found


@given(
    st.sampled_from(["alternate", "batch:2", "loop:3"]),
    st.lists(
        st.sampled_from(["good", "good", "misprint", "not-inspected", "gone"]),
        min_size=2 * SHEETS,
        max_size=2 * SHEETS,
    ),
)
def test_a_sheet_is_accepted_if_and_only_if_both_its_sides_are_good(order: str, words: list[str]) -> None:
    plan = plan_of(order)
    found = decided(plan, words)
    assert [one.job_page for one in found] == list(range(SHEETS))
    for sheet, one in enumerate(found):
        own = [words[at] for at in plan.positions(sheet)]
        assert one.tag == plan.positions(sheet)[1] + 1
        if own[1] == "gone":
            assert one.result is Result.NONE
        else:
            assert (one.result is Result.ACCEPT) == (own == ["good", "good"])
            assert (one.code is Code.MISPRINT) == ("misprint" in own)


def test_a_bad_front_diverts_its_sheet_and_no_other() -> None:
    words = ["good"] * 12
    words[4] = "misprint"
    found = decided(plan_of("alternate"), words)
    assert letters(found) == "aadaaa"
    assert (found[2].page, found[2].why) == ("s0001", "front: misprint")


def test_a_side_that_comes_again_or_late_diverts_its_sheet() -> None:
    together, own = SheetSides(plan_of("alternate")), decider()
    assert together.add(record(0, "good", page=0), came=True) is None
    assert together.add(record(1, "good", ("repeated",), page=0), came=True) is None
    told = together.add(record(2, "good", page=1), came=True)
    assert told is not None
    assert own.decide(told.record).code is Code.OUT_OF_PLACE
    assert told.rows == (0, 1, 2)


@pytest.mark.parametrize("word", ["misprint", "not-inspected"])
def test_a_side_that_nobody_can_place_is_never_accepted(word: str) -> None:
    together, own = SheetSides(plan_of("alternate")), decider()
    assert together.is_due(None)
    told = together.add(record(0, word, ("unknown",), page=None), came=True)
    assert told is not None
    assert own.decide(told.record).result is Result.DIVERT


def test_all_sides_are_accounted_for_by_their_sheets_and_printed_again_as_sheets() -> None:
    plan = plan_of("alternate")
    words = ["good", "good", "misprint", "good", "good", "good"]
    pages = [record(at, word) for at, word in enumerate(words)]
    kept = LoggedDecisions(began={"layout": plan.facts, "job_pages": 4})
    together, own = SheetSides(plan), decider()
    for page in pages:
        told = together.add(page, came=True)
        if told is not None:
            made = own.decide(told.record)
            kept.decisions[made.tag] = {
                "tag": made.tag, "result": int(made.result), "code": int(made.code), "came": True,
                "job_page": made.job_page, "page": made.page, "set": 0, "rows": told.rows,
            }  # fmt: skip
            kept.trays[made.tag] = {
                "session": 1,
                "tray": "good" if made.result is Result.ACCEPT else "reject",
            }
    found = reconciled(pages, kept, None)
    assert [(one.account, one.verdict, one.job_page) for one in found.sheets] == [
        ("accepted", "good", 0),
        ("diverted", "misprint", 1),
        ("accepted", "good", 2),
    ]
    (again,) = listed(pages, gate=(kept, found), sheets=2 * SHEETS).sheets[:1]
    assert (again.run_sheet, again.copy, again.number, again.pages) == (1, 1, 2, (3, 4))
    assert (again.page, again.behind, again.why) == ("s0002", "s0001", "the sheet is a misprint")
