"""What is exchanged with the controller, without a wire and with a clock that is set."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.press.gate import GateSettings, PlcSettings
from prooflight.scans.lines import LineBlock
from prooflight_line.plant.gate.deciding import SheetDecision
from prooflight_line.plant.gate.exchange import Exchange
from prooflight_line.plant.gate.handshake import HANDSHAKE, Event, State, after
from prooflight_line.plant.gate.log import GateLog, LoggedDecisions, rows_of
from prooflight_line.plant.gate.registers import (
    READ,
    RING,
    WRAP,
    WRITTEN,
    Code,
    Fault,
    OurStatus,
    Result,
    Shown,
    count_distance,
    packed,
    packed_of_plc,
    ring_register,
    unpacked,
    unpacked_of_plc,
)
from prooflight_line.plant.gate.registers import after as next_number
from prooflight_line.plant.gate.tracking import Tracker, Transport

if TYPE_CHECKING:
    from collections.abc import Iterator

LINES = np.zeros((1, 10, 2), np.uint16)
LINE_MM, PER_MM, SPEED = 1.0, 10.0, 1000.0


@dataclass
class Wired:
    """An exchange whose controller answers at once, as long as it is told to."""

    log: GateLog
    told: list[State] = field(default_factory=list)
    now_s: float = 50.0
    shown: dict[str, int] = field(default_factory=dict)
    trays: list[int] = field(default_factory=list)
    """The controller's ring; empty: it has none."""
    line: int = 0

    def __post_init__(self) -> None:
        settings = GateSettings(distance_mm=1000.0, plc=PlcSettings(host="plc", counts_per_mm=PER_MM))
        transport = Transport(line_pitch_mm=LINE_MM, counts_per_mm=PER_MM)
        self.tracker = Tracker(transport, distance_mm=1000.0, tolerance_mm=40.0)
        self.exchange = Exchange(
            settings,
            self.tracker,
            log=self.log,
            tell=lambda state, _why: self.told.append(state),
            clock=lambda: self.now_s,
        )
        self.shown = {register.name: 0 for register in READ}

    def connect(self, session: int = 7) -> None:
        self.exchange.connected(Shown(values=self.shown), session=session)

    def turn(self, *, takes: bool = True, beats: bool = True, lines: bool = True) -> dict[str, int]:
        """One exchange of 10 ms; what was written."""
        written = unpacked(self.exchange.words())
        self.exchange.wrote()
        if takes:
            self.shown |= {"session_taken": written["session"], "result_taken": written["result_number"]}
        self.shown["plc_heartbeat"] = (self.shown["plc_heartbeat"] + beats) & 0xFFFF
        self.shown["encoder"] = int(self.now_s * SPEED * PER_MM)
        shown = Shown(values=self.shown, trays=tuple(self.trays))
        alive = self.exchange.answered(shown, request_s=self.now_s, answered_s=self.now_s + 0.001)
        self.alive = alive
        self.now_s += 0.01
        if lines:
            self.tracker.lines(LineBlock(first_line=self.line, lines=LINES, time_s=self.now_s))
            self.line += 10
        return written

    def ready(self) -> None:
        self.connect()
        for _ in range(14):
            self.turn()
        assert self.exchange.state is State.READY

    def post(self, sheet: int, result: Result = Result.ACCEPT, *, line: int | None = None) -> None:
        decision = SheetDecision(
            sheet=sheet, result=result, code=Code.GOOD, job_page=sheet, page=f"p{sheet}", set_number=0
        )
        at = self.line if line is None else line
        self.exchange.post(decision, line=at, last_line_s=self.now_s)


@pytest.fixture
def wired(tmp_path: Path) -> Iterator[Wired]:
    with GateLog(tmp_path / "gate.jsonl") as log:
        yield Wired(log=log)


def test_the_way_to_ready_and_what_is_said_of_it(wired: Wired) -> None:
    wired.connect()
    first = wired.turn(takes=False)
    assert wired.exchange.state is State.JOINING
    assert (first["session"], first["status"]) == (7, 0)
    second = wired.turn()
    assert second["fault"] == Fault.NOT_TAKEN
    assert wired.exchange.state is State.ALIGNING
    for _ in range(14):
        last = wired.turn()
    assert last["status"] == OurStatus.READY
    assert last["fault"] == Fault.NONE
    assert last["tolerance"] == 400
    assert wired.told == [State.JOINING, State.ALIGNING, State.READY]


