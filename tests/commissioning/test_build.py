from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import respond, with_pixels
from prooflight.camera.sensor import draw_fixed_pattern
from prooflight.commissioning.build import build_press
from prooflight.errors import PressFileError
from prooflight.inks.built_in import built_in_inks
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.press.artefact import Press


def with_value(press_file: PressFile, old: str, new: str) -> PressFile:
    assert press_file.text.count(old) == 1
    return PressFile(Path("changed.toml"), press_file.text.replace(old, new))


def test_same_seed_same_press_to_the_bit(prototype: PressFile) -> None:
    first, again, other = (build_press(prototype, seed=seed, pixels=32) for seed in (3, 3, 4))
    assert first.digest == again.digest
    assert first.digest != other.digest
    assert first.origin["seed"] == "3"
    assert first.origin["press_file"] == prototype.text


def test_a_press_carries_the_cameras_geometry(press: Press, prototype: PressFile) -> None:
    camera = prototype.camera()
    assert press.geometry.pixels == 400
    assert press.geometry.pixel_pitch_mm == camera.pixel_pitch_mm
    assert press.geometry.line_pitch_mm == camera.line_pitch_mm
    assert press.dpi == pytest.approx(25.4 * press.supersampling / camera.pixel_pitch_mm)
    assert press.name == "prototype"


def test_pixels_are_the_files_unless_others_are_asked_for(prototype: PressFile) -> None:
    short = with_value(prototype, "pixels = 2048", "pixels = 48")
    press = build_press(short, seed=1)
    assert press.geometry.pixels == 48
    assert press.sensors[0].column_gain.shape == (48,)


def test_columns_are_those_of_the_drawn_specimen(press: Press, prototype: PressFile) -> None:
    camera = with_pixels(prototype.camera(), 400)
    pattern = draw_fixed_pattern(camera.sensors[0], np.random.default_rng(1))
    want = camera.column_light() * pattern.gain
    got = press.sensors[0].column_gain
    # the specimen's columns differ by 1 %; calibration knows each to 5e-5, and to 6e-4 where dark was clipped
    assert np.abs(got / want - 1).max() < 1.5e-3
    assert np.corrcoef(got, want)[0, 1] > 0.99


def test_white_and_backing_are_what_the_camera_answers(
    two_sensor_press: Press, two_sensor_file: PressFile
) -> None:
    camera = two_sensor_file.camera()
    paper = respond(camera, two_sensor_file.inks().reflectance(np.zeros(4)))
    backing = respond(camera, np.full(36, two_sensor_file.backing_reflectance))
    for index, sensor in enumerate(two_sensor_press.sensors):
        per_e = camera.sensors[index].dn_per_e
        assert sensor.name == camera.sensors[index].name
        assert sensor.white_dn == pytest.approx(paper[index].electrons * per_e, rel=1e-6)
        assert sensor.backing_dn == pytest.approx(backing[index].electrons * per_e, rel=1e-6)
        assert np.sqrt(sensor.backing_variance_dn2) == pytest.approx(
            backing[index].dn_sigma_temporal, rel=1e-3
        )
        assert sensor.top_code_dn == 2 ** camera.sensors[index].bits - 1
        assert sensor.backing_dn < 0.1 * sensor.white_dn


@pytest.mark.parametrize("luminance", [150.0, 400.0])
def test_a_press_whose_paper_saturates_the_sensor_is_refused(prototype: PressFile, luminance: float) -> None:
    bright = with_value(prototype, "luminance_cd_m2 = 100.0", f"luminance_cd_m2 = {luminance}")
    with pytest.raises(PressFileError) as refusal:
        build_press(bright, seed=1, pixels=64)
    text = str(refusal.value)
    assert text.startswith("changed.toml: sensor mono: ")
    assert "4095" in text
    assert "luminance_cd_m2" in text
    assert "\n" not in text


class OnDarkerPaper(PressFile):
    """A press file whose inks lie on paper darker than the white tile."""

    def inks(self, progress: object = None) -> ReflectanceModel:
        inks = built_in_inks()
        return replace(inks, paper=0.85 * inks.paper)


def test_a_white_tile_that_saturates_is_refused_whatever_the_paper(prototype: PressFile) -> None:
    text = prototype.text.replace("luminance_cd_m2 = 100.0", "luminance_cd_m2 = 160.0")
    with pytest.raises(PressFileError):
        build_press(OnDarkerPaper(Path("changed.toml"), text), seed=1, pixels=64)


def test_steps_are_told_as_they_begin(prototype: PressFile) -> None:
    steps: list[str] = []
    build_press(prototype, seed=1, pixels=16, progress=steps.append)
    assert len(steps) >= 2
    assert len(set(steps)) == len(steps)
