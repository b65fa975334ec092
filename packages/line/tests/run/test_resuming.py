"""What a run that broke off has recorded, from its rows alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from packages.line.tests.journal.sample_rows import good, misprint

from prooflight.detectors.verdict import Verdict
from prooflight_line.run.resuming import Past
from prooflight_line.run.sheets.readings import UNSEEN, UNWATCHED


def missing(sheet: int, page: int) -> Any:
    verdict = Verdict.skipped(f"p{page + 1:04}", f"page {page + 1} was not detected")
    return good(sheet, job_page=page, verdict=verdict, faults=("missing",))


def stray(sheet: int) -> Any:
    verdict = Verdict(page=f"sheet {sheet}", verdict="misprint", kind="wrong-page")
    return good(sheet, job_page=None, verdict=verdict, faults=("unknown",))


def test_a_run_without_rows_begins_at_its_first_sheet() -> None:
    past = Past.of([])
    assert (past.first_sheet, past.due, past.last, past.time_s) == (0, 0, None, None)
    assert past.readings(5).best.due == 0


def test_position_and_counts_come_from_the_rows() -> None:
    rows = [
        good(0),
        misprint(1),
        missing(2, 3),
        good(3, job_page=4, faults=("missing",)),
        good(4, job_page=2, faults=("out-of-order",)),
        stray(5),
        replace(good(6, job_page=6), late=True),
        good(7, job_page=7, verdict=Verdict.skipped("p0008", UNWATCHED), faults=("unwatched",)),
    ]
    past = Past.of(rows)
    assert (past.first_sheet, past.due, past.last) == (8, 8, 7)
    assert past.missing == {3}
    counts = past.counts
    assert (counts["good"], counts["misprints"], counts["not_inspected"], counts["late"]) == (4, 2, 1, 1)
    assert (counts["missing"], counts["pages_seen"]) == (1, 6)
    assert past.first_not_inspected == f"p0008: {UNWATCHED}"
    assert past.faults["unwatched"] == 1


def test_pages_between_the_last_row_and_the_first_sheet_passed_unwatched() -> None:
    readings = Past.of([good(sheet) for sheet in range(4)]).readings(20)
    found = readings.go_on(readings.of_page([7]))
    assert [page for page, _ in found] == [4, 5, 6]
    assert {why for _, why in found} == {UNWATCHED}
    assert (readings.best.due, readings.missing, readings.blind) == (8, set(), False)
    # A camera that gives no lines later is another matter.
    readings.blind = True
    assert {why for _, why in readings.go_on(readings.of_page([10]))} == {UNSEEN}


def test_the_page_that_is_due_may_come_at_once() -> None:
    readings = Past.of([good(sheet) for sheet in range(4)]).readings(20)
    assert readings.go_on(readings.of_page([4])) == []
    assert readings.best.due == 5


def test_a_promise_that_was_void_stays_so() -> None:
    void = replace(good(1).verdict, promise_suspended=True)
    said = "this press's good pages are not like those that the promise rests on (...)"
    rows = [good(0), good(1, verdict=void, notes=("a drift", said)), good(2, verdict=void)]
    past = Past.of(rows)
    assert past.promise_suspended == said
    assert past.counts["promise_suspended"] == 2
