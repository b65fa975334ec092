"""Requests in the log for programs: each has a number, and one about a sheet has the sheet's name."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import served

from prooflight.cli import event_log
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.labels import run_key

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path)
    yield made
    made.close()


@pytest.fixture
def _log_for_programs() -> Iterator[None]:
    event_log.begin("json")
    yield
    event_log.end()


@pytest.mark.usefixtures("_log_for_programs")
def test_a_request_about_a_sheet_has_the_name_of_the_sheet(
    console: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = console.client(Role.VIEWER)
    capsys.readouterr()
    answer = viewer.get("/api/v1/runs/last/sheets/11", headers={"X-Request-ID": "proxy-7"})
    assert answer.headers["X-Request-ID"] == "proxy-7"
    (line,) = map(json.loads, capsys.readouterr().err.splitlines())
    run = console.console.reading.last_run()
    assert run is not None
    assert (line["event"], line["request"], line["status"]) == ("request", "proxy-7", 200)
    assert (line["run"], line["sheet"], line["id"]) == (run.id, 11, f"{run_key(run)}/11")
    assert line["press"] == run.facts.press


@pytest.mark.usefixtures("_log_for_programs")
def test_a_failure_is_logged_with_the_number_of_its_request(
    console: Served, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console.console.metrics, "text", lambda: [].index(3))
    viewer = console.client(Role.VIEWER)
    capsys.readouterr()
    answer = viewer.get("/metrics")
    assert answer.status_code == 500
    (line,) = map(json.loads, capsys.readouterr().err.splitlines())
    assert (line["level"], line["status"]) == ("warning", 500)
    assert line["request"] == answer.headers["X-Request-ID"]
    assert "ValueError" in line["exception"]


@pytest.mark.parametrize("given", ["", "a b", "x" * 65, "a\u00e4".encode("latin-1")])
def test_a_number_that_is_none_is_replaced(console: Served, given: str | bytes) -> None:
    named = console.client().get("/healthz", headers={"X-Request-ID": given}).headers["X-Request-ID"]
    assert re.fullmatch("[0-9a-f]{16}", named)


def test_people_read_no_requests(console: Served, capsys: pytest.CaptureFixture[str]) -> None:
    console.client().get("/healthz")
    assert capsys.readouterr().err == ""
