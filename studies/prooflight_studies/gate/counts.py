"""Whether everything that counts sheets to print again counts, to the sheet, what lies outside the good tray.

A press is played on a clock of its own, so that a run of hundreds of sheets takes seconds. Gate, exchange, decisions,
gate's log and journal are those of ``watch``, the controller is the simulated one, and what a person finds in the trays
is what the belt knows of each sheet. Sheets are bad, not inspected, late, doubled, repeated or missing, and the plant
fails: the link is silent for a moment or cut, the controller loses its power, the inspection is killed and begins anew.

``python -m prooflight_studies.gate.counts --runs 10 --sheets 400`` plays ten runs; it exits with 1 where counts differ.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from starlette.testclient import TestClient

from prooflight.cli import show
from prooflight.detectors.verdict import Verdict
from prooflight.press.gate import GateSettings, PlcSettings
from prooflight.rng import stream
from prooflight.scans.geometry import ScanGeometry
from prooflight.scans.lines import LineBlock
from prooflight_console.accounts.roles import Role
from prooflight_console.app import console_app
from prooflight_console.settings import ConsoleSettings
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts
from prooflight_line.plant.gate.gate import Gate
from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.registers import Shown
from prooflight_line.plant.simulator.belt import Belt, BeltSheet
from prooflight_line.plant.simulator.plc import SimulatedPlc
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome
from prooflight_line.run_package.accounts import accounts_of

if TYPE_CHECKING:
    from collections.abc import Generator

    from prooflight_line.plant.gate.exchange import Exchange

DISTANCE_MM, SPEED_MM_S, SHEET_MM, PITCH_MM, LINE_MM = 1200.0, 1500.0, 120.0, 180.0, 0.5
STEP_S: Final = 0.02
"""Of the clock, and from exchange to exchange."""
JOB_PAGES: Final = 8
LATENCY_S, LATE_S = 0.15, 1.0
"""From a sheet's last line to its verdict; the way to the gate takes 0.7 s."""
HEARTBEAT_S: Final = 0.5
RESTART_S: Final = 1.5
"""From the end of a killed inspection to the next one."""
GEOMETRY: Final = ScanGeometry(
    pixels=2, pixel_pitch_mm=LINE_MM, line_pitch_mm=LINE_MM, lead_in_mm=5.0, lead_out_mm=5.0
)
LINES: Final = np.zeros((1, round(SPEED_MM_S * STEP_S / LINE_MM), 2), np.uint16)
SHARES: Final = {
    "misprint": 0.05,
    "not-inspected": 0.04,
    "late": 0.03,
    "lost-lines": 0.02,
    "missing": 0.02,
    "repeated": 0.02,
    "unknown": 0.02,
    "double": 0.02,
    "slip": 0.02,
}
"""assumed: a press in a bad hour."""
FAILURES: Final = {"silent": 0.3, "cut": 1.2, "power": 1.5}
"""How long the link is silent (the controller's heartbeat outlasts it), is cut, and the controller is off. [s]"""


@dataclass(slots=True)
class Played:
    """One start of the inspection: a run of the journal, and what a person finds in the trays of it."""

    run: int
    needed: int
    killed: bool = False
    pages: dict[int, int] = field(default_factory=dict)
    """Place in the run of each sheet on the belt, by its serial number; of those that belong to the job."""
    good: set[int] = field(default_factory=set)
    """Places in the run of sheets that lie in the good tray, and are good."""
    stuck: int = 0
    """Sheets that stuck below a good one and got with it into the good tray, where they do not belong."""
    bad: list[int] = field(default_factory=list)
    """Serial numbers of all other sheets in the good tray."""

    @property
    def lacking(self) -> list[int]:
        """Sheets that the job needs and that do not lie in the good tray."""
        return sorted(set(range(self.needed)) - self.good)


class Press:
    """Camera, belt, controller and inspection on one clock."""

    def __init__(self, folder: Path, *, seed: int, sheets: int) -> None:
        """folder: gets the journal, the gate's log beside it, and the controller's log of its trays."""
        self.journal, self.trays = folder / "runs.sqlite", folder / "trays.jsonl"
        self.rng, self.sheets = stream(seed, "gate-plan"), sheets
        self.now_s = 0.0
        belt = Belt(distance_mm=DISTANCE_MM, counts_per_mm=10.0, first_count=int(self.rng.integers(2**32)))
        self._log = self.trays.open("w", encoding="utf-8", buffering=1)
        self.plc = SimulatedPlc(belt=belt, heartbeat_s=HEARTBEAT_S, log=self._log, clock=lambda: self.now_s)
        belt.start(SPEED_MM_S, 0.0)
        self.serial = 0
        self.next_mm = 0.0

    def close(self) -> None:
        """No more sheets."""
        self._log.close()

    def play(self, opened: Journal, *, killed: bool, failures: int) -> Generator[Played]:
        """One start of the inspection; gives what is known so far, once in the middle of the run and at its end."""
        run = opened.begin_run(_facts(self.sheets))
        played = Played(run=run, needed=self.sheets, killed=killed)
        settings = GateSettings(distance_mm=DISTANCE_MM, plc=PlcSettings(host="plc"))
        gate = Gate(
            settings,
            GEOMETRY,
            job_pages=JOB_PAGES,
            journal=opened.path,
            run_id=run,
            clock=lambda: self.now_s,
        )
        walk = _Walk(self, gate, opened, played, failures=failures)
        try:
            while not walk.over:
                walk.step()
                if walk.half:
                    opened.commit()
                    yield played
            if not killed:
                opened.end_run(run, RunEnd(ended_s=self.now_s, ending="finished"))
            opened.commit()
            yield played
        finally:
            gate._log.close()  # noqa: SLF001 - the gate's own link was never started, so that it cannot be left


