"""Rates and drifts over days or weeks, over all runs that a search selects."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from functools import cache
from typing import TYPE_CHECKING, Final, Literal

from prooflight_console.reading.trend import group_of
from prooflight_line.journal.following import QUARTER_S
from prooflight_line.journal.labels import MISPRINT, OF_GOOD
from prooflight_line.run.monitor.channels import drift_channels

if TYPE_CHECKING:
    from prooflight_console.quality.index import SearchIndex
    from prooflight_console.quality.searching import SheetSearch

Step = Literal["day", "week"]
MOST_PERIODS: Final = 60
"""Number of days or weeks in a chart; of more, the last ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Period:
    """A day or a week."""

    first: date
    last: date
    sheets: int
    misprints: int
    not_inspected: int
    false_alarms: int
    """Number of misprints by verdict that people labelled as false alarms or released."""
    confirmed: int
    """Number of misprints that people labelled so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Mean of one nuisance amount in each period."""

    channel: str
    what: str
    unit: str
    chart: str
    """The chart that shows it, one of ``reading.trend.GROUPS``."""
    means: tuple[float | None, ...]
    """None: no sheet was sampled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Rates and drifts by period."""

    periods: tuple[Period, ...]
    drifts: tuple[Drift, ...]


def trend(index: SearchIndex, search: SheetSearch, *, step: Step) -> Trend:
    """Return rates and drifts of the runs and the time that a search selects; its other conditions are left aside."""
    text, values = search.run_condition(index)
    if search.since_s is not None:
        text += " AND c.quarter >= ?"
        values.append(search.since_s // QUARTER_S)
    if search.until_s is not None:
        text += " AND c.quarter < ?"
        values.append(search.until_s // QUARTER_S)
    counts = index.query(
        "SELECT c.quarter, sum(c.sheets), sum(c.misprints), sum(c.not_inspected) FROM counts c"
        f" JOIN runs r ON r.id = c.run_id WHERE {text} GROUP BY c.quarter",
        values,
    )
    totals: dict[date, list[int]] = defaultdict(lambda: [0] * 5)
    for quarter, *numbers in counts:
        for at, number in enumerate(numbers):
            totals[_first_day(quarter, step)][at] += number
    if not totals:
        return Trend(periods=(), drifts=())
    starts = _starts(min(totals), max(totals), step)
    labels = index.query(
        "SELECT s.at_s, s.label FROM sheets s JOIN runs r ON r.id = s.run_id"
        f" WHERE {search.run_condition(index)[0]} AND s.verdict = 'misprint' AND s.label NOT NULL",
        search.run_condition(index)[1],
    )
    for at_s, label in labels:
        if (first := _first_day(int(at_s // QUARTER_S), step)) in totals:
            totals[first][3] += label in OF_GOOD
            totals[first][4] += label == MISPRINT
    length = timedelta(days=6 if step == "week" else 0)
    names = ("sheets", "misprints", "not_inspected", "false_alarms", "confirmed")
    periods = tuple(
        Period(first=first, last=first + length, **dict(zip(names, totals[first], strict=True)))
        for first in starts
    )
    return Trend(periods=periods, drifts=_drifts(index, text, values, starts, step))


def _drifts(
    index: SearchIndex, text: str, values: list[object], starts: list[date], step: Step
) -> tuple[Drift, ...]:
    rows = index.query(
        "SELECT c.quarter, c.channel, sum(c.count), sum(c.total) FROM amounts c"
        f" JOIN runs r ON r.id = c.run_id WHERE {text} GROUP BY c.quarter, c.channel",
        values,
    )
    sums: dict[str, list[list[float]]] = {}
    for quarter, channel, number, total in rows:
        at = bisect_right(starts, _first_day(quarter, step)) - 1
        if at >= 0:
            cell = sums.setdefault(channel, [[0.0, 0.0] for _ in starts])[at]
            cell[0] += number
            cell[1] += total
    sensors = [name.removeprefix("light-") for name in sums if name.startswith("light-")]
    drifts = []
    for channel in drift_channels(sensors):
        if channel.name in sums and (chart := group_of(channel.name)) is not None:
            means = tuple(
                total / number * channel.scale if number else None for number, total in sums[channel.name]
            )
            drifts.append(
                Drift(channel=channel.name, what=channel.what, unit=channel.unit, chart=chart, means=means)
            )
    return tuple(drifts)


@cache
def _first_day(quarter: int, step: Step) -> date:
    """Return the first day of the period of a quarter of an hour, by the clock of the console's machine."""
    day = datetime.fromtimestamp(quarter * QUARTER_S).date()
    return day - timedelta(days=day.weekday()) if step == "week" else day


def _starts(first: date, last: date, step: Step) -> list[date]:
    length = 7 if step == "week" else 1
    number = min((last - first).days // length + 1, MOST_PERIODS)
    return [last - timedelta(days=length * at) for at in range(number - 1, -1, -1)]
