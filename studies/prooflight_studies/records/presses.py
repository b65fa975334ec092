"""Processes of the study: presses that record sheets at their pace, and their shippers; any of them may be killed."""

from __future__ import annotations

import multiprocessing
import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from prooflight.detectors.verdict import Region, Verdict
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts
from prooflight_line.records.service import ShippingService

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess
    from multiprocessing.synchronize import Event
    from pathlib import Path

ALARM_EVERY: Final = 50
COMMIT_S: Final = 0.5
"""Time between commits of a journal, as of a run's recorder."""
PLANTS: Final = ("north", "south", "east", "west")


@dataclass(frozen=True, slots=True, kw_only=True)
class PressPlan:
    """A press of the study."""

    number: int
    journal: Path
    sheets_per_s: float
    seconds: float

    @property
    def name(self) -> str:
        """Name of the press."""
        return f"press {self.number:02}"

    @property
    def sheets(self) -> int:
        """Number of sheets that it records."""
        return int(self.seconds * self.sheets_per_s)

    @property
    def plant(self) -> str:
        """Name of its plant."""
        return PLANTS[self.number % len(PLANTS)]


def sheet(number: int, time_s: float) -> PageRecord:
    """Return a sheet's record as long as a real one's; one in ``ALARM_EVERY`` is a misprint. [s]"""
    verdict = Verdict(
        page=f"p{number % 24 + 1:04}", verdict="good", score=-1.0, threshold=1.0, detector="matched_filter"
    )
    if number % ALARM_EVERY == ALARM_EVERY - 1:
        spot = Region(x_mm=60.0, y_mm=80.0, width_mm=3.0, height_mm=3.0, score=9.0, kind="spots-voids")
        verdict = replace(verdict, verdict="misprint", kind="spots-voids", score=8.0, regions=(spot,))
    return PageRecord(
        sheet=number, job_page=number, verdict=verdict, late=False, first_line=3000 * number, time_s=time_s
    )


def record_sheets(plans: list[PressPlan], begun_s: float) -> None:
    """Record sheets of several presses at their pace, in one process. begun_s: Unix time of the first sheets. [s]

    A sheet's time is that at which it was recorded, so that its row says when it could have been shipped at first.
    """
    journals = [Journal.open(str(plan.journal), announce=lambda line: None) for plan in plans]
    runs = [
        journal.begin_run(run_facts(plan.name, sheets=plan.sheets, started_s=begun_s))
        for plan, journal in zip(plans, journals, strict=True)
    ]
    recorded = [0] * len(plans)
    ends_s = begun_s + plans[0].seconds
    while (now_s := time.time()) < ends_s:
        for at, (plan, journal, run) in enumerate(zip(plans, journals, runs, strict=True)):
            due = min(int((now_s - begun_s) * plan.sheets_per_s), plan.sheets)
            for number in range(recorded[at], due):
                journal.record(run, sheet(number, number / plan.sheets_per_s))
            recorded[at] = max(recorded[at], due)
            journal.commit()
        time.sleep(max(0.0, now_s + COMMIT_S - time.time()))
    for plan, journal, run, count in zip(plans, journals, runs, recorded, strict=True):
        for number in range(count, plan.sheets):
            journal.record(run, sheet(number, number / plan.sheets_per_s))
        journal.end_run(run, RunEnd(ended_s=time.time(), ending="finished"))
        for _ in range(100):  # a disk that was full a moment ago
            if journal.commit():
                break
            time.sleep(COMMIT_S)
        journal.close()


def ship(plans: list[PressPlan], url: str, down: Event | None = None) -> None:
    """Ship the journals of several presses, in one process, until it is terminated. down: set at the first failure."""
    threads, ended = [], threading.Event()
    for plan in plans:
        service = ShippingService(
            url=url,
            press=plan.name,
            plant=plan.plant,
            journal=plan.journal,
            pictures=None,
            announce=lambda line: None if down is None else down.set(),
        )
        threads.append(threading.Thread(target=service.run, args=(ended,), daemon=True))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def started(target: object, *arguments: object) -> BaseProcess:
    """Start a process, as a program of its own."""
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)  # type: ignore[arg-type]
    process.start()
    return process


def run_facts(press: str, *, sheets: int, started_s: float) -> RunFacts:
    """Return what a journal states of a run of this press. started_s: Unix time. [s]"""
    return RunFacts(
        job="made-up",
        job_digest="",
        press=press,
        press_digest="0" * 64,
        detector="matched_filter",
        source="made-up",
        started_s=started_s,
        sheets=sheets,
    )
