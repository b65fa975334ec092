"""Search over all runs and charts of misprints: an index that follows the journal, and rows behind each bar."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.console.tests.consoles import Served, served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.verdict import Region, Verdict
from prooflight_console.accounts.roles import Role
from prooflight_console.quality.index import SearchIndex
from prooflight_console.quality.pareto import misprints
from prooflight_console.quality.searching import SheetSearch, count, find, sheet_numbers
from prooflight_console.quality.trends import trend
from prooflight_line.journal.defect_conditions import DefectConditions
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from prooflight_line.journal.records import PageRecord

SEED = 463
DAY_S = datetime(2026, 5, 28).timestamp()
"""Midnight where the console is."""
ALL = 10**9


def defective(
    sheet: int, *regions: tuple[float, float, float, float, str], kind: str, **changes: Any
) -> PageRecord:
    """A misprint with defects: x, y, width and height in mm, and ink."""
    record = misprint(sheet, kind=kind, kept=False)
    places = tuple(
        Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=9.0, kind=kind, ink=ink)
        for x, y, width, height, ink in regions
    )
    return replace(record, verdict=replace(record.verdict, regions=places), **changes)


def unseen(sheet: int) -> PageRecord:
    return good(sheet, verdict=Verdict(page=f"p{sheet + 1:04}", verdict="not-inspected", reason="lost"))


def write(path: Path) -> None:
    """Two runs a day apart: streaks of cyan at 60 mm, a spot of black at (100, 200), one sheet that was not seen."""
    with Journal.open(str(path)) as journal:
        for number, press in enumerate(("left", "left 2")):
            settings = {"customer": "Quay"} if number else {}
            begun = facts(
                started_s=DAY_S + number * 86_400.0, press=press, job=f"job{number}.pdf", settings=settings
            )
            run = journal.begin_run(begun)
            for sheet in range(60):
                record = good(sheet, time_s=5000.0 + 100.0 * sheet)
                time = {"time_s": record.time_s}
                if sheet in (10, 11, 12):
                    record = defective(sheet, (60.0, 0.0, 2.0, 297.0, "C"), kind="streak", **time)
                elif sheet == 20 + number:
                    record = defective(
                        sheet,
                        (100.0, 200.0, 3.0, 4.0, "K"),
                        (10.0, 10.0, 1.0, 1.0, ""),
                        kind="spots-voids",
                        **time,
                    )
                elif sheet == 30:
                    record = replace(unseen(sheet), **time)
                journal.record(run, record)


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path, run=False)
    write(made.journal)
    yield made
    made.close()


def hits(console: Served, **conditions: Any) -> list[tuple[int, int]]:
    index = console.console.index
    index.catch_up()
    rows = sheet_numbers(index, SheetSearch(**conditions), limit=ALL, upto_row=ALL)
    assert count(index, SheetSearch(**conditions), upto_row=ALL) == len(rows)
    return sorted((run, sheet) for run, sheet, *_ in rows)


def test_each_criterion_selects_the_sheets_that_meet_it(console: Served) -> None:
    streaks = [(run, sheet) for run in (1, 2) for sheet in (10, 11, 12)]
    spots, blind = [(1, 20), (2, 21)], [(1, 30), (2, 30)]
    assert hits(console) == sorted(streaks + spots + blind)
    assert hits(console, verdict="misprint") == sorted(streaks + spots)
    assert hits(console, verdict="not-inspected") == blind
    assert hits(console, defect=DefectConditions(kind="streak")) == streaks
    assert hits(console, defect=DefectConditions(ink="C")) == streaks
    assert hits(console, defect=DefectConditions(ink="")) == spots, "of no single ink"
    assert hits(console, defect=DefectConditions(least_mm=5.0)) == streaks
    assert hits(console, defect=DefectConditions(x_mm=105.0, y_mm=200.0, within_mm=2.0)) == spots
    assert hits(console, defect=DefectConditions(x_mm=105.0, y_mm=200.0, within_mm=1.9)) == []
    assert (
        hits(console, defect=DefectConditions(ink="K", x_mm=0.0, y_mm=0.0, width_mm=50.0, height_mm=50.0))
        == []
    )
    assert hits(console, job="job1", verdict="misprint") == [(2, 10), (2, 11), (2, 12), (2, 21)]
    assert hits(console, customer="quay", defect=DefectConditions(kind="streak")) == streaks[3:]
    assert hits(console, press="left", defect=DefectConditions(ink="K")) == [(1, 20)], "of exactly this name"
    assert hits(console, press="ef", defect=DefectConditions(ink="K")) == spots, "part of a name"
    assert hits(console, page="p0011", verdict="misprint") == [(1, 10), (2, 10)]
    assert hits(console, runs=(2,), verdict="not-inspected") == [(2, 30)]


def test_sheets_are_sought_by_their_own_time(console: Served) -> None:
    """Sheet 10 passed 1000 s after the run's first, whatever the source's clock says."""
    at = DAY_S + 1000.0
    assert hits(console, since_s=at, until_s=at + 0.1) == [(1, 10)]
    assert hits(console, since_s=at + 0.1, until_s=at + 100.0) == []
    assert hits(console, since_s=DAY_S + 86_400.0, verdict="not-inspected") == [(2, 30)]


regions = st.builds(
    Region,
    x_mm=st.integers(0, 40).map(float),
    y_mm=st.integers(0, 40).map(float),
    width_mm=st.integers(0, 20).map(float),
    height_mm=st.integers(0, 20).map(float),
    score=st.just(1.0),
    kind=st.sampled_from(("streak", "spots-voids")),
    ink=st.sampled_from(("C", "K", "")),
)
lengths = st.none() | st.integers(0, 40).map(float)
conditions = st.builds(
    DefectConditions,
    kind=st.none() | st.sampled_from(("streak", "spots-voids")),
    ink=st.none() | st.sampled_from(("C", "K", "")),
    least_mm=lengths,
    x_mm=lengths,
    y_mm=lengths,
    width_mm=st.integers(0, 10).map(float),
    height_mm=st.integers(0, 10).map(float),
    within_mm=st.integers(0, 9).map(float),
)


def meets(asked: DefectConditions, region: Region) -> bool:
    if asked.kind not in (None, region.kind) or asked.ink not in (None, region.ink):
        return False
    if asked.least_mm is not None and max(region.width_mm, region.height_mm) < asked.least_mm:
        return False
    if (box := asked.box_mm) is None:
        return True
    x = max(region.x_mm - box[2], box[0] - (region.x_mm + region.width_mm), 0.0)
    y = max(region.y_mm - box[3], box[1] - (region.y_mm + region.height_mm), 0.0)
    return x * x + y * y <= asked.within_mm**2


@given(conditions, regions)
def test_sql_selects_the_defects_that_meet_the_conditions(asked: DefectConditions, region: Region) -> None:
    box = ("x", "y", "w", "h")
    text, values = asked.sql(kind="kind", ink="ink", box=box)
    row = "SELECT ? AS kind, ? AS ink, ? AS x, ? AS y, ? AS w, ? AS h"
    fields = (region.kind, region.ink, region.x_mm, region.y_mm, region.width_mm, region.height_mm)
    with closing(sqlite3.connect(":memory:")) as connection:
        selected = connection.execute(f"SELECT 1 FROM ({row}) WHERE {text}", (*fields, *values)).fetchall()
    assert bool(selected) == meets(asked, region)


def test_the_index_of_a_journal_that_grows_is_that_of_the_whole_one(tmp_path: Path) -> None:
    """Whatever the order: in steps, with sheets recorded again, and with a journal of another content."""
    console = served(tmp_path, run=False)
    index, rng = console.console.index, np.random.default_rng(SEED)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts(started_s=DAY_S))
        for sheet in range(300):
            again = int(rng.integers(0, sheet + 1)) if rng.random() < 0.1 else sheet
            bad = rng.random() < 0.3
            journal.record(run, defective(again, (5, 5, 1, 1, "C"), kind="streak") if bad else good(again))
            if sheet % 40 == 0:
                journal.commit()
                index.catch_up()
    index.catch_up()
    tables = {
        name: index.query(f"SELECT * FROM {name} ORDER BY 1, 2, 3")
        for name in ("sheets", "defects", "counts", "amounts", "runs")
    }
    fresh = SearchIndex(
        tmp_path / "fresh", console.console.reading, console.console.incidents, console.console.label_store
    )
    assert fresh.catch_up()
    for name, rows in tables.items():
        again_rows = fresh.query(f"SELECT * FROM {name} ORDER BY 1, 2, 3")
        if name == "amounts":
            assert [row[:4] for row in rows] == [row[:4] for row in again_rows]
            assert [row[4] for row in rows] == pytest.approx([row[4] for row in again_rows])
        else:
            assert rows == again_rows, name
    assert sum(row[2] for row in tables["counts"]) == console.console.reading.run(1).pages
    console.close()


def test_a_damaged_index_and_another_journal_are_indexed_anew(console: Served) -> None:
    expected = hits(console)
    index = console.console.index
    index.path.write_bytes(b"no database" * 1000)
    other = SearchIndex(
        index.path, console.console.reading, console.console.incidents, console.console.label_store
    )
    assert other.catch_up()
    assert len(sheet_numbers(other, SheetSearch(), limit=ALL, upto_row=ALL)) == len(expected)
    with closing(sqlite3.connect(index.path)) as connection, connection:
        connection.execute("UPDATE position SET page = 'of another journal'")
        connection.execute("UPDATE sheets SET kind = 'ghost'")
    third = SearchIndex(
        index.path, console.console.reading, console.console.incidents, console.console.label_store
    )
    assert third.catch_up()
    assert (
        sheet_numbers(third, SheetSearch(defect=DefectConditions(kind="ghost")), limit=1, upto_row=ALL) == []
    )


def test_results_are_sorted_by_each_column_and_pages_of_them_join(console: Served) -> None:
    held = console.console
    held.index.catch_up()
    for order in ("time", "-time", "size", "-size", "kind", "page", "-job", "press", "label", "sheet"):
        whole = find(held.reading, held.index, SheetSearch(), order=order, limit=ALL, upto_row=ALL)
        parts = [
            find(held.reading, held.index, SheetSearch(), order=order, skip=at, limit=3, upto_row=ALL)
            for at in range(0, 12, 3)
        ]
        keys = [(hit.written.run_id, hit.written.page.sheet) for hit in whole]
        assert [(h.written.run_id, h.written.page.sheet) for part in parts for h in part] == keys
        assert len(set(keys)) == 10
    sizes = [
        hit.size_mm
        for hit in find(held.reading, held.index, SheetSearch(), order="-size", limit=ALL, upto_row=ALL)
    ]
    assert sizes == [297.0] * 6 + [4.0] * 2 + [None] * 2


def test_many_sheets_are_labelled_at_once_and_taken_back(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    address = "/search/label?upto=1000000&verdict=look"
    answer = operator.post(address, data={"label": "false-alarm", "note": "lint"})
    assert answer.status_code == 200, answer.text
    done = answer.headers["HX-Redirect"]
    first, last, labelled, left_out = re.search(r"labelled=(\d+)-(\d+)-(\d+)-(\d+)", done).groups()  # type: ignore[union-attr]
    assert (labelled, left_out) == ("8", "2"), "what was not inspected is never called good"
    assert len(hits(console, label="good")) == 8
    assert hits(console, label="none") == [(1, 30), (2, 30)]
    page = operator.get(done).text
    assert "8 sheets labelled. 2 sheets were not inspected and stay without a label." in page
    viewer = console.client(Role.VIEWER)
    undo = f"/search/label/undo?first={first}&last={last}"
    assert viewer.post(undo).status_code == 403
    engineer = console.client(Role.ENGINEER)
    assert engineer.post(undo).status_code in (404, 409, 422), "labels of somebody else"
    assert operator.post(undo).status_code == 200
    assert hits(console, label="any") == []
    assert operator.post(undo).status_code in (404, 409, 422), "nothing is left to undo"
    picked = operator.post(address, data={"label": "misprint", "pick": ["1/10", "2/21"]})
    assert picked.status_code == 200
    assert hits(console, label="misprint") == [(1, 10), (2, 21)]
    assert operator.post(address, data={"label": "misprint", "pick": ["x"]}).status_code == 422
    assert operator.post(address, data={"label": "good"}).status_code == 422
    assert operator.post("/search/label?upto=9&job=none", data={"label": "misprint"}).status_code == 422


def test_a_label_of_an_incident_is_that_of_its_sheets(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    assert operator.post("/runs/1/incidents/1/label", data={"label": "false-alarm"}).status_code == 200
    assert hits(console, label="good") == [(1, 10), (1, 11), (1, 12)]
    assert operator.post("/runs/1/sheets/5/label", data={"label": "misprint"}).status_code == 200
    assert hits(console, label="misprint", verdict="any") == [(1, 5)], "a good sheet that somebody labelled"


def test_searches_are_saved_for_their_owner(console: Served) -> None:
    ann, ben = console.client(Role.OPERATOR), console.client(Role.ENGINEER)
    address = "/search/saved?kind=streak&verdict=misprint"
    assert ann.post(address, data={"name": "  cyan <b>streaks</b> "}).status_code == 200
    shown = ann.get("/search").text
    assert "cyan &lt;b&gt;streaks&lt;/b&gt;" in shown
    assert 'href="/search?kind=streak&amp;verdict=misprint"' in shown
    assert "streaks" not in ben.get("/search").text.partition("<form")[0]
    number = re.search(r"/search/saved/(\d+)/remove", shown)
    assert number is not None
    ben.post(f"/search/saved/{number[1]}/remove")
    assert "cyan" in ann.get("/search").text, "nobody removes another's"
    ann.post(f"/search/saved/{number[1]}/remove")
    assert "cyan" not in ann.get("/search").text
    assert ann.post(address, data={"name": " "}).status_code in (409, 422)


@pytest.mark.parametrize("by_cost", [False, True])
def test_behind_each_bar_are_exactly_its_sheets(console: Served, by_cost: bool) -> None:
    """A bar's conditions, given to the search, select as many sheets as it states."""
    held = console.console
    held.index.catch_up()
    costs = {facts().press_digest: RunningCosts(false_alarm_cents=2.0, missed_misprint_cents=30.0)}
    groups = misprints(held.index, SheetSearch(verdict="misprint"), costs, by_cost=by_cost)
    assert (groups.sheets, groups.unpriced, groups.cents) == (8, 0, 16.0), "all were stopped"
    assert [(one.name, one.sheets) for one in groups.kinds] == [("streak", 6), ("spots-voids", 2)]
    assert {one.name: one.sheets for one in groups.inks} == {"C": 6, "K": 2, "none": 2}
    client = console.client(Role.VIEWER)
    for one in (*groups.kinds, *groups.inks, *groups.places):
        query = "&".join(f"{name}={value}" for name, value in one.conditions.items())
        rows = client.get(f"/search.json?verdict=misprint&{query}").json()
        assert len(rows) == one.sheets, one
    unknown = misprints(held.index, SheetSearch(verdict="misprint"), {})
    assert (unknown.unpriced, unknown.cents) == (8, 0.0)


