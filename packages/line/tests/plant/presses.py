"""A press that is played in real time: lines for the gate, sheets for the belt of a simulated controller."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight.press.gate import GateSettings, PlcSettings
from prooflight.scans.geometry import ScanGeometry
from prooflight.scans.lines import LineBlock
from prooflight_line.journal.records import PageRecord
from prooflight_line.plant.simulator.plc import Belt, BeltSheet, SimulatedPlc
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.simulator.server import PlcServer

DISTANCE_MM, SPEED_MM_S, SHEET_MM, SHEET_PITCH_MM = 1200.0, 1500.0, 120.0, 180.0
GEOMETRY = ScanGeometry(pixels=2, pixel_pitch_mm=0.5, line_pitch_mm=0.5, lead_in_mm=5.0, lead_out_mm=5.0)
BLOCK = 30
NOTHING = np.zeros((1, BLOCK, 2), np.uint16)
PATIENCE_S = 30.0
"""Only a test that fails waits so long."""


def controller(*, style: str = "registers") -> SimulatedPlc:
    belt = Belt(distance_mm=DISTANCE_MM, counts_per_mm=10.0, first_count=123_456)
    return SimulatedPlc(belt=belt, style=style)


def settings(port: int, **more: Any) -> GateSettings:
    style = more.pop("style", "registers")
    plc = PlcSettings(host="127.0.0.1", port=port, style=style, timeout_ms=1000, heartbeat_ms=2000)
    return GateSettings(distance_mm=DISTANCE_MM, plc=plc, **more)


def until(happens: Callable[[], object]) -> None:
    """Wait for an event that other threads bring about."""
    end_s = time.monotonic() + PATIENCE_S
    while not happens():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.005)


@dataclass
class PlayedPress:
    """Sheets pass the camera and the gate is told of each."""

    server: PlcServer
    gate: Gate
    judge: Callable[[int], str] = lambda sheet: "misprint" if sheet % 4 == 3 else "good"
    begun_s: float = 0.0
    line: int = 0
    sheet: int = 0
    """In the run of the gate."""
    serial: int = 0
    """On the belt."""
    next_mm: float = 300.0
    given: dict[int, str] = field(default_factory=dict)
    """By serial number, what was said of it."""

    def start(self) -> None:
        self.begun_s = time.monotonic()
        self.server.call(lambda: self.server.plc.belt.start(SPEED_MM_S, self.begun_s))

    def watched_by(self, gate: Gate) -> None:
        """Another start: the camera's count and the sheets' numbers begin anew."""
        self.gate, self.line, self.sheet = gate, 0, 0

    def pass_lines(self, *, seen: bool = True) -> None:
        """The next block, when it is due, and the sheet that is complete with it."""
        passed_mm = (time.monotonic() - self.begun_s) * SPEED_MM_S
        line0_mm = passed_mm - self.line * 0.5 if self.line == 0 else self._line0_mm
        self._line0_mm = line0_mm
        until_mm = line0_mm + (self.line + BLOCK) * 0.5
        time_s = self.begun_s + until_mm / SPEED_MM_S
        time.sleep(max(time_s - time.monotonic(), 0))
        if seen:
            self.gate.tracker.lines(LineBlock(first_line=self.line, lines=NOTHING, time_s=time_s))
        self.line += BLOCK
        if self.next_mm + SHEET_MM + GEOMETRY.lead_out_mm > until_mm:
            return
        front_mm, self.next_mm = self.next_mm, self.next_mm + SHEET_PITCH_MM
        self.serial += 1
        truth = self.judge(self.serial - 1)
        sheet = BeltSheet(serial=self.serial, front_mm=front_mm, truth=truth)
        self.server.call(lambda: self.server.plc.belt.lay(sheet))
        if seen and front_mm > line0_mm:
            self.given[self.serial] = truth
            self.tell(truth, round((front_mm - line0_mm) / 0.5), time_s)

    def tell(self, verdict: str, front_line: int, time_s: float) -> None:
        number, self.sheet = self.sheet, self.sheet + 1
        self.gate.arrived(number, None)  # type: ignore[arg-type]
        found = Verdict(page=f"p{number:04d}", verdict=verdict)  # type: ignore[arg-type]
        record = PageRecord(
            sheet=number,
            job_page=number,
            verdict=found,
            late=False,
            first_line=front_line - round(GEOMETRY.lead_in_mm / 0.5),
            time_s=time_s,
        )
        self.gate.observe(Outcome(record=record, evidence=PageEvidence()))

    def run_until(self, happens: Callable[[], object], *, seen: bool = True) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not happens():
            assert time.monotonic() < end_s, "it never happened"
            self.pass_lines(seen=seen)

    def at_gate(self) -> int:
        return len(self.server.plc.rows)