class _Walk:
    """The steps of one run."""

    def __init__(self, press: Press, gate: Gate, opened: Journal, played: Played, *, failures: int) -> None:
        self._press, self._gate, self._opened, self._played = press, gate, opened, played
        rng, sheets = press.rng, press.sheets
        names, shares = [*SHARES, "good"], [*SHARES.values(), 1 - sum(SHARES.values())]
        self._kinds = [names[at] for at in rng.choice(len(names), size=sheets, p=shares)]
        self._die_at = round(sheets * rng.uniform(0.4, 0.8)) if played.killed else sheets
        span = np.sort(rng.uniform(0.15, 0.9, failures)) * sheets * PITCH_MM / SPEED_MM_S
        self._failures = [
            (press.now_s + float(begins_s), list(FAILURES)[int(rng.integers(len(FAILURES)))])
            for begins_s in span
        ]
        self._away_until_s = self._off_until_s = -1.0
        self._line, self._line0_mm = 0, press.plc.belt.travelled_mm(press.now_s)
        press.next_mm = max(press.next_mm, self._line0_mm + 600.0)
        self._position = self._number = 0
        self._coming: list[tuple[float, int | None, str]] = []
        """Sheets that have not passed the camera whole: front [mm], place in the run, and what they are."""
        self._due: list[tuple[float, Outcome]] = []
        self._half_given = self._dead = False
        self._seen_rows = len(press.plc.rows)
        self._ends_s: float | None = None

    @property
    def over(self) -> bool:
        """Whether the last sheet has reached the gate, or the inspection is dead for long enough."""
        return self._ends_s is not None and self._press.now_s >= self._ends_s

    @property
    def half(self) -> bool:
        """True once, in the middle."""
        if self._half_given or self._position < self._press.sheets // 2 or self._dead:
            return False
        self._half_given = True
        return True

    def step(self) -> None:
        """One turn of the clock."""
        press = self._press
        press.now_s += STEP_S
        self._fail()
        self._lay()
        if not self._dead:
            self._inspect()
        if press.now_s >= self._away_until_s and press.now_s >= self._off_until_s and not self._dead:
            self._exchange()
        press.plc.scan()
        self._sorted()

    def _fail(self) -> None:
        now_s, plc = self._press.now_s, self._press.plc
        if plc.off and now_s >= self._off_until_s:
            plc.power(on=True)
        while self._failures and self._failures[0][0] <= now_s:
            _, name = self._failures.pop(0)
            if name == "power":
                plc.power(on=False)
                self._off_until_s = now_s + FAILURES[name]
            else:
                self._away_until_s = now_s + FAILURES[name]
            if name != "silent":
                self._exchange_of_gate.lost(f"the link is {name}")

    def _lay(self) -> None:
        """Lay sheets that pass the camera now on the belt; a press whose inspection is dead prints no more."""
        press = self._press
        travelled_mm = press.plc.belt.travelled_mm(press.now_s)
        while self._position < press.sheets and press.next_mm <= travelled_mm + PITCH_MM:
            position, kind = self._position, self._kinds[self._position]
            self._position += 1
            if kind == "missing":
                self._coming.append((press.next_mm - 1.0, position, kind))
                continue
            self._feed(position, kind)
            if kind in ("repeated", "unknown"):
                self._feed(position if kind == "repeated" else None, kind)
        if self._position == press.sheets and self._ends_s is None:
            self._ends_s = press.now_s + (DISTANCE_MM + 3 * PITCH_MM) / SPEED_MM_S + 1.0

    def _feed(self, position: int | None, kind: str) -> None:
        press, rng = self._press, self._press.rng
        press.serial += 1
        first = kind in ("repeated", "unknown") and position not in self._played.pages.values()
        own = "good" if first and position is not None else kind
        truth = own if own in ("misprint", "repeated", "unknown") else "good"
        slip_mm = float(rng.uniform(60, 90)) if own == "slip" else 0.0
        front_mm = press.next_mm + float(rng.uniform(-8, 8))
        sheet = BeltSheet(
            serial=press.serial, front_mm=front_mm, truth=truth, slip_mm=slip_mm, under=own == "double"
        )
        press.plc.belt.lay(sheet)
        press.serial += own == "double"
        press.next_mm += PITCH_MM
        if position is not None:
            self._played.pages[sheet.serial] = position
        self._coming.append((front_mm, position, own))

    def _inspect(self) -> None:
        """What the camera and the inspection do."""
        press = self._press
        now_s = press.now_s
        self._gate.tracker.lines(LineBlock(first_line=self._line, lines=LINES, time_s=now_s))
        self._line += LINES.shape[1]
        travelled_mm = press.plc.belt.travelled_mm(now_s)
        while self._coming and self._coming[0][0] + SHEET_MM + GEOMETRY.lead_out_mm <= travelled_mm:
            front_mm, position, kind = self._coming.pop(0)
            number, self._number = self._number, self._number + 1
            if number >= self._die_at:
                self._dead = True
                self._ends_s = now_s + RESTART_S + DISTANCE_MM / SPEED_MM_S
                self._position = press.sheets
                return
            if kind != "missing":
                self._exchange_of_gate.arrived(number + 1)
            first_line = round((front_mm - self._line0_mm - GEOMETRY.lead_in_mm) / LINE_MM)
            record = _record(number, position, kind, first_line=first_line, time_s=now_s)
            late_s = LATE_S if kind == "late" else LATENCY_S
            outcome = Outcome(record=record, evidence=PageEvidence(), came=kind != "missing")
            self._due.append((now_s + late_s, outcome))
        while self._due and self._due[0][0] <= now_s:
            outcome = self._due.pop(0)[1]
            self._gate.observe(outcome)
            self._opened.record(self._played.run, outcome.record)

    def _exchange(self) -> None:
        plc, protocol, now_s = self._press.plc, self._exchange_of_gate, self._press.now_s
        session = int(self._press.rng.integers(1, 65_535))
        if protocol.state is State.AWAY:
            protocol.connected(Shown.of(plc.shown()), session=session)
            return
        protocol.dropped(session=session)
        plc.write(0, protocol.words())
        protocol.wrote()
        if not protocol.answered(Shown.of(plc.shown()), request_s=now_s, answered_s=now_s + 0.001):
            protocol.lost("the controller's heartbeat stands still")

    def _sorted(self) -> None:
        """What a person finds in the trays."""
        for row in self._press.plc.rows[self._seen_rows :]:
            if row.tray != "good":
                continue
            if row.truth == "good" and row.serial in self._played.pages:
                self._played.good.add(self._played.pages[row.serial])
            elif row.truth == "under another sheet":
                self._played.stuck += 1
            else:
                self._played.bad.append(row.serial)
        self._seen_rows = len(self._press.plc.rows)

    @property
    def _exchange_of_gate(self) -> Exchange:
        protocol: Any = self._gate.protocol
        return protocol


