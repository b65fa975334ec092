"""A gate that is resumed from its log: the same decisions as without the break, and no tag for two sheets."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.plant.presses import GEOMETRY, PlayedPress, controller, settings
from packages.line.tests.plant.test_deciding import decider, record

from prooflight.scans.lines import LineBlock
from prooflight_line.plant.gate.gate import Gate
from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.log import LoggedDecisions, PlantError, log_path
from prooflight_line.plant.gate.registers import WRAP, Code, Result
from prooflight_line.plant.gate.resuming import (
    LOST,
    cut_torn_line,
    on_their_way,
    refuse_other_gate,
    unrecorded,
)
from prooflight_line.plant.gate.tracking import Tracker, Transport
from prooflight_line.plant.simulator.server import PlcServer
from prooflight_line.testing.relay import Relay

if TYPE_CHECKING:
    from pathlib import Path

KINDS = st.sampled_from(
    [("good", ()), ("good", ()), ("good", ()), ("misprint", ()), ("misprint", ("unknown",)), ("good", ("repeated",)),
     ("not-inspected", ()), ("good", ("lost-lines",)), ("not-inspected", ("missing",))]
)  # fmt: skip


def line_of(decision: Any) -> dict[str, Any]:
    """The line of a decision as the gate logs it."""
    return {
        "tag": decision.tag,
        "came": decision.came,
        "result": int(decision.result),
        "code": int(decision.code),
        "job_page": decision.job_page,
        "page": decision.page,
        "set": decision.set_number,
    }


@given(
    sheets=st.lists(KINDS, min_size=1, max_size=30),
    cut=st.integers(0, 30),
    divert=st.sampled_from(["sheet", "until-clean-break"]),
    policy=st.sampled_from(["reject", "accept"]),
    pages_a_set=st.sampled_from([1, 2, 4]),
)
def test_a_resumed_gate_decides_as_one_that_never_stopped(
    sheets: list[tuple[str, tuple[str, ...]]], cut: int, divert: str, policy: str, pages_a_set: int
) -> None:
    how = {"divert": divert, "policy": policy, "pages_a_set": pages_a_set, "stop_in_a_row": 3}
    whole, resumed = decider(**how), decider(**how)

    def decided(own: Any, at: int) -> Any:
        verdict, faults = sheets[at]
        page = None if "unknown" in faults else at
        return own.decide(record(at, verdict, faults, page=page), came=faults != ("missing",))

    expected = [decided(whole, at) for at in range(len(sheets))]
    for decision in expected[:cut]:
        resumed.recall(line_of(decision))
    assert [decided(resumed, at) for at in range(min(cut, len(sheets)), len(sheets))] == expected[cut:]


def test_what_passed_unwatched_is_sent_nothing_and_spoils_its_set() -> None:
    own = decider(pages_a_set=2)
    unwatched = own.decide(record(0, "not-inspected", ("unwatched",)), watched=False)
    assert (unwatched.result, unwatched.code, unwatched.came) == (Result.NONE, Code.NOT_INSPECTED, True)
    assert own.decide(record(1, "good")).code is Code.SET_SPOILED
    assert own.decide(record(2, "good")).code is Code.GOOD


def logged(path: Path, *rows: dict[str, Any]) -> LoggedDecisions:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return LoggedDecisions.read(path)


def decision(tag: int, code: Code, result: Result, **more: Any) -> dict[str, Any]:
    facts = {"job_page": tag - 1, "page": f"p{tag}", "set": 0, "came": True, "position": 100 * tag}
    return {"kind": "decision", "tag": tag, "code": int(code), "result": int(result), **facts, **more}


def test_decisions_that_the_journal_lost_become_rows_and_a_misprint_stays_one(tmp_path: Path) -> None:
    gate_log = logged(
        tmp_path / "log",
        decision(4, Code.GOOD, Result.ACCEPT),
        decision(5, Code.MISPRINT, Result.DIVERT),
        decision(7, Code.NOT_INSPECTED, Result.DIVERT),
        decision(8, Code.NONE, Result.NONE, came=False),
    )
    rows = unrecorded(gate_log, 3, None, time_s=2.0)
    assert [row.sheet for row in rows] == [3, 4, 5, 6, 7], "sheet 5, of which nothing is known, leaves no gap"
    assert [row.verdict.verdict for row in rows] == ["not-inspected", "misprint", *["not-inspected"] * 3]
    assert [row.disposition for row in rows] == ["accept", "divert", "hold", "divert", "hold"]
    assert rows[4].faults == ("missing",)
    assert all(LOST in row.verdict.reason for row in rows)
    assert unrecorded(gate_log, 8, None, time_s=2.0) == []


def test_sheets_are_on_their_way_until_the_log_shows_their_tray(tmp_path: Path) -> None:
    gate_log = logged(
        tmp_path / "log",
        *(decision(tag, Code.GOOD, Result.ACCEPT) for tag in range(1, 6)),
        decision(6, Code.NONE, Result.NONE, came=False),
        {"kind": "tray", "tag": 2, "tray": "good", "session": 1},
        {"kind": "written", "tag": 4, "position": 444},
        {"kind": "unsent", "tag": 3, "code": int(Code.TOO_LATE)},
    )
    assert [(one.tag, position, taken) for one, position, taken in on_their_way(gate_log)] == [
        (4, 444, True),
        (5, 500, False),
    ]


def test_a_line_that_was_not_written_whole_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_text('{"kind": "session", "session": 5}\n{"kind": "decis')
    cut_torn_line(path)
    assert path.read_text() == '{"kind": "session", "session": 5}\n'
    cut_torn_line(path)
    assert path.read_text() == '{"kind": "session", "session": 5}\n'
    path.write_text('{"kind"')
    cut_torn_line(path)
    assert path.read_text() == ""


def test_another_gate_is_refused(tmp_path: Path) -> None:
    own = settings(5020)
    gate = Gate(own, GEOMETRY, job_pages=4, journal=tmp_path / "runs.sqlite", run_id=1)
    gate._log.close()
    gate_log = LoggedDecisions.read(log_path(tmp_path / "runs.sqlite", 1))
    refuse_other_gate(gate_log, own, where="press.toml")
    with pytest.raises(PlantError, match=r"press.toml: \[gate\] is not that of the run"):
        refuse_other_gate(gate_log, settings(5020, policy="accept"), where="press.toml")


@pytest.mark.parametrize(
    ("count", "position", "passed"),
    [
        (1000, 900, True),
        (1000, 1000, True),
        (1000, 1500, False),
        (WRAP - 100, 200, False),
        (5, 500_000, True),
    ],
)
def test_the_controllers_count_shows_which_sheets_have_passed(
    count: int, position: int, passed: bool
) -> None:
    tracker = Tracker(Transport(line_pitch_mm=0.5, counts_per_mm=10.0), distance_mm=1000.0, tolerance_mm=40.0)
    assert tracker.due_at_s(position) is None
    tracker.counted(count, request_s=0.0, answered_s=1.0)
    due_s = tracker.due_at_s(position)
    assert due_s is not None
    assert (due_s < 1.0) == passed
    for at in range(3):
        lines = np.zeros((1, 100, 2), np.uint16)
        tracker.lines(LineBlock(first_line=100 * at, lines=lines, time_s=float(at)))
    if not passed:  # 100 lines of 0.5 mm a second are 500 counts a second
        left = (position - count) % WRAP
        assert tracker.due_at_s(position) == pytest.approx(1.0 + left / 500)


def test_a_gate_that_is_resumed_goes_on_with_its_tags(tmp_path: Path) -> None:
    """The process ends without a word while sheets are on their way, and the next one takes them over."""
    journal = tmp_path / "runs.sqlite"
    with PlcServer(controller()) as server, Relay("127.0.0.1", server.port) as relay:
        first = Gate(settings(relay.port), GEOMETRY, job_pages=4, journal=journal, run_id=1)
        first._link.start()
        press = PlayedPress(server=server, gate=first)
        press.start()
        press.run_until(lambda: first.protocol.state is State.READY)
        press.run_until(lambda: server.plc.counts["good"] >= 3)
        relay.cut()  # nothing is written any more: the log ends in the middle
        first._log.close()
        past = LoggedDecisions.read(log_path(journal, 1))
        own = settings(server.port)
        second = Gate(own, GEOMETRY, job_pages=4, journal=journal, run_id=1, past=past)
        decided, waiting = len(past.decisions), second.protocol.waiting
        with second:
            press.watched_by(second)
            press.sheet = decided
            press.run_until(lambda: second.protocol.state is State.READY)
            good = server.plc.counts["good"]
            press.run_until(lambda: server.plc.counts["good"] >= good + 3)
        first._link.close()
    after = LoggedDecisions.read(log_path(journal, 1))
    assert list(after.decisions) == list(range(1, max(after.decisions) + 1)), "no gap, and none twice"
    assert len(after.sessions) > len(past.sessions)
    assert waiting >= 0
    for row in server.plc.rows:
        assert row.tray == "reject" or row.truth == "good"
        if row.tag:
            assert (after.decisions[row.tag]["result"] == Result.ACCEPT) == (row.truth == "good")
