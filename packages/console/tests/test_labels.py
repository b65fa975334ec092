"""What people say of sheets: what a label covers, what it cannot do, how a sheet is vouched for, and how all of it is
undone.
"""

from __future__ import annotations

import csv
import io
import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.consoles import served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.cli import run
from prooflight.detectors.verdict import Verdict
from prooflight_console.accounts.roles import Role, Scope
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, labels_path
from prooflight_line.journal.records import RunEnd

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

    from prooflight_line.journal.records import PageRecord

API = "/api/v1/runs/1"
BLIND = tuple(range(5, 15))
"""Sheets that were not inspected: the first incident."""
BAD = (20, 21, 60, 61)
"""Misprints at one place, the last two long after the incident of the first two has ended: the second incident."""
SHEETS = 70


def record(sheet: int) -> PageRecord:
    if sheet in BLIND:
        return good(sheet, verdict=Verdict.skipped(f"p{sheet + 1:04}", "the deadline had passed"))
    return misprint(sheet) if sheet in BAD else good(sheet)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    """A run that goes on, and has come to sheet 39."""
    with Journal.open(str(tmp_path / "journal.sqlite")) as opened:
        opened.begin_run(facts(sheets=SHEETS))
        go_on(opened, 0, 40)
        yield opened


@pytest.fixture
def console(journal: Journal, tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path, run=False)
    yield made
    made.close()


def go_on(journal: Journal, since: int, until: int) -> None:
    for sheet in range(since, until):
        journal.record(1, record(sheet))
    journal.commit()


def again(client: TestClient) -> list[int]:
    """Places in the run of sheets to print again, which everybody must tell alike."""
    listed = client.get(f"{API}/reprint").json()
    found = [one["run_sheet"] for one in listed["sheets"]]
    rows = list(csv.DictReader(io.StringIO(client.get("/runs/1/reprint.csv").text)))
    client.app.state.console.live._poll()  # type: ignore[attr-defined]
    now = client.get("/api/v1/now").json()["to_print_again"]
    report = client.get(f"{API}/report").json()["to_print_again"]
    assert {listed["count"], len(rows), now, report} == {len(found)}
    return found


def open_incidents(client: TestClient) -> list[int]:
    client.app.state.console.live._poll()  # type: ignore[attr-defined]
    return [one["number"] for one in client.get("/api/v1/now").json()["incidents"]]


@pytest.mark.parametrize("word", ["false-alarm", "good", "misprint", "unknown"])
def test_no_label_ships_a_sheet_that_nobody_looked_at(console: Served, word: str) -> None:
    operator = console.client(Role.OPERATOR)
    before = again(operator)
    assert set(BLIND) <= set(before)
    answer = operator.post(f"{API}/incidents/1/labels", json={"label": word})
    assert (answer.status_code, "one by one" in answer.json()["detail"]) == (409, True)
    assert operator.post("/runs/1/incidents/1/label", data={"label": word}).status_code == 409
    operator.post(f"{API}/sheets/5/labels", json={"label": word})
    assert again(operator) == before
    assert operator.post(f"{API}/incidents/1/labels", json={"label": "seen"}).status_code == 201
    page = operator.get("/runs/1/incidents/1").text
    assert "False alarm" not in page
    assert "Nichts" not in operator.get("/runs/1/incidents/1", headers={"Accept-Language": "de"}).text


