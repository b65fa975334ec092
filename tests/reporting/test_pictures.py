"""Pictures: the right colours in the right places, whatever the page's size."""

from __future__ import annotations

import io
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

from prooflight.detectors.verdict import Region
from prooflight.inspection.inspector import Inspector
from prooflight.pages.raster import Page
from prooflight.reporting import pictures
from prooflight.reporting.pictures import Frame
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, scan_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.base import Inspection
    from prooflight.press.artefact import Press

A4 = Frame(x_mm=0.0, y_mm=0.0, width_mm=210.0, height_mm=297.0)


def flat(recipe: tuple[int, ...], *, rows: int = 300, columns: int = 200) -> Page:
    return Page(
        cmyk=np.full((rows, columns, 4), recipe, np.uint8),
        dpi=481.8,
        name="p0001",
        number=1,
    )


def inspected(page: Page, press: Press, kind: str | None = None) -> Inspection:
    request = None if kind is None else MisprintRequest(kind=kind, severity=0.9)
    scan = scan_page(
        page,
        press=press,
        request=request,
        others=(),
        fetch=lambda _number: page,
        rng=stream(5, "print", page.number),
    )
    return Inspector.of(press, "chi-square").inspect(page, scan.dn)


@pytest.mark.parametrize("recipe", list(product((0, 255), repeat=4)))
def test_flat_pages_have_the_colours_of_the_appearance_table(press: Press, recipe: tuple[int, ...]) -> None:
    picture = np.asarray(pictures.page_picture(flat(recipe), press, width_px=50))
    node = tuple(-1 if ink else 0 for ink in recipe)
    assert picture.shape == (75, 50, 3)
    assert (picture == press.appearance_srgb[node]).all()


def test_appearance_is_linear_between_nodes_of_the_table(press: Press) -> None:
    cmyk = np.random.default_rng(1).integers(0, 256, (20, 30, 4), dtype=np.uint8)
    axis = np.linspace(0, 255, press.appearance_srgb.shape[0])
    referee = RegularGridInterpolator((axis,) * 4, press.appearance_srgb.astype(float))
    # half a code of rounding, and a little for float32
    assert np.abs(pictures.appearance(cmyk, press.appearance_srgb) - referee(cmyk)).max() <= 0.501


def test_a_fine_pattern_is_averaged_and_not_sampled(press: Press) -> None:
    page = flat((0, 0, 0, 0))
    page.cmyk[:, ::2, 3] = 255
    picture = np.asarray(pictures.page_picture(page, press, width_px=50)).astype(float)
    paper, black = press.appearance_srgb[0, 0, 0, 0], press.appearance_srgb[0, 0, 0, -1]
    assert picture.std() < 1
    assert (picture.mean(axis=(0, 1)) < paper).all()
    assert (picture.mean(axis=(0, 1)) > black).all()


def test_pictures_are_never_enlarged(press: Press) -> None:
    assert pictures.page_picture(flat((0, 0, 0, 9), rows=3, columns=7), press, width_px=320).size == (7, 3)


def test_bare_paper_has_signal_one_in_every_column(press: Press) -> None:
    page = flat((0, 0, 0, 0), rows=600, columns=400)
    expected, measured = pictures.signals(inspected(page, press), press)
    inner = expected[8:-8, 8:-8]
    assert (
        np.abs(inner - 1).max() < 2e-3
    )  # the backing beyond the edges: 0.2 % of an edge lies beyond 4 pixels
    assert abs(measured[8:-8, 8:-8].mean() - 1) < 1e-3
    # 12 bits and some thousand electrons: noise below 2 % a pixel, and no column stands out
    assert np.abs(measured[8:-8, 8:-8].mean(axis=0) - 1).max() < 0.005


def test_grey_pictures_encode_the_linear_signal_as_srgb_does() -> None:
    signal = np.array([[0.0, 0.002, 0.2140411, 1.0, 1.3]], np.float32)
    frame = Frame(x_mm=0, y_mm=0, width_mm=5, height_mm=1)
    picture = np.asarray(pictures.grey_picture(signal, frame, width_px=10))
    # IEC 61966-2-1: code 127.5 is 0.2140 of full light
    assert np.abs(picture[0].astype(float) - [0, 0.02584 * 255, 127.5, 255, 255]).max() <= 0.51


