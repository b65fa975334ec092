"""The press files that come with the package read, build, and are what they say."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from prooflight.commissioning.build import build_press
from prooflight.press.press_file import LINE_CAMERA_PRESETS, PressFile, line_camera_press_text
from prooflight.press.scanner import field_mm, press_dpi, scanner_press_file
from prooflight.scans.scanner.feeder import FeederPrior
from prooflight.spectra import WAVE_NM

SENSORS = {"prototype": 1, "two-sensors": 2, "rgb-line": 3, "scanner": 3}


def preset(name: str) -> PressFile:
    text = resources.files("prooflight.press").joinpath("presets", f"{name}.toml").read_text(encoding="utf-8")
    return PressFile(Path(f"{name}.toml"), text)


@pytest.mark.parametrize("name", SENSORS)
def test_every_preset_builds_and_paper_fills_much_of_the_swing(name: str) -> None:
    press = build_press(preset(name), seed=1, pixels=16)
    assert len(press.sensors) == len(press.clipped) == SENSORS[name]
    fill = [sensor.white_dn / sensor.top_code_dn for sensor in press.sensors]
    assert 0.6 < max(fill) < 0.75
    assert min(fill) > 0.25
    # black of all four inks stays clear of 0 DN on all but a few nodes in a thousand
    if name != "scanner":  # its rounding to eight bits is wider than the light of black
        assert max(share.black for share in press.clipped) < 0.01
    assert max(share.saturation for share in press.clipped) == 0.0


@pytest.mark.parametrize("name", LINE_CAMERA_PRESETS)
def test_a_file_for_an_actual_press_states_either_world_and_is_the_preset_otherwise(name: str) -> None:
    written = PressFile(Path("my.toml"), line_camera_press_text(name))
    assert written.variation() == {"world": "either"}
    assert preset(name).variation() == {}
    assert written.text.startswith(preset(name).text)


def test_quantum_efficiencies_of_the_two_sensors_sum_to_a_flat_half() -> None:
    first, second = preset("two-sensors").camera().sensors
    visible = (WAVE_NM >= 400) & (WAVE_NM <= 700)
    both = (first.quantum_efficiency + second.quantum_efficiency)[visible]
    np.testing.assert_allclose(both, 0.5, atol=1e-12)


def test_the_first_of_two_sensors_is_the_prototypes_and_both_have_its_noise() -> None:
    (alone,) = preset("prototype").camera().sensors
    first, second = preset("two-sensors").camera().sensors
    np.testing.assert_array_equal(first.quantum_efficiency, alone.quantum_efficiency)
    for field in (
        "read_noise_e",
        "dark_current_e_per_s",
        "dsnu_e",
        "prnu_percent",
        "conversion_gain_uv_per_e",
    ):
        assert getattr(first, field) == getattr(second, field) == getattr(alone, field)


def test_filters_of_the_colour_line_peak_in_their_colours() -> None:
    sensors = preset("rgb-line").camera().sensors
    peaks = {sensor.name: float(WAVE_NM[sensor.quantum_efficiency.argmax()]) for sensor in sensors}
    assert peaks["blue"] < 490 < peaks["green"] < 580 < 600 < peaks["red"]
    together = np.max([sensor.quantum_efficiency for sensor in sensors], axis=0)
    assert together[(WAVE_NM >= 420) & (WAVE_NM <= 680)].min() > 0.02  # no gap in the visible


def test_a_scanner_has_the_resolution_and_the_channels_of_its_scans() -> None:
    grey = scanner_press_file(dpi=press_dpi(600), grey=True, width_mm=field_mm([(297, 210), (100, 100)]))
    camera = grey.camera()
    geometry = grey.geometry(camera)
    assert [sensor.name for sensor in camera.sensors] == ["green"]
    assert geometry.pixel_pitch_mm == pytest.approx(25.4 / 150, rel=1e-4)
    assert 216 <= geometry.field_mm < 216.2
    assert geometry.lead_in_mm == geometry.lead_out_mm == 0
    assert grey.feeder == FeederPrior(shift_mm=2.7, skew_deg=0.3, stretch_percent=0.8)
    assert preset("prototype").feeder is None
    back = "[geometry.back]\nshift_mm = 3.1\nskew_deg = 0.4\nstretch_percent = 1.0\n\n[variation.page]"
    duplex = PressFile(Path("duplex.toml"), grey.text.replace("[variation.page]", back)).feeder
    assert duplex is not None
    assert duplex.back == FeederPrior(shift_mm=3.1, skew_deg=0.4, stretch_percent=1.0)
    assert replace(duplex, back=None) == grey.feeder
    colour = scanner_press_file(dpi=press_dpi(200), grey=False, width_mm=field_mm([(297, 420)]))
    assert len(colour.camera().sensors) == 3
    assert colour.geometry(colour.camera()).field_mm == pytest.approx(304, abs=0.2)
    fill = build_press(grey, seed=1, pixels=16).sensors[0]
    assert 0.5 < fill.white_dn / fill.top_code_dn < 0.75


def test_a_press_knows_at_what_resolution_it_rips() -> None:
    told = PressFile(Path("told.toml"), preset("prototype").text + "\n[rip]\ndpi = 600\n")
    assert build_press(told, seed=1, pixels=16).rip_dpi == 600
    assert build_press(preset("prototype"), seed=1, pixels=16).rip_dpi is None