def test_a_trend_counts_each_sheet_on_its_own_day(console: Served) -> None:
    console.client(Role.OPERATOR).post("/runs/1/incidents/1/label", data={"label": "false-alarm"})
    index = console.console.index
    index.catch_up()
    days = trend(index, SheetSearch(), step="day")
    assert [one.first.isoformat() for one in days.periods] == ["2026-05-28", "2026-05-29"]
    assert [(one.sheets, one.misprints, one.not_inspected, one.false_alarms) for one in days.periods] == [
        (60, 4, 1, 3),
        (60, 4, 1, 0),
    ]
    (week,) = trend(index, SheetSearch(), step="week").periods
    assert (week.first.isoformat(), week.last.isoformat(), week.sheets) == ("2026-05-25", "2026-05-31", 120)
    (black,) = (one for one in days.drifts if one.channel == "gain-black")
    # Sheets 0, 20 and 40 are sampled: 0, 2 and 4 percent.
    assert black.means == pytest.approx((2.0, 2.0))
    one_run = trend(index, SheetSearch(runs=(2,)), step="day")
    assert [one.sheets for one in one_run.periods] == [60]


def test_the_page_of_charts_leads_to_rows_and_states_what_is_missing(console: Served) -> None:
    client = console.client(Role.VIEWER)
    shown = client.get("/quality").text
    assert "Streak" in shown
    assert "8 sheets without a cost: start the console with --press" in shown
    for address in set(re.findall(r'href="(/search[^"]*)"', shown)):
        assert client.get(address.replace("&amp;", "&")).status_code == 200, address
    both = client.get("/quality?run=1&run=2").text
    assert "Of 2 runs:" in both
    assert client.get("/quality?since=yesterday").status_code == 422
    assert client.get("/quality?run=0").status_code == 422
    assert (
        "No sheet was recorded in this time." in client.get("/quality?since=2020-01-01&until=2020-01-02").text
    )


