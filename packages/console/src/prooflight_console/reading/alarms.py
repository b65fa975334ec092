"""Alarms of several runs in figures, and the state of the alarms that one shift hands to the next."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight_console.alarms.priority import Priority
from prooflight_console.alarms.statistics import HOUR_S, STALE_S, Operation, binned, statistics

if TYPE_CHECKING:
    from prooflight_console.alarms.statistics import Annunciation, Statistics
    from prooflight_console.reading.incidents import LabelledIncident, RunIncidents
    from prooflight_console.reading.now import Now
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import RunRow

SPANS_H: Final = (8, 24, 168, 720)
"""Times of which statistics are shown: a shift, a day, a week, and the 30 days that ISA-18.2 asks for. [h]"""
MOST_RUNS: Final = 16
"""Greatest number of runs in statistics: as many as ``RunIncidents`` caches."""
BINS: Final = 48
SHIFT_S: Final = 8 * HOUR_S
MOST_STANDING: Final = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmFigures:
    """Alarm statistics of the last runs."""

    statistics: Statistics
    runs: int
    truncated: bool
    """Whether earlier runs of this time were left out."""
    since_s: float
    """Unix time at which the statistics begin. [s]"""
    until_s: float
    """Unix time at which they end. [s]"""
    bins: list[int]
    """Number of alarms in ``BINS`` equal parts of the time."""
    standing: int
    stale: int
    """Number of alarms that have been standing for longer than ``STALE_S``."""
    unseen: int
    shelved: int

    @property
    def facts(self) -> dict[str, Any]:
        """Figures for programs; see ``StatisticsAnswer``."""
        of = self.statistics
        names = ("hours", "alarms", "per_hour", "most_in_period", "periods_above", "flood_share", "floods")
        more = ("hours_above_share", "most_frequent_share", "response_s", "kinds", "priorities")
        own = ("runs", "truncated", "standing", "stale", "unseen", "shelved")
        return {name: getattr(of, name) for name in (*names, *more)} | {
            name: getattr(self, name) for name in own
        }


def alarm_figures(reading: Reading, incidents: RunIncidents, *, hours: float, now_s: float) -> AlarmFigures:
    """Return the statistics of the runs of the last hours; now_s: Unix time. [s]"""
    since_s = now_s - hours * HOUR_S
    operations: list[Operation] = []
    alarms: list[Annunciation] = []
    labelled: list[LabelledIncident] = []
    standing_s: list[float] = []
    runs = reading.runs(before=None, limit=MOST_RUNS + 1, damaged=lambda _: None)
    within = [(run, until) for run in runs if (until := _until_s(reading, run)) >= since_s]
    for run, until_s in within[:MOST_RUNS]:
        operations.append(Operation(run=run.id, since_s=max(run.facts.started_s, since_s), until_s=until_s))
        alarms += incidents.annunciations(run)
        of_run = incidents.of(run)
        labelled += of_run
        standing_s += [until_s - one.since_s for one in of_run if one.incident.open]
    return AlarmFigures(
        statistics=statistics(alarms, operations),
        runs=len(operations),
        truncated=len(within) > MOST_RUNS,
        since_s=since_s,
        until_s=now_s,
        bins=binned([one.at_s for one in alarms], since_s, now_s, BINS),
        standing=len(standing_s),
        stale=sum(age_s > STALE_S for age_s in standing_s),
        unseen=sum(not one.seen for one in labelled),
        shelved=sum(one.shelved for one in labelled),
    )


def handover_summary(now: Now, incidents: RunIncidents, *, now_s: float) -> dict[str, Any]:
    """Return the state of the alarms of the last run, and its last shift in numbers; now_s: Unix time. [s]"""
    run = now.run
    if run is None:
        return {"run": None}
    lately = [one for one in incidents.annunciations(run) if now_s - SHIFT_S <= one.at_s <= now_s]
    levels = Counter(one.priority for one in lately)
    return {
        "run": run.id,
        "job": run.facts.job,
        "state": now.state,
        "sheets": run.pages,
        "misprints": run.misprints,
        "not_inspected": run.not_inspected,
        "to_print_again": now.reprints.count,
        "alarms": {level.value: levels[level] for level in Priority},
        "pending": len(now.incidents),
        "standing": [_brief(one) for one in now.incidents if one.incident.open][:MOST_STANDING],
        "shelved": [
            _brief(one)
            | {"until_s": one.shelving.ends_s, "reason": one.shelving.reason, "by": one.shelving.by}
            for one in now.shelved[:MOST_STANDING]
            if one.shelving is not None
        ],
    }


def _brief(one: LabelledIncident) -> dict[str, Any]:
    incident = one.incident
    return {
        "incident": incident.number,
        "kind": incident.kind,
        "priority": one.priority.value,
        "sheets": incident.count,
    }


def _until_s(reading: Reading, run: RunRow) -> float:
    """Return when a run ended, or its last sheet came; Unix time. [s]"""
    if run.end is not None:
        return run.end.ended_s
    return reading.clock_zero_s(run) + reading.last_time_s(run)
