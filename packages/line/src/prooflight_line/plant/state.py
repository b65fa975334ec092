"""State of press, run and incidents, accumulated from the events so far, for receivers that join late."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

from prooflight_line.journal.schema import finite
from prooflight_line.plant.events import (
    EventsLost,
    IncidentChanged,
    IncidentEnded,
    IncidentOpened,
    Noticed,
    RunEnded,
    RunStarted,
    SheetAtGate,
    SheetJudged,
    StateChanged,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight_line.plant.events import Event, IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """State of the plant after some events."""

    stream: str = ""
    number: int = 0
    """Number of the last event that the state includes."""
    time_s: float = 0.0
    press: str = ""
    run: int | None = None
    job: str = ""
    simulated: bool = False
    """Whether the run's press is the simulated one."""
    running: bool = False
    """Whether a run has started and not ended."""
    ending: str | None = None
    """How the last run ended; None: it has not. lost: Prooflight is gone without having reported the end."""
    states: Mapping[str, str] = field(default_factory=dict)
    """States of press, camera, inspection and gate, as far as they have been reported."""
    sheets: int = 0
    """Number of sheets judged since the run's start, as far as their events arrived."""
    good: int = 0
    misprints: int = 0
    not_inspected: int = 0
    last_sheet: int | None = None
    held: int = 0
    """Number of sheets whose disposition is hold."""
    in_good_tray: int = 0
    """Number of sheets that the controller has confirmed to be in the good tray."""
    in_reject_tray: int = 0
    unconfirmed: int = 0
    """Number of sheets that passed the gate without a report of the controller."""
    incidents: Mapping[int, IncidentFacts] = field(default_factory=dict)
    """Open incidents, by number."""

    def after(self, event: Event) -> PlantState:
        """Return the state after one more event."""
        now = replace(
            self,
            stream=event.stream,
            number=event.number,
            time_s=event.time_s,
            press=event.press,
            run=event.run,
        )
        match event.body:
            case RunStarted(job=job, simulated=simulated):
                return PlantState(
                    stream=now.stream,
                    number=now.number,
                    time_s=now.time_s,
                    press=now.press,
                    run=now.run,
                    states=now.states,
                    job=job,
                    simulated=simulated,
                    running=True,
                )
            case RunEnded(ending=ending):
                return replace(now, running=False, ending=ending, incidents={})
            case SheetJudged() as sheet:
                counted = sheet.came
                return replace(
                    now,
                    sheets=now.sheets + counted,
                    good=now.good + (sheet.verdict == "good"),
                    misprints=now.misprints + (sheet.verdict == "misprint"),
                    not_inspected=now.not_inspected + (counted and sheet.verdict == "not-inspected"),
                    last_sheet=sheet.sheet,
                    held=now.held + (counted and sheet.disposition == "hold"),
                )
            case SheetAtGate(tray=tray):
                return replace(
                    now,
                    in_good_tray=now.in_good_tray + (tray == "good"),
                    in_reject_tray=now.in_reject_tray + (tray == "reject"),
                    unconfirmed=now.unconfirmed + (tray == "unconfirmed"),
                )
            case IncidentOpened(incident=incident) | IncidentChanged(incident=incident):
                return replace(now, incidents={**now.incidents, incident.number: incident})
            case IncidentEnded(incident=incident):
                left = {number: one for number, one in now.incidents.items() if number != incident.number}
                return replace(now, incidents=left)
            case StateChanged(of=of, state=state):
                return replace(now, states={**now.states, of: state})
            case Noticed() | EventsLost():
                return now
        return now

    def json(self) -> str:
        """Return the state as JSON, with the open incidents as a list."""
        document = asdict(self) | {"incidents": [asdict(one) for one in self.incidents.values()]}
        return json.dumps(finite(document), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
