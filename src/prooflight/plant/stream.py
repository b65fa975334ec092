"""The one stream of events: made of what a run says, numbered, and handed to whoever listens."""

from __future__ import annotations

import secrets
import threading
import time
from typing import TYPE_CHECKING, Final, Literal

from prooflight.line.incidents import Incidents
from prooflight.plant.events import (
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

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.journal.records import Ending, RunFacts
    from prooflight.line.incidents import Direction, IncidentChange
    from prooflight.line.notices import Notice
    from prooflight.line.outcomes import Outcome
    from prooflight.pages.layout.plan import SheetPlan

INSPECTION_STATES: Final = {"overloaded": "overloaded", "in-time": "in-time"}
"""What a notice says of the inspection."""
CAMERA_STATES: Final = {
    "silent": "silent",
    "lines-again": "delivering",
    "camera-away": "away",
    "camera-back": "delivering",
}
"""What a notice says of the camera."""


class EventStream:
    """One run's events. Its methods may be called from any thread; none waits for those who listen."""

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
        """listeners: given every event in order, one at a time; they must not wait. run: its number in the journal.

        size_mm: of a sheet, for words. plan: how the job lies on sheets; None: a page a sheet. stream: its
        name; None: one that nobody else has.
        """
        self._listeners = tuple(listeners)
        self._press, self._run, self._clock = press, run, clock
        self._stream = secrets.token_hex(8) if stream is None else stream
        self._guard = threading.RLock()
        self._number = 0
        self._incidents, self._size_mm, self._plan = Incidents(size_mm), size_mm, plan
        self._moving: dict[int, Direction] = {}
        """Which way open incidents were last said to go."""
        self._states: dict[str, tuple[str, str]] = {}
        self._counts = dict.fromkeys(("good", "misprint", "not-inspected", "late", "incidents"), 0)

    @property
    def incidents(self) -> Incidents:
        """Of the run so far."""
        return self._incidents

    def publish(self, body: Body) -> Event:
        """Tell something; returns what was told."""
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
        """The run begins."""
        self.publish(run_started(facts, self._size_mm))

    def told(self, outcome: Outcome) -> None:
        """The next sheet, in the order of the run."""
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
        """A sheet has passed the gate."""
        self.publish(passed)

    def noticed(self, notice: Notice) -> None:
        """Something that is of no sheet."""
        with self._guard:
            self.publish(noticed(notice))
            if notice.kind in CAMERA_STATES:
                self.state("camera", CAMERA_STATES[notice.kind], notice.text)
            if notice.kind in INSPECTION_STATES:
                self.state("inspection", INSPECTION_STATES[notice.kind], notice.text)

    def state(
        self, of: Literal["press", "camera", "inspection", "gate"], state: str, detail: str = ""
    ) -> None:
        """Tell a state, where it is another than before."""
        with self._guard:
            if self._states.get(of) == (state, detail):
                return
            self._states[of] = state, detail
            self.publish(StateChanged(of=of, state=state, detail=detail))

    def ended(self, ending: Ending, detail: str = "") -> None:
        """The run is over, and its incidents with it."""
        with self._guard:
            for change in self._incidents.finish():
                self._changed(change)
            self._counts["incidents"] = self._incidents.number
            self.publish(RunEnded(ending=ending, detail=detail, counts=dict(self._counts)))

    def _changed(self, change: IncidentChange) -> None:
        """Tell of an incident what is news: of four hundred sheets of a streak nine say so."""
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
