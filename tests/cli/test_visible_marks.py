"""``press show`` says what a press would catch, and draws where."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from PIL import Image
from tests.cli.calls import call

from prooflight.pages.files import write_tiff

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture(scope="module")
def taught(trained_press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("taught") / "taught.press"
    trained_press.save(path)
    return path


@pytest.fixture(scope="module")
def job(make_page: Callable[..., Page], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("job")
    for number in (1, 2):
        write_tiff(make_page(number, number=number), folder / f"p{number:04}.tif")
    return folder


def test_tints_and_a_page_are_told_and_the_map_is_drawn(
    taught: Path, job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "press", "show", taught, "--job", job, "--page", 2, "--map", tmp_path / "map.png"
    code, out, _ = call(capsys, *words, "--json")
    facts = json.loads(out, parse_constant=pytest.fail)
    assert code == 0
    assert [row["place"] for row in facts["catches"]] == ["bare paper", "40 % black"]
    assert facts["catches"][0]["spot_mm"] < facts["catches"][1]["spot_mm"]
    assert {"bare paper", "text or hard edge"} <= {row["place"] for row in facts["catches_on_page"]}
    assert facts["floor_percent_of_white"] == 10
    with Image.open(tmp_path / "map.png") as image:
        assert image.format == "PNG"
        assert image.width > 800
    (tmp_path / "map.png").unlink()
    shown = call(capsys, *words)[1]
    assert "What would be caught on page 2" in shown
    assert "40 % black" in shown
    assert (tmp_path / "map.png").exists()


def test_a_press_without_our_detector_tells_its_floor_alone(
    press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = json.loads(call(capsys, "press", "show", press_file, "--json")[1])
    assert facts["catches"] == []
    assert facts["floor"].endswith("unless it is no more than a benign speck of the paper.")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--map", "map.png"], "--job"),
        (["--page", "1"], "--job"),
        (["--job", "JOB"], "does not state what it can detect"),
        (["--job", "JOB", "--page", "3", "--map", "map.png"], "no page 3"),
    ],
)
def test_what_cannot_be_shown_ends_in_one_line(
    press_file: Path,
    taught: Path,
    job: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    press = taught if "3" in words else press_file
    code, out, err = call(capsys, "press", "show", press, *[job if word == "JOB" else word for word in words])
    assert (code, out) == (2, "")
    assert said in " ".join(err.split())
    assert not (tmp_path / "map.png").exists()
