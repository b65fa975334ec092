from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prooflight.errors import JobError
from prooflight.pages.raster import Page
from prooflight.scans.geometry import ScanGeometry


def geometry(**changes: Any) -> ScanGeometry:
    fields: dict[str, Any] = {
        "pixels": 400,
        "pixel_pitch_mm": 0.1,
        "line_pitch_mm": 0.1,
        "lead_in_mm": 2.0,
        "lead_out_mm": 3.0,
    }
    return ScanGeometry(**fields | changes)


def page_of(width_mm: int, height_mm: int) -> Page:
    """A page of whole millimetres at one pixel each, its top-left pixel full black."""
    cmyk = np.zeros((height_mm, width_mm, 4), np.uint8)
    cmyk[0, 0, 3] = 255
    return Page(cmyk=cmyk, dpi=25.4, name="p0003", number=3)


def test_a_scan_is_lead_in_page_and_lead_out() -> None:
    assert geometry().field_mm == pytest.approx(40)
    assert geometry().lines(25.0) == 300
    assert geometry().lines(25.01) == 301
    assert geometry(line_pitch_mm=0.3).lines(25.0) == 100


def test_a_page_is_centred_in_the_field_and_starts_after_the_lead_in() -> None:
    one = geometry()
    x, y = one.centres_x_mm(30.0), one.centres_y_mm(300)
    assert one.left_mm(30.0) == pytest.approx(5)
    assert x[0] == pytest.approx(-4.95)
    assert x[50] == pytest.approx(0.05)  # the first pixel on the page
    assert x[-1] == pytest.approx(34.95)
    assert y[0] == pytest.approx(-1.95)
    assert y[20] == pytest.approx(0.05)
    np.testing.assert_allclose(np.diff(x), 0.1)
    np.testing.assert_allclose(np.diff(y), 0.1)


def test_where_a_page_lies_too_far_right_and_down_pixels_lie_further_left_and_up_on_it() -> None:
    one = geometry()
    np.testing.assert_allclose(one.centres_x_mm(30.0, shift_mm=0.4), one.centres_x_mm(30.0) - 0.4)
    np.testing.assert_allclose(one.centres_y_mm(50, shift_mm=-0.7), one.centres_y_mm(50) + 0.7)


@given(
    width=st.floats(1, 39.9),
    height=st.floats(1, 60),
    line_pitch=st.floats(0.05, 0.4),
)
def test_on_page_holds_just_the_pixels_that_lie_whole_on_it(
    width: float, height: float, line_pitch: float
) -> None:
    one = geometry(line_pitch_mm=line_pitch)
    lines, columns = one.on_page(width, height)
    x, y = one.centres_x_mm(width), one.centres_y_mm(one.lines(height))
    for centres, half, extent, place in ((x, 0.05, width, columns), (y, line_pitch / 2, height, lines)):
        inside = (centres - half >= -1e-9) & (centres + half <= extent + 1e-9)
        assume(
            (np.abs(np.abs(centres - extent / 2) + half - extent / 2) > 1e-6).all()
        )  # not on the very edge
        chosen = np.zeros(centres.size, bool)
        chosen[place] = True
        np.testing.assert_array_equal(chosen, inside)


def test_raster_dpi_puts_whole_pixels_into_camera_pixels() -> None:
    assert geometry().raster_dpi(1) == pytest.approx(254)
    assert geometry().raster_dpi(2) == pytest.approx(508)


@pytest.mark.parametrize(("width", "seen"), [(39.0, True), (40.0, True), (40.09, True), (40.2, False)])
def test_a_page_is_seen_if_it_is_no_wider_than_the_field_to_a_pixel(width: float, seen: bool) -> None:
    assert geometry().sees(width) is seen


def test_a_page_that_fits_is_laid_as_it_is() -> None:
    page = page_of(38, 90)
    assert geometry().lay(page) is page


def test_a_page_that_fits_only_the_other_way_round_is_turned() -> None:
    laid = geometry().lay(page_of(90, 38))
    assert laid.width_mm == pytest.approx(38)
    assert laid.height_mm == pytest.approx(90)
    assert laid.cmyk[0, -1, 3] == 255  # clockwise: the top-left corner comes to the top right
    assert laid.cmyk.flags.c_contiguous
    assert (laid.name, laid.number) == ("p0003", 3)


def test_a_page_that_fits_neither_way_is_refused_by_name() -> None:
    with pytest.raises(JobError) as refusal:
        geometry().lay(page_of(90, 80))
    text = str(refusal.value)
    assert text.startswith("page 3: is 90.0 x 80.0 mm")
    assert "40.0 mm" in text
    assert "\n" not in text


@pytest.mark.parametrize(("width_mm", "height_mm"), [(1, 1), (4, 30), (30, 4), (1, 200)])
def test_a_page_of_which_there_is_too_little_to_judge_is_refused(width_mm: int, height_mm: int) -> None:
    with pytest.raises(JobError) as refusal:
        geometry().lay(page_of(width_mm, height_mm))
    text = str(refusal.value)
    assert text.startswith(f"page 3: is {width_mm}.00 x {height_mm}.00 mm")
    assert "from 5.0 x 5.0 mm on" in text
    assert geometry(pixel_pitch_mm=0.25, line_pitch_mm=0.25).least_mm == 8.0
    laid = page_of(5, 5)
    assert geometry().lay(laid) is laid
