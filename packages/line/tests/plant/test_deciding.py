"""What becomes of each sheet, and what must be printed again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.verdict import Verdict
from prooflight.press.gate import GateSettings, PlcSettings
from prooflight_line.journal.records import PageRecord
from prooflight_line.plant.gate.deciding import GateDecider, SheetDecision
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Sequence

GOOD, BAD = ("good", ()), ("misprint", ())
PAGES = 4


def decider(**settings: Any) -> GateDecider:
    plc = PlcSettings(host="plc")
    return GateDecider(settings=GateSettings(distance_mm=1000, plc=plc, **settings), job_pages=PAGES)


def record(sheet: int, verdict: str, faults: tuple[str, ...] = (), *, page: int | None = -1) -> PageRecord:
    shown = sheet if page == -1 else page
    found = (
        Verdict.skipped(f"p{sheet}", "why not")
        if verdict == "not-inspected"
        else Verdict(page=f"p{sheet}", verdict=verdict)  # type: ignore[arg-type]
    )
    return PageRecord(
        sheet=sheet, job_page=shown, verdict=found, late=False, first_line=0, time_s=0.0, faults=faults
    )


def decided(sheets: Sequence[tuple[str, tuple[str, ...]]], **settings: Any) -> list[SheetDecision]:
    own = decider(**settings)
    return [own.decide(record(at, *one)) for at, one in enumerate(sheets)]


def letters(decisions: Sequence[SheetDecision]) -> str:
    return "".join(
        {Result.ACCEPT: "a", Result.DIVERT: "d", Result.STOP: "s"}[one.result] for one in decisions
    )


@pytest.mark.parametrize(
    ("verdict", "faults", "code"),
    [
        ("good", (), Code.GOOD),
        ("good", ("slip",), Code.GOOD),
        ("good", ("missing",), Code.GOOD),
        ("misprint", (), Code.MISPRINT),
        ("misprint", ("unknown",), Code.UNKNOWN_SHEET),
        ("misprint", ("blank",), Code.UNKNOWN_SHEET),
        ("not-inspected", (), Code.NOT_INSPECTED),
        ("good", ("lost-lines",), Code.LOST_LINES),
        ("good", ("extra-lines",), Code.LOST_LINES),
        ("not-inspected", ("lost-lines",), Code.LOST_LINES),
        ("good", ("repeated",), Code.OUT_OF_PLACE),
        ("good", ("out-of-order",), Code.OUT_OF_PLACE),
    ],
)
@pytest.mark.parametrize("policy", ["reject", "accept", "stop"])
def test_each_sheet_for_itself(verdict: str, faults: tuple[str, ...], code: Code, policy: str) -> None:
    """Doubts follow the policy; what is known does not."""
    found = decider(policy=policy).decide(record(0, verdict, faults))
    doubt = code in (Code.NOT_INSPECTED, Code.LOST_LINES)
    known = Result.ACCEPT if code is Code.GOOD else Result.DIVERT
    by_policy = {"reject": Result.DIVERT, "accept": Result.ACCEPT, "stop": Result.STOP}
    assert found.code is code
    assert found.result is (by_policy[policy] if doubt else known)


@given(
    st.lists(st.sampled_from(["good", "misprint", "not-inspected"]), max_size=40),
    st.sampled_from(["reject", "accept", "stop"]),
    st.sampled_from(["sheet", "until-clean-break"]),
    st.integers(1, 5),
)
def test_no_misprint_is_ever_accepted_and_no_doubt_under_reject(
    verdicts: list[str], policy: str, divert: str, pages_a_set: int
) -> None:
    found = decided([(one, ()) for one in verdicts], policy=policy, divert=divert, pages_a_set=pages_a_set)
    for verdict, one in zip(verdicts, found, strict=True):
        if verdict == "misprint" or (verdict == "not-inspected" and policy == "reject"):
            assert one.result is not Result.ACCEPT


def test_the_bad_sheet_only() -> None:
    assert letters(decided([GOOD, BAD, GOOD, GOOD])) == "adaa"


def test_all_that_follow_until_a_whole_copy_begins() -> None:
    """Copies of four pages: the stack grows by whole copies again from sheet 4 on."""
    found = decided([GOOD, BAD, *[GOOD] * 6], divert="until-clean-break")
    assert letters(found) == "adddaaaa"
    assert {one.code for one in found[2:4]} == {Code.UNTIL_CLEAN_BREAK}


def test_a_copy_that_begins_badly_is_no_clean_break() -> None:
    found = decided([BAD, GOOD, GOOD, GOOD, BAD, *[GOOD] * 5], divert="until-clean-break")
    assert letters(found) == "dddd" + "dddd" + "aa"


def test_a_bad_page_spoils_the_rest_of_its_set() -> None:
    found = decided([GOOD, GOOD, GOOD, BAD, GOOD, GOOD, GOOD], pages_a_set=3)
    assert letters(found) == "aaaddda"
    assert [one.code for one in found[3:6]] == [Code.MISPRINT, Code.SET_SPOILED, Code.SET_SPOILED]


def test_a_page_that_did_not_come_spoils_its_set() -> None:
    own = decider(pages_a_set=4)
    own.decide(record(0, "good"))
    gone = own.decide(record(1, "not-inspected", ("missing",), page=1), came=False)
    assert gone.result is Result.NONE
    assert own.decide(record(2, "good", page=2)).code is Code.SET_SPOILED
    assert own.decide(record(3, "good", page=4)).code is Code.GOOD


def test_a_stranger_spoils_no_set() -> None:
    own = decider(pages_a_set=2)
    own.decide(record(0, "good"))
    assert own.decide(record(1, "misprint", ("unknown",), page=None)).result is Result.DIVERT
    assert own.decide(record(2, "good", page=1)).result is Result.ACCEPT


@pytest.mark.parametrize(
    ("how", "lost", "found"),
    [({"pages_a_set": 4}, 1, "aadda"), ({"divert": "until-clean-break"}, 1, "aadda"), ({}, 1, "aaaaa")],
)
def test_a_good_sheet_that_was_lost_on_its_way_takes_others_with_it(
    how: dict[str, Any], lost: int, found: str
) -> None:
    """When sheet 2 comes it is known that an earlier one came too late for the gate."""
    own, decisions = decider(**how), list[SheetDecision]()
    for at in range(len(found)):
        if at == 2:
            own.lost(decisions[lost])
        decisions.append(own.decide(record(at, "good")))
    assert letters(decisions) == found


@pytest.mark.parametrize(
    ("rule", "sheets", "found"),
    [
        ({"stop_in_a_row": 3}, [BAD, BAD, GOOD, BAD, BAD, BAD, GOOD], "ddaddsa"),
        ({"stop_of": (2, 4)}, [BAD, GOOD, GOOD, GOOD, BAD, GOOD, BAD], "daaadas"),
        ({}, [BAD] * 5, "ddddd"),
    ],
)
def test_stop_rules(rule: dict[str, Any], sheets: list[Any], found: str) -> None:
    assert letters(decided(sheets, **rule)) == found
