"""Live events by a real server: what `watch` writes is told at once, and who was away misses nothing."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import httpx
import pytest
import uvicorn
from packages.console.tests.consoles import PASSWORD, Served, served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.detectors.verdict import Verdict
from prooflight_console.accounts.roles import Role, Scope
from prooflight_console.reading import live as live_module
from prooflight_line.journal.journal import Journal
from prooflight_line.run.recording import Recorder

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S = 30.0
"""Only a test that fails waits so long."""


@contextmanager
def running(console: Served, port: int = 0) -> Iterator[int]:
    """The console behind a real socket; its port."""
    bound = socket.create_server(("127.0.0.1", port))
    server = uvicorn.Server(uvicorn.Config(console.app, log_level="error", timeout_graceful_shutdown=2))
    thread = threading.Thread(target=lambda: asyncio.run(server.serve(sockets=[bound])), daemon=True)
    thread.start()
    try:
        yield bound.getsockname()[1]
    finally:
        console.console.live.close()
        server.should_exit = True
        thread.join(PATIENCE_S)
        bound.close()
        assert not thread.is_alive()


@contextmanager
def signed_in(console: Served, port: int, role: Role = Role.VIEWER) -> Iterator[httpx.Client]:
    if role.value not in {person.name for person in console.accounts.people()}:
        console.accounts.choose(console.accounts.add(role.value, role, by="test"), PASSWORD)
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE_S, trust_env=False) as client:
        given = {"name": role.value, "password": PASSWORD}
        client.headers["X-CSRF-Token"] = client.post("/api/v1/session", json=given).json()["csrf"]
        yield client


@contextmanager
def listening(
    client: httpx.Client, path: str = "/api/v1/events", **told: Any
) -> Iterator[Iterator[tuple[str, str, Any]]]:
    """Events as (kind, id, data), without pings."""
    with client.stream("GET", path, **told) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")

        def events() -> Iterator[tuple[str, str, Any]]:
            held: dict[str, str] = {}
            for line in answer.iter_lines():
                if line:
                    name, _, value = line.partition(": ")
                    held[name] = value
                elif "event" in held:
                    yield held["event"], held.get("id", ""), json.loads(held["data"])
                    held = {}

        with closing(events()) as each:
            yield each


def sheets_of(events: Iterator[tuple[str, str, Any]], number: int) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    while len(found) < number:
        kind, row, data = next(events)
        if kind == "sheet":
            found.append((row, data["sheet"]))
    return found


def test_a_sheet_is_told_when_it_is_durable_and_once(console: Served) -> None:
    with running(console) as port, signed_in(console, port) as client, listening(client) as events:
        kind, _, now = next(events)
        assert (kind, now["state"], now["run"]["pages"]) == ("now", "interrupted", 30)
        with Journal.open(str(console.journal)) as journal, Recorder(journal, 1) as recorder:
            for sheet in (30, 31, 32):
                recorder.record(good(sheet))
            assert sheets_of(events, 3) == [("31", 30), ("32", 31), ("33", 32)]
            recorder.record(misprint(33))
            assert sheets_of(events, 1) == [("34", 33)]
            state = next(data for kind, _, data in events if kind == "now" and data["run"]["pages"] == 34)
            assert (state["state"], state["alarm"]) == ("look", False), "one sheet"
            assert state["incidents"][0]["count"] == 4, "the same streak as before"
            for sheet in (34, 35):
                recorder.record(misprint(sheet))
            state = next(data for kind, _, data in events if kind == "now" and data["run"]["pages"] == 36)
            assert (state["state"], state["alarm"]) == ("stop", True)


def test_who_was_away_gets_all_sheets_since(console: Served) -> None:
    with running(console) as port, signed_in(console, port) as client:
        with listening(client) as events:
            assert next(events)[0] == "now"
        with Journal.open(str(console.journal)) as journal:
            for sheet in range(30, 50):
                journal.record(1, good(sheet))
        with listening(client, headers={"Last-Event-ID": "28"}) as events:
            assert sheets_of(events, 22) == [(str(sheet + 1), sheet) for sheet in range(28, 50)]
        with listening(client, params={"after": 48}) as events:
            assert sheets_of(events, 2) == [("49", 48), ("50", 49)]


def test_a_server_that_began_anew_tells_on_from_the_last_id(tmp_path: Path) -> None:
    console = served(tmp_path)
    with running(console) as port, signed_in(console, port) as client:
        cookies = dict(client.cookies)
        with listening(client) as events:
            assert next(events)[0] == "now"
    with Journal.open(str(console.journal)) as journal:
        for sheet in range(30, 35):
            journal.record(1, good(sheet))
    again = served(tmp_path, run=False)
    with (
        running(again) as port,
        httpx.Client(base_url=f"http://127.0.0.1:{port}", cookies=cookies, trust_env=False) as client,
        listening(client, headers={"Last-Event-ID": "30"}) as events,
    ):
        assert sheets_of(events, 5) == [(str(sheet + 1), sheet) for sheet in range(30, 35)]


def test_more_than_is_told_again_is_a_gap(console: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "MOST_MISSED", 5)
    with running(console) as port, signed_in(console, port) as client:
        with listening(client) as events:
            assert next(events)[0] == "now"
        console.console.live._events.clear()  # what was kept in memory; the rest is asked of the journal
        with listening(client, params={"after": 2}) as events:
            assert next(events)[:2] == ("gap", "30")
        with listening(client, params={"after": 26}) as events:
            assert sheets_of(events, 4) == [(str(sheet + 1), sheet) for sheet in range(26, 30)]


def test_a_journal_that_begins_anew_is_a_gap(console: Served) -> None:
    with (
        running(console) as port,
        signed_in(console, port) as client,
        listening(client, headers={"Last-Event-ID": "999"}) as events,
    ):
        assert next(events)[0:2] == ("gap", "30")


def test_events_end_with_the_session(console: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "PING_S", 0.05)
    console.console.live._clock = lambda: console.clock.now_s
    with running(console) as port, signed_in(console, port) as client, listening(client) as events:
        assert next(events)[0] == "now"
        console.accounts.change("viewer", by="test", locked=True)
        console.clock.now_s += 1
        assert [kind for kind, _, _ in events][-1] == "end"


def test_events_end_when_their_token_is_revoked(console: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "PING_S", 0.05)
    console.console.live._clock = lambda: console.clock.now_s
    console.accounts.choose(console.accounts.add("screen", Role.VIEWER, by="test"), PASSWORD)
    token, secret = console.accounts.new_token("screen", "wall", [Scope.READ], by="test")
    headers = {"Authorization": f"Bearer {secret}"}
    with (
        running(console) as port,
        httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE_S, trust_env=False) as client,
        listening(client, headers=headers) as events,
    ):
        assert next(events)[0] == "now"
        console.accounts.revoke(token.id, by="test")
        console.clock.now_s += 1
        assert [kind for kind, _, _ in events][-1] == "end"


def test_the_page_gets_its_parts_as_html_and_the_word_of_somebody_else(console: Served) -> None:
    with (
        running(console) as port,
        signed_in(console, port) as viewer,
        signed_in(console, port, Role.OPERATOR) as operator,
        listening(viewer, "/now/events", headers={"Accept-Language": "de"}) as events,
    ):
        kind, _, told = next(events)
        assert kind == "parts"
        assert set(told["parts"]) == {"state", "todo", "incidents", "health", "control"}
        assert "Fehlstellen" in told["parts"]["incidents"]
        assert "hx-post" not in told["parts"]["incidents"], "a viewer has nothing to tap"
        operator.post("/api/v1/runs/1/incidents/1/labels", json={"label": "false-alarm"}).raise_for_status()
        told = next(data for kind, _, data in events if kind == "parts")
        assert "Kein offenes Ereignis" in told["parts"]["incidents"]


def test_a_console_that_began_before_its_journal_finds_it(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with running(console) as port, signed_in(console, port) as client, listening(client) as events:
        assert next(events)[2]["state"] == "no-run"
        with Journal.open(str(console.journal)) as journal:
            run = journal.begin_run(facts())
            journal.record(run, good(0))
            journal.commit()
            came, state = list[tuple[str, int]](), ""
            while not came or state != "good":  # either may be first
                kind, row, data = next(events)
                state = data["state"] if kind == "now" else state
                came += [(row, data["sheet"])] if kind == "sheet" else []
                # The clock stands, and a run that was read before its sheet has its next state after STATE_S.
                console.clock.now_s += live_module.STATE_S
            assert came == [("1", 0)]


def test_a_hundred_listeners_ask_the_journal_no_more_than_one(console: Served) -> None:
    asked = []
    reading = console.console.reading
    original = reading.written_after

    def counted(*given: Any, **told: Any) -> Any:
        asked.append(given)
        return original(*given, **told)

    reading.written_after = counted  # type: ignore[method-assign]
    live = console.console.live

    async def listen() -> list[int]:
        live._poll()
        waiting = [live.events(None) for _ in range(100)]
        for each in waiting:
            await anext(each)
            await anext(each)
        asked.clear()
        with Journal.open(str(console.journal)) as journal:
            journal.record(1, good(30))
        live._poll()
        live._wake()
        told = [await anext(each) for each in waiting]
        for each in waiting:
            await each.aclose()
        return [text.count("event: sheet") for text in told]

    assert asyncio.run(listen()) == [1] * 100
    assert len(asked) == 1


def test_inspection_that_does_not_keep_pace_leads_the_page_before_a_misprint(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts(sheets=200))
        for sheet in range(100):
            late = Verdict.skipped(f"p{sheet + 1:04}", "its verdict would have come too late")
            record = good(sheet, verdict=late) if sheet % 9 else good(sheet)
            journal.record(run, misprint(sheet) if sheet == 95 else record)
        journal.commit()
        client = console.client(Role.OPERATOR)
        state = client.get("/api/v1/now").json()
        assert (state["state"], state["alarm"], state["overload"]) == (
            "overload",
            True,
            {"late": 87, "recent": 100},
        )
        page = client.get("/").text
    assert "Inspection cannot keep up: 87 of the last 100 sheets not inspected." in page
    band = page[page.index('class="band overload') :]
    assert band.index("Inspection cannot keep up") < band.index('class="run"')
    assert "Reduce the press speed." in page
    assert "pages were not ready in time" in page
    assert "prooflight job prepare" in page
    assert ">Held<" in page
    assert "Let pass" not in page
    assert "The verdict would have been late" in page, "a card says why its sheets were not inspected"
    console.close()


def test_a_misprint_that_the_costs_accept_is_shown_as_the_policy_of_the_press_file(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts())
        found = misprint(3)
        journal.record(run, good(3, verdict=replace(found.verdict, stopping_costs_more=True)))
        journal.commit()
        client = console.client(Role.OPERATOR)
        page, sheet = client.get("/").text, client.get("/api/v1/runs/1/sheets/3").json()
    assert (sheet["disposition"], sheet["decided_by"]) == ("accept", "costs")
    assert "Accepted (costs)" in page
    assert "Accepted according to the costs in the press file." in page
    assert "Accepted for cost reasons." in page
    console.close()


@pytest.mark.parametrize(("came", "says"), [(3, "3 of 3 sheets"), (4, "4 sheets, 3 planned")])
def test_more_sheets_than_were_planned_are_said_and_a_page_that_did_not_come_is_no_sheet(
    tmp_path: Path, came: int, says: str
) -> None:
    console = served(tmp_path, run=False)
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts(sheets=3))
        missing = Verdict.skipped("p0004", "it did not come")
        journal.record(run, good(0, verdict=missing, faults=("missing",)))
        for sheet in range(1, came + 1):
            journal.record(run, good(sheet))
        journal.commit()
        client = console.client(Role.OPERATOR)
        assert client.get("/api/v1/runs/1").json()["absent"] == 1
        assert says in client.get("/").text
    console.close()
