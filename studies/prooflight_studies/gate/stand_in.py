"""The inspection of the long run, played: lines that show nothing, verdicts as they were drawn, everything else real.

Tracker, decisions, exchange, link, gate's log and journal are those of ``watch``. It is a process of its own, so that
it can be killed: ``python -m prooflight_studies.gate.stand_in PLAN JOURNAL HOST PORT STARTED_S``, which begins when a
line comes on its standard input.
"""

from __future__ import annotations

import heapq
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final
from unittest import mock

import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight.press.gate import GateSettings, PlcSettings
from prooflight.scans.lines import LineBlock, LineFault
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunFacts
from prooflight_line.plant.gate.gate import Gate
from prooflight_line.plant.gate.link import Wire
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import InOrder, Outcome
from prooflight_line.run.recording import Recorder
from prooflight_line.run.sheets.records import SeenPage
from prooflight_studies.gate.plan import (
    DISTANCE_MM,
    GEOMETRY,
    JOB_PAGES,
    LASTS_S,
    LINE_MM,
    SHEET_MM,
    Plan,
)

if TYPE_CHECKING:
    from prooflight_studies.gate.plan import PlannedSheet

BLOCK_LINES: Final = 128
BLANK: Final = np.zeros((1, BLOCK_LINES, GEOMETRY.pixels), np.uint16)
JUMPS_S: Final = (3600.0, -7200.0)
"""Jumps of the wall clock, one after the other."""
RECKONED_WRONG: Final = 1.07
"""The camera's count after it was away: reckoned by time, and wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledClock:
    """Monotonic time since the start of the run, some times as fast."""

    started_s: float
    faster: float

    def __call__(self) -> float:
        """Now. [s]"""
        return (time.monotonic() - self.started_s) * self.faster

    def until(self, when_s: float) -> None:
        """Wait."""
        left_s = (when_s - self()) / self.faster
        if left_s > 0:
            time.sleep(left_s)


def settings_of(host: str, port: int) -> GateSettings:
    """Return the gate of this study, as a press file would have it."""
    return GateSettings(distance_mm=DISTANCE_MM, plc=PlcSettings(host=host, port=port))


def hurried_wire(faster: float) -> type[Wire]:
    """Return a wire whose patience is as much shorter as time is faster."""

    class Hurried(Wire):
        def __init__(self, plc: PlcSettings) -> None:
            super().__init__(replace(plc, timeout_ms=max(round(plc.timeout_ms / faster), 10)))

    return Hurried


class StandIn:
    """Judges the sheets of a plan that pass the camera from now on."""

    def __init__(self, plan: Plan, gate: Gate, recorder: Recorder, clock: ScaledClock) -> None:
        self._plan, self._gate, self._recorder, self._clock = plan, gate, recorder, clock
        self._order = InOrder()
        self._number = 0
        self._due: list[tuple[float, int, Outcome]] = []
        self._line = 0
        self._away = [
            (begins_s, begins_s + LASTS_S[name]) for begins_s, name in plan.failures if name == "camera-away"
        ]

    def run(self) -> None:
        """Run until the plan ends."""
        per_s = self._plan.speed_mm_s / LINE_MM
        clock, plan = self._clock, self._plan
        begun_s = clock()
        self._line = 0
        start_line = begun_s * per_s  # of the transport, at the camera's line 0
        waiting = iter([one for one in plan.sheets if one.front_mm > begun_s * plan.speed_mm_s + 20])
        coming = next(waiting, None)
        faults: tuple[LineFault, ...] = ()
        while True:
            time_s = (start_line + self._line + BLOCK_LINES) / per_s
            if time_s > plan.ends_s:
                break
            away = next(((since, until) for since, until in self._away if since <= time_s < until), None)
            if away is not None:
                # Nobody sees what passes; the count goes on as it is reckoned, which is wrong.
                passed = int((away[1] - time_s) * per_s) + 1
                while coming is not None and coming.front_mm < away[1] * plan.speed_mm_s + 20:
                    coming = next(waiting, None)
                self._late(away[1])
                reckoned = round(passed * RECKONED_WRONG)
                faults = (
                    LineFault(
                        kind="camera-away", first_line=self._line, lines=reckoned, detail="it was away"
                    ),
                )
                start_line += passed - reckoned
                self._line += reckoned
                continue
            self._late(time_s)
            block = LineBlock(first_line=self._line, lines=BLANK, time_s=time_s, faults=faults)
            faults = ()
            self._gate.tracker.lines(block)
            self._line += BLOCK_LINES
            travelled_mm = time_s * plan.speed_mm_s
            while coming is not None and coming.front_mm + SHEET_MM + GEOMETRY.lead_out_mm <= travelled_mm:
                self._seen(coming, time_s, round(coming.front_mm / LINE_MM - start_line))
                coming = next(waiting, None)
        while self._due:
            self._late(self._due[0][0])

    def _late(self, until_s: float) -> None:
        """Wait, and give the verdicts that are ready meanwhile."""
        while self._due and self._due[0][0] <= until_s:
            when_s, _, outcome = heapq.heappop(self._due)
            self._clock.until(when_s)
            for turn in self._order.put(outcome):
                self._gate.observe(turn)
                self._recorder.record(turn.record)
        self._clock.until(until_s)

    def _seen(self, sheet: PlannedSheet, time_s: float, front_line: int) -> None:
        number, self._number = self._number, self._number + 1
        first_line = front_line - round(GEOMETRY.lead_in_mm / LINE_MM)
        page = sheet.serial // 2
        seen = SeenPage(scan=BLANK, first_line=first_line, last_line_time_s=time_s, job_page=page)
        self._gate.arrived(number, seen)
        record = PageRecord(
            sheet=number,
            job_page=None if sheet.kind == "unknown" else page,
            verdict=_verdict(sheet),
            late=False,
            first_line=first_line,
            time_s=time_s,
            faults=_faults(sheet),
            notes=(f"serial {sheet.serial}",),
        )
        outcome = Outcome(record=record, latency_s=sheet.latency_s, evidence=PageEvidence())
        heapq.heappush(self._due, (time_s + sheet.latency_s, number, outcome))


def _verdict(sheet: PlannedSheet) -> Verdict:
    page = f"p{sheet.serial // 2 % JOB_PAGES + 1:04d}"
    if sheet.kind in ("misprint", "unknown", "false-alarm"):
        return Verdict(page=page, verdict="misprint", kind="streak", detector="stand-in")
    if sheet.kind == "late":
        return Verdict.skipped(page, "the verdict would have been late")
    return Verdict(page=page, verdict="good", detector="stand-in")


def _faults(sheet: PlannedSheet) -> tuple[str, ...]:
    return {
        "unknown": ("unknown",),
        "repeated": ("repeated",),
        "double": ("extra-lines",),
        "lost-lines": ("lost-lines",),
    }.get(sheet.kind, ())


class JumpingClock:
    """The wall clock, which somebody sets while the run goes on."""

    def __init__(self, plan: Plan, clock: ScaledClock) -> None:
        self._at_s = [begins_s for begins_s, name in plan.failures if name == "clock-jump"]
        self._clock, self._true = clock, time.time

    def __call__(self) -> float:
        """Now, as it is set. [s]"""
        jumps = sum(self._clock() >= at_s for at_s in self._at_s)
        return self._true() + sum(JUMPS_S[at % len(JUMPS_S)] for at in range(jumps))


def main(plan_file: str, journal: str, host: str, port: str, started_s: str) -> None:
    """Play the inspection until the plan ends, or somebody ends this process."""
    plan = Plan.load(Path(plan_file))
    sys.stdin.readline()  # it stands by until it is told to begin
    clock = ScaledClock(started_s=float(started_s), faster=plan.faster)
    facts = RunFacts(
        job="a job of 8 pages",
        job_digest="",
        press="stand-in",
        press_digest="",
        detector="stand-in",
        source="a plan",
        started_s=time.time(),
        sheets=plan.sheets[-1].serial // 2 + 1,  # some may be lost before the camera
    )
    with (
        mock.patch("time.time", JumpingClock(plan, clock)),
        Journal.open(journal) as opened,
        Recorder(opened, opened.begin_run(facts)) as recorder,
        Gate(
            settings_of(host, int(port)),
            GEOMETRY,
            job_pages=JOB_PAGES,
            journal=opened.path,
            run_id=recorder.run_id,
            clock=clock,
            open_wire=hurried_wire(plan.faster),
            pace=plan.faster,
        ) as gate,
    ):
        StandIn(plan, gate, recorder, clock).run()


if __name__ == "__main__":
    main(*sys.argv[1:])