def test_pictures_have_square_pixels_on_paper_even_if_the_camera_has_not() -> None:
    signal = np.ones((100, 400), np.float32)
    frame = Frame(x_mm=0, y_mm=0, width_mm=40, height_mm=50)
    assert pictures.grey_picture(signal, frame, width_px=80).size == (80, 100)


def colours_of(block_z: float, *, ink: float = 0.0) -> tuple[int, int, int]:
    z = np.full((1, 4, 5), block_z, np.float32)
    picture = pictures.error_picture(
        z,
        np.full((32, 40), 1 - ink, np.float32),
        Frame(x_mm=0, y_mm=0, width_mm=40, height_mm=32),
        width_px=40,
    )
    red, green, blue = np.asarray(picture)[16, 20].tolist()
    return red, green, blue


@pytest.mark.parametrize("ink", [0.0, 0.6, 1.0])
def test_lighter_is_blue_and_darker_is_orange_to_red_over_any_content(ink: float) -> None:
    for strength in (8.0, 12.0, 900.0):
        red, _, blue = colours_of(strength, ink=ink)
        assert blue > red + 60
        red, _, blue = colours_of(-strength, ink=ink)
        assert red > blue + 60
    red, green, blue = colours_of(0.0, ink=ink)
    assert min(red, green, blue) > 180  # the ghost is faint
    assert max(red, green, blue) - min(red, green, blue) <= 3


def test_colours_saturate_and_darken_evenly_to_both_ends() -> None:
    steps = np.linspace(-pictures.SATURATION, pictures.SATURATION, 97).astype(np.float32)
    luma = pictures.error_colours(steps) @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luma[:49]) > 0).all()
    assert (np.diff(luma[48:]) < 0).all()
    assert (pictures.error_colours(np.float32([40.0])) == pictures.error_colours(np.float32([12.0]))).all()


def test_of_several_sensors_the_one_farthest_off_is_shown() -> None:
    z = np.zeros((2, 4, 4), np.float32)
    z[0, 0, 0], z[1, 0, 0] = 3.0, -11.0
    z[0, 3, 3], z[1, 3, 3] = 11.0, -3.0
    frame = Frame(x_mm=0, y_mm=0, width_mm=32, height_mm=32)
    picture = np.asarray(pictures.error_picture(z, np.ones((32, 32), np.float32), frame, width_px=32)).astype(
        int
    )
    assert picture[1, 1, 0] > picture[1, 1, 2]
    assert picture[-2, -2, 2] > picture[-2, -2, 0]


def test_blocks_lie_where_their_pixels_lie_when_the_page_is_no_whole_number_of_blocks() -> None:
    z = np.zeros((1, 5, 6), np.float32)
    z[0, 4, 5] = 12.0  # lines 32..39, pixels 40..47 of 43 x 51
    frame = Frame(x_mm=0, y_mm=0, width_mm=51, height_mm=43)
    picture = np.asarray(pictures.error_picture(z, np.ones((43, 51), np.float32), frame, width_px=102))
    blue = np.argwhere(picture[..., 0] < 100)
    pixel = picture.shape[1] / 51
    # to one picture pixel of rounding
    assert np.abs(blue.min(axis=0) - np.array([32, 40]) * pixel).max() <= 1
    assert np.abs(blue.max(axis=0) + 1 - np.array([40, 48]) * pixel).max() <= 1


def test_a_page_smaller_than_a_block_has_a_plain_error_picture() -> None:
    frame = Frame(x_mm=0, y_mm=0, width_mm=0.5, height_mm=0.3)
    picture = pictures.error_picture(
        np.zeros((1, 0, 0), np.float32), np.ones((3, 5), np.float32), frame, width_px=700
    )
    assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) == 1


