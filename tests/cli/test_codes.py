"""``prooflight codes``: what a press's camera will read of a job."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
import zxingcpp

from prooflight.cli import run
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


def page(number: int, text: str | None, *, dpi: float = 481.8) -> Page:
    cmyk = np.zeros((round(44 / 25.4 * dpi), round(36 / 25.4 * dpi), 4), np.uint8)
    cmyk[-100:, :, 0] = 120
    if text is not None:
        drawn = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.QRCode)
        grey = np.array(drawn.to_image(scale=1, add_quiet_zones=False))
        side = round(12 / 25.4 * dpi)
        cmyk[80 : 80 + side, 80 : 80 + side, 3] = 255 - cv2.resize(
            grey, (side, side), interpolation=cv2.INTER_NEAREST
        )
    return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04d}", number=number)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    for number, text in enumerate((None, "LOT 12", "LOT 13"), start=1):
        write_tiff(page(number, text), tmp_path / "job" / f"p{number:04d}.tif")
    return tmp_path / "job"


def test_codes_of_a_job_are_listed(
    job: Path, press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press.save(tmp_path / "a.press")
    assert run(["codes", str(job), "--press", str(tmp_path / "a.press"), "--json"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(one["page"], one["text"], one["checked"]) for one in found] == [
        ("p0002", "LOT 12", True),
        ("p0003", "LOT 13", True),
    ]
    assert run(["codes", str(job), "--press", str(tmp_path / "a.press"), "--pages", "3"]) == 0
    shown = capsys.readouterr().out
    assert "LOT 13" in shown
    assert "LOT 12" not in shown


def test_a_job_without_codes_says_so(
    job: Path, press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press.save(tmp_path / "a.press")
    assert run(["codes", str(job), "--press", str(tmp_path / "a.press"), "--pages", "1"]) == 0
    assert capsys.readouterr().out == "1 page: no code that this camera can read\n"
