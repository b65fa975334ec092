"""Each script of `examples/` runs as a program, says something and draws something."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
GALLERY = (
    "golden_copy",
    "predict_a_page",
    "second_sensor",
    "table_1_small",
    "teach_a_press",
    "write_a_detector",
)


def test_the_gallery_is_whole() -> None:
    assert tuple(script.stem for script in SCRIPTS) == GALLERY


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_begins_with_its_title_and_can_be_read_in_one_sitting(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    said = ast.get_docstring(ast.parse(text))
    assert said is not None
    title, _, shown = said.partition("\n\n")
    assert title.startswith("# ")
    assert len(shown) > 100
    assert 40 <= len(text.splitlines()) <= 125


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_runs(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the process of the tests, which treats warnings as errors; others load modules and kernels for seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(script)])  # without a folder it draws where it is started
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.strip()
    pictures = sorted(tmp_path.glob("*.png"))
    assert pictures
    for path in pictures:
        with Image.open(path) as picture:
            assert min(picture.size) >= 100
            assert np.asarray(picture.convert("L")).std() > 5  # something is drawn
