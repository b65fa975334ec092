"""Sheets to print again: every sheet that the job needs and that does not lie in the good tray, and no other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.plant.runs import FACTS, MISPRINT, record

from prooflight.detectors.verdict import Verdict
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.journal.labels import Label, Labels
from prooflight_line.journal.records import RunEnd, RunRow
from prooflight_line.plant.gate.log import LoggedDecisions
from prooflight_line.plant.gate.reconciling import Accounted, Reconciliation
from prooflight_line.plant.reprinting import NEVER, NOT_PRINTED, NOT_SEEN_WHOLE, UNCONFIRMED, reprint_list

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.plant.reprinting import ReprintList

PAGES = 4
BLIND = Verdict.skipped("p0003", "the deadline had passed")


def run_of(sheets: int | None, *, state: str = "finished", **settings: Any) -> RunRow:
    counts = dict.fromkeys(("pages", "misprints", "not_inspected", "late", "faulty"), 0)
    return RunRow(
        id=1,
        facts=replace(FACTS, sheets=sheets, settings={"job_pages": PAGES, **settings}),
        end=None if state == "running" else RunEnd(ended_s=9.0, ending="finished"),
        state=state,  # type: ignore[arg-type]
        dropped_pages=0,
        dropped_evidence=0,
        promise_suspended_from=None,
        **counts,  # type: ignore[arg-type]
    )


def said(*words: tuple[str, int | None, int | None], **more: Any) -> Labels:
    """Words as (word, sheet, incident)."""
    made = [
        Label(
            id=at + 1,
            run="1@0",
            sheet=sheet,
            incident=None if incident is None else str(incident),
            word=word,
            note="",
            by="Mei",
            at_s=float(at),
            **more,
        )
        for at, (word, sheet, incident) in enumerate(words)
    ]
    return Labels(made)


def listed(
    pages: Sequence[PageRecord] = (),
    *,
    sheets: int | None = None,
    state: str = "finished",
    labels: Labels | None = None,
    incident_of: Callable[[int], int | None] = lambda _sheet: None,
    gate: tuple[LoggedDecisions, Reconciliation] | None = None,
    settings: dict[str, Any] | None = None,
) -> ReprintList:
    passed = max((page.job_page + 1 for page in pages if page.job_page is not None), default=0)
    return reprint_list(
        run_of(passed if sheets is None else sheets, state=state, **(settings or {})),
        pages,
        passed=passed,
        labels=labels or said(),
        incident_of=incident_of,
        gate=gate,
    )


def numbers(found: ReprintList) -> list[int]:
    return [one.run_sheet for one in found.all()]


# --- without a gate ---


def test_what_was_not_judged_good_is_printed_again_with_its_reason() -> None:
    pages = [record(0), record(1, MISPRINT), record(2, BLIND), record(3)]
    found = listed(pages)
    assert [(one.run_sheet, one.why, one.verdict) for one in found.sheets] == [
        (1, "streak at x = 120 mm in black", "misprint"),
        (2, "the deadline had passed", "not-inspected"),
    ]
    assert found.by == "verdicts"


@pytest.mark.parametrize("word", ["false-alarm", "good", "misprint", "unknown"])
def test_no_label_makes_a_sheet_good_that_nobody_looked_at(word: str) -> None:
    pages = [record(0, BLIND), record(1, MISPRINT)]
    on_incidents = said((word, None, 1), (word, None, 2))
    assert 0 in numbers(listed(pages, labels=on_incidents, incident_of=lambda sheet: sheet + 1))
    assert 0 in numbers(listed(pages, labels=said((word, 0, None), (word, 1, None))))


@pytest.mark.parametrize("fault", ["lost-lines", "extra-lines", "splice"])
def test_a_sheet_of_which_nobody_saw_all_is_delivered_only_where_a_person_vouches_for_it(fault: str) -> None:
    pages = [record(0), replace(record(1), faults=(fault,)), record(2)]
    assert [pages[1].disposition, *numbers(listed(pages))] == ["hold", 1]
    assert next(listed(pages).all()).why == NOT_SEEN_WHOLE
    assert numbers(listed(pages, labels=said(("good", 1, None)))) == [1]
    found = listed(pages, labels=said(("vouched", 1, None)))
    assert (numbers(found), found.vouched) == ([], (1,))
    misprint = [replace(record(0, verdict=MISPRINT), faults=(fault,))]
    assert numbers(listed(misprint, labels=said(("good", 0, None)))) == [0]


def test_a_false_alarm_is_a_good_sheet_up_to_the_last_that_the_person_saw() -> None:
    pages = [record(at, MISPRINT) for at in range(4)]
    found = listed(pages, labels=said(("false-alarm", None, 1), upto=1), incident_of=lambda _sheet: 1)
    assert numbers(found) == [2, 3]


def test_a_person_vouches_for_one_sheet_and_no_other() -> None:
    pages = [record(at, BLIND) for at in range(3)]
    found = listed(pages, labels=said(("vouched", 1, None)))
    assert (numbers(found), found.vouched) == ([0, 2], (1,))
    assert numbers(listed(pages, labels=said(("vouched", 1, None), ("misprint", 1, None)))) == [0, 1, 2]


def test_a_page_that_was_printed_well_later_is_not_printed_again() -> None:
    pages = [record(0, MISPRINT), record(1), record(2, job_page=0, faults=("repeated",))]
    assert numbers(listed(pages)) == []
    worse = [record(0), record(1), record(2, MISPRINT, job_page=0, faults=("repeated",))]
    assert numbers(listed(worse)) == [], "the first print of it is good"


def test_a_front_and_a_back_of_different_prints_make_no_good_sheet() -> None:
    """Sheet 0 came twice: each time another side was bad, and once more when both were good."""
    plan = SheetPlan(layout=Layout.parse("sides=2"), sides=4, sheets=2)
    settings = {"layout": plan.facts}
    sides = [(0, MISPRINT), (1, None), (0, None), (1, MISPRINT), (2, None), (3, None)]
    pages = [
        record(
            at, *([] if bad is None else [bad]), job_page=page, faults=("repeated",) if at in (2, 3) else ()
        )
        for at, (page, bad) in enumerate(sides)
    ]
    assert numbers(listed(pages, sheets=4, settings=settings)) == [0]
    again = [record(at + 6, job_page=at, faults=("repeated",)) for at in (0, 1)]
    assert numbers(listed([*pages, *again], sheets=4, settings=settings)) == []


def test_a_run_that_ended_early_lacks_what_it_never_printed_and_one_that_goes_on_does_not() -> None:
    pages = [record(0), record(1, MISPRINT), record(2)]
    found = listed(pages, sheets=10)
    assert (numbers(found), len(found), found.unprinted) == ([1, *range(3, 10)], 8, range(3, 10))
    last = list(found.all())[-1]
    assert (last.why, last.verdict, last.behind, last.page) == (
        NOT_PRINTED,
        "not-inspected",
        "p0003",
        "p0002",
    )
    assert numbers(listed(pages, sheets=10, state="running")) == [1]


def test_a_page_that_did_not_come_is_printed_again() -> None:
    gone = Verdict(page="p0002", verdict="not-inspected")
    pages = [record(0), record(1, gone, faults=("missing",)), record(2)]
    (one,) = listed(pages).sheets
    assert (one.run_sheet, one.why) == (1, NEVER)


@given(
    st.lists(st.sampled_from(["good", "misprint", "not-inspected"]), min_size=1, max_size=30),
    st.integers(0, 10),
    st.data(),
)
def test_every_sheet_that_is_needed_is_delivered_or_listed(
    words: list[str], more: int, data: st.DataObject
) -> None:
    made = {"good": (), "misprint": (MISPRINT,), "not-inspected": (BLIND,)}
    pages = [record(at, *made[word]) for at, word in enumerate(words)]
    vouched = data.draw(st.sets(st.integers(0, len(words) - 1)))
    labels = said(*(("vouched", sheet, None) for sheet in vouched))
    found = listed(pages, sheets=len(words) + more, labels=labels)
    delivered = {at for at, word in enumerate(words) if word == "good"} | vouched
    assert sorted(numbers(found)) == sorted(set(range(len(words) + more)) - delivered)
    assert len(found) == sum(found.pages().values())


# --- with a gate ---


def accounted(page: int | None, account: str, decision: str = "", why: str = "", **more: Any) -> Accounted:
    name = "" if page is None else f"p{page % PAGES + 1:04d}"
    told = {"sheet": page, "tray": {"accepted": "good", "wrong": "good"}.get(account, "")} | more
    return Accounted(account=account, job_page=page, page=name, decision=decision, why=why, **told)  # type: ignore[arg-type]


def by_trays(
    accounts: list[Accounted], *, pages_a_set: int = 1, state: str = "finished", **more: Any
) -> ReprintList:
    kept = LoggedDecisions(began={"job_pages": PAGES, "settings": {"pages_a_set": pages_a_set}})
    found = Reconciliation(sheets=tuple(accounts), tolerated=False)
    return listed(gate=(kept, found), state=state, **more)


SHEETS = [
    accounted(0, "accepted"),
    accounted(1, "diverted", "divert", "a misprint"),
    accounted(2, "accepted"),
    accounted(2, "diverted", "divert", "it came twice"),
    accounted(None, "unseen"),
    accounted(4, "lost", "accept", "too late", tray="reject"),
    accounted(5, "not-at-gate", "accept"),
]


def test_what_is_not_in_the_good_tray_is_printed_again_and_says_where_it_goes() -> None:
    assert [(one.copy, one.number, one.behind, one.why) for one in by_trays(SHEETS).sheets] == [
        (1, 2, "p0001", "a misprint"),
        (1, 4, "p0003", "no sheet with this page was detected"),
        (2, 1, "p0003", "too late"),
        (2, 2, "p0003", UNCONFIRMED),
    ]


def test_a_sheet_on_its_way_to_the_gate_is_not_printed_again_until_one_behind_it_has_come() -> None:
    assert numbers(by_trays(SHEETS, state="running")) == [1, 3, 4]
    assert numbers(by_trays([*SHEETS, accounted(6, "accepted")], state="running")) == [1, 3, 4, 5]


def test_where_the_gate_is_an_output_that_names_no_tray_what_was_accepted_in_time_is_delivered() -> None:
    kept = LoggedDecisions(began={"job_pages": PAGES, "settings": {"plc": {"style": "coil"}}})
    kept.decisions = {tag: {} for tag in (1, 2, 3)}
    kept.unsent = {3: {}}
    accounts = [
        accounted(0, "not-at-gate", "accept"),
        accounted(1, "not-at-gate", "divert", "a misprint"),
        accounted(2, "not-at-gate", "accept"),
    ]
    found = listed(gate=(kept, Reconciliation(sheets=tuple(accounts), tolerated=False)))
    assert [(one.run_sheet, one.why) for one in found.sheets] == [(1, "a misprint"), (2, UNCONFIRMED)]


def test_a_misprint_in_the_good_tray_is_taken_out_and_printed_again() -> None:
    (one,) = by_trays([accounted(0, "wrong", "divert", "a misprint"), accounted(1, "accepted")]).sheets
    assert (one.run_sheet, one.take_out, one.why) == (0, True, "a misprint; the sheet is in the good tray")


def test_a_sheet_of_which_the_two_logs_name_different_trays_is_printed_again() -> None:
    sheets = [accounted(0, "accepted", contested=True), accounted(1, "accepted")]
    assert [(one.run_sheet, one.take_out) for one in by_trays(sheets).sheets] == [(0, False)]


def test_a_spoiled_set_is_printed_again_as_a_whole_and_what_lies_in_the_good_tray_is_taken_out() -> None:
    sheets = [accounted(0, "accepted"), accounted(1, "diverted", "divert", "a misprint")]
    sheets += [accounted(page, "accepted") for page in (2, 3)]
    found = by_trays(sheets, pages_a_set=2).sheets
    assert [(one.run_sheet, one.take_out, one.why) for one in found] == [
        (0, True, "the set is reprinted as a whole"),
        (1, False, "a misprint"),
    ]


def test_in_a_run_with_a_gate_no_label_moves_paper_and_a_person_who_vouches_does() -> None:
    sheets = [accounted(0, "accepted"), accounted(1, "diverted", "divert", "a misprint")]
    pages = [record(0), record(1, MISPRINT)]
    own = {"pages": pages, "sheets": 2}
    assert numbers(by_trays(sheets, labels=said(("false-alarm", 1, None)), **own)) == [1]
    found = by_trays(sheets, labels=said(("vouched", 1, None)), **own)
    assert (numbers(found), found.vouched) == ([], (1,))


def test_nobody_vouches_with_one_side_for_a_sheet_whose_other_side_was_never_seen() -> None:
    """The inspection was killed between the two sides of the second sheet."""
    plan = SheetPlan(layout=Layout(sides=2), sides=4, sheets=2)
    rows = [record(at) for at in range(3)]
    rows[2] = record(2, BLIND)
    decided = LoggedDecisions(began={"layout": plan.facts})
    sheets = (
        Accounted(account="accepted", sheet=0, job_page=0, decision="accept", tray="good"),
        Accounted(account="diverted", sheet=2, job_page=1, decision="divert", tray="reject"),
    )
    gate = decided, Reconciliation(sheets=sheets, tolerated=False)
    labels = said(("vouched", 2, None))
    assert numbers(listed(rows, gate=gate, labels=labels)) == [1]
    assert numbers(listed([*rows, record(3)], gate=gate, labels=labels)) == []


def test_a_good_sheet_that_was_rejected_is_listed_with_its_number_so_that_a_person_may_vouch_for_it() -> None:
    lost = accounted(1, "lost", "accept", "too late", tray="reject", in_journal=True)
    killed = accounted(2, "lost", "accept", "too late", tray="reject")  # before the journal had it
    found = by_trays([accounted(0, "accepted"), lost, killed])
    assert [(one.run_sheet, one.sheet, one.verdict) for one in found.sheets] == [
        (1, 1, "good"),
        (2, None, "good"),
    ]
