"""Where sheets are between camera and gate, by lines and counts of a transport that is played."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.scans.lines import LineBlock, LineFault
from prooflight_line.plant.gate.registers import WRAP
from prooflight_line.plant.gate.tracking import ENOUGH, TrackedLines, Tracker, Transport

PITCH_MM, PER_MM, DISTANCE_MM = 0.5, 10.0, 1500.0
BLOCK = 40
NOTHING = np.zeros((1, BLOCK, 2), np.uint16)


@dataclass
class Played:
    """A transport at one speed: lines every block, a count whenever it is asked for."""

    speed_mm_s: float = 1000.0
    first_count: int = 5_000
    answer_s: float = 0.002
    per_mm: float = PER_MM
    tracker: Tracker = field(init=False)
    line: int = 0
    time_s: float = 100.0
    begun_s: float = 100.0

    def __post_init__(self) -> None:
        transport = Transport(line_pitch_mm=PITCH_MM, counts_per_mm=PER_MM)
        self.tracker = Tracker(transport, distance_mm=DISTANCE_MM, tolerance_mm=40.0)

    def count(self, time_s: float) -> int:
        return int(self.first_count + (time_s - self.begun_s) * self.speed_mm_s * self.per_mm) % WRAP

    def ask(self, *, after_s: float = 0.5) -> None:
        """The count is read some part of the way between question and answer."""
        request_s = self.time_s
        read_s = request_s + after_s * self.answer_s
        self.tracker.counted(self.count(read_s), request_s=request_s, answered_s=request_s + self.answer_s)

    def block(self, **told: object) -> None:
        self.time_s += BLOCK * PITCH_MM / self.speed_mm_s
        self.tracker.lines(
            LineBlock(first_line=self.line, lines=NOTHING, time_s=self.time_s, **told)  # type: ignore[arg-type]
        )
        self.line += BLOCK

    def run(self, blocks: int) -> None:
        for _ in range(blocks):
            self.ask()
            self.block()

    def true_position(self, line: int) -> int:
        return round(self.first_count + (line * PITCH_MM + DISTANCE_MM) * PER_MM)


@given(
    speed_mm_s=st.floats(200, 3000),
    first_count=st.integers(0, WRAP - 1),
    parts=st.lists(st.floats(0, 1), min_size=3 * ENOUGH, max_size=3 * ENOUGH),
)
def test_the_place_at_the_gate_is_known_to_a_third_of_the_tolerance(
    speed_mm_s: float, first_count: int, parts: list[float]
) -> None:
    """Wherever between question and answer the count was read."""
    played = Played(speed_mm_s=speed_mm_s, first_count=first_count)
    for part in parts:
        played.ask(after_s=part)
        played.block()
    assert played.tracker.aligned
    position = played.tracker.position(1000)
    assert position is not None
    off = (position - played.true_position(1000) + WRAP // 2) % WRAP - WRAP // 2
    assert abs(off) <= 40.0 * PER_MM / 3


def test_nothing_is_said_before_enough_readings_agree() -> None:
    played = Played()
    played.run(ENOUGH)
    assert not played.tracker.aligned
    assert played.tracker.position(0) is None
    played.run(3)
    assert played.tracker.aligned


def test_a_sheet_is_due_when_it_has_travelled() -> None:
    played = Played()
    played.run(20)
    due_s = played.tracker.due_s(200)
    assert due_s == pytest.approx(100.0 + (200 * PITCH_MM + DISTANCE_MM) / 1000.0, abs=1e-6)
    assert played.tracker.speed_mm_s == pytest.approx(1000.0)


def test_answers_that_take_too_long_say_nothing() -> None:
    played = Played(answer_s=0.04)  # 40 mm of travel
    played.run(60)
    assert not played.tracker.aligned


def test_lines_that_were_lost_without_a_word_unsettle_it_until_readings_agree_again() -> None:
    played = Played()
    played.run(30)
    played.time_s += 0.1  # the transport went on; the camera's count did not
    played.run(4)
    assert not played.tracker.aligned
    played.run(2 * ENOUGH)
    position = played.tracker.position(played.line)
    assert position is not None
    assert abs(position - played.true_position(played.line) - 0.1 * 1000.0 * PER_MM) <= 40.0 * PER_MM / 3


def test_a_camera_that_was_away_is_not_believed_and_sheets_of_before_are() -> None:
    played = Played()
    played.run(30)
    before = played.tracker.position(500)
    away = LineFault(kind="camera-away", first_line=played.line, lines=900, detail="away")
    played.line += 900
    played.time_s += 0.4
    played.ask()
    played.block(faults=(away,))
    assert not played.tracker.aligned
    assert played.tracker.position(played.line) is None
    assert played.tracker.position(500) == before


def test_a_count_that_goes_back_is_another_stretch() -> None:
    played = Played()
    played.run(30)
    played.line = 0
    played.block()
    assert not played.tracker.aligned


def test_an_encoder_that_counts_otherwise_than_said_is_not_believed() -> None:
    played = Played(per_mm=1.2 * PER_MM)
    for _ in range(200):
        played.ask()
        played.block()
    assert not played.tracker.aligned


def test_readings_are_forgotten_with_the_controller() -> None:
    played = Played()
    played.run(30)
    played.tracker.forget_readings()
    assert played.tracker.position(100) is None
    played.first_count = 77
    played.run(ENOUGH + 3)
    position = played.tracker.position(100)
    assert position is not None
    assert abs(position - played.true_position(100)) <= 40.0 * PER_MM / 3


def test_the_source_is_passed_on_and_its_lines_are_followed() -> None:
    class Source:
        sensors, pixels, closed = 1, 2, False

        def blocks(self):  # type: ignore[no-untyped-def]
            for at in range(3):
                yield LineBlock(first_line=BLOCK * at, lines=NOTHING, time_s=1.0 + at)

        def close(self) -> None:
            self.closed = True

    played, source = Played(), Source()
    followed = TrackedLines(source, played.tracker)
    assert [block.first_line for block in followed.blocks()] == [0, BLOCK, 2 * BLOCK]
    assert played.tracker.speed_mm_s == pytest.approx(BLOCK * PITCH_MM)
    followed.close()
    assert source.closed
