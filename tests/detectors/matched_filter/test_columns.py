"""Columns of the camera that lost gain are told from streaks by the backing beyond the sheet. Seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.binning import MOST_COLUMNS, faulty_columns
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.scans.placement import Placement
from prooflight.scans.scan import Scan
from prooflight.simulation.scans import ideal_scan, simulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

COLUMN = 190


def scan_of(page: Page, press: Press, *, seed: int = 1, shift_mm: float = 0.0) -> NDArray[np.uint16]:
    placement = Placement(shift_mm=(0.0, shift_mm))
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)
    return ideal_scan(seen, press, np.random.default_rng(seed))


def faulty(scan: NDArray[np.uint16], page: Page, press: Press) -> list[list[int]]:
    flags = faulty_columns(scan, press.sensors, press.geometry, page_height_mm=page.height_mm)
    return [np.flatnonzero(one).tolist() for one in flags]


@pytest.mark.parametrize("gain", [0.0, 0.5, 1.5])
def test_a_column_that_is_off_on_the_backing_is_faulty(
    two_sensor_press: Press, page: Page, gain: float
) -> None:
    scan = scan_of(page, two_sensor_press).astype(float)
    offset = two_sensor_press.sensors[1].column_offset_dn[COLUMN]
    scan[1, :, COLUMN] = offset + gain * (scan[1, :, COLUMN] - offset)
    assert faulty(np.rint(scan).astype(np.uint16), page, two_sensor_press) == [[], [COLUMN]]


def test_a_streak_of_ink_ends_with_the_sheet(press: Press, page: Page) -> None:
    cmyk = page.cmyk.copy()
    cmyk[:, 400:404, 3] = 255
    assert faulty(scan_of(replace(page, cmyk=cmyk), press), page, press) == [[]]


@pytest.mark.parametrize("shift_mm", [-3.0, -0.76, 0.0, 0.76, 3.0])
def test_good_columns_are_faulty_nowhere_wherever_the_page_lies(
    press: Press, page: Page, shift_mm: float
) -> None:
    for seed in range(5):
        assert faulty(scan_of(page, press, seed=seed, shift_mm=shift_mm), page, press) == [[]]


def test_many_columns_are_no_fault_of_single_ones(press: Press, page: Page) -> None:
    scan = scan_of(page, press)
    some = np.arange(10, 10 + 20 * int(MOST_COLUMNS * press.geometry.pixels + 1), 20)
    scan[:, :, some] //= 2
    assert faulty(scan, page, press) == [[]]


def test_a_scan_that_is_cut_short_tells_of_no_column(press: Press, page: Page) -> None:
    scan = scan_of(page, press)
    scan[:, :, COLUMN] //= 2
    assert faulty(scan[:, :-40], page, press) == [[]]


def test_what_no_sensor_saw_is_not_called_good(trained_press: Press, page: Page) -> None:
    """The detector's only sensor has a faulty column: its page is not inspected, and the reason names the column."""
    scan = simulate(page, trained_press, world="press", seed=4).dn
    inspector = Inspector.of(trained_press)
    prepared = inspector.prepare(page)
    assert inspector.inspect(prepared, Scan(dn=scan)).verdict.verdict == "good"
    scan[:, :, COLUMN] //= 2
    verdict = inspector.inspect(prepared, Scan(dn=scan)).verdict
    assert verdict.verdict == "not-inspected", (verdict, verdict.regions)
    assert f"camera column {COLUMN} " in verdict.reason