def test_one_result_at_a_time_until_it_is_acknowledged(wired: Wired) -> None:
    wired.ready()
    wired.post(0)
    wired.post(1, Result.DIVERT)
    one = wired.turn(takes=False)
    again = wired.turn(takes=True)
    assert (one["tag"], one["result"], one["result_number"]) == (1, Result.ACCEPT, 1)
    assert one["status"] & OurStatus.PASS
    assert (again["tag"], again["result_number"]) == (1, 1)
    two = wired.turn()
    assert (two["tag"], two["result"], two["result_number"]) == (2, Result.DIVERT, 2)
    assert not two["status"] & OurStatus.PASS
    assert len(wired.exchange.latencies_s) == 2


def test_the_position_is_where_the_encoder_will_be(wired: Wired) -> None:
    wired.ready()
    wired.post(0, line=wired.line - 100)
    position = wired.turn()["position"]
    line_s = wired.now_s - 0.02 - 100 * LINE_MM / SPEED  # when that line passed, about
    assert abs(position - (line_s * SPEED + 1000.0) * PER_MM) < 400 / 3


def test_a_new_connection_tells_again_of_all_that_have_not_reached_the_gate(wired: Wired) -> None:
    wired.ready()
    for sheet in range(3):
        wired.post(sheet)
        wired.turn()
    assert all(one.written_s for one in wired.exchange._sheets.values())
    wired.exchange.lost("cut")
    assert wired.exchange.state is State.AWAY
    wired.connect(session=8)
    tags = [wired.turn()["tag"] for _ in range(24)]
    assert [tag for at, tag in enumerate(tags) if tag and tag not in tags[:at]] == [1, 2, 3]


def test_a_controller_that_forgot_the_session_gets_another(wired: Wired) -> None:
    wired.ready()
    wired.post(0)
    wired.turn()
    wired.shown["session_taken"] = 0
    wired.turn(takes=False)
    assert wired.exchange.state is State.JOINING
    assert wired.exchange.dropped(session=9)
    assert wired.exchange.session == 9
    assert not wired.exchange.dropped(session=10)
    tags = {wired.turn()["tag"] for _ in range(6)}
    assert tags == {0, 1}  # of the sheet that it forgot


def test_a_heartbeat_that_stands_still_ends_the_connection(wired: Wired) -> None:
    wired.ready()
    for _ in range(49):
        wired.turn(beats=False)
        assert wired.alive
    wired.now_s += 0.1
    wired.turn(beats=False)
    assert not wired.alive


def test_a_sheet_that_reached_the_gate_first_is_too_late_and_is_not_written(
    wired: Wired, tmp_path: Path
) -> None:
    wired.ready()
    for _ in range(130):
        wired.turn()
    wired.post(0, line=wired.line - 1200)  # it passed the gate 0.2 s ago
    wired.post(1)
    assert wired.turn()["tag"] == 2
    assert wired.exchange.too_late == 1
    kept = LoggedDecisions.read(tmp_path / "gate.jsonl")
    assert kept.unsent[1]["code"] == Code.TOO_LATE
    assert [one.tag for one in wired.exchange.lost_sheets] == [1]


def test_nothing_is_written_while_nobody_knows_the_place(wired: Wired) -> None:
    wired.connect()
    wired.turn()
    wired.post(0)
    written = wired.turn()
    assert written["result_number"] == 0
    assert written["status"] & OurStatus.BUSY


def test_stop_stays_on(wired: Wired) -> None:
    wired.ready()
    wired.post(0, Result.STOP)
    wired.turn()
    for sheet in range(1, 4):
        wired.post(sheet)
        assert wired.turn()["status"] & OurStatus.STOP


def test_busy_from_the_last_line_to_the_acknowledgement(wired: Wired) -> None:
    wired.ready()
    wired.exchange.arrived(1)
    seen = wired.turn()
    assert seen["sheet_at_camera"] == 1
    assert seen["status"] & OurStatus.BUSY
    wired.post(0)
    wired.turn()
    assert not wired.turn()["status"] & OurStatus.BUSY


# --- trays ---


