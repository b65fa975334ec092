"""Statistics of alarms against the figures of ANSI/ISA-18.2-2016, clause 16 (alarm performance metrics).

An alarm is annunciated when its incident opens and each time that it returns. Rates are per hour of operation, which
is the time that runs took; hours and periods of ten minutes count from the start of each run.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Final

from prooflight_console.alarms.priority import Priority

if TYPE_CHECKING:
    from collections.abc import Sequence

HOUR_S: Final = 3600.0
PERIOD_S: Final = 600.0
"""Period in which a flood is counted. [s] (ISA-18.2)"""
FLOOD_BEGINS, FLOOD_ENDS = 10, 5
"""A flood begins with more than 10 alarms in a period, and ends with fewer than 5 (ISA-18.2)."""
MOST_PER_HOUR: Final = 30
"""Number of alarms in an hour above which the hour counts as overloaded (ISA-18.2)."""
STALE_S: Final = 24 * HOUR_S
"""Time after which a standing alarm is stale. [s] (ISA-18.2)"""
MOST_FREQUENT: Final = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Annunciation:
    """One announcement of an alarm."""

    run: int
    incident: int
    kind: str
    priority: Priority
    """Highest priority that the incident reached."""
    at_s: float
    """Unix time. [s]"""
    acknowledged_s: float | None = None
    """Time until a person acknowledged or labelled the incident; None: nobody did, or it returned before. [s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """Time of operation of one run, within the time of the statistics."""

    run: int
    since_s: float
    """Unix time. [s]"""
    until_s: float
    """Unix time. [s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """Alarm statistics."""

    hours: float
    alarms: int
    most_in_period: int
    """Greatest number of alarms in any ten minutes."""
    periods: int
    """Number of periods of ten minutes."""
    periods_above: int
    """Number of them with more than ``FLOOD_BEGINS`` alarms."""
    periods_in_flood: int
    hours_counted: int
    """Number of whole and begun hours of the runs."""
    hours_above: int
    """Number of them with more than ``MOST_PER_HOUR`` alarms."""
    floods: int
    kinds: dict[str, int]
    """Number of alarms by kind, the most frequent first."""
    priorities: dict[Priority, int]
    most_frequent: int
    """Number of alarms from the ``MOST_FREQUENT`` most frequent incidents."""
    acknowledged: int
    response_s: float | None
    """Median time until an alarm was acknowledged; None: none was. [s]"""

    @property
    def per_hour(self) -> float | None:
        """Alarms per hour of operation; None if there was no operation."""
        return self.alarms / self.hours if self.hours else None

    @property
    def flood_share(self) -> float:
        """Share of the periods that are in a flood."""
        return self.periods_in_flood / self.periods if self.periods else 0.0

    @property
    def hours_above_share(self) -> float:
        """Share of the hours with more than ``MOST_PER_HOUR`` alarms."""
        return self.hours_above / self.hours_counted if self.hours_counted else 0.0

    @property
    def most_frequent_share(self) -> float:
        """Share of the alarms that come from the most frequent incidents."""
        return self.most_frequent / self.alarms if self.alarms else 0.0


def statistics(alarms: Sequence[Annunciation], operations: Sequence[Operation]) -> Statistics:
    """Return the statistics of alarms during these operations; other alarms count for nothing."""
    ordered = sorted(alarms, key=lambda one: one.at_s)
    counted: list[Annunciation] = []
    in_periods: list[int] = []
    floods = in_flood = hours_counted = hours_above = 0
    for operation in operations:
        of_run = [
            one
            for one in ordered
            if one.run == operation.run and operation.since_s <= one.at_s <= operation.until_s
        ]
        counted += of_run
        offsets_s = [one.at_s - operation.since_s for one in of_run]
        span_s = operation.until_s - operation.since_s
        periods = _counts(offsets_s, span_s, PERIOD_S)
        hours = _counts(offsets_s, span_s, HOUR_S)
        begun, periods_in_flood = _floods(periods)
        floods, in_flood = floods + begun, in_flood + periods_in_flood
        in_periods += periods
        hours_counted, hours_above = (
            hours_counted + len(hours),
            hours_above + sum(n > MOST_PER_HOUR for n in hours),
        )
    responses_s = [one.acknowledged_s for one in counted if one.acknowledged_s is not None]
    incidents = Counter((one.run, one.incident) for one in counted)
    priorities = Counter(one.priority for one in counted)
    return Statistics(
        hours=sum(one.until_s - one.since_s for one in operations) / HOUR_S,
        alarms=len(counted),
        most_in_period=most_within([one.at_s for one in counted], PERIOD_S),
        periods=len(in_periods),
        periods_above=sum(count > FLOOD_BEGINS for count in in_periods),
        periods_in_flood=in_flood,
        hours_counted=hours_counted,
        hours_above=hours_above,
        floods=floods,
        kinds=dict(Counter(one.kind for one in counted).most_common()),
        priorities={level: priorities[level] for level in Priority},
        most_frequent=sum(count for _, count in incidents.most_common(MOST_FREQUENT)),
        acknowledged=len(responses_s),
        response_s=median(responses_s) if responses_s else None,
    )


def most_within(times_s: Sequence[float], span_s: float) -> int:
    """Return the greatest number of times within any span of this length."""
    ordered = sorted(times_s)
    return max(
        (at + 1 - bisect_right(ordered, time_s - span_s) for at, time_s in enumerate(ordered)), default=0
    )


def binned(times_s: Sequence[float], since_s: float, until_s: float, bins: int) -> list[int]:
    """Return the number of times in equal parts of a span."""
    counts = [0] * bins
    for time_s in times_s:
        if since_s <= time_s <= until_s:
            counts[min(int((time_s - since_s) / (until_s - since_s) * bins), bins - 1)] += 1
    return counts


def _counts(offsets_s: Sequence[float], span_s: float, part_s: float) -> list[int]:
    """Return the number of alarms in each part of a run, the last of which may be shorter."""
    counts = [0] * max(math.ceil(span_s / part_s), 1)
    for offset_s in offsets_s:
        counts[min(int(offset_s / part_s), len(counts) - 1)] += 1
    return counts


def _floods(periods: Sequence[int]) -> tuple[int, int]:
    """Return the number of floods, and of the periods in them."""
    floods = in_flood = 0
    flooded = False
    for count in periods:
        if not flooded and count > FLOOD_BEGINS:
            flooded, floods = True, floods + 1
        elif flooded and count < FLOOD_ENDS:
            flooded = False
        in_flood += flooded
    return floods, in_flood
