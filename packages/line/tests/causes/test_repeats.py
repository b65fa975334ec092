"""Repeats: the distance that was put in comes out, and marks anywhere have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from packages.line.tests.causes.rows import GEOMETRY, PAGE_MM, region, rolled, row

from prooflight_line.causes.marks import marks_of, sheet_distance_mm
from prooflight_line.causes.repeats import repeats_of


@pytest.mark.parametrize(("distance", "sheets"), [(47.1, 3), (94.2, 4), (200.0, 8), (534.1, 20), (942.5, 30)])
def test_a_distance_comes_out(distance: float, sheets: int) -> None:
    marks = marks_of(rolled(distance, sheets=sheets), GEOMETRY)
    (repeat,) = repeats_of(marks, sheet_mm=PAGE_MM, sd_mm=0.3)
    assert repeat.distance_mm == pytest.approx(distance, abs=3 * repeat.sd_mm)
    assert len(repeat.marks) == len(marks)
    assert not repeat.on_page
    assert repeat.x_mm == pytest.approx(70)


def test_marks_beside_a_roller_do_not_hide_it() -> None:
    # Half as many marks as the roller's, in its own column, seed 1: the tolerance of 3 sd is that of the fit.
    rng = np.random.default_rng(1)
    marks = marks_of(rolled(94.2, sheets=8), GEOMETRY)
    off = 310.0 * rng.random(len(marks) // 2) * 8
    others = [replace(marks[0], along_mm=float(at), sheet=int(at / 310), y_mm=float(at % 310)) for at in off]
    repeat = repeats_of([*marks, *others], sheet_mm=PAGE_MM, sd_mm=0.3)[0]
    assert repeat.distance_mm == pytest.approx(94.2, abs=3 * repeat.sd_mm)


def test_one_place_of_all_sheets_is_the_page() -> None:
    records = [row(sheet, region(50, 80)) for sheet in range(8)]
    (repeat,) = repeats_of(marks_of(records, GEOMETRY), sheet_mm=PAGE_MM, sd_mm=0.3)
    assert repeat.on_page
    assert repeat.distance_mm == pytest.approx(310, abs=0.1)


def test_one_place_of_sheets_that_come_unevenly_is_the_page() -> None:
    late = [0, 40, 10, 300, 170, 90, 20, 210, 60, 130]
    records = [
        row(sheet, region(50, 80), first_line=3100 * sheet + late[sheet]) for sheet in range(len(late))
    ]
    (repeat,) = repeats_of(marks_of(records, GEOMETRY), sheet_mm=PAGE_MM, sd_mm=0.3)
    assert repeat.on_page


def test_marks_anywhere_have_no_repeat() -> None:
    # 1 % is promised for each run; of 60 runs, seed 2, more than 4 have a chance of 1e-5 (binomial).
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(60):
        places = [(int(rng.integers(30)), rng.uniform(68, 72), rng.uniform(0, PAGE_MM)) for _ in range(30)]
        records = [row(sheet, *(region(x, y) for at, x, y in places if at == sheet)) for sheet in range(30)]
        alarms += bool(repeats_of(marks_of(records, GEOMETRY), sheet_mm=PAGE_MM, sd_mm=0.3))
    assert alarms <= 4


def test_too_few_marks_have_none() -> None:
    assert repeats_of([], sheet_mm=PAGE_MM, sd_mm=0.3) == []
    assert repeats_of(marks_of(rolled(94.2, sheets=1), GEOMETRY), sheet_mm=PAGE_MM, sd_mm=0.3) == []


def test_regions_near_each_other_are_one_mark() -> None:
    (mark,) = marks_of([row(0, region(50, 80), region(52, 81, width=2))], GEOMETRY)
    assert (mark.x_mm, mark.width_mm) == (pytest.approx(51.25), pytest.approx(3.5))
    assert mark.along_mm == pytest.approx(2 + mark.y_mm)


def test_sheets_off_their_path_have_no_marks() -> None:
    assert marks_of([row(0, region(50, 80), faults=("slip",))], GEOMETRY) == []


def test_the_distance_of_sheets() -> None:
    assert sheet_distance_mm([row(3), row(5), row(6)], GEOMETRY) == pytest.approx(310)
    assert sheet_distance_mm([row(0)], GEOMETRY) is None
