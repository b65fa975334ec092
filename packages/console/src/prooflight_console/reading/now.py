"""The current state of the press: one state, open incidents, and actions that are due."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight.detectors.disposition import LEAST_FIRST
from prooflight_line.journal.exporting import job_warnings
from prooflight_line.run.pace import overload

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.inspection.sheets import Counts
    from prooflight_console.reading.gate_health import GateHealth
    from prooflight_console.reading.incidents import LabelledIncident
    from prooflight_console.reading.reprints import Counted
    from prooflight_line.journal.records import PageRecord, RunRow

State = Literal[
    "no-run", "waiting", "good", "overload", "stop", "look", "silent", "ended", "fault", "interrupted"
]
"""State of the press.

waiting: for the first sheet. overload: inspection does not keep pace with the press. stop: an alarm advises
to stop, and nobody has answered. look: another alarm is open or unanswered. silent: no sheet comes. fault,
interrupted, ended: how the run ended.
"""
SILENT_S: Final = 10.0
"""Time without a sheet after which the camera is reported as silent, as ``watch`` does. [s]"""
RECENT: Final = 100
"""Number of last sheets from which the health of camera and verdicts is computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Health of the camera and of the inspection, by the last sheets."""

    sheets: int
    lost_lines: int
    """Number of sheets with lines that the camera lost."""
    not_inspected: int
    late: int
    faults: int
    """Number of sheets with any fault of the paper path."""
    sheets_per_s: float | None
    """Rate by the source's clock; None if there are too few sheets."""
    inspection_ms: float | None
    """Median inspection time. [ms]"""
    quiet_s: float | None
    """Time since the console last saw a new sheet; None if the run has ended. [s]"""

    @property
    def camera(self) -> Literal["good", "look", "bad", "off"]:
        """State of the camera's lamp, by lost lines and silence."""
        if self.quiet_s is None or not self.sheets:
            return "off"
        if self.quiet_s > SILENT_S:
            return "bad"
        return "look" if self.lost_lines else "good"

    @property
    def inspection(self) -> Literal["good", "look", "bad", "off"]:
        """State of the inspection's lamp, by late sheets and sheets that were not inspected."""
        if self.quiet_s is None or not self.sheets:
            return "off"
        if self.not_inspected * 10 > self.sheets:
            return "bad"
        return "look" if self.not_inspected or self.late else "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Now:
    """Current state of the last run."""

    state: State
    run: RunRow | None
    cause: LabelledIncident | None
    """The most urgent incident; None if none needs action."""
    incidents: tuple[LabelledIncident, ...]
    """Incidents that are open or not answered, the most urgent first."""
    reprints: Counted
    """Counts of sheets to print again."""
    health: Health
    together: Counts | None = None
    """Counts of sheets and sets; None if every page is a sheet of its own, and belongs to no set."""
    gate: GateHealth | None = None
    """Health of the gate; None if the run has no gate."""
    overload: tuple[int, int] | None = None
    """Late sheets, and how many of the last they are of; None if inspection keeps pace."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the run's job, a line each."""
        return () if self.run is None else job_warnings(self.run)

    @property
    def alarm(self) -> bool:
        """Whether the alarm should sound."""
        stops = any(
            not labelled.seen and labelled.incident.disposition == "stop" for labelled in self.incidents
        )
        return stops or self.state == "overload"


def health(pages: Sequence[PageRecord], *, quiet_s: float | None) -> Health:
    """Return the health by the last sheets, which are in order."""
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
    incidents: Sequence[LabelledIncident],
    pages: Sequence[PageRecord],
    *,
    quiet_s: float,
    reprints: Counted,
    together: Counts | None = None,
    gate: GateHealth | None = None,
) -> Now:
    """Return the current state of the press; incidents: all of the run; pages: its last ones."""
    going = run is not None and run.state == "running"
    pending = sorted((labelled for labelled in incidents if _needs_action(labelled)), key=_urgency)
    last = health(pages, quiet_s=quiet_s if going else None)
    slow = overload(pages)
    state: State = "no-run"
    if run is not None:
        urgent = pending[0] if pending else None
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
        elif last.camera == "bad":
            state = "silent"
        else:
            state = "look" if pending else "good"
    return Now(
        state=state,
        run=run,
        cause=pending[0] if pending else None,
        incidents=tuple(pending),
        reprints=reprints,
        health=last,
        together=together,
        gate=gate,
        overload=slow,
    )


def _needs_action(labelled: LabelledIncident) -> bool:
    """Return whether an incident needs action.

    It does if nobody has seen it, if a label does not cover its last sheets, or if it is open and no false
    alarm.
    """
    if not labelled.seen or (labelled.label is not None and not labelled.answered):
        return True
    return labelled.incident.open and labelled.word != "false-alarm"


def _urgency(labelled: LabelledIncident) -> tuple[bool, int, bool, int]:
    incident = labelled.incident
    return labelled.seen, -LEAST_FIRST.index(incident.disposition), not incident.open, -incident.last_sheet
