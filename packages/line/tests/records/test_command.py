"""``prooflight records`` from an empty database to a hit, and what it says where something is missing."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from packages.line.tests.journal.journals import facts, record
from packages.line.tests.records.conftest import misprint
from tests.cli.calls import call

from prooflight.cli import show
from prooflight_line.journal.journal import Journal
from prooflight_line.records.database import RecordsError, connect, upgrade
from prooflight_line.testing.postgres import LocalPostgres


def test_from_an_empty_database_to_a_hit(
    database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: object) -> str:
        code, out, err = call(capsys, "records", *arguments)
        assert code == 0, err
        return out

    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        number = journal.begin_run(facts(started_s=1e9))
        for sheet in range(4):
            journal.record(number, misprint(record(sheet)) if sheet == 2 else record(sheet))
    monkeypatch.setenv("PROOFLIGHT_RECORDS", database)
    monkeypatch.setattr(show.people, "width", 200)
    assert "schema none -> 0001" in run("upgrade")
    ship = ("ship", "--press", "one", "--plant", "north", "--journal", str(path), "--once")
    assert "4 sheets and 0 labels shipped" in run(*ship)
    assert "0 sheets and 0 labels shipped" in run(*ship)
    (hit,) = json.loads(run("search", "--verdict", "misprint", "--json"))
    assert (hit["press"], hit["sheet"], hit["kind"]) == ("one", 2, "streak")
    assert "streak" in run("search")
    assert "more than 3" in run("search", "--limit", "3")
    assert run("search", "--until", "2001-09-09", "--json").strip() == "[]"
    run("search", "--csv", str(tmp_path / "all.csv"))
    with (tmp_path / "all.csv").open(newline="") as file:
        assert [row["sheet"] for row in csv.DictReader(file)] == ["3", "2", "1", "0"]
    (state,) = json.loads(run("presses", "--hours", "1e6", "--json"))
    assert (state["press"], state["running"], state["sheets"], state["misprints"]) == ("one", "job.pdf", 4, 1)


def test_the_log_for_programs_names_the_sheets_that_were_shipped(
    records: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        number = journal.begin_run(facts(started_s=1e9))
        for sheet in range(2):
            journal.record(number, record(sheet))
    options = ("--press", "one", "--plant", "north", "--journal", str(path), "--once", "--log", "json")
    code, out, log = call(capsys, "records", "ship", "--to", records, *options)
    assert (code, out) == (0, "")
    events = [json.loads(line) for line in log.splitlines()]
    assert [(one["event"], one["press"], one["id"]) for one in events] == [
        ("shipped", "one", f"{number}@1000000000/{sheet}") for sheet in range(2)
    ]


def test_a_database_of_another_encoding_is_refused_in_one_line(server: LocalPostgres) -> None:
    with connect(server.url, upgraded=False) as connection:
        connection.execute("CREATE DATABASE plain ENCODING 'SQL_ASCII' LOCALE 'C' TEMPLATE template0")
    with pytest.raises(RecordsError, match="encoding SQL_ASCII, not UTF8"):
        upgrade(server.url.replace("/postgres?", "/plain?"))