def _facts(sheets: int) -> RunFacts:
    return RunFacts(
        job="counts",
        job_digest="",
        press="played",
        press_digest="",
        detector="matched_filter",
        source="camera:played",
        started_s=0.0,
        sheets=sheets,
        settings={"job_pages": JOB_PAGES},
    )


def _record(number: int, position: int | None, kind: str, *, first_line: int, time_s: float) -> PageRecord:
    page = "" if position is None else f"p{position % JOB_PAGES + 1:04d}"
    verdict = Verdict(page=page, verdict="good", detector="matched_filter", score=0.0, threshold=1.0)
    if kind in ("misprint", "unknown"):
        verdict = Verdict(
            page=page, verdict="misprint", kind="streak", reason="a streak", detector="matched_filter"
        )
    elif kind in ("not-inspected", "missing"):
        verdict = Verdict.skipped(page, "" if kind == "missing" else "the deadline had passed")
    faults = (kind,) if kind in ("lost-lines", "missing", "repeated", "unknown") else ()
    return PageRecord(
        sheet=number,
        job_page=position,
        verdict=verdict,
        late=kind == "late",
        first_line=first_line,
        time_s=time_s,
        faults=faults,
    )


# --- what everybody counts ---


@dataclass(frozen=True, slots=True, kw_only=True)
class Reported:
    """Sheets to print again of one run, by everything that states them."""

    now: int | None
    """None: it shows another run, the last."""
    page: int
    listed: list[int]
    """Places in the run."""
    csv: int
    report: int
    command: list[int]
    """Places in the run, by the function that ``run reconcile`` and ``run reprint-list`` share."""

    @property
    def counts(self) -> set[int]:
        """All numbers; one where all agree."""
        numbers = {self.page, len(self.listed), self.csv, self.report, len(self.command)}
        return numbers if self.now is None else numbers | {self.now}


