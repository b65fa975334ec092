"""What is kept of each sheet and of pages that did not come, and what the run is told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.disposition import without_gate
from prooflight.detectors.verdict import Verdict
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight_line.run.monitor.run import Announcement, PageEvidence, RunMonitor
from prooflight_line.run.outcomes import CORRUPTED, RunWatch, missing_page, outcome, skipped, unknown_sheet
from prooflight_line.run.sheets.records import Fault, MissingPage, SeenPage

NOTHING = np.zeros((1, 1, 1), np.uint16)
GOOD = Verdict(page="p0004", verdict="good")
SAID = PageEvidence(values={"light-mono": 0.02})


def fault(kind: Any, detail: str = "") -> Fault:
    return Fault(kind=kind, first_line=70, detail=detail or f"it is {kind}")


def seen(page: int | None, *faults: Fault) -> SeenPage:
    return SeenPage(scan=NOTHING, first_line=40, last_line_time_s=2.5, job_page=page, faults=faults)


def test_a_sheets_record_says_where_and_when_it_came() -> None:
    done = outcome(7, seen(3, fault("repeated"), fault("repeated")), GOOD, late=True, latency_s=0.25)
    record = done.record
    assert (record.sheet, record.job_page, record.first_line, record.time_s) == (7, 3, 40, 2.5)
    assert (record.late, record.faults, record.verdict) == (True, ("repeated",), GOOD)
    assert (done.latency_s, done.came) == (0.25, True)
    assert not outcome(7, seen(3), GOOD).record.late


@pytest.mark.parametrize("kind", [*sorted(CORRUPTED), "repeated", "out-of-order", ""])
def test_a_spoilt_scan_tells_the_run_nothing(kind: str) -> None:
    done = outcome(7, seen(3, *([fault(kind)] if kind else [])), GOOD, evidence=SAID)
    assert done.evidence.values == done.record.nuisance == ({} if kind in CORRUPTED else {"light-mono": 0.02})


def test_sheets_are_named_by_the_page_that_they_show() -> None:
    assert skipped(7, seen(3), "why").record.verdict == Verdict.skipped("p0004", "why")
    assert skipped(7, seen(None), "why").record.verdict.page == "sheet 7"
    assert skipped(7, seen(3), "why", name="back").record.verdict.page == "back"


def test_an_unknown_sheet_is_a_misprint_and_says_why() -> None:
    blank = unknown_sheet(7, seen(None, fault("blank"), fault("slip", "lines are lost"))).record.verdict
    assert (blank.page, blank.verdict, without_gate(blank)[0]) == ("sheet 7", "misprint", "stop")
    assert (blank.kind, blank.reason) == ("missing-content", "it is blank; lines are lost")
    other = unknown_sheet(7, seen(None)).record.verdict
    assert (other.kind, other.reason) == ("wrong-page", "the sheet shows no page of the job")


def test_a_page_that_did_not_come_was_not_inspected() -> None:
    done = missing_page(7, MissingPage(job_page=3, faults=(fault("missing", "3 of 4 came"),)), 9.0)
    assert done.record.verdict == Verdict.skipped("p0004", "3 of 4 came")
    assert (done.came, done.record.late, done.record.job_page) == (False, False, 3)
    assert (done.record.first_line, done.record.time_s, done.record.faults) == (70, 9.0, ("missing",))
    bare = missing_page(7, MissingPage(job_page=3, faults=()), 9.0, name="back").record
    assert (bare.first_line, bare.faults, bare.verdict.page) == (0, ("missing",), "back")


@pytest.mark.parametrize(
    ("sheets", "job_page", "left"), [(10, 3, 6), (10, None, 2), (4, 3, 0), (3, 3, 0), (None, 3, None)]
)
def test_the_run_knows_how_many_pages_are_left(
    monkeypatch: pytest.MonkeyPatch, sheets: int | None, job_page: int | None, left: int | None
) -> None:
    """By the page of the job where the sheet shows one, for sheets may be missing, else by how many have come."""
    asked: list[tuple[int, int | None]] = []

    def see(
        _: RunMonitor, number: int, evidence: PageEvidence, *, pages_left: int | None
    ) -> list[Announcement]:
        asked.append((number, pages_left))
        return []

    monkeypatch.setattr(RunMonitor, "see", see)
    monitor = RunMonitor.begin(sensors=("mono",), columns_mm=np.array([0.5]), costs=RunningCosts())
    done = outcome(7, seen(job_page), GOOD)
    assert RunWatch(monitor=monitor, adapting=None, sheets=sheets).add(done) is done
    assert asked == [(7, left)]


@dataclass
class Summaries:
    """Test of a run that records the summaries of its pages."""

    added: list[float] = field(default_factory=list)
    suspended: bool = False
    strangest: str = ""
    remedy: str = ""

    def add(self, summary: NDArray[np.float64]) -> None:
        self.added.append(float(summary[0]))


def test_copies_of_a_design_count_once_in_the_test_of_a_run() -> None:
    """Six sheets show a job of three pages twice; a sheet of no page of the job is a design of its own."""
    monitor = RunMonitor.begin(sensors=("mono",), columns_mm=np.array([0.5]), costs=RunningCosts())
    test = Summaries()
    watch = RunWatch(
        monitor=monitor,
        adapting=None,
        sheets=6,
        design=lambda page: page % 3,
        guarantee=GuaranteeMonitor(test=test),
    )
    for sheet, page in enumerate((0, 1, 2, 3, None, 4, 5, None)):
        evidence = PageEvidence(summary=np.array([float(sheet)]))
        watch.add(outcome(sheet, seen(page), GOOD, evidence=evidence))
    assert test.added == [0.0, 1.0, 2.0, 4.0, 7.0]
