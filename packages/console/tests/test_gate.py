"""A run's gate for programs: every sheet accounted for as by ``run reconcile``, and the log line by line."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest
from packages.line.tests.journal.sample_rows import good

from prooflight.cli import run
from prooflight_console.accounts.roles import Role, Scope
from prooflight_line.journal.journal import Journal
from prooflight_line.plant.gate.log import GateLog, log_path
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Iterator

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

GATE = "/api/v1/runs/1/gate"
BAD = (10, 11, 12)
LOST, WRONG, UNSEEN = 3, 11, 29


@pytest.fixture
def gated(console: Served) -> Served:
    """The run of 30 sheets with three misprints: one good sheet is rejected, one bad one is not, the last not seen."""
    with GateLog(log_path(console.journal, 1)) as log:
        log.add("run", run=1, job_pages=30, settings={"policy": "reject", "distance_mm": 2000.0})
        log.add("session", session=7)
        for sheet in range(30):
            bad = sheet in BAD
            result, code = (Result.DIVERT, Code.MISPRINT) if bad else (Result.ACCEPT, Code.GOOD)
            log.add(
                "decision", tag=sheet + 1, sheet=sheet, came=True, result=int(result), code=int(code),
                job_page=sheet, page=f"p{sheet + 1:04}", set=sheet // 8, why="", position=1000 * sheet,
            )  # fmt: skip
            log.add("written", tag=sheet + 1, position=1000 * sheet)
            if sheet != UNSEEN:
                reject = sheet == LOST or (bad and sheet != WRONG)
                log.add("tray", tag=sheet + 1, tray="reject" if reject else "good", session=7)
    return console


@pytest.fixture
def viewer(gated: Served) -> TestClient:
    return gated.client(Role.VIEWER)


def test_sheets_are_accounted_for_as_the_command_accounts_for_them(
    gated: Served, viewer: TestClient, capsys: pytest.CaptureFixture[str]
) -> None:
    told = viewer.get(GATE, params={"limit": 500}).json()
    assert told["counts"] == {"accepted": 25, "lost": 1, "diverted": 2, "wrong": 1, "not-at-gate": 1}
    assert (told["sessions"], told["settings"]["policy"], told["next"]) == ([7], "reject", None)
    assert run(["run", "reconcile", "1", "--json", "--journal", str(gated.journal)]) == 1
    command = json.loads(capsys.readouterr().out)
    for name in ("run", "counts", "lost_by", "not_in_the_journal"):
        assert told[name] == command[name]
    names = ("sheet", "account", "job_page", "page", "verdict", "in_journal", "decision", "tray", "why")
    assert [[one[name] for name in names] for one in told["items"]] == [
        [one[name] for name in names] for one in command["sheets"]
    ]
    sheet = told["items"][WRONG]
    assert (sheet["account"], sheet["tag"], sheet["position"], sheet["set"], sheet["written"]) == (
        *("wrong", WRONG + 1, 11_000, 1),
        True,
    )


def test_sheets_come_page_by_page_and_by_what_became_of_them(viewer: TestClient) -> None:
    found: list[int] = []
    after: int | None = -1
    while after is not None:
        told = viewer.get(GATE, params={"limit": 7, "after": after}).json()
        found, after = found + [one["sheet"] for one in told["items"]], told["next"]
    assert found == list(range(30))
    diverted = viewer.get(GATE, params={"account": "diverted"}).json()
    assert [one["sheet"] for one in diverted["items"]] == [10, 12]
    assert viewer.get(GATE, params={"account": "burnt"}).status_code == 422


def test_what_is_written_meanwhile_counts(gated: Served, viewer: TestClient) -> None:
    assert viewer.get(GATE).json()["counts"]["not-at-gate"] == 1
    with GateLog(log_path(gated.journal, 1)) as log:
        log.add("tray", tag=UNSEEN + 1, tray="good", session=7)
    assert "not-at-gate" not in viewer.get(GATE).json()["counts"]


def test_the_log_is_given_line_by_line(gated: Served, viewer: TestClient) -> None:
    lines: list[dict[str, Any]] = []
    after: int | None = 0
    while after is not None:
        told = viewer.get(f"{GATE}/log", params={"limit": 20, "after": after}).json()
        lines, after = lines + told["items"], told["next"]
    written = log_path(gated.journal, 1).read_text().splitlines()
    assert [{"line": number, **json.loads(line)} for number, line in enumerate(written, 1)] == lines


def test_a_run_without_a_gate_and_a_damaged_log_are_told(console: Served) -> None:
    viewer = console.client(Role.VIEWER)
    for path in (GATE, f"{GATE}/log"):
        answer = viewer.get(path)
        assert (answer.status_code, answer.json()["detail"]) == (404, "run 1 had no gate")
    log = log_path(console.journal, 1)
    log.parent.mkdir()
    log.write_text('{"kind": "run"}\nnothing\n{"kind": "end"}\n')
    for path in (GATE, f"{GATE}/log"):
        answer = viewer.get(path)
        assert (answer.status_code, answer.json()["type"]) == (409, "urn:prooflight:unusable")
        assert "line 2 is not JSON" in answer.json()["detail"]


@pytest.fixture
def goes_on(console: Served) -> Iterator[Journal]:
    """The run goes on while a test looks."""
    with Journal.open(str(console.journal)) as journal:
        journal.record(1, good(30))
        journal.commit()
        yield journal


def gate_now(console: Served, viewer: TestClient) -> dict[str, Any]:
    console.console.live._poll()
    told: dict[str, Any] = viewer.get("/api/v1/now").json()["health"]["gate"]
    return told


def test_the_page_now_shows_what_the_gate_says_as_its_log_grows(
    gated: Served, goes_on: Journal, viewer: TestClient
) -> None:
    accounts = viewer.get(GATE).json()["counts"]
    told = gate_now(gated, viewer)
    assert (told["decided"], told["diverted"], told["last_reconciled"]) == (30, 3, 28)
    assert (told["wrong"], told["lost"]) == (accounts["wrong"], accounts["lost"]) == (1, 1)
    assert (told["first_wrong"], told["lamp"], told["state"]) == (WRONG, "bad", "away")
    with GateLog(log_path(gated.journal, 1)) as log:
        log.add("state", state="ready", why="")
        log.add("tray", tag=UNSEEN + 1, tray="good", session=7)
    gated.clock.now_s += 2.0
    told = gate_now(gated, viewer)
    assert (told["state"], told["last_reconciled"], told["wrong"]) == ("ready", UNSEEN, 1)
    page = viewer.get("/").text
    assert "ready<br>30 sheets decided, 3 to be rejected<br>trays reconciled up to sheet 29" in page
    assert "1 sheet in the good tray although rejected; first: sheet 11" in page


def test_a_gate_that_is_as_it_should_be_has_a_good_lamp_and_one_without_controller_a_bad(
    console: Served, goes_on: Journal
) -> None:
    viewer = console.client(Role.VIEWER)
    assert gate_now(console, viewer) is None
    assert "not used in this run" in viewer.get("/").text
    states = {"ready": "good", "aligning": "look", "joining": "look", "away": "bad"}
    with GateLog(log_path(console.journal, 1)) as log:
        log.add("run", run=1, job_pages=30, settings={"policy": "reject"})
        for state, lamp in states.items():
            log.add("state", state=state, why="")
            console.clock.now_s += 2.0
            told = gate_now(console, viewer)
            assert (told["state"], told["lamp"]) == (state, lamp)


def test_a_damaged_log_is_said_on_the_page_and_a_torn_line_is_waited_for(
    gated: Served, goes_on: Journal
) -> None:
    viewer, log = gated.client(Role.VIEWER), log_path(gated.journal, 1)
    whole = '{"kind": "state", "state": "ready", "why": ""}\n'
    with log.open("a", encoding="utf-8") as file:
        file.write(whole[:20])
    assert gate_now(gated, viewer)["state"] == "away"
    with log.open("a", encoding="utf-8") as file:
        file.write(whole[20:])
    gated.clock.now_s += 2.0
    assert gate_now(gated, viewer)["state"] == "ready"
    with log.open("a", encoding="utf-8") as file:
        file.write("nothing\n")
    gated.clock.now_s += 2.0
    assert (gate_now(gated, viewer)["state"], gate_now(gated, viewer)["lamp"]) == ("damaged", "bad")
    assert "the gate log is damaged" in viewer.get("/").text


def test_whoever_signed_in_may_look_and_a_token_by_its_scope(gated: Served) -> None:
    nobody = gated.client()
    assert nobody.get(GATE).status_code == 401
    gated.client(Role.VIEWER)
    for scope, code in ((Scope.READ, 200), (Scope.LABELS, 403)):
        secret = gated.accounts.new_token("viewer", scope.value, [scope], by="test")[1]
        assert nobody.get(GATE, headers={"Authorization": f"Bearer {secret}"}).status_code == code


def test_where_a_sheet_of_the_journal_cannot_be_read_nobody_says_how_many_are_printed_again(
    console: Served,
) -> None:
    """It may be a misprint: a list without it would deliver what nobody knows to be good."""
    with closing(sqlite3.connect(console.journal)) as connection, connection:
        connection.execute("UPDATE pages SET whole_verdict = '{' WHERE sheet = ?", (BAD[0],))
    viewer = console.client(Role.VIEWER)
    assert viewer.get("/api/v1/now").json()["to_print_again"] is None
    assert viewer.get("/api/v1/runs/1/reprint").status_code == 503
