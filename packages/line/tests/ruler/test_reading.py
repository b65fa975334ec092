"""What a ruler page says of a camera, against the press that printed it and the camera that saw it."""

from __future__ import annotations

import numpy as np
import pytest
from packages.line.tests.ruler.prints import (
    LAYOUT,
    TRUE_LINE_MM,
    ruler_page,
    ruler_press_file,
    seen,
    true_mtf50,
)

from prooflight.errors import ScanError
from prooflight.pages.raster import MM_PER_INCH
from prooflight.prediction.printed import PrintedPage
from prooflight.scans.placement import Placement
from prooflight_line.ruler.finding import find_ruler, relative_light
from prooflight_line.ruler.places import ruler_scale
from prooflight_line.ruler.reading import read_ruler, sensor_place

TOP = 4095


@pytest.fixture(scope="module")
def scan() -> np.ndarray:
    return seen()


def refusal(lines: np.ndarray) -> str:
    with pytest.raises(ScanError) as refused:
        read_ruler(lines, top_code_dn=TOP, where="cam 1")
    return str(refused.value)


def test_pitches_are_those_of_lens_and_encoder(scan: np.ndarray) -> None:
    """By 4 standard errors, and these are below 1 part in 20,000."""
    (one,) = read_ruler(scan, top_code_dn=TOP, where="cam 1")
    camera = ruler_press_file().camera()
    for found, true in ((one.scale.pixel_mm, camera.pixel_pitch_mm), (one.scale.line_mm, TRUE_LINE_MM)):
        assert found.value == pytest.approx(true, abs=4 * found.standard_error + 1e-6)
        assert found.standard_error < 5e-5 * true
    assert abs(one.scale.skew_deg.value) < 0.002
    assert abs(one.scale.shear_deg) < 0.004
    assert (one.scale.bent_across_mm, one.scale.bent_along_mm) < (0.003, 0.003)
    assert one.scale.residual_px < (0.05, 0.05)


def test_a_place_of_the_page_is_where_the_geometry_has_it(scan: np.ndarray) -> None:
    (one,) = read_ruler(scan, top_code_dn=TOP, where="cam 1")
    camera = ruler_press_file().camera()
    geometry = ruler_press_file().geometry(camera)
    x, y = geometry.centres_x_mm(LAYOUT.width_mm), geometry.centres_y_mm(scan.shape[1])
    assert one.scale.at(x[300], y[900]) == pytest.approx((300, 900), abs=0.03)
    assert one.scale.at(x[1100], y[1700]) == pytest.approx((1100, 1700), abs=0.03)


@pytest.mark.parametrize("f_number", [2.8, 8.0, 16.0])
def test_sharpness_is_that_of_lens_pixel_and_motion(f_number: float) -> None:
    """By 4 standard errors and 2 %: what bins, window and the oblique normal leave."""
    (one,) = read_ruler(seen(f_number=f_number), top_code_dn=TOP, where="cam 1")
    for places, true in zip((one.across, one.along), true_mtf50(f_number), strict=True):
        assert len(places) == 3
        for place in places:
            off = abs(place.mtf50.value - true)
            assert off < 4 * place.mtf50.standard_error + 0.02 * true, (place.mtf50, true)
            assert place.mtf50.standard_error < 0.06 * true


@pytest.mark.parametrize("skew_deg", [-0.8, 0.3])
def test_a_turned_page_is_found_turned(skew_deg: float) -> None:
    lines = seen(placement=Placement(skew_deg=skew_deg, shift_mm=(0.7, -0.4)))
    (one,) = read_ruler(lines, top_code_dn=TOP, where="cam 1")
    assert one.scale.skew_deg.value == pytest.approx(
        skew_deg, abs=0.002 + 4 * one.scale.skew_deg.standard_error
    )
    assert one.scale.pixel_mm.value == pytest.approx(
        ruler_press_file().camera().pixel_pitch_mm, rel=2e-4
    )  # a turn of 0.8 degrees is a pitch of 1e-4, if it were not known
    assert one.scale.line_mm.value == pytest.approx(TRUE_LINE_MM, rel=2e-4)


def test_planes_that_lie_apart_are_placed() -> None:
    """In raster pixels of 0.05 mm; a mono camera sees yellow least, and is sure of it least."""
    pixel = MM_PER_INCH / ruler_page().dpi
    planes = np.array([[2, -1], [0, 3], [-2, 2], [0, 0]])
    printed = PrintedPage(page=ruler_page(), planes=planes)
    (one,) = read_ruler(seen(printed), top_code_dn=TOP, where="cam 1")
    found = {plane.ink: plane for plane in one.planes}
    assert set(found) == {"C", "M", "Y"}
    for at, letter in enumerate("CMY"):
        plane, (right, down) = found[letter], planes[at] * pixel
        tolerance = 0.006 if letter == "Y" else 0.003
        assert plane.across_mm.value == pytest.approx(right, abs=tolerance)
        assert plane.along_mm.value == pytest.approx(down, abs=tolerance)


