"""The press files that come with the package read, build, and are what they say."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from prooflight.commissioning.build import build_press
from prooflight.press.press_file import PressFile
from prooflight.spectra import WAVE_NM

SENSORS = {"prototype": 1, "two-sensors": 2, "rgb-line": 3}


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
    assert max(share.black for share in press.clipped) < 0.01
    assert max(share.saturation for share in press.clipped) == 0.0


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


def test_a_press_knows_at_what_resolution_it_rips() -> None:
    told = PressFile(Path("told.toml"), preset("prototype").text + "\n[rip]\ndpi = 600\n")
    assert build_press(told, seed=1, pixels=16).rip_dpi == 600
    assert build_press(preset("prototype"), seed=1, pixels=16).rip_dpi is None
