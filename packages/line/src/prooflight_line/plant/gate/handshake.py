"""The handshake with the controller as a table of states and transitions.

    away -> joining -> aligning -> ready
      ^________|__________|_________|

The link follows this table, and the picture in docs/reference/registers.md is drawn from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class State(StrEnum):
    """State of the handshake."""

    AWAY = "away"
    """There is no connection, or no answer in time."""
    JOINING = "joining"
    """The link is connected; the controller has not yet taken this session."""
    ALIGNING = "aligning"
    """The session is taken; the encoder is not yet aligned with the lines."""
    READY = "ready"
    """Results are written, and acknowledged one by one."""


class Event(StrEnum):
    """Event that changes the state."""

    CONNECTED = "the map is correct"
    TAKEN = "session_taken = session"
    ALIGNED = "encoder and lines agree"
    MISALIGNED = "encoder and lines do not agree"
    DROPPED = "session_taken is another"
    LOST = "no answer in time, or plc_heartbeat has stopped"


@dataclass(frozen=True, slots=True)
class Transition:
    """Transition from one state to the next."""

    state: State
    event: Event
    then: State


HANDSHAKE: Final = (
    Transition(State.AWAY, Event.CONNECTED, State.JOINING),
    Transition(State.JOINING, Event.TAKEN, State.ALIGNING),
    Transition(State.JOINING, Event.LOST, State.AWAY),
    Transition(State.ALIGNING, Event.ALIGNED, State.READY),
    Transition(State.ALIGNING, Event.DROPPED, State.JOINING),
    Transition(State.ALIGNING, Event.LOST, State.AWAY),
    Transition(State.READY, Event.MISALIGNED, State.ALIGNING),
    Transition(State.READY, Event.DROPPED, State.JOINING),
    Transition(State.READY, Event.LOST, State.AWAY),
)
_NEXT: Final = {(one.state, one.event): one.then for one in HANDSHAKE}


def after(state: State, event: Event) -> State:
    """Return the next state; an event for which the state has no transition leaves it as it is."""
    return _NEXT.get((state, event), state)
