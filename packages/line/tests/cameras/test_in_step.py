"""Cameras laid side by side by their count: whatever is lost and whichever block comes first, no line moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.cameras.peers import faults_of

from prooflight.scans.alignment import SensorOffset
from prooflight.scans.lines import LineBlock
from prooflight_line.cameras.camera import Grab
from prooflight_line.cameras.counting import LineCounter
from prooflight_line.cameras.several import InStep

LINES, PIXELS = 8, 16


def played(first: int, count: int, sensor: int) -> np.ndarray:
    """Lines as a sensor saw them, (count, pixels), each different."""
    lines = np.arange(first, first + count)[:, None]
    return (lines * 7 + sensor * 100 + np.arange(PIXELS)) % 251


def grab(place: int, *, sensor: int = 0, **changed: Any) -> Grab:
    return replace(
        Grab(
            block_id=place + 1,
            id_wraps=True,
            data=played(place * LINES, LINES, sensor).astype(np.uint8).ravel(),
            missing=(),
            pixel_format="Mono8",
            lines=LINES,
            pixels=PIXELS,
            padding=0,
            time_s=float(place),
        ),
        **changed,
    )


def two(*wholes: float, most_lag: int = 1000) -> InStep:
    return InStep([[SensorOffset(lines=whole)] for whole in wholes], names=("A", "B", "C"), most_lag=most_lag)


def lost_of(blocks: list[LineBlock], sensor: int) -> set[int]:
    """Lines that faults say a sensor did not see."""
    return {
        line
        for fault in faults_of(blocks)
        if fault.unseen and fault.sensor in (None, sensor)
        for line in range(fault.first_line, fault.next_line)
    }


def assert_in_place(blocks: list[LineBlock], *, begun: int, wholes: tuple[int, ...]) -> None:
    """What a sensor is said to have seen is what passed it: the common line n, its offset later."""
    for sensor, whole in enumerate(wholes):
        lost = lost_of(blocks, sensor)
        for block in blocks:
            lines = np.arange(block.first_line, block.next_line)
            seen = np.array([line not in lost for line in lines])
            wanted = played(begun + block.first_line + whole, len(lines), sensor)
            np.testing.assert_array_equal(block.lines[sensor][seen], wanted[seen])


@given(
    lost=st.lists(st.tuples(st.integers(0, 1), st.integers(1, 38)), max_size=12),
    holes=st.lists(st.tuples(st.integers(0, 1), st.integers(1, 38), st.integers(0, 120)), max_size=6),
    order=st.randoms(use_true_random=False),
    whole=st.integers(-20, 20),
)
def test_whatever_is_lost_and_whichever_comes_first_each_sensor_keeps_its_lines(
    lost: list[tuple[int, int]], holes: list[tuple[int, int, int]], order: Any, whole: int
) -> None:
    step, counters = two(0, whole), [LineCounter(name="A"), LineCounter(name="B")]
    waiting = [[place for place in range(40) if (sensor, place) not in lost] for sensor in range(2)]
    gone = {(sensor, place): ((at, at + 8),) for sensor, place, at in holes}
    blocks, wanted = list[LineBlock](), [set[int](), set[int]()]
    while any(waiting):
        sensor = order.choice([one for one in range(2) if waiting[one]])
        place = waiting[sensor].pop(0)
        one = grab(place, sensor=sensor, missing=gone.get((sensor, place), ()))
        for block in counters[sensor].take(one):
            blocks += step.add(sensor, block)
    begun = max(0, -whole)  # of sensor 0's own count, where both have lines
    assert blocks[0].first_line == 0
    assert_in_place(blocks, begun=begun, wholes=(0, whole))
    end = blocks[-1].next_line
    for sensor, own in enumerate((0, whole)):
        for missed, place in lost:
            if missed == sensor:
                wanted[sensor] |= set(range(place * LINES, (place + 1) * LINES))
        for (missed, place), ((at, behind),) in gone.items():
            if missed == sensor and (missed, place) not in lost:
                hole = range(at // PIXELS, -(-behind // PIXELS))
                wanted[sensor] |= {place * LINES + line for line in hole}
        named = {line for line in lost_of(blocks, sensor) if line < end}
        assert named == {line - own - begun for line in wanted[sensor] if 0 <= line - own - begun < end}


def test_a_camera_that_falls_silent_is_left_out_and_taken_in_again_in_its_place() -> None:
    step, counters = two(0, 3, most_lag=64), [LineCounter(name="A"), LineCounter(name="B")]
    blocks, held = list[LineBlock](), []
    for place in range(60):
        for sensor in range(2):
            if sensor == 1 and 20 <= place < 45:
                continue
            for block in counters[sensor].take(grab(place, sensor=sensor)):
                blocks += step.add(sensor, block)
        held.append(step.waiting_lines)
        # 8 blocks of A and the 3 lines of B's offset are waited for.
        assert step.silent == ((1,) if 28 <= place < 45 else ())
    assert max(held) <= 64 + 2 * LINES + 3
    assert_in_place(blocks, begun=0, wholes=(0, 3))
    # From the first that B did not see, less its offset, to where A was when it came again.
    assert lost_of(blocks, 1) == set(range(20 * LINES - 3, 46 * LINES))
    assert not lost_of(blocks, 0)


def test_a_camera_that_is_known_to_be_away_is_not_waited_for() -> None:
    step, counters = two(0, 0), [LineCounter(name="A"), LineCounter(name="B")]
    blocks = list[LineBlock]()
    for sensor in (0, 1):
        for block in counters[sensor].take(grab(0, sensor=sensor)):
            blocks += step.add(sensor, block)
    blocks += step.away(1, "the camera sends no lines")
    for place in range(1, 4):
        for block in counters[0].take(grab(place)):
            blocks += step.add(0, block)
    assert [block.first_line for block in blocks] == [0, 8, 16, 24]
    counters[1].restarted(lines=24, why="B was away for 3 s", grab=None)
    for block in counters[1].take(grab(4, sensor=1)):
        blocks += step.add(1, block, counted=False)
    for block in counters[0].take(grab(4)):
        blocks += step.add(0, block)
    assert lost_of(blocks, 1) == set(range(8, 40))
    assert {fault.kind for fault in faults_of(blocks)} == {"camera-away"}
    assert faults_of(blocks)[-1].detail.endswith("the places of its lines are unknown")


def test_sensors_of_one_camera_that_lie_apart_are_put_side_by_side() -> None:
    """A trilinear camera: the second and third colour see each place 3 and 6 lines later, less a fraction."""
    offsets = [SensorOffset(), SensorOffset(lines=3.4), SensorOffset(lines=6.2, pixels=2.0)]
    step = InStep([offsets], names=("RGB",))
    colours = np.stack([played(0, 64, sensor) for sensor in range(3)]).astype(np.uint16)
    blocks = [
        block
        for first in range(0, 64, LINES)
        for block in step.add(
            0, LineBlock(first_line=first, lines=colours[:, first : first + LINES], time_s=float(first))
        )
    ]
    laid = np.concatenate([block.lines for block in blocks], axis=1)
    assert laid.shape[1] == 64 - 6
    for sensor, whole in enumerate((0, 3, 6)):
        wanted = colours[sensor, whole : whole + laid.shape[1]]
        if sensor == 2:
            wanted = np.concatenate([wanted[:, 2:], wanted[:, -1:], wanted[:, -1:]], axis=1)
        np.testing.assert_array_equal(laid[sensor], wanted)
    assert not faults_of(blocks)


def test_where_no_sensor_has_lines_the_count_jumps() -> None:
    step, counters = two(0, 0), [LineCounter(name="A"), LineCounter(name="B")]
    blocks = list[LineBlock]()
    for place in (0, 1, 3):
        for sensor in range(2):
            for block in counters[sensor].take(grab(place, sensor=sensor)):
                blocks += step.add(sensor, block)
    assert [(block.first_line, block.next_line) for block in blocks] == [(0, 8), (8, 16), (24, 32)]
    assert {(fault.sensor, fault.first_line, fault.lines) for fault in faults_of(blocks)} == {
        (0, 16, 8),
        (1, 16, 8),
    }


@pytest.mark.parametrize(
    ("lines", "whole", "fraction"), [(3.4, 3, 0.4), (-0.5, 0, -0.5), (0.5, 1, -0.5), (-2.75, -3, 0.25)]
)
def test_an_offset_is_whole_lines_and_a_fraction(lines: float, whole: int, fraction: float) -> None:
    offset = SensorOffset(lines=lines)
    assert offset.whole[0] == whole
    assert offset.fraction[0] == pytest.approx(fraction)
