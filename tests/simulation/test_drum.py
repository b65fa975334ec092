from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import RequestError
from prooflight.scans.pacing import Pacer
from prooflight.simulation.drum import (
    AMOUNTS,
    LINE_FAULTS,
    ORDER_FAULTS,
    Drum,
    DrumFault,
    Turn,
    stretched,
    turns,
)
from prooflight.simulation.ring import GrowingRing

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.press.artefact import Press

LINES = 120


class FakeClock:
    """A clock that only sleeping, or whoever is slow, moves."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept = 0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds
        self.slept += 1


@pytest.fixture
def scans(press: Press) -> list[np.ndarray]:
    """Three sheets, every line of which says which it is."""
    pixels = press.geometry.pixels
    return [
        np.repeat(np.arange(1000 * n, 1000 * n + LINES, dtype=np.uint16)[None, :, None], pixels, axis=2)
        for n in (1, 2, 3)
    ]


def stamped(drum: Drum) -> tuple[np.ndarray, np.ndarray]:
    """First pixel of every line, and the camera's count of every line."""
    blocks = list(drum.blocks())
    values = np.concatenate([block.lines[0, :, 0] for block in blocks])
    counts = np.concatenate([block.first_line + np.arange(block.lines.shape[1]) for block in blocks])
    return values, counts


@given(block_lines=st.integers(1, 2 * LINES), gap_lines=st.integers(0, 9), sheets=st.integers(1, 7))
def test_all_lines_pass_in_order_whatever_the_blocks(
    press: Press, block_lines: int, gap_lines: int, sheets: int
) -> None:
    pixels = press.geometry.pixels
    ring = [np.full((1, LINES, pixels), 1000 + n, np.uint16) for n in range(3)]
    drum = Drum(ring, press=press, passing=turns(sheets, {}), gap_lines=gap_lines, block_lines=block_lines)
    values, counts = stamped(drum)
    np.testing.assert_array_equal(counts, np.arange(sheets * (LINES + gap_lines)))
    by_sheet = values.reshape(sheets, LINES + gap_lines)[:, gap_lines:]
    np.testing.assert_array_equal(by_sheet, 1000 + np.arange(sheets)[:, None] % 3 * np.ones(LINES, int))


def test_pages_a_second_count_pages_of_the_mean_length(press: Press) -> None:
    """A job that begins with a card must not make all its sheets pass at the card's pace."""
    ring = [np.zeros((1, lines, press.geometry.pixels), np.uint16) for lines in (100, 260, 300)]
    assert Drum(ring, press=press, passing=turns(3, {}), pages_per_s=5.0, gap_lines=10).page_lines == 230
    drum = Drum(ring, press=press, passing=turns(3, {}), pages_per_s=5.0, scan_lines=250.0)
    assert drum.page_lines == 250


def test_pages_a_second_are_kept_by_the_clock(press: Press, scans: list[np.ndarray]) -> None:
    clock = FakeClock()
    pacer = Pacer(5.0 * LINES, clock=clock, sleep=clock.sleep)
    drum = Drum(scans, press=press, passing=turns(10, {}), pacer=pacer, block_lines=50)
    times = [(block.next_line, block.time_s) for block in drum.blocks()]
    assert drum.page_lines == LINES
    for line, time_s in times:
        assert time_s == pytest.approx(100.0 + line / (5.0 * LINES))
    assert clock.now_s == pytest.approx(102.0)
    assert clock.slept == len(times)


def test_who_is_slow_gets_lines_late_but_as_of_when_they_were_read(
    press: Press, scans: list[np.ndarray]
) -> None:
    clock = FakeClock()
    drum = Drum(scans, press=press, passing=turns(4, {}), pacer=Pacer(LINES, clock=clock, sleep=clock.sleep))
    for block in drum.blocks():
        assert block.time_s == pytest.approx(100.0 + block.next_line / LINES)
        clock.now_s += 10.0
    assert clock.slept == 1


def test_a_drum_that_waits_makes_up_for_no_lost_time(press: Press, scans: list[np.ndarray]) -> None:
    clock = FakeClock()
    pacer = Pacer(LINES, waits=True, clock=clock, sleep=clock.sleep)
    times = []
    for block in Drum(scans, press=press, passing=turns(4, {}), pacer=pacer, block_lines=LINES).blocks():
        times.append(block.time_s)
        clock.now_s += 10.0
    assert times == pytest.approx([101.0, 111.0, 121.0, 131.0])


def test_scans_of_a_growing_ring_are_waited_for_and_its_error_is_raised() -> None:
    go = threading.Event()

    def rest() -> Iterator[Any]:
        go.wait()
        yield SimpleNamespace(dn=1)
        raise RequestError("ring", "broke", remedy="none")

    ring = GrowingRing([SimpleNamespace(dn=0)], rest(), 3)  # type: ignore[list-item]
    assert (len(ring), ring[0]) == (3, 0)
    go.set()
    assert ring[1] == 1
    with pytest.raises(RequestError, match="broke"):
        ring[2]
    assert ring[1] == 1


def test_it_can_be_closed_at_any_time(press: Press, scans: list[np.ndarray]) -> None:
    drum = Drum(scans, press=press, passing=(Turn(page=n) for n in range(10**9)))
    blocks = drum.blocks()
    for _ in range(5):
        next(blocks)
    drum.close()
    drum.close()
    assert list(blocks) == []


