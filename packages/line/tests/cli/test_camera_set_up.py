"""A camera on loopback is looked at and set up, as a technician does it: typed, said, written."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.cameras.peers import ID
from packages.line.tests.cameras.scene_cameras import scene_camera
from packages.line.tests.cameras.scenes import Scenes
from packages.line.tests.ruler.prints import TRUE_LINE_MM, ruler_page, ruler_press, ruler_press_file
from PIL import Image

from prooflight.cli import run
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from pathlib import Path

SETTINGS = """
# the line camera, as Maria wants it
[camera]
pixel_format = "Mono12"   # what bits says
block_lines = 64
trigger = "free"
line_rate_hz = 2770.0
exposure_us = 2000.0
features = { Width = 1280 }
"""


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    pages = {"ruler": ruler_page()}
    return Scenes.of(ruler_press_file(), ruler_press(), pages, reference_us=2000.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "my.toml"
    file.write_text(ruler_press_file().text + SETTINGS)
    return file


def typed(path: Path, *more: str, lines: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "prooflight", "camera", "set-up", ID, str(path), *more],
        input=lines,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={"COLUMNS": "120", **_environment()},
    )


def _environment() -> dict[str, str]:
    import os

    return {**os.environ, "NO_COLOR": "1"}


def test_a_technician_types_stops_and_goes_on(path: Path, scenes: Scenes) -> None:
    before = path.read_text()
    with scene_camera(scenes, path.with_name("my.set-up.json")):
        stopped = typed(path, lines="\n\nq\n")  # dark, keep, stop before the light
        assert stopped.returncode == 0, stopped.stderr
        assert "stopped; the same command continues from here" in stopped.stdout
        assert "> Cover the lens. Enter: measure, s: skip, q: stop" in stopped.stderr
        done = typed(path, "--json", lines="\n" * 40)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["finished"]
    assert {key: one["state"] for key, one in told["steps"].items()} == {
        **dict.fromkeys(("camera", "dark", "flat", "focus", "width", "pitch", "paper"), "good"),
        **dict.fromkeys(("colour", "alignment"), "not needed"),
    }
    assert [one["key"] for one in told["questions"]][:4] == ["dark", "dark.keep", "flat", "flat"]
    assert told["asked"] == len(told["questions"]) == 13
    assert told["steps"]["width"]["values"]["pixel_mm"]["value"] == pytest.approx(0.10543, rel=1e-4)
    assert told["steps"]["pitch"]["values"]["line_mm"]["value"] == pytest.approx(TRUE_LINE_MM, rel=1e-4)
    after = path.read_text()
    assert (
        '# the line camera, as Maria wants it\n[camera]\npixel_format = "Mono12"   # what bits says\n'
        in after
    )
    assert after.startswith(before.partition("luminance_cd_m2")[0])
    PressFile.read(path).camera()


def test_what_a_camera_shows_now(path: Path, scenes: Scenes, capsys: pytest.CaptureFixture[str]) -> None:
    follow, picture = path.with_name("scene"), path.with_name("view.png")
    follow.write_text("ruler")
    with scene_camera(scenes, follow):
        asked = ["camera", "view", ID, "--press", str(path), "--seconds", "4", "--picture", str(picture)]
        assert run([*asked, "--json"]) == 0
        rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert run(["camera", "view", ID, "--frames", "1"]) == 0
        people = capsys.readouterr().out
    (sensor,) = rows[-1]["sensors"]
    assert len(sensor["profile_dn"]) == 1280
    assert sensor["saturated_share"] == 0
    assert sensor["flatness"] > 0.9
    assert sensor["focus"]["by"] == "ruler page"
    assert sensor["focus"]["mtf50_across_per_pixel"]["value"] == pytest.approx(0.53, abs=0.04)
    assert rows[-1]["lens_mtf50_per_pixel"] == pytest.approx(0.56, abs=0.01)
    assert rows[-1]["health"]["temperature_c"] == 41.5
    assert rows[-1]["health"]["lines_per_s"] > 0
    with Image.open(picture) as image:
        assert image.size == (1430, 962)
    assert f"{ID}   1 x 1280 pixels, Mono12" in people
    assert "lines/s" in people


def test_what_is_wrong_is_one_line(path: Path, scenes: Scenes, capsys: pytest.CaptureFixture[str]) -> None:
    answers, follow = path.with_name("answers.toml"), path.with_name("scene")
    follow.write_text("flat")
    with scene_camera(scenes, follow):
        for text, said in (
            ("fokus = 's'\n", f"prooflight: {answers}: 'fokus' is not a question; use dark, flat, "),
            ("focus = \n", f"prooflight: {answers}: is not TOML "),
            ("dark = ''\n", f"prooflight: {ID}: is not dark: "),
        ):
            answers.write_text(text)
            assert run(["camera", "set-up", ID, str(path), "--answers", str(answers)]) == 2
            err = capsys.readouterr().err
            assert err.startswith(said)
            assert err.count("\n") == 1
        shallow = path.read_text().replace('"Mono12"', '"Mono8"')
        path.write_text(shallow)
        assert run(["camera", "set-up", ID, str(path), "--yes"]) == 2
        assert capsys.readouterr().err == (
            f"prooflight: {ID}: sends Mono8, 8 bits, but my.toml states sensor.bits = 12;"
            ' set camera.pixel_format, e.g. "Mono12"\n'
        )
        assert path.read_text() == shallow
    assert run(["chart", "make", "--ruler", "--size", "3x4", "-o", str(path.parent)]) == 2
    assert capsys.readouterr().err.startswith(
        "prooflight: ruler page: a page 3 mm in width; give a multiple of 0.1"
    )
    assert run(["chart", "make", "--ruler", "--size", "A4", "-o", str(path.parent)]) == 2
    assert capsys.readouterr().err.startswith(
        "prooflight: --size: 'A4' is not a width and a height; write e.g. 210x297"
    )
