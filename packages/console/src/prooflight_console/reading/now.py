"""The current state of the press: one state, open incidents, and actions that are due."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight_console.alarms.grouping import flood, single_and_grouped
from prooflight_console.alarms.priority import BLIND, GOES_ON, Priority
from prooflight_console.reading.incidents import next_alarm
from prooflight_line.journal.exporting import job_warnings
from prooflight_line.run.pace import overload

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.inspection.sheets import Counts
    from prooflight_console.alarms.alarm_store import Handover
    from prooflight_console.alarms.grouping import Group
    from prooflight_console.reading.gate_health import GateHealth
    from prooflight_console.reading.incidents import LabelledIncident
    from prooflight_console.reading.reprints import Counted
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.journal.run_control import Starter
    from prooflight_line.journal.start import Start

State = Literal[
    "no-run",
    "waiting",
    "good",
    "overload",
    "stop",
    "blind",
    "look",
    "silent",
    "ended",
    "fault",
    "interrupted",
]
"""State of the press.

waiting: for the first sheet, of a run that has started or starts. overload: inspection does not keep pace with the
press. stop: misprints go on, of one cause or of several, and the press has not stopped since somebody saw them.
blind: sheets are not inspected, one after the other. look: an alarm of medium priority needs action. good: none
does, though one of low priority may. silent: no sheet comes. fault, interrupted, ended: how the run ended.
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
    """Incidents that need action and are not shelved, the most urgent first."""
    shelved: tuple[LabelledIncident, ...]
    """Incidents that a person shelved, those that end first in front."""
    flood: bool
    """Whether more alarms began in the last ten minutes than a person can answer."""
    reprints: Counted
    """Counts of sheets to print again."""
    health: Health
    layout_counts: Counts | None = None
    """Counts of sheets and sets; None if every page is a sheet of its own, and belongs to no set."""
    gate: GateHealth | None = None
    """Health of the gate; None if the run has no gate."""
    handover: Handover | None = None
    """The last note of hand-over, if it is of the last shift."""
    start: Start | None = None
    """How far the start of the next run has got; None: nothing starts."""
    stopping: str = ""
    """Who asked for the end of the run, which goes on until then; empty: nobody."""
    starter: Starter | None = None
    """What starts jobs when people ask for it; None: nothing does."""
    overload: tuple[int, int] | None = None
    """Late sheets, and how many of the last they are of; None if inspection keeps pace."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the run's job, a line each."""
        return () if self.run is None else job_warnings(self.run)

    @property
    def goes_on(self) -> bool:
        """Whether a process watches the run."""
        return self.run is not None and self.run.state == "running"

    @property
    def alarm(self) -> bool:
        """Whether the alarm should sound."""
        return self.state == "overload" or (self.state in ("stop", "blind") and self.unseen_costly > 0)

    @property
    def unseen_costly(self) -> int:
        """Number of incidents of more than low priority that nobody has seen."""
        return sum(not one.seen and one.priority is not Priority.LOW for one in self.incidents)

    @property
    def affected(self) -> int:
        """Number of the last sheets that these incidents cost, whatever the causes."""
        return _affected(self.incidents)

    @property
    def unseen(self) -> int:
        """Number of incidents that nobody has seen."""
        return sum(not one.seen for one in self.incidents)

    @property
    def upto(self) -> int:
        """Last sheet of these incidents: an acknowledgement of all covers no later one."""
        return max((one.incident.last_sheet for one in self.incidents), default=0)

    @property
    def next(self) -> LabelledIncident | None:
        """The incident to look at next."""
        return next_alarm(self.incidents)

    @property
    def shown(self) -> tuple[list[LabelledIncident], list[Group]]:
        """Incidents that are shown one by one, and the groups of all others."""
        return single_and_grouped(self.incidents, flooded=self.flood)


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
    layout_counts: Counts | None = None,
    gate: GateHealth | None = None,
    begun_s: Sequence[float] = (),
    handover: Handover | None = None,
    start: Start | None = None,
    stopping: str = "",
    starter: Starter | None = None,
) -> Now:
    """Return the current state of the press.

    Parameters
    ----------
    incidents
        All of the run.
    pages
        Its last ones.
    begun_s
        Times at which alarms began or returned, by the source's clock, in order. [s]
    """
    going = run is not None and run.state == "running"
    pending = sorted(
        (one for one in incidents if one.needs_action and not one.shelved), key=lambda one: one.urgency
    )
    shelved = [one for one in incidents if one.shelved]
    last = health(pages, quiet_s=quiet_s if going else None)
    slow = overload(pages)
    stands = last.camera == "bad"
    state: State = "no-run"
    if run is not None:
        urgent = pending[0] if pending else None
        if going and slow is not None:
            state = "overload"
        elif going and urgent is not None and _affected(pending) >= GOES_ON and not (stands and urgent.seen):
            state = "blind" if urgent.incident.kind in BLIND else "stop"
        elif run.state in ("fault", "interrupted"):
            state = "fault" if run.state == "fault" else "interrupted"
        elif not going:
            state = "ended"
        elif not pages:
            state = "waiting"
        elif stands:
            state = "silent"
        else:
            state = "look" if any(one.priority is not Priority.LOW for one in pending) else "good"
    if start is not None and not (going and pages):
        state = "waiting"
    return Now(
        state=state,
        start=start,
        stopping=stopping,
        starter=starter,
        run=run,
        cause=pending[0] if pending else None,
        incidents=tuple(pending),
        shelved=tuple(sorted(shelved, key=_ends_s)),
        flood=bool(pages) and going and flood(begun_s, pages[-1].time_s),
        reprints=reprints,
        health=last,
        layout_counts=layout_counts,
        gate=gate,
        handover=handover,
        overload=slow,
    )


def _affected(pending: Sequence[LabelledIncident]) -> int:
    """Return how many of the last sheets incidents cost; each sheet belongs to one incident."""
    costly = (one for one in pending if one.priority is not Priority.LOW)
    return sum(one.recent for one in costly if one.of_misprints or one.incident.kind in BLIND)


def _ends_s(one: LabelledIncident) -> float:
    assert one.shelving is not None
    return one.shelving.ends_s