def trays_logged(wired: Wired) -> list[tuple[int, str]]:
    assert wired.log._file is not None
    rows = rows_of(Path(wired.log._file.name))
    return [(row["tag"], row["tray"]) for row in rows if row["kind"] == "tray"]


def reach(wired: Wired, tag: int, tray: int) -> None:
    """A sheet reaches the gate: the controller notes it in its ring, if it has one, and as the last."""
    if wired.trays:
        wired.trays[wired.shown["sheets_at_gate"] % RING] = ring_register(tag, tray)
    wired.shown["sheets_at_gate"] += 1
    wired.shown |= {"last_tag": tag, "last_tray": tray}


@pytest.mark.parametrize("ring", [False, True])
def test_sheets_between_two_exchanges_are_missed_without_the_ring_alone(wired: Wired, ring: bool) -> None:
    wired.trays = [0] * RING if ring else []
    wired.ready()
    for tag in range(1, 7):
        wired.exchange.arrived(tag)
    reach(wired, 1, 1)
    wired.turn()
    for tag, tray in ((2, 2), (0, 2), (4, 1)):  # of the third no result was found
        reach(wired, tag, tray)
    wired.turn()
    expected = [(1, "good"), (2, "reject"), (4, "good")]
    assert trays_logged(wired) == (expected if ring else expected[:1])


def test_a_connection_names_no_sheet_of_the_one_before(wired: Wired) -> None:
    """The controller has forgotten the results of a session that broke, and the log is by sessions."""
    wired.trays = [0] * RING
    wired.ready()
    wired.exchange.arrived(1)
    wired.exchange.lost("no answer")
    reach(wired, 1, 1)
    wired.connect(session=8)
    wired.turn()
    assert trays_logged(wired) == []


def test_a_controller_that_counts_from_0_again_names_no_sheet(wired: Wired) -> None:
    wired.trays = [0] * RING
    wired.ready()
    wired.shown["sheets_at_gate"] = 5
    wired.turn()
    before = trays_logged(wired)
    wired.shown["sheets_at_gate"] = 0
    wired.turn()
    assert trays_logged(wired) == before


@given(st.integers(1, 2**32 - 1), st.integers(0, 300), st.integers(1, 2))
def test_a_tag_is_known_by_its_short_form(tag: int, later: int, tray: int) -> None:
    values = {register.name: 0 for register in READ} | {"sheets_at_gate": 9}
    trays = [0] * RING
    trays[8] = ring_register(tag, tray)
    assert 0 <= trays[8] < 2**16
    shown = Shown(values=values, trays=tuple(trays))
    assert shown.passed(1, last_tag=tag + later) == [(tag, tray)]


# --- registers and states ---


@given(st.data())
def test_what_is_packed_is_unpacked(data: Any) -> None:
    for registers, pack, unpack in (
        (WRITTEN, packed, unpacked),
        (READ, packed_of_plc, unpacked_of_plc),
    ):
        values = {one.name: data.draw(st.integers(0, 2 ** (16 * one.words) - 1)) for one in registers}
        words = pack(values)
        assert all(0 <= word < 2**16 for word in words)
        assert unpack(words) == values


@pytest.mark.parametrize("registers", [WRITTEN, READ])
def test_registers_neither_overlap_nor_leave_room(registers: Any) -> None:
    at = [place for one in registers for place in range(one.at, one.at + one.words)]
    assert at == list(range(at[0], at[0] + len(at)))


def test_too_few_registers_are_refused() -> None:
    with pytest.raises(ValueError, match="3 registers are too few: 15 are needed"):
        unpacked([0, 0, 0])


@given(st.integers(0, WRAP - 1), st.integers(-(2**31), 2**31 - 1))
def test_counts_are_apart_the_shorter_way_round(count: int, off: int) -> None:
    assert count_distance((count + off) % WRAP, count) == off


def test_numbers_go_round_without_0() -> None:
    assert [next_number(one) for one in (0, 1, 0xFFFE, 0xFFFF)] == [1, 2, 0xFFFF, 1]


def test_from_every_state_but_the_first_a_lost_link_leads_to_the_first() -> None:
    assert {one.state for one in HANDSHAKE} == set(State)
    for state in State:
        assert after(state, Event.LOST) is State.AWAY
        assert len({one.event for one in HANDSHAKE if one.state is state}) == sum(
            one.state is state for one in HANDSHAKE
        )
