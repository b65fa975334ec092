"""The ruler page as it is laid out and printed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.errors import RequestError
from prooflight.inks.chart_print import DPI
from prooflight.inks.ruler_layout import MARGIN_MM, RulerLayout
from prooflight.inks.ruler_print import ruler_raster, write_ruler

if TYPE_CHECKING:
    from pathlib import Path

SIZES = st.tuples(st.integers(1240, 9000), st.integers(1200, 9000)).map(
    lambda size: (size[0] / 10, size[1] / 10)
)


@settings(max_examples=15)
@given(size=SIZES)
def test_whatever_the_size_a_place_holds_the_same_and_nothing_is_in_the_margins(
    size: tuple[float, float],
) -> None:
    layout, largest = RulerLayout(width_mm=size[0], height_mm=size[1]), RulerLayout.largest()
    assert set(layout.bars()) <= set(largest.bars())
    assert set(layout.markers()) <= set(largest.markers())
    assert set(layout.squares()) <= set(largest.squares())
    assert set(layout.crosses()) <= set(largest.crosses())
    checks = len(list(layout.check_lines()))
    for corners, _ in list(layout.painted())[:-checks]:
        assert corners.min() >= MARGIN_MM - 1e-6
        assert (corners.max(axis=0) <= np.array(size) - MARGIN_MM + 1e-6).all()
    assert sum(not bar.upright for bar in layout.bars()) >= 2 * 20  # two combs along
    assert len({bar.box[1] for bar in layout.bars() if bar.upright}) >= 2  # two across
    numbers = [marker.number for marker in layout.markers()]
    assert len(set(numbers)) == len(numbers) >= 1
    assert max(numbers) < 250


def test_edges_but_those_of_turned_squares_lie_on_tenths_of_a_millimetre() -> None:
    layout = RulerLayout()
    turned = {square.corners_mm.tobytes() for square in layout.squares()}
    for corners, _ in layout.painted():
        if corners.tobytes() not in turned:
            np.testing.assert_allclose(corners * 10, np.round(corners * 10), atol=1e-6)


def test_the_pdf_is_the_raster(tmp_path: Path) -> None:
    """Ripped without anti-aliasing at 508 dpi: but for words they are alike, to a pixel."""
    pytest.importorskip("pymupdf", reason="reading PDFs is an extra")
    from prooflight.pages.job import JobSource

    layout = RulerLayout(width_mm=130.0, height_mm=130.0)
    path = tmp_path / "ruler.pdf"
    write_ruler(path, layout)
    first = path.read_bytes()
    write_ruler(path, layout)
    assert path.read_bytes() == first
    with JobSource(path=path, dpi=2 * DPI, profile=None).open() as job:
        page = job.page(1)
    raster = ruler_raster(layout)
    assert page.cmyk.shape == raster.shape
    inside = slice(200, None), slice(200, None)  # 10 mm in: no words there
    for ink in range(4):
        drawn, ripped = raster[..., ink], np.ascontiguousarray(page.cmyk[..., ink])
        # A ripper may ink a pixel that an edge just touches.
        least, most = cv2.erode(drawn, np.ones((3, 3))), cv2.dilate(drawn, np.ones((3, 3)))
        assert (ripped >= least)[inside].all()
        assert (ripped <= most)[inside].all()
        assert (drawn == 255).any()


def test_sizes_that_cannot_be_are_one_line() -> None:
    with pytest.raises(
        RequestError, match=r"^ruler page: a page 100 mm in width; give a multiple of 0\.1 mm from 124"
    ):
        RulerLayout(width_mm=100.0)
    with pytest.raises(RequestError, match=r"^ruler page: a page 200\.05 mm in height; "):
        RulerLayout(height_mm=200.05)