def played(press: Press, scans: list[np.ndarray], **fault: Any) -> tuple[np.ndarray, np.ndarray]:
    return stamped(Drum(scans, press=press, passing=turns(3, {1: DrumFault(**fault)}), block_lines=7))


def test_lost_lines_are_gone_and_the_count_tells_or_not(press: Press, scans: list[np.ndarray]) -> None:
    values, counts = played(press, scans, kind="lost-lines", amount=20, at=0.5)
    assert not set(range(2060, 2080)) & set(values.tolist())
    assert values.size == 3 * LINES - 20
    (jump,) = np.flatnonzero(np.diff(counts) != 1)
    assert (values[jump], values[jump + 1], counts[jump + 1] - counts[jump]) == (2059, 2080, 21)
    silent, counted = played(press, scans, kind="lost-lines", amount=20, at=0.5, counted=False)
    np.testing.assert_array_equal(silent, values)
    np.testing.assert_array_equal(counted, np.arange(silent.size))


def test_extra_lines_come_again_with_their_count_or_stand_still(
    press: Press, scans: list[np.ndarray]
) -> None:
    values, counts = played(press, scans, kind="extra-lines", amount=20, at=0.5)
    assert values.size == 3 * LINES + 20
    again = np.flatnonzero((values >= 2040) & (values < 2060))
    np.testing.assert_array_equal(values[again[:20]], values[again[20:]])
    np.testing.assert_array_equal(counts[again[:20]], counts[again[20:]])
    still, counted = played(press, scans, kind="extra-lines", amount=20, at=0.5, counted=False)
    assert (still == 2059).sum() == 21
    np.testing.assert_array_equal(counted, np.arange(still.size))


def test_a_slip_leaves_backing_before_its_sheet(press: Press, scans: list[np.ndarray]) -> None:
    values, _ = played(press, scans, kind="slip", amount=5.0)
    late = round(5.0 / press.geometry.line_pitch_mm)
    sensor = press.sensors[0]
    np.testing.assert_allclose(
        values[LINES : LINES + late],
        sensor.column_offset_dn[0] + sensor.column_gain[0] * sensor.backing_dn,
        atol=0.5,
    )
    assert values[LINES + late] == 2000


@pytest.mark.parametrize("percent", [-1.0, -0.3, 0.3, 1.0])
def test_a_stretched_scan_has_all_its_lines_in_order(scans: list[np.ndarray], percent: float) -> None:
    long = np.repeat(scans[0], 10, axis=1)
    found = stretched(long, percent)[0, :, 0].astype(int)
    assert found.size == round(10 * LINES * (1 + percent / 100))
    assert (np.diff(found) >= 0).all()
    ideal = np.arange(found.size) / (1 + percent / 100)
    assert np.abs((found - 1000) * 10 - ideal).max() <= 10


def test_a_splice_hides_what_lies_under_it_and_nothing_else(press: Press, scans: list[np.ndarray]) -> None:
    values, _ = played(press, scans, kind="splice", amount=4.0, at=0.5)
    middle = values[LINES : 2 * LINES]
    half = round(2.0 / press.geometry.line_pitch_mm)
    changed = middle != np.arange(2000, 2000 + LINES)
    np.testing.assert_array_equal(np.flatnonzero(changed), 60 + np.arange(-half, half))
    assert len(set(middle[changed].tolist())) == 1


def test_turns_say_what_passes() -> None:
    faults = {
        1: DrumFault(kind="repeated"),
        3: DrumFault(kind="out-of-order"),
        6: DrumFault(kind="missing"),
        8: DrumFault(kind="blank"),
    }
    passing = turns(10, faults)
    assert [turn.page for turn in passing] == [0, 1, 1, 2, 4, 3, 5, None, 7, None, 9]
    assert [turn.fault.kind for turn in passing if turn.fault] == ["missing", "blank"]


@pytest.mark.parametrize("faults", [{10: "slip"}, {-1: "blank"}, {9: "out-of-order"}])
def test_faults_lie_on_the_job(faults: dict[int, Any]) -> None:
    with pytest.raises(RequestError, match="of 10"):
        turns(10, {sheet: DrumFault(kind=kind) for sheet, kind in faults.items()})
    with pytest.raises(RequestError, match="without overlap"):
        turns(10, {3: DrumFault(kind="out-of-order"), 4: DrumFault(kind="blank")})


@pytest.mark.parametrize("kind", [*ORDER_FAULTS, *LINE_FAULTS])
def test_drawn_faults_have_the_stated_amounts(kind: Any) -> None:
    drawn = [DrumFault.draw(kind, np.random.default_rng(n)) for n in range(60)]
    low, high = AMOUNTS.get(kind, (0.0, 0.0))
    assert all(low <= abs(fault.amount) <= high and 0.2 <= fault.at <= 0.8 for fault in drawn)
    if kind == "stretch":
        assert {np.sign(fault.amount) for fault in drawn} == {-1.0, 1.0}


def test_a_sheet_that_nobody_gave_cannot_pass(press: Press, scans: list[np.ndarray]) -> None:
    for kind in ("blank", "unknown"):
        passing = [Turn(page=None, fault=DrumFault(kind=kind))]  # type: ignore[arg-type]
        with pytest.raises(RequestError, match=kind):
            list(Drum(scans, press=press, passing=passing).blocks())
    with pytest.raises(RequestError, match="no scans"):
        Drum([], press=press, passing=[])
    with pytest.raises(RequestError, match="above 0"):
        Drum(scans, press=press, passing=[], pages_per_s=-1.0)
