"""Pictures of the console: contact sheets are small and keep their grounds, and every page is on one."""

from __future__ import annotations

import io
import re
from importlib.resources import files

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("uvicorn", reason='needs pip install "prooflight-console"')

from prooflight_line.testing.sample_runs import CUT_PIXELS, ExpectedScan, misprint
from prooflight_studies.screens.contact_sheets import GAP_PX, GROUND, MOST_PX, SCALE, as_png, contact_sheet
from prooflight_studies.screens.study import SCREENS


def test_pictures_are_in_rows_cut_and_scaled() -> None:
    wide, long = Image.new("RGB", (500, 200), "white"), Image.new("RGB", (100, 2 * MOST_PX), "black")
    sheet = contact_sheet([[wide, long], [wide]])
    width, height = round(500 * SCALE) + round(100 * SCALE), round(MOST_PX * SCALE) + round(200 * SCALE)
    assert sheet.size == (width + 3 * GAP_PX, height + 3 * GAP_PX)
    assert sheet.getpixel((0, 0)) == GROUND
    assert sheet.getpixel((GAP_PX, GAP_PX)) == (255, 255, 255)
    assert sheet.getpixel((2 * GAP_PX + round(500 * SCALE), GAP_PX + 500)) == (0, 0, 0)


def test_a_picture_takes_fewer_colours_until_it_is_small_enough() -> None:
    pixels = np.random.default_rng(31).integers(0, 256, (200, 200, 3)).astype(np.uint8)
    pixels[:100] = (12, 200, 99)
    picture = Image.fromarray(pixels)
    whole = as_png(picture)
    small = as_png(picture, most_bytes=len(whole) // 2)
    assert len(small) < len(whole)
    for data in (whole, small):
        shown = Image.open(io.BytesIO(data)).convert("RGB")
        assert shown.getpixel((50, 50)) == (12, 200, 99), "the most common colour is exact"


def test_every_page_of_the_navigation_is_pictured_once() -> None:
    base = (files("prooflight_console") / "pages" / "templates" / "base.html.j2").read_text(encoding="utf-8")
    linked = set(re.findall(r'\("\w+", "(/\w*)"\)', base))
    assert len(linked) == 8
    assert linked <= {screen.path.partition("?")[0] for screen in SCREENS}
    assert len({screen.name for screen in SCREENS}) == len(SCREENS)


def test_a_section_of_a_scan_is_where_its_defect_is() -> None:
    ramp = np.tile(np.arange(1000, 3000, dtype=np.float32), (1, 1500, 1))
    scan = ExpectedScan(dn=ramp, pixel_mm=0.1, line_mm=0.1)
    page = misprint(
        3,
        np.random.default_rng(31),
        kind="missing-content",
        box_mm=(80.0, 60.0, 4.0, 3.0),
        expected=lambda number: scan if number == 4 else pytest.fail(f"page {number}"),
    )
    assert page.evidence is not None
    x, y, width, height = page.evidence["cut0_mm"]
    assert (x, y, width, height) == pytest.approx((75.0, 54.5, 14.0, 14.0))
    cut = page.evidence["cut0"][0]
    assert cut.shape == (CUT_PIXELS, CUT_PIXELS)
    # Left of the defect the ramp, within it paper; noise has a standard deviation of 12.
    assert abs(cut[70, :50].mean() - ramp[0, 0, 750:800].mean()) < 12
    assert abs(cut[60:80, 55:85].mean() - np.quantile(ramp, 0.999)) < 12
