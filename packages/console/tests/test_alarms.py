"""Alarms as people handle them: acknowledged at once, shelved with an end and a reason, counted, and handed over."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.consoles import served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.detectors.verdict import Verdict
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

API = "/api/v1/runs/1"
SHELVE = f"{API}/incidents/1/shelvings"
ASKED: dict[str, Any] = {"minutes": 60, "reason": "known  spot", "priority": "medium"}


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    """A run that goes on, whose last sheet is a misprint: incident 1, of medium priority."""
    with Journal.open(str(tmp_path / "journal.sqlite")) as opened:
        opened.begin_run(facts(sheets=400, started_s=999_000.0))
        for sheet in range(30):
            opened.record(1, good(sheet))
        opened.record(1, misprint(30))
        opened.commit()
        yield opened


@pytest.fixture
def console(journal: Journal, tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path, run=False)
    yield made
    made.close()


def now(console: Served, client: TestClient) -> dict[str, Any]:
    console.console.live._poll()
    told: dict[str, Any] = client.get("/api/v1/now").json()
    return told


def test_a_shelved_alarm_is_away_listed_and_comes_back_by_itself(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    assert now(console, operator)["state"] == "look"
    answer = operator.post(SHELVE, json=ASKED)
    assert answer.status_code == 201, answer.text
    shelving = answer.json()
    assert (shelving["by"], shelving["reason"], shelving["ends_s"]) == ("operator", "known spot", 1_003_600.0)
    told = now(console, operator)
    assert (told["state"], told["pending"], told["shelved"]) == ("good", 0, 1)
    assert operator.get(f"{API}/incidents/1").json()["shelved_until_s"] == 1_003_600.0
    page = operator.get("/alarms?show=shelved").text
    assert "known spot" in page
    assert "operator" in page
    assert operator.get(f"{API}/reprint").json()["count"] == 1, "a shelving changes no list"
    console.clock.now_s += 3600.0
    told = now(console, operator)
    assert (told["pending"], told["shelved"]) == (1, 0)
    (listed,) = operator.get(f"{API}/shelvings").json()["items"]
    assert (listed["in_force"], listed["ended_by"]) == (False, None)
    assert operator.get(f"{API}/shelvings?in_force=true").json()["items"] == []


def test_a_shelved_alarm_comes_back_with_a_higher_priority(console: Served, journal: Journal) -> None:
    operator = console.client(Role.OPERATOR)
    operator.post(SHELVE, json=ASKED).raise_for_status()
    for sheet in (31, 32):
        journal.record(1, misprint(sheet))
    journal.commit()
    told = now(console, operator)
    assert (told["state"], told["alarm"], told["shelved"]) == ("stop", True, 0)
    assert "although it is shelved" in operator.get("/runs/1/incidents/1").text
    refused = operator.post(SHELVE, json=ASKED)
    assert (refused.status_code, "is now high" in refused.json()["detail"]) == (409, True)
    asked = ASKED | {"priority": "high"}
    assert operator.post(SHELVE, json=asked).status_code == 403, "an operator shelves no high priority"
    assert console.client(Role.ENGINEER).post(SHELVE, json=asked).status_code == 201
    assert now(console, operator)["shelved"] == 1


def test_a_shelving_is_ended_and_replaced_and_the_audit_says_by_whom(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    first = operator.post(SHELVE, json=ASKED).json()["id"]
    second = operator.post(SHELVE, json=ASKED | {"minutes": 15}).json()["id"]
    assert operator.delete(f"{API}/shelvings/{first}").status_code == 409, "the second took its place"
    ended = operator.delete(f"{API}/shelvings/{second}")
    assert (ended.status_code, ended.json()["ended_by"]) == (200, "operator")
    assert now(console, operator)["shelved"] == 0
    deeds = [entry.what for entry in console.accounts.audited() if entry.what.startswith("alarms.")]
    assert deeds == ["alarms.unshelve", "alarms.shelve", "alarms.shelve"]
    page = console.client(Role.ADMIN).get("/setup/audit").text
    for text in ("ended the shelving of an alarm", "priority: Medium", "time [min]: 15", "run 1, incident 1"):
        assert text in page


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"minutes": 0}, 422),
        ({"minutes": 721}, 422),
        ({"minutes": "nan"}, 422),
        ({"reason": ""}, 422),
        ({"reason": " \n "}, 409),
        ({"reason": "x" * 301}, 422),
        ({"priority": "urgent"}, 422),
        ({"more": 1}, 422),
    ],
)
def test_a_shelving_without_an_end_or_a_reason_is_refused(
    console: Served, changes: dict[str, Any], status: int
) -> None:
    operator = console.client(Role.OPERATOR)
    assert operator.post(SHELVE, json=ASKED | changes).status_code == status
    assert operator.get(f"{API}/shelvings").json()["items"] == []


def test_what_is_not_there_cannot_be_shelved_and_a_viewer_may_not(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    assert operator.post(f"{API}/incidents/7/shelvings", json=ASKED).status_code == 404
    assert operator.post("/api/v1/runs/9/incidents/1/shelvings", json=ASKED).status_code == 404
    assert operator.delete(f"{API}/shelvings/7").status_code == 409
    assert console.client(Role.VIEWER).post(SHELVE, json=ASKED).status_code == 403
    form = {"minutes": "60", "priority": "medium", "reason": " "}
    answer = operator.post("/runs/1/incidents/1/shelve", data=form)
    assert (answer.status_code, 'role="alert"' in answer.text) == (200, True)


def test_all_are_acknowledged_that_were_seen_and_no_later_one(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        journal.begin_run(facts())
        for sheet in range(60):
            journal.record(1, misprint(sheet) if sheet in (5, 6, 7) else good(sheet))
        reason = Verdict.skipped("p0061", "it was too dark")
        journal.record(1, good(60, verdict=reason))
        journal.commit()
        operator = console.client(Role.OPERATOR)
        seen = f"{API}/incidents/seen"
        assert console.client(Role.VIEWER).post(seen, json={"upto": 60}).status_code == 403
        assert operator.post(seen, json={"upto": -1}).status_code == 422
        assert operator.post(seen, json={}).status_code == 422
        assert operator.post(seen, json={"upto": 59}).json() == {"incidents": [1]}
        told = now(console, operator)
        assert (told["unseen"], told["pending"]) == (1, 1), "an ended one that was seen needs nothing more"
        assert operator.post("/runs/1/incidents/seen", data={"upto": "60"}).status_code == 204
        assert operator.get(f"{API}/incidents/2").json()["seen"]
        assert operator.post(seen, json={"upto": 60}).json() == {"incidents": []}
    console.close()


def test_the_statistics_count_each_return_and_the_page_shows_them(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts(started_s=1_000_000.0 - 7200.0, sheets=None))
        for sheet in range(0, 120):
            record = misprint(sheet) if sheet in (10, 60) else good(sheet)
            journal.record(run, record)
        journal.end_run(run, RunEnd(ended_s=1_000_000.0 - 3600.0, ending="finished"))
    operator = console.client(Role.OPERATOR)
    operator.post("/runs/1/incidents/1/seen").raise_for_status()
    told = operator.get("/api/v1/alarms/statistics?hours=24").json()
    assert (told["alarms"], told["hours"], told["per_hour"], told["runs"]) == (2, 1.0, 2.0, 1)
    assert told["priorities"] == {"high": 0, "medium": 2, "low": 0}
    assert told["kinds"] == {"spots-voids": 2}
    assert told["response_s"] == pytest.approx(7200.0 - 0.2 * 60), "the last return was acknowledged"
    page = operator.get("/alarms/statistics").text
    assert "ISA-18.2" in page
    assert "≤ 6 (12)" in page
    assert operator.get("/api/v1/alarms/statistics?hours=1").json()["alarms"] == 0
    for wrong in ("0", "721", "nan", "x"):
        assert operator.get(f"/api/v1/alarms/statistics?hours={wrong}").status_code == 422
    console.close()


def test_a_thousand_alarms_stay_usable(tmp_path: Path) -> None:
    """Each at a place of its own: the page Now groups them, the list pages them, and none is missing."""
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts(sheets=None))
        for sheet in range(1000):
            found = misprint(sheet, kept=False)
            place = replace(found.verdict.regions[0], x_mm=60.0 * (sheet % 33), y_mm=60.0 * (sheet // 33))
            journal.record(run, replace(found, verdict=replace(found.verdict, regions=(place,))))
        journal.commit()
        operator = console.client(Role.OPERATOR)
        told = now(console, operator)
        assert (told["flood"], told["state"], told["pending"]) == (True, "stop", 1000)
        page = operator.get("/").text
        assert page.count('class="incident card') == 4
        assert "996 alarms" in page
        listed = operator.get("/alarms?page=20").text
        assert listed.count('class="incident card') == 50
        assert operator.get("/alarms?page=21").text.count('class="incident card') == 0
        last = told["incidents"][0]["last_sheet"]
        assert len(operator.post(f"{API}/incidents/seen", json={"upto": last}).json()["incidents"]) == 1000
        assert now(console, operator)["unseen"] == 0
    console.close()


def test_a_note_is_handed_over_with_the_state_of_the_alarms(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    assert operator.post("/api/v1/handovers", json={"text": ""}).status_code == 422
    assert operator.post("/api/v1/handovers", json={"text": "  "}).status_code == 409
    assert console.client(Role.VIEWER).post("/api/v1/handovers", json={"text": "x"}).status_code == 403
    answer = operator.post("/api/v1/handovers", json={"text": "blanket <b>ordered</b>"})
    assert answer.status_code == 201
    summary = answer.json()["summary"]
    assert (summary["state"], summary["alarms"]["medium"], summary["pending"]) == ("look", 1, 1)
    console.console.live._poll()
    for path in ("/", "/alarms/hand-over"):
        assert "blanket &lt;b&gt;ordered&lt;/b&gt;" in operator.get(path).text
    operator.post("/alarms/hand-over", data={"text": "second"}).raise_for_status()
    first_page = operator.get("/api/v1/handovers?limit=1").json()
    assert [note["text"] for note in first_page["items"]] == ["second"]
    (older,) = operator.get(f"/api/v1/handovers?before={first_page['next']}").json()["items"]
    assert older["text"].startswith("blanket")


def test_a_label_says_what_it_changed_and_undo_takes_it_back(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    assert "What the labels changed" not in operator.get("/runs/1/incidents/1").text
    answer = operator.post("/runs/1/incidents/1/label", data={"label": "false-alarm"}).text
    assert '<s>1</s> → <a href="/runs/1/reprint">0</a>' in answer
    assert "<s>0</s> → 1" in answer
    assert "no sheet of this incident is part of the random sample" in answer
    (word,) = operator.get(f"{API}/incidents/1").json()["labels"]
    undone = operator.post(f"/runs/1/labels/{word['id']}/undo?shown=30").text
    assert '<s>0</s> → <a href="/runs/1/reprint">1</a>' in undone


def test_incidents_lead_to_their_neighbours_and_to_the_next_alarm(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        journal.begin_run(facts())
        for sheet in range(30):
            kind = {3: "streak", 9: "spots-voids", 15: "scum"}.get(sheet)
            journal.record(1, good(sheet) if kind is None else misprint(sheet, kind=kind))
        journal.commit()
        operator = console.client(Role.OPERATOR)
        page = operator.get("/runs/1/incidents/2").text
        assert 'rel="prev" href="/runs/1/incidents/1"' in page
        assert 'rel="next" href="/runs/1/incidents/3"' in page
        assert 'href="/runs/1/incidents/3" data-go="N"' in page
        assert 'rel="next"' not in operator.get("/runs/1/incidents/3").text
    console.close()


def test_a_file_of_schema_2_gets_the_tables_of_alarms(console: Served, tmp_path: Path) -> None:
    console.client(Role.OPERATOR)
    path = console.accounts.path
    console.accounts.close()
    with closing(sqlite3.connect(path)) as file:
        for table in ("shelvings", "handovers"):
            file.execute(f"DROP TABLE {table}")
        file.execute("UPDATE console SET schema = 2")
        file.commit()
    again = served(tmp_path, run=False)
    assert again.client(Role.OPERATOR).post(SHELVE, json=ASKED).status_code == 201
    again.close()


def test_a_run_that_does_not_inspect_is_red_until_the_press_stands_and_somebody_has_seen_it(
    console: Served, journal: Journal
) -> None:
    operator = console.client(Role.OPERATOR)
    for sheet in range(31, 34):
        journal.record(1, good(sheet, verdict=Verdict.skipped(f"p{sheet + 1:04}", "the lamp is too dark")))
    journal.commit()
    assert now(console, operator)["state"] == "blind"
    page = operator.get("/").text
    assert 'class="band blind unseen-alarm"' in page
    assert "the lamp is too dark" in page
    console.clock.now_s += 60.0
    assert now(console, operator)["state"] == "blind", "nobody has seen it"
    operator.post("/runs/1/incidents/seen", data={"upto": "33"}).raise_for_status()
    told = now(console, operator)
    assert (told["state"], told["alarm"]) == ("silent", False)


def test_misprints_of_different_causes_are_red_together(console: Served, journal: Journal) -> None:
    operator = console.client(Role.OPERATOR)
    for sheet, kind in ((31, "streak"), (32, "scum")):
        journal.record(1, misprint(sheet, kind=kind))
    journal.commit()
    told = now(console, operator)
    assert [one["priority"] for one in told["incidents"]] == ["medium"] * 3
    assert (told["state"], told["alarm"]) == ("stop", True)
    assert "Misprints with different causes" in operator.get("/").text
    operator.post(f"{API}/incidents/1/labels", json={"label": "false-alarm"}).raise_for_status()
    assert now(console, operator)["state"] == "look", "a false alarm wastes nothing"
