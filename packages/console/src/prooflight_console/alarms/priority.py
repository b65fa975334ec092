"""Priority of an alarm: by what it costs, and by whether it goes on.

An alarm is an incident. It costs a sheet wherever the disposition is not `accept`. It goes on while it is open and
recurs on at least ``GOES_ON`` of the last ``RECENT`` sheets. ISA-18.2 recommends three priorities, given by the
consequence and by the time to respond.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Final

from prooflight_line.run.incidents import (
    CAMERA_GONE,
    ENDS_AFTER,
    LATE,
    LOST_LINES,
    NO_MISPRINT,
    NOT_INSPECTED,
)

if TYPE_CHECKING:
    from prooflight_line.run.incidents import Incident

RECENT: Final = ENDS_AFTER
"""Number of last sheets of the run that show whether an alarm goes on."""
GOES_ON: Final = 3
"""Least number of these sheets. assumed: one is an accident, two may be the two sides of one sheet, and three of
twenty waste 15 % of the paper."""
BLIND: Final = frozenset({LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE})
"""Kinds of incidents in which sheets were not inspected, or too late."""


class Priority(StrEnum):
    """Priority of an alarm."""

    HIGH = "high"
    """Priority of an alarm that costs sheets as long as nobody acts."""
    MEDIUM = "medium"
    """Priority of an alarm that cost single sheets, which a person has to look at."""
    LOW = "low"
    """Priority of an alarm that needs no action: it costs nothing, or its sheets were diverted."""

    @property
    def rank(self) -> int:
        """Position in the order of urgency, from 0 for the most urgent."""
        return list(Priority).index(self)


def recent_sheets(incident: Incident, newest: int) -> int:
    """Return how many of the last ``RECENT`` sheets belong to an incident. newest: last sheet of the run."""
    return sum(sheet > newest - RECENT for sheet in set(incident.sheets))


def priority(incident: Incident, recent: int) -> Priority:
    """Return the priority of an incident; recent: as ``recent_sheets`` gives it.

    High: it costs sheets and goes on, as a misprint or because sheets are not inspected. Medium: it is open and
    cost sheets, or it has ended and its sheets may lie among the good ones. Low: all others.
    """
    if incident.disposition == "accept":
        return Priority.LOW
    needs_action = incident.kind in BLIND or incident.kind not in NO_MISPRINT
    if incident.open and recent >= GOES_ON and needs_action:
        return Priority.HIGH
    return Priority.MEDIUM if incident.open or incident.disposition != "divert" else Priority.LOW