@pytest.mark.parametrize(("width_mm", "height_mm"), [(2.0, 2.0), (40.0, 3.0), (3.0, 60.0)])
def test_odd_pages_have_all_their_pictures(
    press: Press, make_page: Callable[..., Page], width_mm: float, height_mm: float
) -> None:
    page = make_page(3, width_mm=width_mm, height_mm=height_mm)
    place = Region(x_mm=0.5, y_mm=0.5, width_mm=0.4, height_mm=0.4, score=20.0, kind="streak")
    made = pictures.alarm_pictures(page, inspected(page, press), press, place=place)
    for picture in (made.expected, made.measured, made.error):
        width, height = Image.open(io.BytesIO(picture)).size
        # within a pixel, the picture has the frame's shape
        assert abs(height - width * made.frame.height_mm / made.frame.width_mm) <= 1
    assert made.frame.width_mm == pytest.approx(width_mm, abs=0.25)
    assert made.frame.height_mm == pytest.approx(height_mm, abs=0.25)
    assert made.zoom is not None
    assert made.zoom.columns >= 15


def zoomed(region: Region, strongest: tuple[int, int] = (0, 0)) -> pictures.Zoom | None:
    z = np.zeros((1, 350, 250), np.float32)
    z[0, strongest[0], strongest[1]] = -50.0
    image = np.ones((2800, 2000), np.float32)
    return pictures.zoom(region, z, image, image, A4)


@given(x=st.floats(0, 205), y=st.floats(0, 290), width=st.floats(0.1, 200), height=st.floats(0.1, 290))
def test_zooms_stay_on_the_page_and_show_the_place(x: float, y: float, width: float, height: float) -> None:
    width, height = min(width, 210 - x), min(height, 297 - y)
    region = Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=9, kind="streak")
    zoom = zoomed(region)
    if width * height > pictures.LARGE_REGION_SHARE * 210 * 297:
        assert zoom is None
        return
    assert zoom is not None
    shown, pixel = zoom.frame, 210 / 2000
    assert shown.x_mm >= 0
    assert shown.y_mm >= 0
    assert shown.x_mm + shown.width_mm <= 210 + 1e-6
    assert shown.y_mm + shown.height_mm <= 297 + 1e-6
    for side in (shown.width_mm, shown.height_mm):
        assert pictures.ZOOM_MM - pixel <= side <= pictures.MOST_ZOOM_MM + pixel
    # it shows at least a part of the region, and all of it along an axis where there is room for its margins
    assert shown.x_mm <= x + width
    assert shown.x_mm + shown.width_mm >= x
    if max(width, height) <= pictures.MOST_ZOOM_MM - 2 * pictures.ZOOM_MARGIN_MM:
        assert shown.x_mm <= x + pixel
        assert shown.x_mm + shown.width_mm >= x + width - pixel
        assert shown.y_mm <= y + pixel
        assert shown.y_mm + shown.height_mm >= y + height - pixel


def test_a_zoom_of_a_long_streak_is_square_around_its_strongest_place() -> None:
    block_mm = 8 * 210 / 2000
    region = Region(x_mm=84.0, y_mm=0.0, width_mm=1.7, height_mm=297.0, score=9, kind="streak")
    zoom = zoomed(region, strongest=(200, 101))
    assert zoom is not None
    assert zoom.frame.width_mm == pytest.approx(zoom.frame.height_mm, abs=0.2)
    middle = zoom.frame.y_mm + zoom.frame.height_mm / 2
    assert middle == pytest.approx(200.5 * 297 / 350, abs=block_mm)


def test_a_faint_streak_is_made_visible_in_both_zooms_alike() -> None:
    expected = np.full((400, 400), 0.5, np.float32)
    measured = expected.copy()
    measured[:, 200:210] *= 0.93
    z = np.zeros((1, 50, 50), np.float32)
    region = Region(x_mm=21.0, y_mm=0.0, width_mm=1.0, height_mm=42.0, score=9, kind="streak")
    frame = Frame(x_mm=0, y_mm=0, width_mm=42, height_mm=42)
    zoom = pictures.zoom(region, z, expected, measured, frame)
    assert zoom is not None
    plain, striped = (
        np.asarray(Image.open(io.BytesIO(data)).convert("L")).astype(int)
        for data in (zoom.expected, zoom.measured)
    )
    assert zoom.contrast == pytest.approx(1 / pictures.LEAST_CONTRAST)
    assert np.ptp(plain) == 0
    assert np.ptp(striped) > 50  # unraised it would be 6
    assert striped.max() == plain.max()
