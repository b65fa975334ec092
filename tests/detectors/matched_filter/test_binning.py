"""Pixels taken together show the mean of what each shows, wherever the page lies."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.binning import (
    binned,
    binned_geometry,
    binned_sensor,
    bins_of,
    thinned,
)
from prooflight.detectors.matched_filter.fit.modes import AddedInks, prepare_modes
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict, shot_slope
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

BINS = 2
MOVED = Placement(shift_mm=(0.23, -0.17), skew_deg=0.05, stretch_percent=(0.02, -0.01))


@pytest.mark.parametrize("bins", [2, 3])
def test_squares_hold_their_means(bins: int) -> None:
    image = np.random.default_rng(1).integers(0, 4000, (6 * bins + 1, 8 * bins)).astype(np.uint16)
    whole = np.concatenate([image, np.repeat(image[-1:], bins, axis=0)]).astype(np.float64)
    asked = whole[: 7 * bins].reshape(7, bins, 8, bins).mean(axis=(1, 3))
    np.testing.assert_allclose(binned(image, bins), asked, rtol=1e-6)


def test_fine_pixels_are_binned_and_coarse_ones_are_not(press: Press) -> None:
    at = binned_geometry(press.geometry, BINS)
    assert bins_of(press.geometry) == BINS
    assert bins_of(at) == 1
    assert at.field_mm == pytest.approx(press.geometry.field_mm)
    assert at.lines(100.0) == -(-press.geometry.lines(100.0) // BINS)


@pytest.mark.parametrize("bins", [2, 3, 5])
def test_a_binned_scan_has_the_lines_that_its_geometry_says(press: Press, bins: int) -> None:
    """Also where the page's height is a whole number of lines, but for rounding."""
    for pitch_mm in (0.1, 0.05, 25.4 / 400, 0.0847):
        geometry = replace(press.geometry, pixels=60, pixel_pitch_mm=pitch_mm, line_pitch_mm=pitch_mm)
        at = binned_geometry(geometry, bins)
        for lines in range(1, 400):
            image = np.zeros((1, geometry.lines(lines * pitch_mm), 60), np.uint16)
            assert at.lines(lines * pitch_mm) == binned(image, bins).shape[1]


def test_a_page_of_any_height_has_modes_of_its_own_lines(press: Press) -> None:
    """Whose last squares of raster pixels need not be full: thinned, such a page may reach a line further."""
    sensors, geometry = press.sensors, press.geometry
    at = binned_geometry(geometry, BINS)
    further = 0
    for rows in range(981, 1001):
        cmyk = np.full((rows, 800, 4), 90, np.uint8)
        cmyk[100:700, 100:500, 3] = 255
        page = Page(cmyk=cmyk, dpi=600.0, name="tint", number=1)
        further += at.lines(thinned(page, BINS).height_mm) > at.lines(page.height_mm)
        expected = predict(page, sensors=sensors, geometry=geometry)
        known = prepare_page(page, expected, sensors=sensors, geometry=geometry)
        assert known.images.levels.shape[1] == known.added.images.shape[1] == at.lines(page.height_mm)
    assert further


def test_modes_of_binned_pixels_are_means_of_modes(press: Press) -> None:
    """Of a thinned raster: soft tints and hard edges."""
    rng = np.random.default_rng(2)
    cmyk = np.zeros((600, 640, 4), np.uint8)
    cmyk[50:-50, 60:300, 0] = np.linspace(0, 255, 240).astype(np.uint8)
    cmyk[50:-50, 60:-60, 3] = 255 * np.kron(rng.random((50, 40)) < 0.3, np.ones((10, 13)))
    page = Page(cmyk=cmyk, dpi=481.8, name="bars", number=1)
    sensors, geometry = press.sensors, press.geometry
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    taken_as = [binned_sensor(sensor, BINS, pitch_mm) for sensor in sensors]
    found = prepare_modes(thinned(page, BINS), sensors=taken_as, geometry=binned_geometry(geometry, BINS))
    asked = prepare_modes(page, sensors=sensors, geometry=geometry)
    of_binned = AddedInks(page, sensors=taken_as, geometry=binned_geometry(geometry, BINS), bins=BINS)
    of_pixels = AddedInks(page, sensors=sensors, geometry=geometry, bins=1)
    pairs = {name: (getattr(found, name), getattr(asked, name)) for name in ("gain", "dot", "cover")}
    for name, (own, fine) in (pairs | {"add": (of_binned.images, of_pixels.images)}).items():
        of_fine = binned(fine, BINS)
        assert np.sqrt(((own - of_fine) ** 2).mean()) < 0.05 * np.abs(of_fine).max(), name
        assert own.mean() == pytest.approx(of_fine.mean(), rel=0.02)


@pytest.mark.parametrize("bins", [2, 3])
@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("line_mm_a_pixel_mm", [1.0, 1.25])
def test_binned_pixels_are_predicted_as_means_of_predictions(
    press: Press, page: Page, bins: int, straight: bool, line_mm_a_pixel_mm: float
) -> None:
    """Also where variance is no straight line over the light, and where lines lie further apart than pixels.

    At edges a pixel's own gain, off its neighbours' by a few per cent, is taken with the mean of their light.
    """
    sensor = press.sensors[0]
    if not straight:
        sensor = replace(sensor, variance_dn2=sensor.variance_dn2 * (1 + 0.1 * (sensor.mean_dn > 1000)))
    assert (shot_slope(sensor) > 0) == straight
    pitch_mm = press.geometry.pixel_pitch_mm
    geometry = replace(press.geometry, pixels=399, line_pitch_mm=line_mm_a_pixel_mm * pitch_mm)
    columns = {"column_gain": sensor.column_gain[:399], "column_offset_dn": sensor.column_offset_dn[:399]}
    sensor = replace(sensor, **columns)
    if bins == 2:
        sensor = replace(sensor, **{name: values[:398] for name, values in columns.items()})
        geometry = replace(geometry, pixels=398)
    fine = predict(page, sensors=[sensor], geometry=geometry, placement=MOVED)
    together = binned_sensor(sensor, bins, (pitch_mm, line_mm_a_pixel_mm * pitch_mm))
    own = predict(page, sensors=[together], geometry=binned_geometry(geometry, bins), placement=MOVED)
    off = (own.expected_dn - binned(fine.expected_dn, bins))[:, 1:-1] / sensor.white_dn
    assert np.sqrt((off**2).mean()) < 1e-3
    assert np.abs(off).max() < 0.01
    variance = binned(fine.variance_dn2, bins) / np.float32(bins**2)
    np.testing.assert_allclose(own.variance_dn2[:, 1:-1], variance[:, 1:-1], rtol=0.05)


def test_pixels_taken_together_see_what_a_lens_scatters_far(press: Press) -> None:
    """Their correction is the fine one's, at the frequencies that they have."""
    sensor, pitch_mm = press.sensors[0], press.geometry.pixel_pitch_mm
    together = binned_sensor(sensor, BINS, (pitch_mm, pitch_mm))
    frequency = np.linspace(0, 0.4, 9)
    found, asked = together.correction.transfer(frequency), sensor.correction.transfer(frequency / BINS)
    np.testing.assert_allclose(found, asked, atol=2e-3)
    assert np.abs(asked - 1).max() > 0.01
