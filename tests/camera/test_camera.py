from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight import spectra
from prooflight.camera.camera import Camera, expose_flat, respond, with_pixels
from prooflight.camera.sensor import FixedPattern, LineSensor, Noise

if TYPE_CHECKING:
    from prooflight.pages.sampling import Footprint
    from prooflight.press.press_file import PressFile

WHITE = np.ones(36)
OTHER_LINES: dict[str, dict[str, Any]] = {
    "pixels": {"pixels": 121},
    "pixel_pitch_um": {"pixel_pitch_um": 12.0},
    "line_rate_hz": {"line_rate_hz": 3000.0},
}


@pytest.fixture
def camera(prototype: PressFile) -> Camera:
    return with_pixels(prototype.camera(), 120)


def at_speed(camera: Camera, ratio: float, *, binning: int = 1) -> Camera:
    """The camera with the page moving at ``ratio`` times the speed that is in step with the sensor."""
    in_step_mm_s = camera.pixel_pitch_mm * camera.sensors[0].line_rate_hz
    return replace(camera, speed_mm_s=ratio * in_step_mm_s, binning_along=binning)


def even(sensor: LineSensor) -> FixedPattern:
    return FixedPattern(gain=np.ones(sensor.pixels), offset_e=np.zeros(sensor.pixels))


def transfer(
    footprint: Footprint, cumulative: np.ndarray, camera: Camera, frequency: np.ndarray
) -> np.ndarray:
    """MTF of a footprint at frequencies in cycles per camera pixel."""
    edges = np.linspace(-footprint.reach_mm, footprint.reach_mm, cumulative.size) / camera.pixel_pitch_mm
    middle, step = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    waves = np.exp(-2j * np.pi * frequency[:, None] * middle)
    return np.abs(waves @ np.diff(cumulative)) * np.sinc(frequency * step)


def lens_transfer(camera: Camera, frequency: np.ndarray) -> np.ndarray:
    weight = camera.light.radiance_photons * camera.sensors[0].quantum_efficiency
    per_mm = frequency[:, None] / (camera.sensors[0].pixel_pitch_um * 1e-3)
    return np.asarray(camera.lens.mtf(per_mm, wave_nm=spectra.WAVE_NM) @ weight / weight.sum())


# --- geometry ---


def test_the_prototype_lays_2048_pixels_on_an_a4_page(prototype: PressFile) -> None:
    camera = prototype.camera()
    assert camera.pixel_pitch_mm == pytest.approx(0.013 * (546.6 - 60) / 60)
    assert camera.field_mm == pytest.approx(216, abs=0.2)
    assert camera.field_mm > 210
    assert camera.line_pitch_mm == camera.pixel_pitch_mm


def test_speed_and_binning_set_the_line_pitch(camera: Camera) -> None:
    assert replace(camera, speed_mm_s=277.0).line_pitch_mm == pytest.approx(0.1)
    assert replace(camera, speed_mm_s=277.0, binning_along=3).line_pitch_mm == pytest.approx(0.3)
    assert at_speed(camera, 1.0).line_travel_mm == pytest.approx(camera.line_travel_mm, rel=1e-12)


def test_a_camera_needs_sensors_that_see_the_same_line(camera: Camera) -> None:
    with pytest.raises(ValueError, match="at least one sensor"):
        replace(camera, sensors=())
    first = camera.sensors[0]
    for field, changes in OTHER_LINES.items():
        other = replace(first, name="other", **changes)
        with pytest.raises(ValueError, match=f"sensors must share {field}: mono and other differ"):
            replace(camera, sensors=(first, other))
    assert replace(camera, sensors=(first, replace(first, bits=8)))


def test_with_pixels_changes_nothing_else(prototype: PressFile) -> None:
    camera = prototype.camera()
    longer = with_pixels(camera, 3000)
    assert longer.sensors[0].pixels == 3000
    assert longer.pixel_pitch_mm == camera.pixel_pitch_mm
    assert longer.sensors[0].read_noise_e == camera.sensors[0].read_noise_e
    assert camera.sensors[0].pixels == 2048


