"""Which sheets are one incident, when it ends, how it grows; and that the run and its journal tell the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.common_cause import NEAR_MM
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunFacts
from prooflight_line.run.incidents import (
    ENDS_AFTER,
    FIRST_SHEETS,
    LAST_SHEETS,
    RETURNS_WITHIN,
    Incident,
    IncidentChange,
    Incidents,
    causes_of,
    incidents_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

GOOD = Verdict(page="p0001", verdict="good")
A4 = 210.0, 297.0


def region(
    kind: str, x: float, y: float, width: float = 4.0, height: float = 4.0, score: float = 9.0
) -> Region:
    return Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=score, kind=kind)


def misprint(*regions: Region, kind: str | None = None, page: str = "p0001") -> Verdict:
    kind = kind or (regions[0].kind if regions else None)
    return Verdict(page=page, verdict="misprint", kind=kind, regions=regions, reason="it is off")


def record(sheet: int, verdict: Verdict = GOOD, **told: Any) -> PageRecord:
    facts: dict[str, Any] = {"job_page": sheet, "late": False, "first_line": 100 * sheet, "time_s": sheet / 5}
    return PageRecord(sheet=sheet, verdict=verdict, **(facts | told))


def streak(x: float = 120.0) -> Verdict:
    return misprint(region("streak", x, 0.0, 1.0, 297.0))


def test_a_streak_on_400_sheets_is_one_incident() -> None:
    """It ends when as many good sheets have passed as the rule says, and its sheets are told in part."""
    records = [record(n, streak() if 50 <= n < 450 else GOOD) for n in range(500)]
    [found] = incidents_of(records, size_mm=A4)
    assert (found.number, found.kind, found.scope, found.count) == (1, "streak", "column", 400)
    assert (found.first_sheet, found.last_sheet, found.ended_with) == (50, 449, 449 + ENDS_AFTER)
    assert found.sheets == (*range(50, 50 + FIRST_SHEETS), *range(450 - LAST_SHEETS, 450))
    assert found.where == "centre, 120 mm from the left, along the travel"
    assert (found.since_s, found.last_s, found.disposition, found.reason) == (
        10.0,
        449 / 5,
        "stop",
        "it is off",
    )
    assert (found.box_mm, found.pages, found.open) == ((120.0, 0.0, 1.0, 297.0), ("p0001",), False)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (region("streak", 120, 0, 1, 297), region("streak", 121, 80, 1, 100), True),
        (region("streak", 120, 0, 1, 297), region("streak", 121 + NEAR_MM, 0, 1, 297), True),
        (region("streak", 120, 0, 1, 297), region("streak", 121.1 + NEAR_MM, 0, 1, 297), False),
        (region("spots-voids", 50, 50), region("spots-voids", 52, 53), True),
        (region("spots-voids", 50, 50), region("spots-voids", 50, 54.1 + NEAR_MM), False),
        (region("spots-voids", 50, 50), region("missing-content", 50, 50), False),
        (region("density", 10, 10), region("density", 150, 200), True),
        (region("wrong-page", 0, 0, 210, 297), region("density", 0, 0, 210, 297), False),
        (region("spots-voids", float("nan"), 50), region("spots-voids", 50, 50), False),
    ],
)
def test_the_same_cause_is_of_one_kind_at_one_place(one: Region, other: Region, same: bool) -> None:
    found = incidents_of([record(0, misprint(one)), record(1, misprint(other))])
    assert len(found) == (1 if same else 2)


@pytest.mark.parametrize(
    ("told", "kind"),
    [
        (record(3, Verdict.skipped("p0004", "too many sheets were waiting for inspection")), "not-inspected"),
        (
            record(3, Verdict.skipped("p0004", "pages 2 to 4 did not come"), faults=("missing",)),
            "missing-page",
        ),
        (record(3, Verdict.skipped("p0004", "lost"), faults=("lost-lines",)), "lost-lines"),
        (record(3, GOOD, faults=("lost-lines",)), "lost-lines"),
        (
            record(
                3,
                Verdict.skipped("p0004", "lost"),
                faults=("lost-lines",),
                notes=(
                    "lines lost: about 90 lines from 4 on were lost: the camera was disconnected for 3.1 s",
                ),
            ),
            "camera-gone",
        ),
        (record(3, GOOD, late=True), "late"),
        (record(3, misprint(), late=True, faults=("lost-lines",)), "unknown"),
    ],
)
def test_what_is_no_misprint_has_kinds_of_its_own(told: PageRecord, kind: str) -> None:
    [found] = incidents_of([told])
    assert (found.kind, found.count) == (kind, 1)
    assert bool(found.where) == (found.scope != "run") == (kind == "unknown")


@pytest.mark.parametrize("told", [record(3), record(3, faults=("slip",)), record(3, notes=("a drift",))])
def test_a_good_sheet_is_no_alarm(told: PageRecord) -> None:
    assert causes_of(told) == ()
    assert incidents_of([told]) == []


def test_reasons_that_differ_in_numbers_are_one_cause() -> None:
    light = "the light is {} times what this press was calibrated for (paper at {} DN, 2857 expected)"
    records = [
        record(0, Verdict.skipped("p0001", light.format(0.70, 2000))),
        record(1, Verdict.skipped("p0002", light.format(0.71, 2031))),
        record(2, Verdict.skipped("p0003", "too many sheets were waiting for inspection")),
    ]
    assert [one.count for one in incidents_of(records)] == [2, 1]


def test_nobody_says_it_is_over_while_nobody_looks() -> None:
    """Sheets that were not inspected do not count towards its end."""
    blind = [record(n, Verdict.skipped("p0001", "no light")) for n in range(1, 101)]
    records = [record(0, streak()), *blind, *(record(n) for n in range(101, 200))]
    first, second = incidents_of(records)
    assert (first.kind, first.ended_with) == ("streak", 100 + ENDS_AFTER)
    assert (second.kind, second.count, second.ended_with) == ("not-inspected", 100, 100 + ENDS_AFTER)


def test_one_page_of_a_job_that_is_wrong_each_time_is_one_incident() -> None:
    spot = misprint(region("missing-content", 30, 40), page="p0007")
    incidents, changes = Incidents(), list[IncidentChange]()
    for n in range(1000):
        changes += incidents.add(record(n, spot if n % 50 == 7 else GOOD))
    [found] = incidents.open
    assert (found.number, found.count, found.returned, found.pages) == (1, 20, 1, ("p0007",))
    assert [change.what for change in changes] == ["opened", "ended", "returned", *["grew"] * 18]


def test_what_comes_back_later_is_another_incident() -> None:
    again = 1 + ENDS_AFTER + RETURNS_WITHIN
    for sheet, count in ((again - 1, 1), (again, 2)):
        assert len(incidents_of([record(0, streak()), record(sheet, streak())])) == count


def test_another_place_of_a_sheet_keeps_its_incident_open() -> None:
    """Each sheet belongs to the incident of its most telling place, and to no other."""
    both = misprint(region("spots-voids", 30, 40), region("streak", 120, 0, 1, 297))
    records = [record(0, streak()), *(record(n, both) for n in range(1, 100)), record(100, streak())]
    first, second = incidents_of(records, ended=False)
    assert (first.kind, first.count, first.returned, first.open) == ("streak", 2, 0, True)
    assert (second.kind, second.count, second.open) == ("spots-voids", 99, True)


@pytest.mark.parametrize(
    ("score", "side", "directions"),
    [
        (lambda n: 9 + 0.1 * n, lambda n: 4 + 0.05 * n, ("grows", "grows")),
        (lambda n: 19 - 0.1 * n, lambda n: 4, ("shrinks", "steady")),
        (lambda n: 9 + (n % 3), lambda n: 4 + (n % 2), ("steady", "steady")),
    ],
)
def test_how_an_incident_goes(score: Any, side: Any, directions: tuple[str, str]) -> None:
    def sheets(count: int) -> Incident:
        spots = [region("spots-voids", 50, 50, side(n), 4, score(n)) for n in range(count)]
        return incidents_of([record(n, misprint(spot)) for n, spot in enumerate(spots)], ended=False)[0]

    found, early = sheets(60), sheets(5)
    assert found.score is not None
    assert found.size_mm2 is not None
    assert (found.score.direction, found.size_mm2.direction) == directions
    assert early.score is not None
    assert early.score.direction == "unknown"
    if directions[0] != "steady":
        assert found.score.now == pytest.approx(score(59))
        assert found.score.a_sheet == pytest.approx(score(1) - score(0))


def test_sheets_must_come_in_the_order_of_the_run() -> None:
    incidents = Incidents()
    incidents.add(record(5))
    for sheet in (5, 4):
        with pytest.raises(ValueError, match=f"sheet {sheet} comes after sheet 5"):
            incidents.add(record(sheet))


KINDS = st.sampled_from(["streak", "spots-voids", "density", "missing-content", "wrong-page"])
REGIONS = st.builds(
    region,
    KINDS,
    st.sampled_from([0.0, 20.0, 22.0, 100.0]),
    st.sampled_from([0.0, 50.0]),
    st.sampled_from([1.0, 6.0]),
    st.sampled_from([3.0, 90.0]),
    st.floats(1, 50),
)
VERDICTS = st.one_of(
    st.just(GOOD),
    st.lists(REGIONS, max_size=3).map(lambda found: misprint(*found, page=f"p{len(found):04}")),
    st.sampled_from(["no light at 3", "no light at 4", "too late"]).map(
        lambda why: Verdict.skipped("p0009", why)
    ),
)
ALARMS = st.dictionaries(
    st.integers(0, 300),
    st.tuples(VERDICTS, st.booleans(), st.sampled_from([(), ("lost-lines",), ("missing",), ("slip",)])),
    max_size=40,
)


def records_of(alarms: dict[int, tuple[Verdict, bool, tuple[str, ...]]], last: int) -> list[PageRecord]:
    return [
        record(n, verdict, late=late, faults=faults)
        for n in range(last + 1)
        for verdict, late, faults in [alarms.get(n, (GOOD, False, ()))]
    ]


@given(ALARMS)
def test_every_alarm_belongs_to_exactly_one_incident(alarms: Any) -> None:
    """And to the one whose number its sheet was given when it came."""
    records, incidents = records_of(alarms, 330), Incidents()
    given: dict[int, int] = {}
    last: dict[int, Incident] = {}
    for one in records:
        changes = incidents.add(one)
        last |= {change.incident.number: change.incident for change in changes}
        mine = [change for change in changes if change.what != "ended"]
        assert len(mine) == bool(causes_of(one))
        for change in mine:
            given[one.sheet] = change.incident.number
    alarming = [one.sheet for one in records if causes_of(one)]
    assert sorted(sheet for found in last.values() for sheet in found.sheets) == alarming
    assert {sheet: n for n, found in last.items() for sheet in found.sheets} == given
    assert sorted(last) == list(range(1, incidents.number + 1))
    for found in last.values():
        assert found.count == len(found.sheets)
        assert all(one < other for one, other in pairwise(found.sheets))
        assert (found.first_sheet, found.last_sheet) == (found.sheets[0], found.sheets[-1])


@given(ALARMS)
def test_good_sheets_may_be_left_out(alarms: Any) -> None:
    records = records_of(alarms, 340)
    told = [one for one in records if causes_of(one)]
    assert incidents_of(told, last_sheet=340) == incidents_of(records)


def test_the_journal_tells_the_same_incidents_as_the_run(tmp_path: Path) -> None:
    spots: Sequence[Region] = [region("spots-voids", 30 + n % 4, 40, score=5 + 0.01 * n) for n in range(100)]
    records = [
        record(n, misprint(spots[n]) if n % 3 else replace(GOOD, promise_suspended=True)) for n in range(100)
    ]
    records[50] = record(50, Verdict.skipped("p0001", "lost"), faults=("lost-lines",))
    facts = RunFacts(
        job="j",
        job_digest="",
        press="p",
        press_digest="",
        detector="matched_filter",
        source="drum",
        started_s=0.0,
    )
    with Journal.open(str(tmp_path / "j.sqlite")) as journal:
        number = journal.begin_run(facts)
        for one in records:
            journal.record(number, one)
        journal.commit()
        kept, seen = list(journal.pages(number)), list(journal.pages(number, passed=False))
    live = incidents_of(records)
    assert len(live) == 2
    assert incidents_of(kept) == live
    assert incidents_of(seen, last_sheet=99) == live
