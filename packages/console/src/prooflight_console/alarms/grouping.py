"""Display of a flood of alarms: the most urgent one by one, the others in groups, and none left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, TypeVar

from prooflight_console.alarms.statistics import FLOOD_BEGINS, PERIOD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_console.alarms.priority import Priority
    from prooflight_line.run.incidents import Incident

MOST_SINGLE: Final = 12
"""Number of alarms that are shown one by one outside a flood. assumed: two screens of the page Now."""
MOST_SINGLE_IN_FLOOD: Final = 4
"""Number of alarms that are shown one by one in a flood. assumed: those that fit on one screen."""


class Alarm(Protocol):
    """What is needed of an alarm."""

    @property
    def incident(self) -> Incident:
        """The incident."""

    @property
    def priority(self) -> Priority:
        """Its priority."""


A = TypeVar("A", bound=Alarm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Alarms of one priority and kind."""

    priority: Priority
    kind: str
    alarms: int
    standing: int
    """Number of them that go on."""
    sheets: int


def flood(times_s: Sequence[float], now_s: float) -> bool:
    """Return whether more than ``FLOOD_BEGINS`` alarms began within the last ``PERIOD_S``; times in order. [s]"""
    return sum(now_s - PERIOD_S < at_s <= now_s for at_s in times_s[-FLOOD_BEGINS - 1 :]) > FLOOD_BEGINS


def single_and_grouped(alarms: Sequence[A], *, flooded: bool) -> tuple[list[A], list[Group]]:
    """Return the alarms to show one by one, and groups of all others; alarms: the most urgent first."""
    single = MOST_SINGLE_IN_FLOOD if flooded else MOST_SINGLE
    rest: dict[tuple[Priority, str], list[Incident]] = {}
    for one in alarms[single:]:
        rest.setdefault((one.priority, one.incident.kind), []).append(one.incident)
    groups = [
        Group(
            priority=level,
            kind=kind,
            alarms=len(incidents),
            standing=sum(one.open for one in incidents),
            sheets=sum(one.count for one in incidents),
        )
        for (level, kind), incidents in rest.items()
    ]
    return list(alarms[:single]), sorted(groups, key=lambda group: (group.priority.rank, -group.alarms))