def test_columns_dim_symmetrically_by_cos4(prototype: PressFile) -> None:
    camera = prototype.camera()
    light = camera.column_light()
    np.testing.assert_allclose(light, light[::-1], rtol=1e-12)
    assert light.argmax() in (1023, 1024)
    assert light.max() == pytest.approx(1, abs=1e-7)
    height = (2047.5 - 1023.5 - 0.5) * 0.013
    assert light[-1] == pytest.approx(
        np.cos(np.arctan(height / camera.lens.image_distance_mm)) ** 4, rel=1e-12
    )


# --- response ---


def test_illuminance_is_luminance_times_the_lenss_geometry(camera: Camera) -> None:
    # E_v = pi T L / (1 + 4 N_w^2) holds band by band, so it holds for lux
    (answer,) = respond(camera, 0.3 * WHITE)
    assert answer.illuminance_lux == pytest.approx(0.3 * 100 * camera.lens.irradiance_per_radiance, rel=1e-12)


def test_response_is_linear_in_reflectance(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    a, b = rng.random((2, 36)) * 0.4
    (of_a,), (of_b,), (of_both,) = (respond(camera, r) for r in (a, b, 2 * a + 0.5 * b))
    for quantity in ("irradiance_photons", "illuminance_lux", "electrons", "volts"):
        want = 2 * getattr(of_a, quantity) + 0.5 * getattr(of_b, quantity)
        np.testing.assert_allclose(getattr(of_both, quantity), want, rtol=1e-12)


def test_response_keeps_the_shape_of_the_colours(camera: Camera) -> None:
    reflectance = np.random.default_rng(1).random((2, 3, 36)) * 0.8
    (answer,) = respond(camera, reflectance)
    assert answer.irradiance_photons.shape == (2, 3, 36)
    for quantity in (
        "illuminance_lux",
        "electrons",
        "volts",
        "dn_mean",
        "dn_sigma_temporal",
        "dn_sigma_total",
    ):
        assert getattr(answer, quantity).shape == (2, 3)
    (alone,) = respond(camera, reflectance[1, 2])
    assert alone.dn_mean == pytest.approx(answer.dn_mean[1, 2], rel=1e-12)


def test_digital_numbers_of_the_response(camera: Camera) -> None:
    sensor = replace(camera.sensors[0], black_level_dn=100, dark_current_e_per_s=3000.0)
    (answer,) = respond(replace(camera, sensors=(sensor,)), 0.5 * WHITE)
    assert answer.volts == pytest.approx(answer.electrons * 10e-6, rel=1e-12)
    want = (answer.electrons + 3000 * 96 / 2770) * 4096 / 200_000 + 100
    assert answer.dn_mean == pytest.approx(want, rel=1e-12)


def test_in_the_shot_noise_limit_sigma_is_the_root_of_the_electrons(camera: Camera) -> None:
    sensor = replace(camera.sensors[0], read_noise_e=0, dark_current_e_per_s=0, dsnu_e=0, prnu_percent=0)
    (answer,) = respond(replace(camera, sensors=(sensor,)), np.array([0.1, 0.4, 0.8])[:, None] * WHITE)
    want = np.sqrt(answer.electrons * sensor.dn_per_e**2 + 1 / 12)
    np.testing.assert_allclose(answer.dn_sigma_temporal, want, rtol=1e-9)
    np.testing.assert_allclose(answer.dn_sigma_total, want, rtol=1e-9)


def test_prnu_dominates_the_total_at_white_and_only_there(camera: Camera) -> None:
    (answer,) = respond(camera, np.array([0.8, 0.0])[:, None] * WHITE)
    signal = answer.dn_mean[0]
    extra = np.sqrt(answer.dn_sigma_total[0] ** 2 - answer.dn_sigma_temporal[0] ** 2)
    assert extra == pytest.approx(0.01 * signal, rel=0.01)  # DSNU and p^2 of shot noise add less than 1 %
    assert answer.dn_sigma_total[1] < 1.0


def test_saturated_white_reads_the_top_code(prototype: PressFile) -> None:
    camera = prototype.camera()
    bright = replace(camera, light=replace(camera.light, luminance_cd_m2=400.0))
    (answer,) = respond(bright, WHITE)
    assert answer.dn_mean == pytest.approx(4095)
    assert answer.volts > 2.0  # what the light would give: volts are before clipping


# --- footprint ---


@pytest.mark.parametrize("ratio", [1.0, 1.01, 0.97])
def test_a_footprint_is_a_symmetric_distribution(camera: Camera, ratio: float) -> None:
    footprint = at_speed(camera, ratio).footprint(camera.sensors[0])
    for cumulative in (footprint.across, footprint.along):
        assert cumulative[0] == 0
        assert cumulative[-1] == pytest.approx(1, abs=1e-12)
        assert (np.diff(cumulative) >= 0).all()
        np.testing.assert_allclose(cumulative + cumulative[::-1], 1, atol=1e-9)


def test_the_mtf_of_a_footprint_is_lens_times_aperture_times_motion(camera: Camera) -> None:
    # far-reaching, so that only a thousandth of the light is cut off
    footprint = camera.footprint(camera.sensors[0], reach_pixels=32)
    frequency = np.linspace(0, 1.6, 30)  # cycles per pixel
    lens = lens_transfer(camera, frequency)
    aperture = np.abs(np.sinc(frequency))
    across = transfer(footprint, footprint.across, camera, frequency)
    along = transfer(footprint, footprint.along, camera, frequency)
    np.testing.assert_allclose(across, lens * aperture, atol=2e-3)
    np.testing.assert_allclose(along, lens * aperture**2, atol=2e-3)


def test_the_default_reach_changes_the_mtf_by_less_than_a_hundredth(camera: Camera) -> None:
    footprint = camera.footprint(camera.sensors[0])
    frequency = np.linspace(0, 1.6, 30)
    want = lens_transfer(camera, frequency) * np.abs(np.sinc(frequency))
    np.testing.assert_allclose(transfer(footprint, footprint.across, camera, frequency), want, atol=0.01)


@pytest.mark.parametrize("ratio", [0.99, 1.002, 1.02])
def test_a_speed_mismatch_smears_along_the_travel_only(camera: Camera, ratio: float) -> None:
    off = at_speed(camera, ratio)
    footprint = off.footprint(camera.sensors[0], reach_pixels=32)
    frequency = np.linspace(0, 0.9, 20)
    across = transfer(footprint, footprint.across, camera, frequency)
    along = transfer(footprint, footprint.along, camera, frequency)
    lens = lens_transfer(camera, frequency)
    np.testing.assert_allclose(across, lens * np.sinc(frequency), atol=2e-3)
    smear = 96 * abs(ratio - 1)  # pixels: stages x |ratio - 1|
    want = np.abs(lens * np.sinc(frequency) * np.sinc(ratio * frequency) * np.sinc(smear * frequency))
    np.testing.assert_allclose(along, want, atol=2e-3)


@pytest.mark.parametrize("binning", [2, 3])
def test_binned_lines_see_one_box_as_long_as_all_of_them(camera: Camera, binning: int) -> None:
    # the sum of neighbouring boxes is one longer box
    footprint = at_speed(camera, 1.0, binning=binning).footprint(camera.sensors[0], reach_pixels=32)
    frequency = np.linspace(0, 0.9, 20)
    want = np.abs(lens_transfer(camera, frequency) * np.sinc(frequency) * np.sinc(binning * frequency))
    got = transfer(footprint, footprint.along, camera, frequency)
    np.testing.assert_allclose(got, want, atol=2e-3)


def test_a_footprint_reaches_as_far_as_the_motion_asks(camera: Camera) -> None:
    sensor = camera.sensors[0]
    pitch = camera.pixel_pitch_mm
    assert camera.footprint(sensor).reach_mm == pytest.approx(4 * pitch)
    assert camera.footprint(sensor, reach_pixels=2.5).reach_mm == pytest.approx(2.5 * pitch)
    assert at_speed(camera, 1.02).footprint(sensor).reach_mm > 5.9 * pitch  # 1.92 pixels of smear


# --- exposure ---


def test_a_flat_exposure_is_the_response_times_cos4(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    patterns = [even(sensor) for sensor in camera.sensors]
    scan = expose_flat(camera, 0.6 * WHITE, lines=3, patterns=patterns, rng=rng, noise=Noise.NONE)
    assert scan.shape == (1, 3, 120)
    sensor = camera.sensors[0]
    (answer,) = respond(camera, 0.6 * WHITE)
    want = (answer.electrons * camera.column_light() + sensor.dark_e) * sensor.dn_per_e
    np.testing.assert_allclose(scan[0], np.broadcast_to(want, (3, 120)), atol=0.5 + 1e-6)
