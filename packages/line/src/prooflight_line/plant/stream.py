"""The stream of events: built from the reports of a run, numbered, and passed to all listeners."""

from __future__ import annotations

import secrets
import threading
import time
from typing import TYPE_CHECKING, Final, Literal

from prooflight_line.plant.events import (
    Body,
    Event,
    IncidentChanged,
    IncidentEnded,
    IncidentOpened,
    RunEnded,
    SheetAtGate,
    StateChanged,
    incident_facts,
    noticed,
    run_started,
    sheet_judged,
)
from prooflight_line.run.incidents import Incidents

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.pages.layout.plan import SheetPlan
    from prooflight_line.journal.records import Ending, RunFacts
    from prooflight_line.run.incidents import Direction, IncidentChange
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.outcomes import Outcome

INSPECTION_STATES: Final = {"overloaded": "overloaded", "in-time": "in-time"}
"""State of the inspection that each kind of notice reports."""
CAMERA_STATES: Final = {
    "silent": "silent",
    "lines-again": "delivering",
    "camera-away": "away",
    "camera-back": "delivering",
}
"""State of the camera that each kind of notice reports."""


class EventStream:
    """Events of one run. Its methods may be called from any thread; none waits for the listeners."""

    def __init__(
        self,
        listeners: Sequence[Callable[[Event], None]],
        *,
        press: str,
        run: int | None = None,
        size_mm: tuple[float, float] | None = None,
        plan: SheetPlan | None = None,
        stream: str | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Begin a stream.

        Parameters
        ----------
        listeners
            Functions that receive every event in order, one at a time. They must not wait.
        run
            Number of the run in the journal.
        size_mm
            Width and height of a sheet, used in descriptions of positions.
        plan
            How the job is imposed on sheets; None: one page a sheet.
        stream
            Identifier of the stream; None: a new random one.
        """
        self._listeners = tuple(listeners)
        self._press, self._run, self._clock = press, run, clock
        self._stream = secrets.token_hex(8) if stream is None else stream
        self._guard = threading.RLock()
        self._number = 0
        self._incidents, self._size_mm, self._plan = Incidents(size_mm), size_mm, plan
        self._moving: dict[int, Direction] = {}
        """Direction that was last reported for each open incident."""
        self._states: dict[str, tuple[str, str]] = {}
        self._counts = dict.fromkeys(("good", "misprint", "not-inspected", "late", "incidents"), 0)

    @property
    def incidents(self) -> Incidents:
        """Incidents of the run so far."""
        return self._incidents

    def publish(self, body: Body) -> Event:
        """Publish an event with this body, and return it."""
        with self._guard:
            self._number += 1
            event = Event(
                stream=self._stream,
                number=self._number,
                time_s=self._clock(),
                press=self._press,
                run=self._run,
                body=body,
            )
            for listener in self._listeners:
                listener(event)
            return event

    def started(self, facts: RunFacts) -> None:
        """Publish that the run begins."""
        self.publish(run_started(facts, self._size_mm))

    def observe(self, outcome: Outcome) -> None:
        """Publish the outcome of the next sheet, in the order of the run."""
        record = outcome.record
        with self._guard:
            changes = self._incidents.add(record)
            for change in changes:
                if change.what == "ended":
                    self._changed(change)
            mine = [change for change in changes if change.what != "ended"]
            number = mine[0].incident.number if mine else None
            if outcome.came:
                self._counts[record.verdict.verdict] += 1
            self._counts["late"] += record.late
            self.publish(sheet_judged(outcome, incident=number, plan=self._plan))
            for change in mine:
                self._changed(change)

    def at_gate(self, passed: SheetAtGate) -> None:
        """Publish that a sheet has passed the gate."""
        self.publish(passed)

    def noticed(self, notice: Notice) -> None:
        """Publish a notice that belongs to no sheet."""
        with self._guard:
            self.publish(noticed(notice))
            if notice.kind in CAMERA_STATES:
                self.state("camera", CAMERA_STATES[notice.kind], notice.text)
            if notice.kind in INSPECTION_STATES:
                self.state("inspection", INSPECTION_STATES[notice.kind], notice.text)

    def state(
        self, of: Literal["press", "camera", "inspection", "gate"], state: str, detail: str = ""
    ) -> None:
        """Publish a state if it differs from the last one."""
        with self._guard:
            if self._states.get(of) == (state, detail):
                return
            self._states[of] = state, detail
            self.publish(StateChanged(of=of, state=state, detail=detail))

    def ended(self, ending: Ending, detail: str = "") -> None:
        """Publish that the run is over, and that its incidents are."""
        with self._guard:
            for change in self._incidents.finish():
                self._changed(change)
            self._counts["incidents"] = self._incidents.number
            self.publish(RunEnded(ending=ending, detail=detail, counts=dict(self._counts)))

    def _changed(self, change: IncidentChange) -> None:
        """Publish a change of an incident if it is news.

        Of a streak on four hundred sheets, nine are news: events follow each doubling of the count and each
        new direction.
        """
        incident, facts = change.incident, incident_facts(change.incident)
        way: Direction = "unknown" if incident.score is None else incident.score.direction
        moves = way in ("grows", "shrinks") and self._moving.get(incident.number) != way
        if moves:
            self._moving[incident.number] = way
        match change.what:
            case "opened":
                self.publish(IncidentOpened(incident=facts))
            case "ended":
                self._moving.pop(incident.number, None)
                self.publish(IncidentEnded(incident=facts))
            case "returned":
                self.publish(IncidentChanged(returned=True, incident=facts))
            case "grew" if moves or incident.count & (incident.count - 1) == 0:
                self.publish(IncidentChanged(returned=False, incident=facts))
