from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight_line.run.sheets.sheet_faults import Rhythm

SHEET, GAP, TOLERANCE = 2800.0, 38.0, 11.4
SHIFT = 7.2
"""0.76 mm of the press world in lines of 0.105 mm; the tolerance is 1.2 mm."""


def beats(gaps: np.ndarray, sheets: np.ndarray | None = None) -> list[tuple[int, float]]:
    rhythm = Rhythm(tolerance=TOLERANCE)
    lengths = np.full(gaps.size, SHEET) if sheets is None else sheets
    return [
        (rhythm.room(float(gap), float(sheet)), rhythm.beat(float(gap), float(sheet)))
        for gap, sheet in zip(gaps, lengths, strict=True)
    ]


def good_gaps(seed: int, count: int) -> np.ndarray:
    """Of sheets each of which lies off its place by as much as good ones do, alone."""
    shifts = np.random.default_rng(seed).uniform(-SHIFT, SHIFT, count + 1)
    return GAP + np.diff(shifts)


RUNS = range(300)
MOST_ODD = 6
"""Of the runs in which chance may bring sheets further than the limit: 1 was seen in 300 of good ones, and so many have
a probability below 0.001 where one in 200 is so."""


def test_good_sheets_are_in_time() -> None:
    odd = [seed for seed in RUNS if any(beat != (0, 0.0) for beat in beats(good_gaps(seed, 300)))]
    assert len(odd) <= MOST_ODD


@pytest.mark.parametrize("slip", [-26.0, 28.0, 60.0, 140.0])
def test_a_belt_that_slipped_is_told_once_and_its_new_place_kept(slip: float) -> None:
    odd = []
    for seed in RUNS:
        gaps, at = good_gaps(seed, 200), 12 + seed % 139
        gaps[at] += slip
        said = beats(gaps)
        told = abs(said[at][1] - slip) < 2 * SHIFT
        if not told or any(beat != (0, 0.0) for n, beat in enumerate(said) if n != at):
            odd.append(seed)
    assert len(odd) <= MOST_ODD


@pytest.mark.parametrize("slip", [28.0, 60.0, 140.0])
def test_a_sheet_alone_off_its_place_is_told_and_the_next_is_not(slip: float) -> None:
    odd = []
    for seed in RUNS:
        gaps, at = good_gaps(seed, 200), 12 + seed % 139
        gaps[at] += slip
        gaps[at + 1] -= slip
        said = beats(gaps)
        if said[at][1] <= 0 or any(late for n, (_, late) in enumerate(said) if n != at):
            odd.append(seed)
    assert len(odd) <= MOST_ODD


@given(st.integers(0, 10**6), st.integers(1, 100), st.integers(1, 3))
def test_room_for_sheets_that_did_not_come_is_counted(seed: int, at: int, sheets: int) -> None:
    gaps = good_gaps(seed, 200)
    gaps[at] += sheets * (SHEET + GAP)
    said = beats(gaps)
    counted = [skipped for skipped, _ in said]
    assert counted == [sheets if n == at else 0 for n in range(200)]
    assert all(late == 0.0 for _, late in said)


def test_sheets_of_many_lengths_have_one_gap() -> None:
    lengths = np.random.default_rng(1).choice([1500.0, 2000.0, 2800.0], 100)
    assert all(beat == (0, 0.0) for beat in beats(good_gaps(2, 100), lengths))
