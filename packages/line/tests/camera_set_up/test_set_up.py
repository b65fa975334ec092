"""The set-up as a technician walks through it, with a camera of this process; and everything that can be wrong."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.cameras.scenes import SCENE_OF, PlayedCamera, Scenes
from packages.line.tests.ruler.prints import TRUE_LINE_MM, ruler_page, ruler_press, ruler_press_file

from prooflight.commissioning.build import build_press
from prooflight.commissioning.characterise import measured_columns
from prooflight.errors import PressFileError, RequestError, ScanError
from prooflight.press.press_file import PressFile
from prooflight_line.camera_set_up import wizard
from prooflight_line.camera_set_up.line_reader import CameraLineReader
from prooflight_line.camera_set_up.steps import STEPS
from prooflight_line.camera_set_up.wizard import Prompts, Protocol, SetUp, Stopped, protocol_path

if TYPE_CHECKING:
    from pathlib import Path

REFERENCE_US = 2000.0
UNKNOWN = {
    "luminance_cd_m2": 700.0,
    "object_distance_mm": 520.0,
    "conversion_gain_uv_per_e": 8.0,
    "read_noise_e": 15.0,
    "dark_current_e_per_s": 100.0,
    "dsnu_e": 5.0,
    "prnu_percent": 3.0,
    "black_level_dn": 0,
    "speed_mm_s": 280.0,
}
"""What the technician's press file does not know yet."""


@pytest.fixture(scope="module")
def all_scenes() -> Scenes:
    press = ruler_press()
    return Scenes.of(ruler_press_file(), press, {"ruler": ruler_page()}, reference_us=REFERENCE_US)