def test_a_label_that_an_older_version_kept_of_such_an_incident_counts_for_nothing(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    before = again(operator)
    key = console.console.reading.run(1).facts.started_s
    LabelStore(console.journal).say("false-alarm", run=f"1@{key:.0f}", incident="1", by="Jan", at_s=1.0)
    assert again(operator) == before
    assert operator.get(f"{API}/incidents/1").json()["label"] is None


def test_a_person_vouches_for_one_sheet_by_name_with_a_reason_and_it_stands_in_the_audit(
    console: Served,
) -> None:
    operator, path = console.client(Role.OPERATOR), f"{API}/sheets/7/release"
    before = again(operator)
    for wrong in ({}, {"reason": ""}, {"reason": " "}):
        assert operator.post(path, json=wrong).status_code in (409, 422)
    assert "Enter a reason" in operator.post("/runs/1/sheets/7/release", data={"reason": " "}).text
    assert console.client(Role.VIEWER).post(path, json={"reason": "fine"}).status_code == 403
    assert again(operator) == before
    said = operator.post(path, json={"reason": "held against the light"}).json()
    assert (said["label"], said["by"], said["note"]) == ("vouched", "operator", "held against the light")
    assert again(operator) == [sheet for sheet in before if sheet != 7]
    assert operator.get(f"{API}/reprint").json()["released_manually"] == [7]
    entry = console.accounts.audited(limit=1)[0]
    assert (entry.who, entry.what) == ("operator", "words.vouch")
    assert entry.target.endswith("sheet 7")
    assert json.loads(entry.after or "")["reason"] == "held against the light"
    page = operator.get("/runs/1/sheets/7").text
    assert "Released manually" in page
    assert operator.post(f"{API}/labels/{said['id']}/undo").status_code == 201
    assert again(operator) == before


def test_a_token_cannot_vouch_and_nobody_can_for_a_sheet_that_never_came(
    console: Served, journal: Journal
) -> None:
    operator = console.client(Role.OPERATOR)
    secret = console.accounts.new_token("operator", "program", list(Scope), by="test")[1]
    bearer = {"Authorization": f"Bearer {secret}"}
    answer = console.client().post(f"{API}/sheets/7/release", json={"reason": "fine"}, headers=bearer)
    assert (answer.status_code, answer.json()["type"]) == (403, "urn:prooflight:scope")
    assert operator.post(f"{API}/sheets/7/labels", json={"label": "vouched"}).status_code == 422
    assert operator.post("/runs/1/sheets/7/label", data={"label": "vouched"}).status_code == 409
    gone = Verdict(page="p0041", verdict="not-inspected")
    journal.record(1, good(40, verdict=gone, faults=("missing",)))
    journal.commit()
    answer = operator.post(f"{API}/sheets/40/release", json={"reason": "fine"})
    assert (answer.status_code, "did not come" in answer.json()["detail"]) == (409, True)
    assert operator.post(f"{API}/sheets/66/release", json={"reason": "fine"}).status_code == 404


def test_a_label_covers_what_the_person_saw_and_later_sheets_open_the_incident_again(
    console: Served, journal: Journal
) -> None:
    operator, path = console.client(Role.OPERATOR), f"{API}/incidents/2"
    operator.post(f"{API}/incidents/1/labels", json={"label": "seen"})
    assert operator.post(f"{path}/labels", json={"label": "false-alarm"}).json()["upto"] == 21
    assert open_incidents(operator) == []
    go_on(journal, 40, SHEETS)
    told = operator.get(path).json()
    assert (told["count"], told["label"], told["labelled"], told["seen"]) == (4, "false-alarm", False, False)
    assert open_incidents(operator) == [2]
    assert again(operator) == [*BLIND, 60, 61]
    report = operator.get(f"{API}/report").json()
    assert (report["run"]["misprints"], sum(report["kinds"].values()), report["false_alarms"]) == (4, 4, 2)
    assert "up to sheet 21" in operator.get("/runs/1/incidents/2").text
    operator.post(f"{path}/labels", json={"label": "false-alarm"})
    assert (open_incidents(operator), again(operator)) == ([], list(BLIND))
    page = operator.get("/report/1").text
    assert page.count('<td class="n">2</td>') >= 1
    assert "no misprints any more" not in page


def test_a_tap_covers_the_sheets_that_the_page_showed_and_not_those_that_came_meanwhile(
    console: Served, journal: Journal
) -> None:
    operator = console.client(Role.OPERATOR)
    page = operator.get("/runs/1/incidents/2").text
    assert "&#34;upto&#34;: 21" in page or '"upto": 21' in page
    go_on(journal, 40, SHEETS)
    answer = operator.post("/runs/1/incidents/2/label", data={"label": "false-alarm", "upto": "21"})
    assert "Sheet 61 came later" in answer.text
    assert again(operator) == [*BLIND, 60, 61]
    late = operator.post(f"{API}/incidents/2/labels", json={"label": "false-alarm", "upto": 10**9}).json()
    assert late["upto"] == 61, "nobody sees what has not come"


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("incidents/2", "false-alarm"),
        ("incidents/2", "seen"),
        ("sheets/20", "good"),
        ("sheets/30", "misprint"),
    ],
)
def test_every_label_can_be_undone_and_the_one_before_counts(console: Served, path: str, word: str) -> None:
    operator = console.client(Role.OPERATOR)

    def state() -> tuple[Any, ...]:
        told = operator.get(f"{API}/{path}").json()
        return told.get("label"), told.get("seen"), again(operator), operator.get(f"{API}/report").json()

    before = state()
    said = operator.post(f"{API}/{path}/labels", json={"label": word}).json()
    undone = operator.post(f"{API}/labels/{said['id']}/undo")
    assert (undone.status_code, undone.json()["undoes"]) == (201, said["id"])
    assert state() == before
    assert len(operator.get(f"{API}/{path}").json()["labels"]) == 2, "nothing is taken away"
    assert operator.post(f"{API}/labels/{said['id']}/undo").status_code == 409, "it does not stand any more"
    assert console.accounts.audited(limit=1)[0].what == "words.undo"
    shown = 20 if path == "incidents/2" else int(path.rpartition("/")[2])
    page = operator.get(f"/runs/1/{path}").text
    assert "undone by operator" in page
    again_said = operator.post(f"{API}/{path}/labels", json={"label": word}).json()
    part = operator.post(f"/runs/1/labels/{again_said['id']}/undo?shown={shown}")
    assert part.status_code == 200
    assert state() == before


