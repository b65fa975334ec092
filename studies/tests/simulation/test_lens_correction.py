"""The correction of a short footprint against the exact camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import with_pixels
from prooflight.camera.lens_correction import SHORT_REACH_PIXELS, lens_correction
from prooflight.inks.built_in import built_in_inks
from prooflight.pages.raster import Page
from prooflight.prediction.lens_correction import correct_light
from prooflight_studies.exact.exposure import page_electrons, page_taps

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.press.press_file import PressFile


PIXELS = 160


@pytest.fixture(scope="module")
def camera(prototype: PressFile) -> Camera:
    return with_pixels(prototype.camera(), PIXELS)


@pytest.mark.parametrize(
    ("binning", "speed"), [(1, 1.0), (2, 1.0), (1, 1.5)], ids=["in step", "binned", "half as fast again"]
)
def test_bars_and_dots_as_the_exact_camera_sees_them(camera: Camera, binning: int, speed: float) -> None:
    in_step = camera.pixel_pitch_mm * camera.sensors[0].line_rate_hz
    pitch = camera.pixel_pitch_mm
    dpi = 25.4 / pitch * 2  # the exact camera needs whole raster pixels in pixels and in lines
    stages = [replace(sensor, tdi_stages=2) for sensor in camera.sensors]
    moving = replace(camera, sensors=tuple(stages), binning_along=binning, speed_mm_s=in_step * speed)
    sensor = moving.sensors[0]
    size = round(sensor.pixels * pitch * dpi / 25.4)
    rng = np.random.default_rng(2)
    cmyk = np.zeros((size, size, 4), np.uint8)
    thick = size // 40
    for x, y in rng.integers(0, size - 4 * thick, (40, 2)):
        cmyk[y : y + thick, x : x + 4 * thick, 3] = 255
        cmyk[x : x + 4 * thick, y : y + thick, 3] = 255
    page = Page(cmyk=cmyk, dpi=dpi, name="bars", number=1)
    x_mm = (np.arange(sensor.pixels) + 0.5) * pitch
    y_mm = (np.arange(int(page.height_mm / moving.line_pitch_mm)) + 0.5) * moving.line_pitch_mm
    exact = page_electrons(
        moving,
        built_in_inks(),
        page,
        centres_x_mm=x_mm,
        centres_y_mm=y_mm,
        backing_reflectance=0.05,
        falloff=False,
    )[0]
    inks = built_in_inks()
    white, black, backing = (
        float(sensor.electrons(moving.irradiance_photons(r)))
        for r in (*inks.reflectance(np.array([[0, 0, 0, 0], [0, 0, 0, 1.0]])), np.full(36, 0.05))
    )
    signal = np.where(cmyk[..., 3] > 0, black, white).astype(np.float32) - np.float32(backing)
    footprint = moving.footprint(sensor, reach_pixels=SHORT_REACH_PIXELS)
    across, along = page_taps(
        footprint,
        centres_x_mm=x_mm,
        centres_y_mm=y_mm,
        raster_pixel_mm=page.pixel_mm,
        raster_shape=signal.shape,
    )
    seen = np.ascontiguousarray(across.apply(along.apply(signal).T).T)
    before = seen + backing - exact
    correct_light(seen, lens_correction(moving, sensor, footprint))
    after = seen + backing - exact
    # the scan of this test ends at the page's edge: neighbours beyond are taken for backing, which they are
    inside = (slice(4, -4), slice(4, -4))
    rms = [float(np.sqrt((error[inside] ** 2).mean())) for error in (before, after)]
    assert rms[1] < 0.15 * rms[0]
    assert np.abs(after[inside]).max() < 0.002 * white
