"""What office pages say: promise and what came of it, places on the page, the press over a run, two runs alike."""

from __future__ import annotations

import csv
import io
import re
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.console.tests.consoles import Served, served, write_run
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight_console.accounts.roles import Role
from prooflight_console.pages.drawings import STEPS, heat_drawing, step_of
from prooflight_console.reading.quality import FalseAlarms, quality
from prooflight_console.reading.report import heat_map
from prooflight_console.reading.trend import group_of, run_figures, trend
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path

SCRIPT = "<script>alert(1)</script>\"'<img src=x onerror=alert(1)>"
PAGES = (
    "/quality",
    "/report",
    "/report/1",
    "/search",
    "/press",
    "/press/figures",
    "/setup",
    "/setup/zones",
    "/setup/users",
    "/setup/audit",
)


def promise(**changes: float | int | None) -> FalseAlarms:
    told: dict[str, object] = {"text": "", "rate": 0.01, "good": 1000, "confirmed": 0, "unanswered": 0}
    return FalseAlarms(**(told | {"suspended_from": None} | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, "kept"),
        ({"confirmed": 10}, "kept"),  # as many as promised
        ({"confirmed": 15}, "kept"),  # P(15 or more) = 0.082 with 1 % of 1,000
        ({"confirmed": 16}, "more"),  # 0.047
        ({"confirmed": 10, "unanswered": 5}, "kept"),
        ({"confirmed": 10, "unanswered": 6}, "waiting"),
        ({"rate": None, "confirmed": 900}, "unknown"),
        ({"suspended_from": 12}, "suspended"),
        ({"good": 0, "confirmed": 0}, "kept"),
    ],
)
def test_a_promise_is_kept_as_long_as_chance_explains_the_alarms(
    changes: dict[str, float | int | None], state: str
) -> None:
    assert promise(**changes).state == state


def test_a_word_changes_the_report_and_is_told_as_an_override(console: Served) -> None:
    held, run = console.console, console.console.reading.run(1)
    operator = console.client(Role.OPERATOR)

    def now() -> tuple[int, int, int]:
        told = quality(held.reading, held.incidents, held.stations, held.reprints.count(run), run)
        return told.false_alarms.confirmed, told.false_alarms.unanswered, len(told.overrides)

    assert now() == (0, 3, 0)
    operator.post("/runs/1/incidents/1/label", data={"label": "false-alarm", "note": "lint"})
    assert now() == (3, 0, 1)
    operator.post("/runs/1/incidents/1/label", data={"label": "misprint"})
    assert now() == (0, 0, 1)
    told = quality(held.reading, held.incidents, held.stations, held.reprints.count(run), run)
    assert [(one.by, one.note, one.stands) for one in told.overrides] == [("operator", "lint", False)]
    assert sum(part["misprint"] for part in told.trend) == 3


@given(st.integers(1, 10_000), st.data())
def test_more_misprints_never_have_a_paler_step(most: int, data: st.DataObject) -> None:
    one = data.draw(st.integers(1, most))
    other = data.draw(st.integers(one, most))
    assert 1 <= step_of(one, most) <= step_of(other, most) <= step_of(most, most) == STEPS
    assert step_of(0, most) == 0


def test_the_heat_map_covers_each_box_and_nothing_else() -> None:
    drawn = heat_drawing(heat_map([(20.0, 30.0, 10.0, 10.0), (20.0, 30.0, 30.0, 10.0)]))
    assert [(cell.x_mm, cell.y_mm, cell.width_mm, cell.count) for cell in drawn.cells] == [
        (20.0, 30.0, 10.0, 2),
        (30.0, 30.0, 20.0, 1),
    ]
    assert (drawn.width_mm, drawn.height_mm) == (210.0, 297.0)
    assert drawn.bounds == ((1, 1), (2, 2))
    assert heat_drawing(heat_map([])).cells == ()


def test_a_course_counts_every_troubled_sheet_once(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts())
        for sheet in range(500):
            lost = ("lost-lines",) if sheet % 50 == 7 else ()
            journal.record(run, good(sheet, late=sheet % 100 == 99, faults=lost))
    held = console.console
    found = held.reading.run(1)
    told = trend(held.reading, found)
    assert len(told["sheets"]) == 240
    assert {name: sum(counts) for name, counts in told["troubles"].items()} == {
        "lost-lines": 10,
        "late": 5,
        "not-inspected": 0,
    }
    assert sum(told["latency"]["counts"]) == 500
    assert run_figures(found, told)["lost_lines"] == 10
    assert held.trends.of(found) is held.trends.of(found), "read once"
    console.close()


