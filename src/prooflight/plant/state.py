"""How press, run and incidents stand, folded from the events so far: what whoever joins late must know first."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

from prooflight.plant.events import (
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
    finite,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.plant.events import Event, IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """After some events."""

    stream: str = ""
    number: int = 0
    """Of the last event that is in it."""
    time_s: float = 0.0
    press: str = ""
    run: int | None = None
    job: str = ""
    simulated: bool = False
    """Whether the run's press is the simulated one."""
    running: bool = False
    """From the run's start to its end."""
    ending: str | None = None
    """How the last run ended; None: it has not. lost: Prooflight is gone without having said so."""
    states: Mapping[str, str] = field(default_factory=dict)
    """Of press, camera, inspection and gate, as far as they have been told."""
    sheets: int = 0
    """Judged since the run's start, as far as their events arrived."""
    good: int = 0
    misprints: int = 0
    not_inspected: int = 0
    last_sheet: int | None = None
    held: int = 0
    """Sheets of which the disposition is hold."""
    in_good_tray: int = 0
    """Sheets of which the controller has confirmed that they went to the good tray."""
    in_reject_tray: int = 0
    unconfirmed: int = 0
    """Sheets that passed the gate without a word of the controller."""
    incidents: Mapping[int, IncidentFacts] = field(default_factory=dict)
    """That are open, by number."""

    def after(self, event: Event) -> PlantState:
        """With one more event."""
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
        """For people's programs; open incidents as a list."""
        told = asdict(self) | {"incidents": [asdict(one) for one in self.incidents.values()]}
        return json.dumps(finite(told), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
