"""A prepared page follows the light of its press, and needs no other modes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import PreparedPage, prepare_page
from prooflight.detectors.matched_filter.fit.modes import mode_tables
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import values_of
from prooflight.prediction.predict import predict
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MOVED = Placement(shift_mm=(0.23, -0.17), skew_deg=0.05)


def under_another_lamp(press: Press) -> Press:
    """Three per cent less light in the middle, and a wave of one per cent."""
    waves = np.cos(np.pi * np.linspace(0, 1, press.geometry.pixels)).astype(np.float32)
    sensors = tuple(
        replace(sensor, column_gain=sensor.column_gain * (np.float32(0.97) + np.float32(0.01) * waves))
        for sensor in press.sensors
    )
    return replace(press, sensors=sensors)


def prepared(page: Page, press: Press) -> PreparedPage:
    expected = predict(page, sensors=press.sensors, geometry=press.geometry)
    return prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry, fringes=True)


def statistics(known: PreparedPage, scan: NDArray[np.uint16]) -> NDArray[np.float32]:
    analysis = analyse(known, scan)
    return values_of(
        all_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.registration, Scatter.white())
    )


def test_under_another_light_a_page_is_what_it_were_if_prepared_anew(
    two_sensor_press: Press, page: Page
) -> None:
    lit = under_another_lamp(two_sensor_press)
    before, anew = prepared(page, two_sensor_press), prepared(page, lit)
    under = before.under(lit.sensors)
    assert under.images is before.images
    np.testing.assert_array_equal(under.images.levels, anew.images.levels)
    np.testing.assert_array_equal(under.page_features, anew.page_features)
    np.testing.assert_array_equal(under.landmarks.lines, anew.landmarks.lines)
    expected = predict(page, sensors=lit.sensors, geometry=lit.geometry, placement=MOVED)
    scan = ideal_scan(expected, lit, np.random.default_rng(1))
    asked = statistics(anew, scan)
    # Landmarks stay those of the light before, and weigh their tiles a little otherwise: the page is found elsewhere by
    # a few thousandths of a pixel, which is a tenth of what statistics scatter by (0.075 where this was written; on
    # another processor 0.23 in one that only explains, of black added in boxes of 16 mm).
    found, deciding = statistics(under, scan), shipped_ranking().model.screen
    assert deciding is not None
    np.testing.assert_allclose(found[deciding.statistic], asked[deciding.statistic], rtol=0, atol=0.2)
    np.testing.assert_allclose(found, asked, rtol=0, atol=0.4)
    assert np.abs(statistics(before, scan) - asked).max() > 1  # the light tells


def test_tables_of_modes_are_made_once_whatever_the_light(press: Press) -> None:
    lit = under_another_lamp(press)
    assert mode_tables(press.sensors[0]) is mode_tables(lit.sensors[0])
