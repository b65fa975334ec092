"""The gate against a real Modbus server whose ladder sorts sheets into trays, in real time, over links that fail."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.plant.presses import (
    DISTANCE_MM,
    GEOMETRY,
    PlayedPress,
    controller,
    settings,
    until,
)

from prooflight_line.plant.gate.gate import Gate, Travel, refuse_near, try_controller
from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.log import LoggedDecisions, PlantError, log_path
from prooflight_line.plant.gate.reconciling import Tray, reconciled
from prooflight_line.plant.simulator.server import PlcServer
from prooflight_line.testing.relay import Relay

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.press.gate import GateSettings
    from prooflight_line.plant.events import SheetAtGate
    from prooflight_line.plant.simulator.plc import SimulatedPlc


@pytest.fixture
def server() -> Iterator[PlcServer]:
    with PlcServer(controller()) as running:
        yield running


@pytest.fixture
def relay(server: PlcServer) -> Iterator[Relay]:
    with Relay("127.0.0.1", server.port) as running:
        yield running


@pytest.fixture
def press(server: PlcServer, relay: Relay, tmp_path: Path) -> Iterator[PlayedPress]:
    """A press whose gate is ready."""
    with Gate(
        settings(relay.port), GEOMETRY, job_pages=4, journal=tmp_path / "runs.sqlite", run_id=1
    ) as gate:
        played = PlayedPress(server=server, gate=gate)
        played.start()
        played.run_until(lambda: gate.protocol.state is State.READY)
        yield played


def safe(plc: SimulatedPlc) -> None:
    """Nothing bad and nothing unknown lies in the good tray."""
    wrong = [row for row in plc.rows if row.tray == "good" and (row.truth != "good" or not row.tag)]
    assert wrong == []


def recovered(press: PlayedPress) -> None:
    """Good sheets get to the good tray again."""
    good = press.server.plc.counts["good"]
    press.run_until(lambda: press.server.plc.counts["good"] >= good + 3)
    safe(press.server.plc)


def test_each_sheet_goes_where_it_was_decided(press: PlayedPress, tmp_path: Path) -> None:
    before = press.at_gate() + 1
    press.run_until(lambda: press.at_gate() >= before + 24)
    sorted_ = [row for row in press.server.plc.rows[before:] if row.serial in press.given]
    assert {(row.truth, row.tray) for row in sorted_} == {("good", "good"), ("misprint", "reject")}
    assert all(row.tag for row in sorted_)
    assert press.gate.protocol.too_late == 0
    kept = LoggedDecisions.read(log_path(tmp_path / "runs.sqlite", 1))
    assert kept.written.keys() >= {row.tag for row in sorted_}
    assert {row.tag: row.tray for row in sorted_}.items() >= {
        tag: row["tray"] for tag, row in kept.trays.items() if tag in {one.tag for one in sorted_}
    }.items()


def test_every_sheet_is_reported_once_with_what_was_decided_and_its_tray(server: PlcServer) -> None:
    reported: list[SheetAtGate] = []
    with Gate(settings(server.port), GEOMETRY, job_pages=4, report=reported.append) as gate:
        press = PlayedPress(server=server, gate=gate)
        press.start()
        press.run_until(lambda: gate.protocol.state is State.READY)
        before = press.sheet
        press.run_until(lambda: sum(one.tray != "unconfirmed" for one in reported) >= 16)
        server.hung = True
        press.run_until(lambda: gate.protocol.state is State.AWAY)
        last = press.sheet + 4
        press.run_until(lambda: press.sheet >= last)
        server.hung = False
    assert sorted(one.sheet for one in reported) == list(range(press.sheet))
    trays = {row.tag - 1: row.tray for row in server.plc.rows if row.tag}
    for one in reported:
        assert one.disposition == (
            "divert" if press.given[one.sheet + press.serial - press.sheet + 1] == "misprint" else "accept"
        )
        assert one.tray in ("unconfirmed", trays.get(one.sheet))
        if one.tray != "unconfirmed" and one.sheet >= before:
            assert (one.in_time, one.tray) == (True, "good" if one.disposition == "accept" else "reject")
    assert any(one.tray == "unconfirmed" and not one.in_time for one in reported if one.sheet >= before)


def test_a_sheet_that_nobody_saw_is_rejected_and_shifts_no_other(press: PlayedPress) -> None:
    press.run_until(lambda: press.sheet >= 5)
    plc = press.server.plc
    tell, press.tell = press.tell, lambda *_: None  # type: ignore[method-assign,assignment]
    unseen = press.serial + 1
    press.run_until(lambda: press.serial >= unseen)
    press.tell = tell  # type: ignore[method-assign]
    press.run_until(lambda: any(row.serial >= unseen + 6 for row in plc.rows))
    safe(plc)
    by_serial = {row.serial: row for row in plc.rows}
    assert (by_serial[unseen].tray, by_serial[unseen].tag) == ("reject", 0)
    for serial in range(unseen + 1, unseen + 6):
        assert (by_serial[serial].tray == "good") == (press.given[serial] == "good")


@pytest.mark.parametrize("failure", ["cut", "hang", "power"])
def test_whatever_goes_away_comes_back_by_itself(failure: str, press: PlayedPress, relay: Relay) -> None:
    press.run_until(lambda: press.sheet >= 4)
    server = press.server
    match failure:
        case "cut":
            relay.cut()
        case "hang":
            server.hung = True
        case "power":
            server.call(lambda: server.plc.power(on=False))
            relay.cut()
    press.run_until(lambda: press.gate.protocol.state is State.AWAY)
    since = press.at_gate()
    press.run_until(lambda: press.at_gate() >= since + 3)
    if failure == "power":
        server.call(lambda: server.plc.power(on=True))
    relay.repair()
    server.hung = False
    recovered(press)


def test_a_delayed_link_makes_good_sheets_late_and_no_bad_one_good(press: PlayedPress, relay: Relay) -> None:
    press.run_until(lambda: press.sheet >= 4)
    relay.delay_s = 1.5
    press.run_until(lambda: press.gate.protocol.state is State.AWAY)
    since = press.at_gate()
    press.run_until(lambda: press.at_gate() >= since + 10)
    safe(press.server.plc)
    relay.delay_s = 0.0
    recovered(press)


def test_a_controller_that_hangs_delays_no_verdict(
    monkeypatch: pytest.MonkeyPatch, press: PlayedPress
) -> None:
    """`told` returns while the link waits for an answer that does not come."""
    monkeypatch.setattr("prooflight_line.plant.gate.gate.LEAVING_S", 0.0)  # these sheets never reach the gate
    press.server.hung = True
    waiting = time.monotonic()
    for _ in range(20):
        press.tell("good", 10**6, waiting)
    assert press.gate.protocol.state is State.READY  # the link has not even noticed yet
    press.server.hung = False


def test_a_wall_clock_that_jumps_changes_nothing(press: PlayedPress, monkeypatch: pytest.MonkeyPatch) -> None:
    true = time.time
    monkeypatch.setattr(time, "time", lambda: true() + 7200.0)
    press.run_until(lambda: press.sheet >= 6)
    monkeypatch.setattr(time, "time", lambda: true() - 7200.0)
    before = press.at_gate()
    press.run_until(lambda: press.at_gate() >= before + 8)
    safe(press.server.plc)
    assert press.gate.protocol.state is State.READY
    assert press.server.plc.counts["good"] > 0


def test_what_comes_at_the_end_still_reaches_the_gate(server: PlcServer, tmp_path: Path) -> None:
    with Gate(
        settings(server.port), GEOMETRY, job_pages=4, journal=tmp_path / "runs.sqlite", run_id=1
    ) as gate:
        press = PlayedPress(server=server, gate=gate)
        press.start()
        press.run_until(lambda: gate.protocol.state is State.READY)
        press.run_until(lambda: press.sheet >= 3)
        last = press.serial
    assert {row.serial for row in server.plc.rows} >= {last}
    assert all(row.tag for row in server.plc.rows if row.serial in press.given)
    kept = LoggedDecisions.read(log_path(tmp_path / "runs.sqlite", 1))
    trays = [
        Tray(session=row.session, tag=row.tag, tray=row.tray, count=row.count) for row in server.plc.rows
    ]
    found = reconciled([], kept, trays)
    assert found.open == ()
    assert found.wrong == ()


def test_the_press_is_stopped_where_the_rules_say_so(server: PlcServer) -> None:
    with Gate(settings(server.port, stop_in_a_row=2), GEOMETRY, job_pages=4) as gate:
        press = PlayedPress(server=server, gate=gate, judge=lambda _sheet: "misprint")
        press.start()
        press.run_until(lambda: server.plc.stopped)
        assert gate.decider.stopped
        press.run_until(lambda: press.at_gate() >= 3)
    assert server.plc.counts["good"] == 0


def test_trying_an_output_leaves_it_as_it_is() -> None:
    with PlcServer(controller(style="coil")) as server:
        for on in (False, True):
            server.call(lambda on=on: server.plc.set_coil(on))
            assert try_controller(settings(server.port, style="coil")) == {"coil": on}
            assert server.plc.coil is on


def test_one_output_lets_good_sheets_pass_and_falls_off_when_nobody_writes() -> None:
    with PlcServer(controller(style="coil")) as server:
        plc = server.plc
        with Gate(settings(server.port, style="coil", tolerance_mm=60), GEOMETRY, job_pages=4) as gate:
            press = PlayedPress(server=server, gate=gate)
            press.start()
            press.run_until(lambda: plc.counts["good"] >= 6 and plc.counts["reject"] >= 2)
        assert [row for row in plc.rows if row.tray == "good" and row.truth != "good"] == []
        until(lambda: not plc.alive)
        assert not plc.coil


# --- a watch that is killed ---

KILLED = textwrap.dedent(
    """
    import sys
    from packages.line.tests.plant.presses import GEOMETRY, SPEED_MM_S, settings
    from prooflight_line.plant.gate.gate import Gate
    gate = Gate(settings(int(sys.argv[1])), GEOMETRY, job_pages=4)
    gate.__enter__()
    print("lives", flush=True)
    sys.stdin.read()
    """
)


def test_a_killed_watch_is_noticed_by_its_heartbeat_and_another_start_begins_anew(
    server: PlcServer, tmp_path: Path
) -> None:
    plc = server.plc
    root = Path(__file__).resolve().parents[4]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(root), *sys.path])}
    command = [sys.executable, "-c", KILLED, str(server.port)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
    ) as killed:
        assert killed.stdout is not None
        assert killed.stdout.readline() == "lives\n"
        until(lambda: plc.alive and plc.session)
        first = plc.session
        killed.send_signal(signal.SIGKILL)
    until(lambda: not plc.alive)
    assert plc.session == 0
    with Gate(settings(server.port), GEOMETRY, job_pages=4) as gate:
        press = PlayedPress(server=server, gate=gate)
        press.start()
        press.run_until(lambda: gate.protocol.state is State.READY)
        assert plc.session not in (0, first)
        recovered(press)


# --- what is refused at the start ---


def refusal(given: GateSettings) -> str:
    """The one line in which it is refused."""
    with pytest.raises(PlantError) as refused:
        try_controller(given)
    text = str(refused.value)
    assert "\n" not in text
    return text


def test_an_unreachable_controller_is_refused_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    assert refusal(settings(port)).startswith(f"127.0.0.1:{port}: no controller answers; check that it is on")


def test_a_controller_that_takes_connections_and_answers_nothing_is_refused_in_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        given = settings(silent.getsockname()[1])
        quick = replace(given, plc=replace(given.plc, timeout_ms=50))
        assert "no answer within 50 ms" in refusal(quick)


def test_a_wrong_register_map_is_refused_in_one_line(server: PlcServer) -> None:
    given = settings(server.port)
    moved = replace(given, plc=replace(given.plc, first_register=8))
    assert "register 40 contains" in refusal(moved)
    beyond = replace(given, plc=replace(given.plc, first_register=500))
    assert "it refuses register or coil 532" in refusal(beyond)


def test_a_gate_nearer_than_the_verdict_can_be_is_refused() -> None:
    given = settings(502)
    travel = Travel(
        distance_mm=given.distance_mm, speed_mm_s=2000, sheet_mm=300, deadline_s=0.5, exchange_s=0.31
    )
    assert travel.spare_s == pytest.approx((DISTANCE_MM - 300) / 2000 - 0.81)
    with pytest.raises(PlantError, match=r"distance_mm = 1200 is too short .* need 1920 mm"):
        refuse_near(given, travel, where="press.toml")
    near_enough = Travel(
        distance_mm=travel.least_mm, speed_mm_s=2000, sheet_mm=300, deadline_s=0.5, exchange_s=0.31
    )
    refuse_near(given, near_enough, where="press.toml")