def test_an_undone_label_leaves_the_one_before_it(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    operator.post(f"{API}/incidents/2/labels", json={"label": "false-alarm"})
    said = operator.post(f"{API}/incidents/2/labels", json={"label": "misprint"}).json()
    assert again(operator) == [*BLIND, 20, 21]
    operator.post(f"{API}/labels/{said['id']}/undo")
    assert again(operator) == list(BLIND)


def test_the_command_line_undoes_too(console: Served, capsys: pytest.CaptureFixture[str]) -> None:
    viewer, journal = console.client(Role.VIEWER), str(console.journal)
    mark = ["run", "mark", "1", "20", "--by", "Mei", "--journal", journal]
    assert run([*mark[:4], "good", *mark[4:]]) == 0
    assert again(viewer) == [*BLIND, 21]
    assert run([*mark[:4], "undo", *mark[4:]]) == 0
    assert again(viewer) == [*BLIND, 20, 21]
    capsys.readouterr()
    assert run([*mark[:4], "undo", *mark[4:]]) == 2
    assert "sheet 20 of run 1 has no label" in capsys.readouterr().err
    assert run([*mark[:4], "vouched", *mark[4:]]) == 2


def test_words_of_schema_1_are_read_and_get_the_new_columns_with_the_next_word(tmp_path: Path) -> None:
    journal = tmp_path / "journal.sqlite"
    with closing(sqlite3.connect(labels_path(journal))) as connection, connection:
        connection.execute("CREATE TABLE store (kind TEXT NOT NULL, schema INTEGER NOT NULL)")
        connection.execute(
            "CREATE TABLE words (id INTEGER PRIMARY KEY, run TEXT NOT NULL, sheet INTEGER, incident TEXT,"
            ' word TEXT NOT NULL, note TEXT NOT NULL, "by" TEXT NOT NULL, at_s REAL NOT NULL)'
        )
        connection.execute("INSERT INTO store VALUES ('prooflight words', 1)")
        connection.execute("INSERT INTO words VALUES (1, '1@1000', NULL, '2', 'false-alarm', '', 'Jan', 5.0)")
    words = LabelStore(journal)
    (old,) = words.of_run("1@1000")
    assert (old.word, old.upto, old.covers(10**6)) == ("false-alarm", None, True)
    words.undo(1, run="1@1000", by="Mei", at_s=6.0)
    assert [(one.word, one.undoes) for one in words.of_run("1@1000")] == [
        ("false-alarm", None),
        ("undone", 1),
    ]


def test_at_the_end_all_counts_are_those_of_the_sheets_that_are_not_good(
    console: Served, journal: Journal, capsys: pytest.CaptureFixture[str]
) -> None:
    go_on(journal, 40, 65)
    journal.end_run(1, RunEnd(ended_s=2000.0, ending="stopped"))
    viewer = console.client(Role.VIEWER)
    wanted = [*BLIND, *BAD, *range(65, SHEETS)]
    assert again(viewer) == wanted
    assert run(["run", "reprint-list", "1", "--json", "--journal", str(console.journal)]) == 0
    command = json.loads(capsys.readouterr().out)
    assert [one["run_sheet"] for one in command["reprints"]] == wanted
    assert (command["count"], command["unprinted"]) == (len(wanted), 5)
    assert "5 sheets from sheet 65 on" in viewer.get("/runs/1/reprint").text
