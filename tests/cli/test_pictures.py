"""Commands that draw a press and judge its tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image
from tests.cli.calls import call

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def test_press_show_draws_the_press_and_tells_where_noise_is_clipped(
    press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press.save(tmp_path / "a.press")
    code, out, _ = call(
        capsys, "press", "show", tmp_path / "a.press", "--picture", tmp_path / "a.png", "--json"
    )
    assert code == 0
    sensor = json.loads(out)["sensors"][0]
    assert sensor["clipped_black_percent"] == sensor["clipped_saturation_percent"] == 0.0
    with Image.open(tmp_path / "a.png") as image:
        assert image.format == "PNG"
