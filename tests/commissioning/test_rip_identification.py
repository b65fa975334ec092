"""What is identified of a RIP lies within its stated uncertainty of what its rasters were made with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prooflight.commissioning.rip_identification import identified_from_rasters, ink_edges
from prooflight.commissioning.rip_identification import test_pdf as page_of_test
from prooflight.pages.pdf.rip_model import RipModel, grown

pytest.importorskip("pymupdf")
DPI = 600.0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rip") / "test.pdf"
    path.write_bytes(page_of_test())
    return path


def _drawn(page: Path, model: RipModel) -> np.ndarray:
    from prooflight.pages.pdf.rip import PdfJob

    with PdfJob(page) as job:
        return job.page(1, DPI, drawn_dpi=DPI, rip=model).cmyk


def test_growth_of_every_ink_is_identified_within_its_uncertainty(page: Path) -> None:
    growth = (10.0, -6.0, 0.0, 17.0)
    raster = _drawn(page, RipModel(fill="centre", growth_um=growth))
    found = identified_from_rasters([raster], lambda model: [_drawn(page, model)], dpi=DPI)
    assert found.model.fill in ("centre", None)  # a growth of all inks is no rule's
    assert found.model.growth_um is not None
    assert found.model.edge_sd_um is not None
    for value, sd, true in zip(found.model.growth_um, found.model.growth_sd_um, growth, strict=True):
        # three standard errors, and what bytes round to: 1/255 of 42 um, either edge
        assert abs(value - true) < 3 * sd + 0.4
    assert any("Black grows by" in sentence for sentence in found.sentences)


def test_a_rip_that_fills_by_area_is_told_from_one_that_rounds(page: Path) -> None:
    raster = _drawn(page, RipModel(fill="area"))
    found = identified_from_rasters([raster], lambda model: [_drawn(page, model)], dpi=DPI)
    assert found.model.fill == "area"


def test_a_shift_is_no_growth() -> None:
    plate = np.zeros((512, 512), np.uint8)
    for row in range(16, 480, 40):
        for column in range(16, 480, 40):
            plate[row : row + 20, column : column + 20] = 255
    edges = ink_edges([plate], [np.roll(plate, (0, 1), (0, 1))], span=255)
    assert edges is not None
    assert edges.growth_pixels == pytest.approx(0, abs=1e-6)
    assert edges.offset_pixels == pytest.approx((1, 0), abs=1e-6)
    assert edges.edge_sd == pytest.approx(0, abs=1e-6)


def test_growth_by_parts_of_a_pixel_is_seen_exactly() -> None:
    plates = np.zeros((512, 512, 4), np.uint8)
    for row in range(16, 480, 40):
        for column in range(16, 480, 40):
            plates[row : row + 20, column : column + 20, 3] = 255
    seen = grown(plates, (0.0, 0.0, 0.0, 0.6))[..., 3]
    edges = ink_edges([plates[..., 3]], [seen], span=255)
    assert edges is not None
    assert edges.growth_pixels == pytest.approx(0.6, abs=1 / 255)


def test_a_page_without_edges_says_nothing() -> None:
    blank = np.zeros((64, 64), np.uint8)
    assert ink_edges([blank], [blank], span=255) is None
