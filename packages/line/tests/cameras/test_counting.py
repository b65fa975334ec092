"""Lines counted through every kind of loss: each line that comes out is the one that was played under its number."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import ScanError
from prooflight.scans.lines import LineBlock, LineFault
from prooflight_line.cameras.camera import Grab
from prooflight_line.cameras.counting import LineCounter, blocks_ahead, lost_lines

LINES, PIXELS = 8, 16
FIRST_ID = 65_401
"""Where Aravis' simulated camera begins: the numbers begin again 135 blocks later."""


def played(first_line: int, count: int) -> np.ndarray:
    """Lines whose pixels say which they are, (count, pixels)."""
    lines = np.arange(first_line, first_line + count)[:, None]
    return (lines * 7 + np.arange(PIXELS)) % 251


def grab(place: int, *, passed: int = 0, **changed: Any) -> Grab:
    """The block at a place in the stream; passed: triggers passed over before it."""
    told = Grab(
        block_id=(FIRST_ID + place - 1) % 65_535 + 1,
        id_wraps=True,
        data=played(place * LINES + passed, LINES).astype(np.uint8).ravel(),
        missing=(),
        pixel_format="Mono8",
        lines=LINES,
        pixels=PIXELS,
        padding=0,
        time_s=float(place),
        triggers=(place + 1) * LINES + passed,
    )
    return replace(told, **changed)


def counted(counter: LineCounter, *grabs: Grab) -> list[LineBlock]:
    return [block for one in grabs for block in counter.take(one)]


def faults_of(blocks: list[LineBlock]) -> list[LineFault]:
    return [fault for block in blocks for fault in block.faults]


def assert_as_played(blocks: list[LineBlock]) -> None:
    """Lines that may be judged show what was played under their number."""
    doubtful = {
        line
        for fault in faults_of(blocks)
        if fault.unseen
        for line in range(fault.first_line, fault.next_line)
    }
    for block in blocks:
        wanted = played(block.first_line, block.lines.shape[1])
        sure = [line not in doubtful for line in range(block.first_line, block.next_line)]
        np.testing.assert_array_equal(block.lines[0][sure], wanted[sure])


@pytest.mark.parametrize(
    ("block_id", "last_id", "wraps", "ahead"),
    [
        (8, 7, True, 1),
        (1, 65_535, True, 1),
        (3, 65_535, True, 3),
        (65_535, 2, True, -2),
        (7, 7, True, 0),
        (65_536, 65_535, False, 1),
        (5, 9, False, -4),
        (64_000, 1, True, 63_999),
    ],
)
def test_numbers_of_sixteen_bits_begin_again_at_one(
    block_id: int, last_id: int, wraps: bool, ahead: int
) -> None:
    assert blocks_ahead(block_id, last_id, wraps=wraps) == ahead


def test_numbers_that_begin_again_lose_no_line() -> None:
    blocks = counted(LineCounter(name="cam"), *(grab(place) for place in range(300)))
    assert [block.first_line for block in blocks] == list(range(0, 300 * LINES, LINES))
    assert not faults_of(blocks)
    assert_as_played(blocks)


def test_a_camera_that_counts_nought_too_loses_no_line() -> None:
    ids = [65_534, 65_535, 0, 1, 2]
    blocks = counted(LineCounter(name="cam"), *(grab(place, block_id=one) for place, one in enumerate(ids)))
    assert [block.first_line for block in blocks] == [place * LINES for place in range(5)]
    assert not faults_of(blocks)


def test_lost_packets_are_a_fault_of_exactly_their_lines() -> None:
    # Bytes 20 to 39 are of lines 1 and 2, the last byte of line 7.
    holed = grab(1, missing=((20, 40), (127, 128)))
    blocks = counted(LineCounter(name="cam"), grab(0), holed, grab(2))
    assert [(block.first_line, block.lines.shape[1]) for block in blocks] == [
        (0, 8),
        (8, 1),
        (11, 4),
        (16, 8),
    ]
    first, second = faults_of(blocks)
    assert (first.kind, first.first_line, first.lines) == ("lost-packets", 9, 2)
    assert (second.kind, second.first_line, second.lines) == ("lost-packets", 15, 1)
    assert first.detail == "lines 9 to 10 were lost: parts of block 65402 did not arrive"
    assert second.detail.startswith("line 15 was lost: ")
    assert_as_played(blocks)