def test_sensors_that_lie_apart_are_placed_to_a_fraction_of_a_line(scan: np.ndarray) -> None:
    """Colour lines 3.4 lines and 0.25 pixels apart: linear between neighbours, as paper that moves on would show it."""
    first = scan[0].astype(np.float64)
    lines = np.arange(first.shape[0])
    later = np.stack([np.interp(lines - 3.4, lines, column) for column in first.T], axis=1)
    right = 0.75 * later + 0.25 * np.roll(later, 1, axis=1)
    both = np.stack([first, right]).round().astype(np.uint16)
    reading = read_ruler(both, top_code_dn=TOP, where="cam 1")
    place = reading[1].place
    assert place.lines.value == pytest.approx(3.4, abs=0.02)
    assert place.pixels.value == pytest.approx(0.25, abs=0.02)
    assert abs(place.turn_deg) < 0.01
    assert place.size == pytest.approx(1, abs=1e-4)
    own = reading[0].place
    assert (own.lines.value, own.pixels.value) == (0, 0)
    # The same by scales alone, as of two cameras whose lines are counted together.
    found = find_ruler(relative_light(both[1:]), where="cam 2")
    other = ruler_scale(both[1].astype(np.float32), found, where="cam 2")
    assert sensor_place(reading[0].scale, other).lines.value == pytest.approx(3.4, abs=0.02)


def test_the_next_page_does_not_disturb(scan: np.ndarray) -> None:
    alone = read_ruler(scan, top_code_dn=TOP, where="cam 1")[0]
    several = np.concatenate([scan, scan[:, :1500]], axis=1)
    found = read_ruler(several, top_code_dn=TOP, where="cam 1")[0]
    assert found.scale.line_mm.value == pytest.approx(alone.scale.line_mm.value, rel=1e-5)
    assert found.scale.pixel_mm.value == pytest.approx(alone.scale.pixel_mm.value, rel=1e-5)


def test_an_encoder_of_half_or_double_pitch_is_measured(scan: np.ndarray) -> None:
    for every, times in ((scan[:, ::2], 2.0), (np.repeat(scan, 2, axis=1), 0.5)):
        found = find_ruler(relative_light(every), where="cam 1")
        assert found.pitch_mm[1] == pytest.approx(times * TRUE_LINE_MM, rel=0.01)


def test_whole_pages_are_told_from_parts(scan: np.ndarray) -> None:
    def whole(lines: np.ndarray) -> bool:
        return find_ruler(relative_light(lines), where="cam 1").whole(lines.shape[1])

    followed = np.concatenate([scan, scan[:, :400]], axis=1)
    assert whole(followed)
    assert not whole(scan[:, :1300])  # the second group is not through
    assert not whole(scan[:, 900:])  # the first is not there


def test_paper_and_black_are_what_the_strips_show(scan: np.ndarray) -> None:
    (one,) = read_ruler(scan, top_code_dn=TOP, where="cam 1")
    assert one.paper_dn == pytest.approx(float(np.median(scan[0, 820:900, 300:1000])), rel=0.01)
    assert 40 < one.solid_dn < 0.06 * one.paper_dn


def test_a_page_that_lies_wrong_is_one_line(scan: np.ndarray) -> None:
    assert refusal(scan[:, ::-1, ::-1]).startswith("cam 1: sees the ruler page upside down; let the edge")
    assert refusal(np.ascontiguousarray(scan[:, :, ::-1])).startswith("cam 1: sees the ruler page mirrored; ")
    turned = np.ascontiguousarray(np.rot90(scan, axes=(1, 2)))
    assert refusal(turned).startswith("cam 1: sees the ruler page sideways; ")


def test_lines_without_a_ruler_page_are_one_line(scan: np.ndarray) -> None:
    blank = np.full((1, 600, 1280), 3000, np.uint16)
    assert refusal(blank) == (
        "cam 1: sees no ruler page in 600 lines; let a whole page of `prooflight chart make --ruler` pass, print side"
        " to the camera"
    )
    noise = np.random.default_rng(1).integers(0, 4095, (1, 600, 1280)).astype(np.uint16)
    assert refusal(noise).startswith("cam 1: sees no ruler page")
    assert refusal(np.zeros((1, 64, 1280), np.uint16)).startswith("cam 1: sees no ruler page")


def test_saturated_paper_is_one_line(scan: np.ndarray) -> None:
    bright = np.minimum(scan.astype(np.int64) * 2, TOP).astype(np.uint16)
    assert refusal(bright).startswith(
        "cam 1: sees paper at its top code, 100 % of 4095 DN; shorten the exposure"
    )


def test_pixels_too_coarse_for_its_bars_are_one_line(scan: np.ndarray) -> None:
    coarse = scan[:, ::5]
    found = find_ruler(relative_light(coarse), where="cam 1")
    with pytest.raises(
        ScanError, match=r"^cam 1: sees 0\.53 mm a pixel or line; a ruler page is for up to 0\.5 mm"
    ):
        ruler_scale(coarse[0].astype(np.float32), found, where="cam 1")