@pytest.fixture
def scenes(all_scenes: Scenes) -> Scenes:
    return Scenes(
        dict(all_scenes.images),
        all_scenes.base,
        all_scenes.gain,
        all_scenes.read_e,
        all_scenes.top,
        REFERENCE_US,
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    text = ruler_press_file().text
    for name, value in UNKNOWN.items():
        text = re.sub(rf"^{name} = [\d.]+", f"{name} = {value}", text, flags=re.MULTILINE)
    file = tmp_path / "my.toml"
    file.write_text(text)
    return file


class Technician:
    """Lays under the camera what is asked for, and answers; otherwise presses Enter."""

    def __init__(self, scenes: Scenes, answers: dict[str, list[str]] | None = None) -> None:
        self.scenes, self.answers = scenes, answers or {}
        self.asked: list[str] = []
        self.heard: list[str] = []
        self.lays = dict(SCENE_OF)

    def answer(self, key: str, words: str, usual: str) -> str:
        self.asked.append(key)
        if key in self.lays:
            self.scenes.scene, self.scenes.at = self.lays[key], 0
        some = self.answers.get(key, [])
        return some.pop(0) if some else ""

    def prompts(self, *, attended: bool = True) -> Prompts:
        return Prompts(say=lambda text, _kind: self.heard.append(text), answer=self.answer, attended=attended)


def set_up(
    path: Path, camera: PlayedCamera, technician: Technician, *, attended: bool = True, **told: Any
) -> Protocol:
    tap = CameraLineReader(camera, clock=camera.clock)
    protocol = told.pop("protocol", None) or Protocol(camera=tap.name, begun=told.pop("begun", False))
    return SetUp(
        line_reader=tap, path=path, prompts=technician.prompts(attended=attended), protocol=protocol, **told
    ).run()


def states(protocol: Protocol) -> dict[str, str]:
    return {key: one["state"] for key, one in protocol.steps.items()}


def test_a_camera_is_set_up_to_what_it_is(path: Path, scenes: Scenes) -> None:
    """Every number of the press file that was not known, by 4 standard errors; page and press are printed by chance."""
    before = path.read_text()
    camera, technician = PlayedCamera(scenes), Technician(scenes)
    protocol = set_up(path, camera, technician)
    assert states(protocol) == {
        **dict.fromkeys(("camera", "dark", "flat", "focus", "width", "pitch", "paper"), "good"),
        "colour": "not needed",
        "alignment": "not needed",
    }
    assert protocol.finished
    values = {name: one for step in protocol.steps.values() for name, one in step["values"].items()}
    found, true = PressFile.read(path).camera(), ruler_press_file().camera()
    sensor, truth = found.sensors[0], true.sensors[0]
    exposure = PressFile.read(path).camera_settings().exposure_us
    assert exposure is not None
    longer = exposure / REFERENCE_US
    for name, wanted in (
        ("conversion_gain_uv_per_e", truth.conversion_gain_uv_per_e),
        ("read_noise_e", truth.read_noise_e),
        ("dark_current_e_per_s", truth.dark_current_e_per_s * longer),
        ("dsnu_e", truth.dsnu_e),
        ("prnu_percent", truth.prnu_percent),
        ("black_level_dn", truth.black_level_dn),
    ):
        error = values[f"{name}.1"]["standard_error"]
        assert getattr(sensor, name) == pytest.approx(wanted, abs=4 * error), name
    assert found.pixel_pitch_mm == pytest.approx(true.pixel_pitch_mm, rel=1e-4)
    assert found.line_pitch_mm == pytest.approx(TRUE_LINE_MM, rel=1e-4)
    assert found.light.luminance_cd_m2 == pytest.approx(true.light.luminance_cd_m2 * longer, rel=0.01)
    bright = float(np.percentile(scenes.images["flat"][0].mean(axis=0), 99.5))
    assert exposure == pytest.approx(REFERENCE_US * (0.8 * 4095 - 40) / (bright - 40), rel=0.01)
    # Everything that is no measured value stands as it stood.
    after = path.read_text().split("\n")
    names = (*UNKNOWN, "line_rate_hz")
    kept = [line for line in before.split("\n") if not line.startswith(tuple(f"{name} =" for name in names))]
    assert [line for line in after if line in set(kept)][: len(kept)] == kept


def test_every_question_is_kept_with_its_answer(path: Path, scenes: Scenes) -> None:
    technician = Technician(scenes, {"sheet.across": ["110.22/110"], "sheet.along": ["190.19/190"]})
    protocol = set_up(path, PlayedCamera(scenes), technician)
    assert [one["key"] for one in protocol.questions] == technician.asked
    assert technician.asked == [
        *("dark", "dark.keep", "flat", "flat.keep", "focus", "focus.keep"),
        *("width", "sheet.across", "width.keep", "pitch", "sheet.along", "pitch.keep"),
    ]
    found = PressFile.read(path).camera()
    assert found.pixel_pitch_mm == pytest.approx(1.002 * ruler_press_file().camera().pixel_pitch_mm, rel=1e-4)
    assert found.line_pitch_mm == pytest.approx(1.001 * TRUE_LINE_MM, rel=1e-4)
    told = json.loads(protocol_path(path).read_text())
    assert told["finished"]
    assert [one["answer"] for one in told["questions"]].count("110.22/110") == 1
    assert all(one["seconds"] >= 0 for one in told["questions"])


def test_steps_may_be_skipped_and_repeated(path: Path, scenes: Scenes) -> None:
    answers = {"flat": ["s"], "focus": ["s"], "dark.keep": ["r", ""], "width": ["s"], "pitch": ["s"]}
    technician = Technician(scenes, answers)
    before = path.read_text()
    protocol = set_up(path, PlayedCamera(scenes), technician)
    assert states(protocol)["flat"] == states(protocol)["pitch"] == "skipped"
    assert technician.asked.count("dark") == 2
    wanted = re.sub(r"luminance_cd_m2 = .*", "", before)
    # A ruler page passes, so that its paper is seen.
    assert states(protocol)["paper"] == "good"
    assert re.sub(r"luminance_cd_m2 = .*", "", path.read_text()) == wanted


def test_what_was_stopped_goes_on(path: Path, scenes: Scenes) -> None:
    with pytest.raises(Stopped):
        set_up(path, PlayedCamera(scenes), Technician(scenes, {"flat": ["q"]}))
    left = Protocol.of(protocol_path(path), camera="Played-1")
    assert left is not None
    assert states(left) == {"camera": "good", "dark": "good"}
    technician = Technician(scenes)
    protocol = set_up(path, PlayedCamera(scenes), technician, protocol=left)
    assert technician.asked[0] == "flat"  # dark is known from before
    assert states(protocol)["flat"] == "good"
    assert Protocol.of(protocol_path(path), camera="Played-1") is None  # finished: the next one begins anew
    left.finished = False
    left.keep(protocol_path(path))
    with pytest.raises(RequestError, match=r"belongs to camera Played-1, and is unfinished; use --again"):
        Protocol.of(protocol_path(path), camera="Other-2")
    protocol_path(path).write_text("{")
    with pytest.raises(RequestError, match="is not the protocol of a set-up; delete it"):
        Protocol.of(protocol_path(path), camera="Played-1")


def test_what_is_wrong_is_said_and_can_be_mended(path: Path, scenes: Scenes) -> None:
    """The lens is forgotten twice: left open for dark, left covered for light."""
    technician = Technician(scenes)
    technician.lays |= {"dark": "flat", "flat": "dark"}
    laid = technician.answer

    def answer(key: str, words: str, usual: str) -> str:
        said = laid(key, words, usual)
        if technician.asked.count(key) == 2:  # mended at the second asking
            scenes.scene = SCENE_OF.get(key, scenes.scene)
        return said

    technician.answer = answer  # type: ignore[method-assign]
    protocol = set_up(path, PlayedCamera(scenes), technician)
    assert states(protocol)["dark"] == states(protocol)["flat"] == "good"
    (dark,) = (line for line in technician.heard if "is not dark" in line)
    assert re.fullmatch(
        r"Played-1: is not dark: \d+ DN of 4095, \d+ DN of difference along the line; cover the lens",
        dark,
    )
    (light,) = (line for line in technician.heard if "sees no light" in line)
    assert light.endswith("uncover the lens, and switch on the lamp")


def refusal(path: Path, camera: PlayedCamera, technician: Technician) -> str:
    before = path.read_bytes()
    with pytest.raises((ScanError, RequestError)) as refused:
        set_up(path, camera, technician, attended=False)
    after = path.read_bytes()
    if before != after:
        PressFile.read(path)
    return str(refused.value)


def test_another_pixel_format_width_or_depth_is_one_line(path: Path, scenes: Scenes) -> None:
    said = refusal(path, PlayedCamera(scenes, form="Mono10"), Technician(scenes))
    assert said == (
        'Played-1: sends Mono10, 10 bits, but my.toml states sensor.bits = 12; set camera.pixel_format, e.g. "Mono12"'
    )
    said = refusal(path, PlayedCamera(scenes, form="RGB12"), Technician(scenes))
    assert said.startswith("Played-1: sends RGB12, 3 sensors, but my.toml describes 1; ")
    said = refusal(path, PlayedCamera(scenes, Width=1024), Technician(scenes))
    assert said.startswith(
        "Played-1: sends lines of 1024 pixels, but my.toml states sensor.pixels = 1280; set Width = 1280"
    )
    with pytest.raises(ScanError, match=r"^Played-1: sends pixel format Bayer"):
        CameraLineReader(PlayedCamera(scenes, form="BayerRG8"))


def test_a_silent_encoder_is_one_line(path: Path, scenes: Scenes) -> None:
    camera = PlayedCamera(scenes)
    camera.silent = True
    said = refusal(path, camera, Technician(scenes))
    assert re.match(
        r"Played-1: has sent no line for 1\d s; start the paper; check encoder and TriggerSource", said
    )


def test_an_encoder_of_another_pitch_is_one_line(path: Path, scenes: Scenes) -> None:
    """It counts every second of its steps only."""
    scenes.images["ruler"] = scenes.images["ruler"][:, ::2]
    said = refusal(path, PlayedCamera(scenes), Technician(scenes))
    assert re.fullmatch(
        r"Played-1: has a line pitch of 0\.212\d mm, 2\.\d\d times the pitch in my\.toml; set the encoder's divider, or"
        r" transport\.speed_mm_s = 58\d\.\d if this pitch is intended",
        said,
    )


def test_light_that_saturates_is_one_line(path: Path, scenes: Scenes) -> None:
    camera = PlayedCamera(scenes)
    camera.limits["ExposureTime"] = (2e4, 1e5)
    camera.values["ExposureTime"] = 2e4
    said = refusal(path, camera, Technician(scenes))
    assert said == "Played-1: is saturated by this light even at 2e+04 us; dim the light, or close the lens"
    camera = PlayedCamera(scenes)
    camera.limits["ExposureTime"] = (1.0, 400.0)
    camera.values["ExposureTime"] = 100.0
    said = refusal(path, camera, Technician(scenes))
    assert re.match(
        r"Played-1: gets too little light: \d+ DN of 4095 at 400 us, its longest exposure; open the lens",
        said,
    )


def test_a_page_that_is_missing_or_lies_wrong_is_one_line(path: Path, scenes: Scenes) -> None:
    technician = Technician(scenes, {"focus": ["s"]})
    technician.lays["width"] = "flat"
    assert refusal(path, PlayedCamera(scenes), technician).startswith("Played-1: sees no ruler page in ")
    scenes.images["ruler"] = scenes.images["ruler"][:, ::-1, ::-1]
    technician = Technician(scenes, {"focus": ["s"]})
    assert refusal(path, PlayedCamera(scenes), technician).startswith(
        "Played-1: sees the ruler page upside down; "
    )


@pytest.mark.parametrize("said", ["190", "190/0", "a/b", "150/190", "nan/190"])
def test_a_length_that_cannot_be_is_one_line(path: Path, scenes: Scenes, said: str) -> None:
    technician = Technician(scenes, {"dark": ["s"], "flat": ["s"], "focus": ["s"], "sheet.across": [said]})
    assert refusal(path, PlayedCamera(scenes), technician) == (
        f"sheet.across: '{said}' is not a measured and a printed length; give e.g. 190.4/190, or nothing"
    )


def test_a_camera_without_exposure_time_is_measured_at_levels_of_the_lamp(path: Path, scenes: Scenes) -> None:
    camera, technician = (
        PlayedCamera(scenes),
        Technician(scenes, {"focus": ["s"], "width": ["s"], "pitch": ["s"]}),
    )
    del camera.values["ExposureTime"]
    white = scenes.images["flat"]
    laid = technician.answer

    def answer(key: str, words: str, usual: str) -> str:
        said = laid(key, words, usual)
        if key in ("flat", "flat.level"):
            share = 1.1 - 0.1 * (1 + technician.asked.count("flat.level"))
            scenes.images["flat"] = scenes.base[:, None] + share * (white - scenes.base[:, None])
        return "d" if key == "flat.level" and technician.asked.count(key) == 9 else said

    technician.answer = answer  # type: ignore[method-assign]
    protocol = set_up(path, camera, technician, attended=False)
    assert states(protocol)["flat"] == "good"
    assert PressFile.read(path).camera().sensors[0].conversion_gain_uv_per_e == pytest.approx(10, rel=0.01)
    assert any("dark current, separate from the black level" in line for line in technician.heard)


def test_a_press_file_that_was_begun_asks_for_the_data_sheet(tmp_path: Path, scenes: Scenes) -> None:
    path = tmp_path / "new.toml"
    path.write_text(PressFile.prototype().text)
    answers = {"tdi_stages": ["8"], "focus": ["s"], "f_number": ["2.8"]}
    technician = Technician(scenes, answers)
    set_up(path, PlayedCamera(scenes), technician, begun=True)
    assert technician.asked[:4] == ["focal_length_mm", "f_number", "pixel_pitch_um", "tdi_stages"]
    found = PressFile.read(path)
    (sensor,) = found.camera().sensors
    assert (sensor.pixels, sensor.tdi_stages, sensor.bits) == (1280, 8, 12)
    assert found.camera_settings().pixel_format == "Mono12"
    assert found.camera().line_pitch_mm == pytest.approx(TRUE_LINE_MM, rel=1e-4)
    assert "tdi_stages = 8                     # stated: data sheet" in found.text
    technician = Technician(scenes, {"tdi_stages": ["many"]})
    path.write_text(PressFile.prototype().text)
    with pytest.raises(RequestError, match=r"^tdi_stages: 'many' is not a number that fits; give e\.g\. 96$"):
        set_up(path, PlayedCamera(scenes), technician, begun=True, attended=False)


def test_answers_of_a_file_are_known_questions() -> None:
    answer = wizard.answers_of(
        {"focus": "s", "flat.level": ["", "d"]}, ("focus", "flat.level"), where="a.toml"
    )
    assert [answer("focus"), answer("flat.level"), answer("flat.level"), answer("dark")] == ["s", "", "d", ""]
    with pytest.raises(RequestError, match=r"^a\.toml: 'fokus' is not a question; use focus, flat\.level$"):
        wizard.answers_of({"fokus": "s"}, ("focus", "flat.level"), where="a.toml")
    with pytest.raises(RequestError, match=r"^a\.toml: focus has a value that is not an answer; "):
        wizard.answers_of({"focus": {"a": 1}}, ("focus",), where="a.toml")


def test_lines_that_came_while_nobody_read_are_let_go(scenes: Scenes) -> None:
    """A backend holds what it received; what was under the camera then is no answer now."""
    camera = PlayedCamera(scenes)
    scenes.scene = "dark"
    waiting = [camera.grab(0.1) for _ in range(100)]
    plain = camera.grab
    camera.grab = lambda timeout_s: waiting.pop(0) if waiting else plain(timeout_s)  # type: ignore[method-assign]
    tap = CameraLineReader(camera, clock=camera.clock)
    scenes.scene = "flat"
    lines = tap.lines(128)
    assert lines.shape == (1, 128, 1280)
    assert lines[:, :, 100:-100].min() > 1500
    assert not waiting


def test_lines_are_on_end_or_begin_anew(scenes: Scenes) -> None:
    camera = PlayedCamera(scenes)
    tap = CameraLineReader(camera, clock=camera.clock)
    plain, count = camera.grab, [0]

    def lossy(timeout_s: float) -> Any:
        count[0] += timeout_s > 0
        if count[0] == 5:
            plain(timeout_s)  # a block is lost
        return plain(timeout_s)

    camera.grab = lossy  # type: ignore[method-assign]
    scenes.scene, scenes.images["count"] = "count", np.arange(4096.0)[None, :, None] * np.ones((1, 1, 1280))
    scenes.scene, scenes.base = "count", np.zeros_like(scenes.base)
    scenes.gain, scenes.read_e = np.array([1e-9]), np.array([0.0])
    found = tap.lines(256)[0, :, 0].astype(int)
    np.testing.assert_array_equal(np.diff(found), 1)
    assert tap.health().lines_lost == 64
    assert tap.rate_hz() == pytest.approx(2770, rel=0.2)


def test_a_press_is_built_with_the_columns_that_were_measured(path: Path, scenes: Scenes) -> None:
    """0.1 % of gain and 0.1 DN of offset: 2,560 lines with 1 % of noise, and what the rest of the line adds.

    The specimen is another than the one that `build_press` would draw. White paper ends a pixel before the line does.
    """
    set_up(path, PlayedCamera(scenes), Technician(scenes), steps=STEPS[:3])
    press_file = PressFile.read(path)
    columns = measured_columns(protocol_path(path), press_file.camera())
    (model,) = build_press(press_file, seed=1, columns=columns).sensors
    (true,) = ruler_press().sensors
    inside = slice(8, -8)
    ratio = model.column_gain[inside] / true.column_gain[inside]
    assert np.std(ratio / ratio.mean()) < 1e-3
    assert ratio.mean() == pytest.approx(1, abs=3e-3)
    off = model.column_offset_dn - true.column_offset_dn
    assert np.std(off) < 0.1
    wrong = replace(columns[0], gain=columns[0].gain[:-1])
    with pytest.raises(
        PressFileError, match=r"describes sensors of \[1280\] pixels, columns were measured of \[1279\]"
    ):
        build_press(press_file, seed=1, columns=[wrong])
    told = json.loads(protocol_path(path).read_text())
    for columns_told in ([], [{"offset_dn": [1.0, 2.0], "gain": [1.0, 0.0]}], [{"gain": [1.0]}]):
        protocol_path(path).write_text(json.dumps(told | {"columns": columns_told}))
        with pytest.raises(RequestError, match=r"holds no columns|is no protocol"):
            measured_columns(protocol_path(path), press_file.camera())


def test_a_set_up_that_goes_on_looks_at_the_camera_again(path: Path, scenes: Scenes) -> None:
    with pytest.raises(Stopped):
        set_up(path, PlayedCamera(scenes), Technician(scenes, {"flat": ["q"]}))
    left = Protocol.of(protocol_path(path), camera="Played-1")
    assert left is not None
    with pytest.raises(ScanError, match="sends Mono10, 10 bits"):
        set_up(path, PlayedCamera(scenes, form="Mono10"), Technician(scenes), protocol=left, attended=False)