def test_a_block_of_which_nothing_arrived_is_lost_as_a_whole() -> None:
    counter = LineCounter(name="cam")
    blocks = counted(counter, grab(0), grab(1, missing=((0, 128),)), grab(2))
    assert [block.first_line for block in blocks] == [0, 16]
    assert [(fault.kind, fault.first_line, fault.lines) for fault in faults_of(blocks)] == [
        ("lost-packets", 8, 8)
    ]
    assert (counter.lines, counter.lost, counter.blocks, counter.broken) == (16, 8, 3, 1)


def test_lost_blocks_are_counted_over_the_turn_of_the_numbers() -> None:
    blocks = counted(LineCounter(name="cam"), grab(133), grab(138))
    assert blocks[1].first_line == 5 * LINES
    (fault,) = blocks[1].faults
    assert (fault.kind, fault.first_line, fault.lines) == ("lost-blocks", LINES, 4 * LINES)


def test_a_block_that_comes_too_late_changes_no_count() -> None:
    blocks = counted(LineCounter(name="cam"), grab(0), grab(2), grab(1), grab(3))
    assert [block.first_line for block in blocks] == [0, 16, 24]
    lost, late = faults_of(blocks)
    assert (lost.kind, late.kind) == ("lost-blocks", "late-lines")
    assert (late.first_line, late.lines, late.unseen) == (8, 8, False)
    assert_as_played(blocks)


def test_triggers_passed_over_make_their_block_doubtful_and_move_the_count() -> None:
    blocks = counted(LineCounter(name="cam"), grab(0), grab(1, triggers=16 + 3), grab(2, passed=3))
    assert [block.first_line for block in blocks] == [0, 8, 19]
    (fault,) = faults_of(blocks)
    assert (fault.kind, fault.first_line, fault.lines) == ("lost-triggers", 8, 11)
    assert "3 line triggers were missed within lines 8 to 15" in fault.detail
    assert_as_played(blocks)


def test_after_a_restart_the_count_goes_on_from_where_it_was() -> None:
    counter = LineCounter(name="cam")
    before = counted(counter, grab(0), grab(1))
    counter.restarted(lines=1000, why="the camera was disconnected for 0.4 s")
    after = counted(counter, grab(0, block_id=1, triggers=8))
    assert [block.first_line for block in before + after] == [0, 8, 1016]
    (fault,) = after[0].faults
    assert (fault.kind, fault.first_line, fault.lines) == ("camera-away", 16, 1000)


@given(
    events=st.lists(
        st.one_of(
            st.just("come"),
            st.just("lost"),
            st.tuples(st.integers(0, 127), st.integers(1, 60)),
            st.integers(1, 4),
        ),
        min_size=1,
        max_size=200,
    )
)
def test_whatever_is_lost_no_line_comes_under_anothers_number(events: list[Any]) -> None:
    """lost: a block; a pair: a hole of bytes; a number: triggers passed over at the block's end."""
    counter, passed, sent = LineCounter(name="cam"), 0, []
    for place, event in enumerate(["come", *events, "come"]):
        if event == "lost":
            continue
        if isinstance(event, tuple):
            sent.append(grab(place, passed=passed, missing=((event[0], min(sum(event), 128)),)))
        elif isinstance(event, int):
            sent.append(grab(place, passed=passed, triggers=(place + 1) * LINES + passed + event))
            passed += event
        else:
            sent.append(grab(place, passed=passed))
    blocks = counted(counter, *sent)
    assert_as_played(blocks)
    came = {line for block in blocks for line in range(block.first_line, block.next_line)}
    named = {line for fault in faults_of(blocks) for line in range(fault.first_line, fault.next_line)}
    assert came | named >= set(range(counter.next_line))
    assert len(came) == counter.lines


def test_a_hole_in_the_padding_loses_no_line() -> None:
    assert not lost_lines([(16, 18)], lines=2, line_bits=128, padding=4).any()
    assert lost_lines([(18, 21)], lines=2, line_bits=128, padding=4).tolist() == [False, True]
    assert lost_lines([(4, 5)], lines=3, line_bits=36).tolist() == [
        True,
        True,
        False,
    ]  # the byte that two share


def test_another_width_is_refused_in_one_line() -> None:
    counter = LineCounter(name="cam 1", pixels=2048, sensors=1)
    with pytest.raises(
        ScanError, match=r"^cam 1: sends 1 sensors x 16 pixels; set it to 1 sensors x 2048 pixels"
    ):
        counted(counter, grab(0))