@pytest.mark.parametrize("bad", ["x=far", "size=-1", "within=1e9", "width=nan", "runs=1;2"])
def test_a_length_that_is_none_is_refused(console: Served, bad: str) -> None:
    assert console.client(Role.VIEWER).get(f"/search?{bad}").status_code == 422


def test_files_and_the_page_have_the_same_rows(console: Served) -> None:
    client = console.client(Role.VIEWER)
    for query in ("verdict=misprint&sort=size", "verdict=good&since=2026-05-29", "verdict=any&job=job0.pdf"):
        rows = client.get(f"/search.json?{query}").json()
        table = client.get(f"/search.csv?{query}").text.splitlines()
        assert len(table) == len(rows) + 1
        assert f"{len(rows)} sheets" in client.get(f"/search?{query}").text, query
    assert rows[0]["at"].endswith("+00:00")


def test_a_damaged_sheet_is_left_out_and_counted(console: Served) -> None:
    with closing(sqlite3.connect(console.journal)) as connection, connection:
        connection.execute("UPDATE pages SET kind = 'ghost' WHERE run_id = 1 AND sheet = 11")
    assert (1, 11) not in hits(console)
    assert console.console.index.damaged == 1
    assert "entry cannot be read" in console.client(Role.VIEWER).get("/search").text
