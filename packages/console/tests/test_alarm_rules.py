"""Rules of alarms: priority by cost and persistence, the state of the press, statistics, and what a flood hides."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.journal.sample_rows import good, misprint

from prooflight.detectors.verdict import Verdict
from prooflight_console.alarms.alarm_store import Shelving
from prooflight_console.alarms.grouping import (
    MOST_SINGLE,
    MOST_SINGLE_IN_FLOOD,
    flood,
    single_and_grouped,
)
from prooflight_console.alarms.priority import GOES_ON, RECENT, Priority, priority, recent_sheets
from prooflight_console.alarms.statistics import (
    HOUR_S,
    PERIOD_S,
    Annunciation,
    Operation,
    most_within,
    statistics,
)
from prooflight_console.reading.incidents import LabelledIncident, next_alarm
from prooflight_line.run.incidents import incidents_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.incidents import Incident

DAY = 86_400.0


def skipped(sheet: int) -> PageRecord:
    return good(sheet, verdict=Verdict.skipped(f"p{sheet + 1:04}", "the deadline had passed"))


def accepted(sheet: int) -> PageRecord:
    found = misprint(sheet)
    return replace(found, verdict=replace(found.verdict, stopping_costs_more=True))


def incident(records: Iterable[PageRecord], last_sheet: int) -> Incident:
    (one,) = incidents_of(list(records), last_sheet=last_sheet, ended=False)
    return one


@pytest.mark.parametrize(
    ("records", "last_sheet", "expected"),
    [
        ([misprint(50)], 50, Priority.MEDIUM),
        ([misprint(50), misprint(51)], 51, Priority.MEDIUM),
        ([misprint(sheet) for sheet in range(50, 53)], 52, Priority.HIGH),
        ([misprint(sheet) for sheet in range(50, 90)], 69 + RECENT, Priority.HIGH),
        ([misprint(50)], 50 + RECENT, Priority.MEDIUM),
        ([misprint(50, gate="divert")], 50, Priority.MEDIUM),
        ([misprint(50, gate="divert")], 50 + RECENT, Priority.LOW),
        ([accepted(sheet) for sheet in range(50, 90)], 89, Priority.LOW),
        ([skipped(sheet) for sheet in range(50, 53)], 52, Priority.HIGH),
        ([skipped(50)], 50, Priority.MEDIUM),
        ([good(sheet, late=True) for sheet in range(50, 60)], 59, Priority.LOW),
    ],
    ids=[
        *("one sheet", "two sheets", "three sheets", "forty sheets, some good after", "one sheet, ended"),
        *("one diverted", "one diverted, ended", "accepted by costs", "not inspected", "one not inspected"),
        "good but late",
    ],
)
def test_a_priority_follows_from_cost_and_persistence(
    records: list[PageRecord], last_sheet: int, expected: Priority
) -> None:
    one = incident(records, last_sheet)
    assert priority(one, recent_sheets(one, last_sheet)) is expected


@given(
    sheets=st.sets(st.integers(0, 200), min_size=1, max_size=60),
    newest=st.integers(200, 240),
)
def test_recent_sheets_are_those_of_the_last_twenty(sheets: set[int], newest: int) -> None:
    one = incident([misprint(0)], 0)
    kept = tuple(sorted(sheets))
    assert recent_sheets(replace(one, sheets=kept), newest) == len(
        sheets & set(range(newest - RECENT + 1, newest + 1))
    )


def test_a_shelving_hides_no_higher_priority() -> None:
    shelving = Shelving(
        id=1, run="1@0", incident=1, priority=Priority.MEDIUM, reason="known", by="Ann", at_s=0.0,
        ends_s=600.0, ended_by=None, ended_s=None,
    )  # fmt: skip
    assert [shelving.hides(level) for level in Priority] == [False, True, True]
    assert shelving.in_force(599.0)
    assert not shelving.in_force(600.0)
    assert not replace(shelving, ended_s=10.0).in_force(20.0)


def labelled(number: int, *, recent: int = 0, sheet: int | None = None) -> LabelledIncident:
    one = incident([misprint(number if sheet is None else sheet)], number if sheet is None else sheet)
    return LabelledIncident(incident=replace(one, number=number), labels=(), recent=recent)


def test_the_next_alarm_is_the_most_urgent_other_one() -> None:
    pending = sorted([labelled(1), labelled(2, recent=GOES_ON), labelled(3)], key=lambda one: one.urgency)
    assert [one.incident.number for one in pending] == [2, 3, 1]
    following = next_alarm(pending, after=2)
    assert following is not None
    assert following.incident.number == 3
    assert next_alarm(pending[:1], after=2) is None


@given(count=st.integers(0, 60), flooded=st.booleans())
def test_a_flood_is_grouped_and_none_is_lost(count: int, flooded: bool) -> None:
    alarms = [labelled(number) for number in range(1, count + 1)]
    single, groups = single_and_grouped(alarms, flooded=flooded)
    assert len(single) == min(count, MOST_SINGLE_IN_FLOOD if flooded else MOST_SINGLE)
    assert len(single) + sum(group.alarms for group in groups) == count
    assert sum(group.sheets for group in groups) == count - len(single)


def test_a_flood_is_more_than_ten_alarms_in_ten_minutes() -> None:
    times_s = [60.0 * minute for minute in range(11)]
    assert not flood(times_s, 600.0), "the first of the eleven is ten minutes old"
    assert flood([*times_s[1:], 599.0], 600.0)
    assert not flood([], 0.0)


def alarms(times_s: Iterable[float], **changes: object) -> list[Annunciation]:
    return [
        replace(
            Annunciation(run=1, incident=number, kind="streak", priority=Priority.LOW, at_s=at_s),
            **changes,  # type: ignore[arg-type]
        )
        for number, at_s in enumerate(times_s)
    ]


def test_six_alarms_an_hour_at_equal_intervals_meet_every_target() -> None:
    told = statistics(
        alarms([600.0 * number + 300.0 for number in range(144)]),
        [Operation(run=1, since_s=0.0, until_s=DAY)],
    )
    assert told.per_hour == pytest.approx(6.0)
    assert (told.hours, told.alarms, told.periods, told.hours_counted) == (24.0, 144, 144, 24)
    assert (told.most_in_period, told.floods, told.flood_share, told.hours_above) == (1, 0, 0.0, 0)
    assert told.most_frequent_share == pytest.approx(10 / 144)


def test_a_flood_lasts_until_fewer_than_five_alarms_come_in_ten_minutes() -> None:
    counts = (0, 11, 7, 5, 4, 10, 12)
    times_s = [PERIOD_S * at + 1.0 + number for at, count in enumerate(counts) for number in range(count)]
    told = statistics(alarms(times_s), [Operation(run=1, since_s=0.0, until_s=PERIOD_S * len(counts))])
    assert (told.floods, told.periods_in_flood, told.periods_above) == (2, 4, 2)
    assert told.flood_share == pytest.approx(4 / 7)
    assert told.most_in_period == 12


def test_only_alarms_of_the_time_of_operation_count_and_each_run_has_its_own_hours() -> None:
    operations = [
        Operation(run=1, since_s=0.0, until_s=HOUR_S / 2),
        Operation(run=2, since_s=DAY, until_s=DAY + 1.5 * HOUR_S),
    ]
    told = statistics(
        [*alarms([10.0, HOUR_S]), *alarms([DAY + 10.0, DAY + 20.0], run=2, acknowledged_s=30.0)], operations
    )
    assert (told.alarms, told.hours, told.hours_counted) == (3, 2.0, 3)
    assert (told.acknowledged, told.response_s) == (2, 30.0)


def test_statistics_of_nothing_are_no_rate() -> None:
    told = statistics([], [])
    assert (told.alarms, told.per_hour, told.flood_share, told.response_s) == (0, None, 0.0, None)


@given(st.lists(st.floats(0, 5000), max_size=30))
def test_the_most_within_a_span_is_what_counting_all_spans_gives(times_s: list[float]) -> None:
    counted = max((sum(end - 600.0 < time_s <= end for time_s in times_s) for end in times_s), default=0)
    assert most_within(times_s, 600.0) == counted
