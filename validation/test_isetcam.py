"""Against ISETCam's own numbers; tolerances as shared/oracle/README.md gives them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.camera.camera import respond
from prooflight.camera.optics import diffraction_mtf
from prooflight.camera.sensor import clipped_gaussian
from prooflight.pages.sampling import taps

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.camera.camera import Camera, SensorResponse

    Oracle = Callable[[str], dict[str, Any]]
    MakeCamera = Callable[[float], Camera]

PATCH_CASES, NOISE_CASES = 18, 14
STANDARD_ERRORS = 4
DIFFRACTION_LOSS = 3e-4


def patches(oracle: Oracle, make: MakeCamera) -> list[tuple[dict[str, Any], Camera, SensorResponse]]:
    cases = oracle("patches")["cases"]
    assert len(cases) == PATCH_CASES
    cameras = [make(case["distance_m"]) for case in cases]
    answers = [
        respond(camera, np.array(case["reflectance"])) for case, camera in zip(cases, cameras, strict=True)
    ]
    return [(case, camera, answer) for case, camera, (answer,) in zip(cases, cameras, answers, strict=True)]


def test_photons_of_the_light(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    light = isetcam_camera(0.5466).light
    patches = oracle("patches")
    np.testing.assert_allclose(light.radiance_w, patches["illuminant_energy"], rtol=1e-6)
    np.testing.assert_allclose(light.radiance_photons, patches["illuminant_photons"], rtol=1e-6)


def test_the_response_to_patches(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    for case, camera, answer in patches(oracle, isetcam_camera):
        assert camera.lens.image_distance_mm == pytest.approx(case["image_distance_m"] * 1e3, rel=1e-9)
        assert camera.lens.magnification == pytest.approx(-case["magnification"], rel=1e-9)
        np.testing.assert_allclose(answer.irradiance_photons, case["irradiance_photons_preOTF"], rtol=1e-6)
        assert answer.illuminance_lux == pytest.approx(case["illuminance"], rel=DIFFRACTION_LOSS)
        assert answer.electrons == pytest.approx(case["electrons_mean"], rel=DIFFRACTION_LOSS)
        assert answer.volts == pytest.approx(case["volts_mean"], rel=DIFFRACTION_LOSS)


def test_mtf(oracle: Oracle) -> None:
    table = oracle("mtf")
    got = diffraction_mtf(
        np.array(table["freq"]),
        wave_nm=np.array(table["wavelength"])[:, None],
        f_number=table["fNumber"],
    )
    np.testing.assert_allclose(got, table["mtf"], atol=1e-9)


def test_cos4(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    (case,) = oracle("cos4")["cases"]
    lens = isetcam_camera(case["distance_m"]).lens
    at_f_mm = np.hypot(np.array(case["x_mm"]), case["y_mm"])
    at_image_mm = at_f_mm * lens.image_distance_mm / case["image_distance_used_mm"]
    np.testing.assert_allclose(lens.relative_illumination(at_image_mm), case["ratio"], rtol=1e-12)


def test_volts_to_digital_numbers(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    table = oracle("quantization")
    sensor = replace(isetcam_camera(0.5466).sensors[0], voltage_swing_v=float(table["voltageSwing"]))
    assert len(table["bits"]) == 4
    for bits, dn in zip(table["bits"], table["dn"], strict=True):
        converter = replace(sensor, bits=bits)
        # ISETCam's top code is 2^bits, which no converter of so many bits has.
        np.testing.assert_array_equal(
            converter.quantise(np.array(table["volts"])), np.minimum(dn, 2**bits - 1), err_msg=f"{bits} bits"
        )
        chain = table["chain"]
        got = converter.quantise(np.array([link["volts"] for link in chain]))
        np.testing.assert_array_equal(got, np.minimum([link[f"dn{bits}"] for link in chain], 2**bits - 1))


def noisy(oracle: Oracle, make: MakeCamera, number: int) -> tuple[dict[str, Any], Any, float, float]:
    """A noise case, its sensor, mean photo-electrons, and conversion gain [V/e-]."""
    case = oracle("noise")["cases"][number]
    config = case["config"]
    sensor = make(0.5466).sensors[0]
    gain = sensor.conversion_gain_uv_per_e * 1e-6
    sensor = replace(
        sensor,
        read_noise_e=config["read"] / gain,
        dark_current_e_per_s=config["dark"] / gain,
        dsnu_e=config["dsnu"] / gain,
        prnu_percent=config["prnu"],
        voltage_swing_v=float(config["swing"]),
    )
    assert config["flag"] == 2  # ISET: all of shot, read, dark, DSNU and PRNU, as far as they are above 0
    return case, sensor, case["noise_free_volts"] / gain, gain


def test_mean_and_total_noise(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    assert len(oracle("noise")["cases"]) == NOISE_CASES
    compared = 0
    for number in range(NOISE_CASES):
        case, sensor, electrons, gain = noisy(oracle, isetcam_camera, number)
        total_e2 = sensor.variance_total_e2(np.array(electrons))
        mean_v, variance_v2 = clipped_gaussian(
            np.array((electrons + sensor.dark_e) * gain),
            np.sqrt(total_e2) * gain,
            low=0.0,
            high=sensor.voltage_swing_v,
        )
        if case["frac_saturated"] == 1:
            assert mean_v == pytest.approx(case["mean_volts"], abs=1e-9)
            assert variance_v2 == pytest.approx(0, abs=1e-12)
            continue
        assert mean_v == pytest.approx(case["mean_volts"], abs=STANDARD_ERRORS * case["se_mean"])
        assert np.sqrt(variance_v2) == pytest.approx(case["std_volts"], abs=STANDARD_ERRORS * case["se_std"])
        if case["frac_saturated"] > 0 or case["frac_zero"] > 0.01:
            continue  # clipped before rounding: rounding's error is not uniform there
        mean, sigma = sensor.dn_moments(np.array(electrons), total_e2)
        error = case["dn12_std"] / np.sqrt(case["n"])
        assert mean == pytest.approx(case["dn12_mean"], abs=STANDARD_ERRORS * error)
        assert sigma == pytest.approx(case["dn12_std"], abs=STANDARD_ERRORS * error / np.sqrt(2))
        compared += 1
    assert compared == 9


def test_edge_profile_through_a_square_aperture(oracle: Oracle, isetcam_camera: MakeCamera) -> None:
    edges = oracle("edges")
    (scene,) = edges["scenes"]
    camera = isetcam_camera(edges["distance_m"])
    on_page = 1 / camera.lens.magnification
    light = np.array(scene["preOTF_electrons_equiv"], np.float32)
    sample_mm = scene["sample_pitch_um"] * 1e-3 * on_page
    centres_mm = np.array(scene["pixel_x_um"]) * 1e-3 * on_page + light.size / 2 * sample_mm
    footprint = camera.footprint(camera.sensors[0])
    seen = taps(
        footprint.across,
        reach_mm=footprint.reach_mm,
        centres_mm=centres_mm,
        raster_pixel_mm=sample_mm,
        raster_pixels=light.size,
    ).apply(light[:, None])[:, 0]
    step = light.max() - light.min()
    assert np.abs(np.diff(seen)).max() > 0.3 * step  # the edge lies within the profile
    np.testing.assert_allclose(seen, scene["pixel_electrons_box"], atol=0.005 * step)
