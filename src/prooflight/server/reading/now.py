"""The press at this moment: one state, what is open, what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight.detectors.disposition import LEAST_FIRST
from prooflight.journal.exporting import job_warnings
from prooflight.line.pace import overload

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.inspection.sheets import Counts
    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.reading.gate_health import GateHealth
    from prooflight.server.reading.incidents import Told
    from prooflight.server.reading.reprints import Counted

State = Literal[
    "no-run", "waiting", "good", "overload", "stop", "look", "silent", "ended", "fault", "interrupted"
]
"""waiting: for the first sheet. overload: inspection does not keep pace with the press. stop: an alarm advises to stop,
and nobody has answered. look: another alarm is open or unanswered. silent: no sheet comes. fault, interrupted, ended:
how the run came to its end."""
SILENT_S: Final = 10.0
"""Without a sheet, as ``watch`` says it of a camera."""
RECENT: Final = 100
"""Sheets by which the health of camera and verdicts is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """What the last sheets say of the camera and of the inspection."""

    sheets: int
    lost_lines: int
    """Sheets of which the camera lost lines."""
    not_inspected: int
    late: int
    faults: int
    """Sheets with any fault of the paper path."""
    sheets_per_s: float | None
    """By the source's clock; None: too few sheets."""
    inspection_ms: float | None
    """Median of the time that a verdict took."""
    quiet_s: float | None
    """Since the console last saw a new sheet; None: the run is not going on."""

    @property
    def camera(self) -> Literal["good", "look", "bad", "off"]:
        """Of its lines."""
        if self.quiet_s is None or not self.sheets:
            return "off"
        if self.quiet_s > SILENT_S:
            return "bad"
        return "look" if self.lost_lines else "good"

    @property
    def inspection(self) -> Literal["good", "look", "bad", "off"]:
        """Whether every sheet gets its verdict in time."""
        if self.quiet_s is None or not self.sheets:
            return "off"
        if self.not_inspected * 10 > self.sheets:
            return "bad"
        return "look" if self.not_inspected or self.late else "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Now:
    """Of the last run."""

    state: State
    run: RunRow | None
    cause: Told | None
    """The most urgent incident; None: none asks for anything."""
    incidents: tuple[Told, ...]
    """Open, or not answered; the most urgent first."""
    reprints: Counted
    """Sheets to print again."""
    health: Health
    together: Counts | None = None
    """Of sheets and sets; None: every page is a sheet of its own, and belongs to no set."""
    gate: GateHealth | None = None
    """None: the run has no gate."""
    overload: tuple[int, int] | None = None
    """Sheets that inspection was too slow for, and among how many of the last; None: it keeps pace."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of the run's job, a line each."""
        return () if self.run is None else job_warnings(self.run)

    @property
    def alarm(self) -> bool:
        """Whether it should be heard."""
        stops = any(not told.seen and told.incident.disposition == "stop" for told in self.incidents)
        return stops or self.state == "overload"


def health(pages: Sequence[PageRecord], *, quiet_s: float | None) -> Health:
    """Of the last sheets, in order."""
    times = [page.time_s for page in pages]
    span_s = times[-1] - times[0] if len(times) > 1 else 0.0
    took = sorted(page.verdict.milliseconds for page in pages if page.verdict.milliseconds > 0)
    return Health(
        sheets=len(pages),
        lost_lines=sum("lost-lines" in page.faults for page in pages),
        not_inspected=sum(page.verdict.verdict == "not-inspected" for page in pages),
        late=sum(page.late for page in pages),
        faults=sum(bool(page.faults) for page in pages),
        sheets_per_s=(len(times) - 1) / span_s if span_s > 0 else None,
        inspection_ms=took[len(took) // 2] if took else None,
        quiet_s=quiet_s,
    )


def now(
    run: RunRow | None,
    incidents: Sequence[Told],
    pages: Sequence[PageRecord],
    *,
    quiet_s: float,
    reprints: Counted,
    together: Counts | None = None,
    gate: GateHealth | None = None,
) -> Now:
    """Put together. incidents: of the run, all; pages: the last ones."""
    going = run is not None and run.state == "running"
    asked = sorted((told for told in incidents if _asks(told)), key=_urgency)
    of = health(pages, quiet_s=quiet_s if going else None)
    slow = overload(pages)
    state: State = "no-run"
    if run is not None:
        urgent = asked[0] if asked else None
        if going and slow is not None:
            state = "overload"
        elif going and urgent is not None and not urgent.seen and urgent.incident.disposition == "stop":
            state = "stop"
        elif run.state in ("fault", "interrupted"):
            state = "fault" if run.state == "fault" else "interrupted"
        elif not going:
            state = "ended"
        elif not pages:
            state = "waiting"
        elif of.camera == "bad":
            state = "silent"
        else:
            state = "look" if asked else "good"
    return Now(
        state=state,
        run=run,
        cause=asked[0] if asked else None,
        incidents=tuple(asked),
        reprints=reprints,
        health=of,
        together=together,
        gate=gate,
        overload=slow,
    )


def _asks(told: Told) -> bool:
    """Whether somebody should look: nobody has, a label does not cover its last sheets, or it goes on and is no false
    alarm.
    """
    if not told.seen or (told.label is not None and not told.answered):
        return True
    return told.incident.open and told.word != "false-alarm"


def _urgency(told: Told) -> tuple[bool, int, bool, int]:
    incident = told.incident
    return told.seen, -LEAST_FIRST.index(incident.disposition), not incident.open, -incident.last_sheet