@pytest.mark.parametrize(
    ("channel", "chart"),
    [
        ("gain-cyan", "density"),
        ("register-black-x", "register-x"),
        ("register-black-y", "register-y"),
        ("light-first", "light"),
        ("lamp-3", "lamp"),
        ("shift-y", "shift"),
        ("streak-104.5", None),
    ],
)
def test_each_channel_has_one_chart(channel: str, chart: str | None) -> None:
    assert group_of(channel) == chart


def test_stored_script_shows_as_text_in_the_office(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    write_run(console.journal, job=SCRIPT, press=SCRIPT, source=SCRIPT, settings={SCRIPT: SCRIPT})
    client = console.client(Role.ADMIN)
    client.post("/runs/1/incidents/1/label", data={"label": "false-alarm", "note": SCRIPT})
    for address in PAGES:
        answer = client.get(address)
        assert answer.status_code == 200, address
        assert "<script>alert" not in answer.text, address
        assert "<img src=x" not in answer.text, address
        assert not re.search(r"<[^>]+\s(on\w+|style)=", answer.text.replace("&#34;", "")), address
    assert "&lt;script&gt;alert(1)" in client.get("/report/1").text
    console.close()


@pytest.mark.parametrize(
    ("address", "role", "status"),
    [
        ("/setup/users", Role.ENGINEER, 403),
        ("/setup/audit", Role.ENGINEER, 403),
        ("/setup/audit/chain", Role.ENGINEER, 403),
        ("/setup/tokens", Role.VIEWER, 200),
        ("/report/1", Role.VIEWER, 200),
        ("/report/9", Role.VIEWER, 404),
        ("/press?run=9", Role.VIEWER, 404),
        ("/press?run=1&against=9", Role.VIEWER, 404),
        ("/search?since=2026-02-31", Role.VIEWER, 422),
        ("/search?since=yesterday", Role.VIEWER, 422),
        ("/runs/1/sheets/3/again", Role.VIEWER, 404),
        ("/runs/1/sheets/10/again", Role.VIEWER, 409),
    ],
)
def test_who_may_see_what_and_what_is_not_there(
    console: Served, address: str, role: Role, status: int
) -> None:
    assert console.client(role).get(address).status_code == status


def test_pages_without_a_journal_say_so(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    client = console.client(Role.VIEWER)
    for address in ("/quality", "/report", "/search", "/press", "/setup"):
        assert client.get(address).status_code == 200, address
    assert "No run has been recorded yet." in client.get("/press").text
    console.close()


def test_search_keeps_what_was_asked_from_page_to_page(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        for job in ("first", "second"):
            run = journal.begin_run(facts(job=job))
            for sheet in range(70):
                journal.record(run, misprint(sheet, kept=False, kind="streak" if sheet % 2 else "scum"))
    client, seen = console.client(Role.VIEWER), []
    address: str | None = "/search?job=second&verdict=misprint"
    while address is not None:
        text = client.get(address).text
        seen += re.findall(r'href="/runs/(\d+)/sheets/(\d+)"', text)
        behind = re.search(r'href="(/search\?[^"]*skip=[^"]*)"', text)
        address = None if behind is None else behind[1].replace("&amp;", "&")
    assert seen == [("2", str(sheet)) for sheet in reversed(range(70))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "prooflight_console.pages.search.EXPORTED_AT_ONCE", 16
        )  # several times from the journal
        answers = {
            kind: client.get(f"/search.{kind}?job=second&verdict=misprint&kind=streak")
            for kind in ("csv", "json")
        }
    streaks = [str(sheet) for sheet in reversed(range(70)) if sheet % 2]
    table = list(csv.DictReader(io.StringIO(answers["csv"].text)))
    assert [row["sheet"] for row in table] == streaks
    assert {(row["run"], row["job"], row["kind"]) for row in table} == {("2", "second", "streak")}
    objects = answers["json"].json()
    assert client.get("/search.json?job=none").json() == []
    assert [str(one["sheet"]) for one in objects] == streaks
    assert objects[0]["regions"], "all of a verdict"
    assert answers["csv"].headers["content-disposition"] == 'attachment; filename="sheets.csv"'
    assert client.get("/search.csv?since=2026-02-31").status_code == 422
    console.close()


def test_names_in_the_audit_and_words_are_told_by_the_reader_s_language(console: Served) -> None:
    client = console.client(Role.ADMIN)
    client.post("/runs/1/incidents/1/label", data={"label": "false-alarm"})
    assert "False alarm" in client.get("/setup/audit").text
    german = client.get("/setup/audit", headers={"Accept-Language": "de"}).text
    assert "hat eine Bewertung abgegeben" in german
