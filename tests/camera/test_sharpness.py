"""MTF against closed forms, and against the footprint that predictions filter with."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.sharpness import nyquist_per_mm, sharpness

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.press.press_file import PressFile

FREQUENCY = np.linspace(0, 200, 41)


@pytest.fixture
def camera(prototype: PressFile) -> Camera:
    return prototype.camera()


def at_ratio(camera: Camera, ratio: float, *, binning: int = 1) -> Camera:
    """The camera with paper ``ratio`` times as fast as in step with the sensor."""
    in_step_mm_s = camera.pixel_pitch_mm * camera.sensors[0].line_rate_hz
    return replace(camera, speed_mm_s=ratio * in_step_mm_s, binning_along=binning)


def test_nothing_is_lost_of_an_even_surface(camera: Camera) -> None:
    found = sharpness(camera, camera.sensors[0], 0.0, wave_nm=550)
    assert found.lens == found.across == found.along == 1


def test_the_lens_is_diffraction_limited_at_its_working_f_number(camera: Camera) -> None:
    # 60 mm F/2.8 at 546.6 mm: m = 60 / 486.6, N_w = 2.8 (1 + m); cut-off 1 / (lambda N_w)
    working = 2.8 * (1 + 60 / 486.6)
    cut_off = 1 / (550e-6 * working)
    x = FREQUENCY / cut_off
    want = 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x**2))
    found = sharpness(camera, camera.sensors[0], FREQUENCY, wave_nm=550)
    np.testing.assert_allclose(found.lens, want, rtol=1e-12)
    beyond = sharpness(camera, camera.sensors[0], [cut_off * 1.0001, cut_off * 3], wave_nm=550)
    assert not beyond.lens.any()


def test_across_the_web_the_whole_pixel_is_the_aperture(camera: Camera) -> None:
    found = sharpness(camera, camera.sensors[0], FREQUENCY, wave_nm=550)
    np.testing.assert_allclose(found.across, found.lens * np.abs(np.sinc(0.013 * FREQUENCY)), rtol=1e-12)
    narrow = replace(camera.sensors[0], fill_factor=0.3)
    np.testing.assert_array_equal(sharpness(camera, narrow, FREQUENCY, wave_nm=550).across, found.across)
    at_nyquist = sharpness(camera, camera.sensors[0], nyquist_per_mm(camera.sensors[0]), wave_nm=550)
    assert at_nyquist.across / at_nyquist.lens == pytest.approx(2 / np.pi)


@pytest.mark.parametrize(("ratio", "binning"), [(1.0, 1), (1.02, 1), (0.97, 1), (1.0, 3), (1.01, 2)])
def test_along_the_web_motion_binning_and_tdi_smear_are_boxes(
    camera: Camera, ratio: float, binning: int
) -> None:
    moving = at_ratio(camera, ratio, binning=binning)
    found = sharpness(moving, moving.sensors[0], FREQUENCY, wave_nm=550)
    cycles = 0.013 * FREQUENCY  # a pixel
    motion = np.sinc(binning * ratio * cycles) * np.sinc(96 * abs(ratio - 1) * cycles)
    np.testing.assert_allclose(found.along, found.across * np.abs(motion), atol=1e-12)


def test_white_light_weighs_wavelengths_as_the_footprint_does(camera: Camera) -> None:
    # The footprint is built from the same optics in its own way: its edge profile, transformed, is the MTF.
    sensor = camera.sensors[0]
    footprint = camera.footprint(sensor, reach_pixels=32)
    places = np.linspace(-footprint.reach_mm, footprint.reach_mm, footprint.across.size)
    middles, step = (places[1:] + places[:-1]) / 2, places[1] - places[0]
    on_page = np.linspace(0, 4, 9)  # cycles/mm
    found = sharpness(camera, sensor, on_page / camera.lens.magnification)
    for got, cumulative in ((found.across, footprint.across), (found.along, footprint.along)):
        waves = np.exp(-2j * np.pi * on_page[:, None] * middles)
        want = np.abs(waves @ np.diff(cumulative)) * np.sinc(on_page * step)
        np.testing.assert_allclose(got, want, atol=2e-3)  # the footprint is cut at its reach


def test_a_blind_sensor_has_no_white_light_mtf(camera: Camera) -> None:
    blind = replace(camera.sensors[0], quantum_efficiency=np.zeros(36))
    with pytest.raises(ValueError, match="sensor mono is not sensitive to this light"):
        sharpness(camera, blind, 10.0)
