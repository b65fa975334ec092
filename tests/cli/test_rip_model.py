"""``press rip-model --scans`` finds how a press's RIP draws edges from scans of its printed test page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from prooflight.cli import run
from prooflight.cmyk import INKS
from prooflight.commissioning.build import build_press
from prooflight.commissioning.rip_identification import ink_edges
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.pdf.rip_model import RipModel
from prooflight.press.press_file import PressFile

pytest.importorskip("pymupdf")
HALF_PIXEL_UM = 25400 / 1200 / 2
"""A RIP that fills what a shape touches draws its edges half a pixel out, on average."""


@pytest.fixture(scope="module")
def folder(prototype: PressFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A press file, the test page, the press that prints it by another rule, and scans of that print."""
    folder = tmp_path_factory.mktemp("rip-model")
    stated = PressFile(folder / "my.toml", f"{prototype.text}\n[rip]\ndpi = 1200\n")
    stated.path.write_text(stated.text)
    press = build_press(stated, seed=1, pixels=1500)
    press.save(folder / "my.press")
    replace(press, rip_model=RipModel(fill="any-part")).save(folder / "true.press")
    assert _run(folder, "press", "rip-model", "--test-page", "test.pdf") == 0
    made = _run(folder, "simulate", "test.pdf", "--press", "true.press", "-o", "scans", "--world", "press")
    assert made == 0
    return folder


def _run(folder: Path, *words: str) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return run(list(words))


def _growth_um(page: Path) -> list[float]:
    """Return by how much the edges of each ink lie outside those of the expected raster, from the rasters of both."""
    with PdfJob(page) as job:
        drawn, printed = (
            job.page(1, 1200, drawn_dpi=1200, rip=RipModel(fill=fill)).cmyk for fill in (None, "any-part")
        )
    edges = [ink_edges([drawn[..., ink]], [printed[..., ink]], span=255) for ink in range(INKS)]
    return [25400 / 1200 * one.growth_pixels for one in edges if one is not None]


def test_scans_of_the_test_page_tell_the_growth_of_every_ink(folder: Path) -> None:
    words = ["press", "rip-model", "my.toml", "test.pdf", "--press", "my.press", "--scans", "scans", "-o"]
    assert _run(folder, *words, "found.toml") == 0
    model = PressFile.read(folder / "found.toml").rip_model
    assert model.growth_um is not None
    true_um = _growth_um(folder / "test.pdf")
    for growth, sd, true in zip(model.growth_um, model.growth_sd_um, true_um, strict=True):
        assert 0 < sd < 5
        # Three standard errors, and what a day's dot gain of 2 % adds: 4 x 2 % x 1/6 of a raster pixel of 53 um.
        assert abs(growth - true) < 3 * sd + 0.7
    assert model.edge_sd_um is not None
    # A uniform distribution over a pixel, drawn by centres or any part, on either edge; print and scan add to it.
    assert HALF_PIXEL_UM / 3**0.5 / 2 < model.edge_sd_um < 3 * HALF_PIXEL_UM


def test_copies_make_it_surer(folder: Path) -> None:
    words = ["press", "rip-model", "my.toml", "test.pdf", "--press", "my.press", "--replace"]
    made = _run(
        folder,
        "simulate",
        "test.pdf",
        "--press",
        "true.press",
        "-o",
        "more",
        "--world",
        "press",
        "--seed",
        "5",
    )
    assert made == 0
    assert _run(folder, *words, "--scans", "more", "-o", "one.toml") == 0
    assert _run(folder, *words, "--scans", "scans", "--scans", "more", "-o", "two.toml") == 0
    one, two = (PressFile.read(folder / name).rip_model for name in ("one.toml", "two.toml"))
    assert sum(two.growth_sd_um) < sum(one.growth_sd_um)


def test_scans_that_show_no_page_write_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dn = tifffile.imread(folder / "scans" / "p0001.tif")
    tifffile.imwrite(tmp_path / "p0001.tif", np.full_like(dn, int(np.median(dn))))
    words = ["press", "rip-model", "my.toml", "test.pdf", "--press", "my.press", "-o", "none.toml"]
    assert _run(folder, *words, "--scans", str(tmp_path)) == 2
    assert "could not be placed" in capsys.readouterr().err
    assert not (folder / "none.toml").exists()