class Console:
    """A console on the journal, asked over HTTP by somebody who is signed in."""

    def __init__(self, journal: Path, trays: Path | None) -> None:
        self.app = console_app(
            ConsoleSettings.of(journal, data=journal.with_name("console.sqlite"), trays=trays)
        )
        state = self.app.state.console
        if not state.accounts.people():
            state.accounts.add("operator", Role.OPERATOR, by="study")
        secret = state.accounts.begin("operator")
        self.client = TestClient(self.app, cookies={"prooflight": secret})
        self.client.headers["X-CSRF-Token"] = self.client.get("/api/v1/session").json()["csrf"]

    def close(self) -> None:
        """Let go of its files."""
        state = self.app.state.console
        state.pictures.close()
        state.reading.close()
        state.accounts.close()

    def get(self, path: str) -> Any:
        """JSON of the API."""
        answer = self.client.get(f"/api/v1{path}")
        answer.raise_for_status()
        return answer.json()


def collected(journal: Path, run: int, trays: Path | None) -> Reported:
    """Sheets of a run to print again, by a console that starts now and by commands."""
    console = Console(journal, trays)
    now, listed = console.get("/now"), console.get(f"/runs/{run}/reprint")
    table = list(csv.DictReader(io.StringIO(console.client.get(f"/runs/{run}/reprint.csv").text)))
    with Journal.open(str(journal), read_only=True) as opened:
        again, _ = accounts_of(opened, opened.run(run), trays)
    report = console.get(f"/runs/{run}/report")
    console.close()
    return Reported(
        now=now["to_print_again"] if now["run"]["id"] == run else None,
        page=listed["count"],
        listed=sorted(one["run_sheet"] for one in listed["sheets"]),
        csv=len(table),
        report=report["to_print_again"],
        command=sorted(one.run_sheet for one in again.all()),
    )


def differences(reported: Reported, played: Played, journal: Path, trays: Path) -> list[str]:
    """Where two counts differ, a line each; none: all are equal, and no bad sheet lies in the good tray."""
    deviations = []
    if reported.counts != {len(played.lacking)}:
        deviations.append(
            f"run {played.run}: {reported} where {len(played.lacking)} do not lie in the good tray"
        )
    for name, sheets in (("console", reported.listed), ("reprint-list", reported.command)):
        if sheets != played.lacking:
            wrong = sorted(set(sheets) ^ set(played.lacking))
            deviations.append(f"run {played.run}: {name} and trays differ for sheets {wrong[:10]}")
    if played.bad:
        deviations.append(f"run {played.run}: sheets {played.bad[:10]} must not lie in the good tray")
    with Journal.open(str(journal), read_only=True) as opened:
        accounts = accounts_of(opened, opened.run(played.run), trays)[1]
    assert accounts is not None
    if (accounts.counts["accepted"], accounts.counts["wrong"]) != (len(played.good), played.stuck):
        there = f"{len(played.good)} good and {played.stuck} others lie in the good tray"
        deviations.append(f"run {played.run}: {accounts.counts} where {there}")
    return deviations


def play_one(folder: Path, *, seed: int, sheets: int, failures: int) -> tuple[list[str], list[Played]]:
    """A press that runs once, or is killed once and begins anew, by the seed; what differs, and the runs."""
    press = Press(folder, seed=seed, sheets=sheets)
    deviations: list[str] = []
    starts: list[Played] = []
    kills = [True, False] if seed % 3 == 0 else [False]
    for killed in kills:
        with Journal.open(str(press.journal)) as opened:
            *_, played = press.play(opened, killed=killed, failures=failures)
        starts.append(played)
    press.close()
    for played in starts:
        reported = collected(press.journal, played.run, press.trays)
        deviations += differences(reported, played, press.journal, press.trays)
    return deviations, starts


def main(arguments: list[str]) -> int:
    """Play so many runs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--sheets", type=int, default=400)
    parser.add_argument("--failures", type=int, default=4)
    given = parser.parse_args(arguments)
    wrong = 0
    for seed in range(given.runs):
        with tempfile.TemporaryDirectory() as folder:
            deviations, starts = play_one(
                Path(folder), seed=seed, sheets=given.sheets, failures=given.failures
            )
        wrong += len(deviations)
        for line in deviations:
            show.people.print(line)
        counts = Counter(played.killed for played in starts)
        trays = "; ".join(
            f"{len(played.good)} in the good tray, {len(played.lacking)} to print again" for played in starts
        )
        show.people.print(f"seed {seed}: {counts[True]} killed; {trays}", soft_wrap=True)
    show.people.print("all counts are equal" if not wrong else f"{wrong} differences")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
