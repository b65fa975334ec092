"""Planes that share their edges: found by fringes on small pages, 36 x 44 mm under 400 pixels, raster 0.053 mm."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.fit.residuals import in_register
from prooflight.detectors.print_prior import PrintPrior
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.registration.overlaps import overlaps_of
from prooflight.registration.patches import Patches
from prooflight.registration.planes import FringeRegister, register_by_fringes, register_far_planes
from prooflight.registration.register import prepare, register
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.prints import draw_placement
from prooflight.simulation.scans import ideal_scan
from prooflight.simulation.worlds import Amounts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.registration.register import Landmarks, Registration
    from prooflight.scans.placement import Placement

DPI = 481.8
FOUR_INKS = (180, 170, 160, 230)
"""A black of four inks: C 71, M 67, Y 63, K 90 %."""
BLACK = (0, 0, 0, 255)
GOOD_MM = PrintPrior().most_plane_mm
INK_STEPS = {
    "cyan": [[1, 0], [0, 0], [0, 0], [0, 0]],
    "two apart": [[0, 1], [0, 0], [-2, 0], [0, 0]],
    "black": [[0, 0], [0, 0], [0, 0], [2, -1]],
    "all": [[-1, 0], [1, 1], [0, -1], [1, 0]],
}
"""By how many raster pixels planes C, M, Y, K lie too far right and down; 2 are 0.105 mm, what good prints may do."""


def set_in(ink: tuple[int, int, int, int]) -> Page:
    """Type-like stems and bars, 0.4 mm wide, over the whole page."""
    rng = np.random.default_rng(3)
    rows, columns = (round(extent * DPI / 25.4) for extent in (44.0, 36.0))
    stem = round(0.4 * DPI / 25.4)
    on = rng.random((rows // stem + 1, columns // stem + 1)) < 0.35
    on[:4], on[-4:], on[:, :4], on[:, -4:] = False, False, False, False
    printed = np.kron(on, np.ones((stem, stem), bool))[:rows, :columns]
    return Page(cmyk=(printed[..., None] * np.array(ink)).astype(np.uint8), dpi=DPI, name="type", number=1)


def displaced(page: Page, steps: NDArray[np.int64]) -> Page:
    """The page with its planes so many raster pixels too far right and down; its border is bare."""
    planes = [
        np.roll(page.cmyk[..., ink], (down, right), axis=(0, 1)) for ink, (right, down) in enumerate(steps)
    ]
    return replace(page, cmyk=np.stack(planes, axis=-1))


def landmarks_of(page: Page, press: Press) -> Landmarks:
    prediction = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    return prepare(page, prediction, sensors=press.sensors, geometry=press.geometry)


def scan_of(page: Page, press: Press, placement: Placement) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)
    return ideal_scan(seen, press, np.random.default_rng(1))


def by_fringes(
    page: Page, press: Press, printed: Page, placement: Placement, *, good_mm: float = GOOD_MM
) -> tuple[Registration, FringeRegister | None]:
    landmarks = landmarks_of(page, press)
    overlaps = overlaps_of(page, landmarks, good_mm=good_mm)
    assert overlaps is not None
    scan = scan_of(printed, press, placement)
    found = register(landmarks, scan)
    return found, register_by_fringes(overlaps, landmarks, scan, found)


def apart(planes_mm: NDArray[np.float64], page: Page) -> NDArray[np.int64]:
    """(3, 2) how far C, M and Y lie off K: where all lie together is the page's place. [raster pixels]"""
    steps = np.rint(planes_mm / page.pixel_mm).astype(np.int64)
    return steps[:3] - steps[3]


@pytest.mark.parametrize("name", INK_STEPS)
def test_planes_of_type_in_four_inks_are_found_to_the_raster_pixel(
    two_sensor_press: Press, name: str
) -> None:
    page, steps = set_in(FOUR_INKS), np.array(INK_STEPS[name])
    placement = draw_placement(Amounts.stated().page, page, np.random.default_rng(5))
    found, fringes = by_fringes(page, two_sensor_press, displaced(page, steps), placement)
    assert fringes is not None
    np.testing.assert_array_equal(apart(fringes.planes_mm, page), steps[:3] - steps[3])
    # Where tiles lie cannot tell planes apart whose edges lie together.
    assert (apart(found.planes_mm, page) != steps[:3] - steps[3]).any()


def test_what_is_predicted_then_lies_where_it_was_printed(two_sensor_press: Press) -> None:
    """Placement and planes together: each plane to a tenth of a camera pixel, 0.011 mm, what registration errs by."""
    page, steps = set_in(FOUR_INKS), np.array(INK_STEPS["all"])
    _, fringes = by_fringes(page, two_sensor_press, displaced(page, steps), IN_PLACE)
    assert fringes is not None
    lie_mm = np.array(fringes.placement.shift_mm) + fringes.planes_mm
    assert np.abs(lie_mm - steps * page.pixel_mm).max() < 0.011


def test_planes_of_a_press_that_rips_itself_are_found_and_predicted_between_raster_pixels(
    two_sensor_press: Press,
) -> None:
    """Register of 0.4 raster pixels, printed from a raster five times as fine.

    By half pixels each plane is found to an eighth of a pixel, where whole ones are off by up to 0.4, and a quarter of
    the squared residual is left at most (seen: an eighth).
    """
    page, fifths = set_in(FOUR_INKS), np.array([[2, 0], [0, 0], [0, -2], [0, 0]])
    fine = replace(page, cmyk=np.repeat(np.repeat(page.cmyk, 5, axis=0), 5, axis=1), dpi=5 * DPI)
    scan = scan_of(displaced(fine, fifths), two_sensor_press, IN_PLACE)
    landmarks = landmarks_of(page, two_sensor_press)
    found, off, left = register(landmarks, scan), {}, {}
    for finer, light in ((1, None), (2, two_sensor_press.ink_light)):
        overlaps = overlaps_of(page, landmarks, good_mm=GOOD_MM, finer=finer)
        assert overlaps is not None
        fringes = register_by_fringes(overlaps, landmarks.finer(finer), scan, found)
        assert fringes is not None
        lie = (np.array(fringes.placement.shift_mm) + fringes.planes_mm) / page.pixel_mm
        off[finer] = np.abs(lie - fifths / 5).max()
        printed, _ = in_register(page, fringes.planes_mm, good_mm=GOOD_MM, light=light)
        expected = predict(
            printed,
            sensors=two_sensor_press.sensors,
            geometry=two_sensor_press.geometry,
            placement=fringes.placement,
            threads=1,
        )
        left[finer] = float(np.square(scan - expected.expected_dn).sum())
    assert off[2] < 0.125 < off[1]
    assert left[2] < left[1] / 4


def test_what_is_in_black_lies_where_black_was_printed_below_a_title_in_colour(
    two_sensor_press: Press,
) -> None:
    """Fringes are those of the title; where the page lies is told by all of it. To a tenth of a camera pixel."""
    title, text = set_in(FOUR_INKS).cmyk, set_in(BLACK).cmyk
    page = replace(set_in(BLACK), cmyk=np.concatenate([title[: len(title) // 3], *[text] * 4]))
    steps = np.array([[0, 0], [0, 0], [0, 0], [0, 2]])
    _, fringes = by_fringes(page, two_sensor_press, displaced(page, steps), IN_PLACE)
    assert fringes is not None
    np.testing.assert_array_equal(apart(fringes.planes_mm, page), steps[:3] - steps[3])
    y_mm = np.array([0.5, 0.7, 0.9]) * page.height_mm
    x_mm = np.full_like(y_mm, page.width_mm / 2)
    seen = fringes.placement.seen_mm(x_mm, y_mm, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    lie_mm = np.stack([x_mm, y_mm]) - seen + fringes.planes_mm[3][:, None]
    assert np.abs(lie_mm - steps[3][:, None] * page.pixel_mm).max() < 0.011


@pytest.mark.parametrize("ink", range(4))
@pytest.mark.parametrize("away_mm", [0.32, 0.6])
def test_a_plane_out_of_register_is_stated_and_not_followed(
    two_sensor_press: Press, ink: int, away_mm: float
) -> None:
    """To the raster pixel, whichever plane the page's place follows; beyond a stroke of 0.4 mm, that or nothing."""
    page, steps = set_in(FOUR_INKS), np.zeros((4, 2), np.int64)
    steps[ink, 0] = round(away_mm / page.pixel_mm)
    landmarks, scan = (
        landmarks_of(page, two_sensor_press),
        scan_of(displaced(page, steps), two_sensor_press, IN_PLACE),
    )
    registration, overlaps = register(landmarks, scan), overlaps_of(page, landmarks, good_mm=GOOD_MM)
    assert overlaps is not None
    fringes = register_by_fringes(overlaps, landmarks, scan, registration)
    assert fringes is None or not apart(fringes.planes_mm, page).any()
    far = register_far_planes(page, landmarks, scan, registration)
    if far is None:
        assert away_mm > 0.4
    else:
        planes_mm, located = far
        assert located.all()
        np.testing.assert_array_equal(apart(planes_mm, page), steps[:3] - steps[3])


def test_planes_of_a_press_that_varies_more_are_followed_further(two_sensor_press: Press) -> None:
    """Cyan and black 0.32 mm apart: good where planes are off by up to 0.171 mm, a misprint where by 0.114."""
    page, steps = set_in(FOUR_INKS), np.zeros((4, 2), np.int64)
    steps[0, 0], steps[3, 0] = -3, 3
    printed = displaced(page, steps)
    _, fringes = by_fringes(page, two_sensor_press, printed, IN_PLACE, good_mm=1.5 * GOOD_MM)
    assert fringes is not None
    np.testing.assert_array_equal(apart(fringes.planes_mm, page), steps[:3] - steps[3])
    _, fringes = by_fringes(page, two_sensor_press, printed, IN_PLACE)
    assert fringes is None or not apart(fringes.planes_mm, page).any()


def test_planes_in_register_stay(two_sensor_press: Press) -> None:
    page = set_in(FOUR_INKS)
    _, fringes = by_fringes(page, two_sensor_press, page, IN_PLACE)
    assert fringes is not None
    assert not fringes.planes_mm.any()


def test_renderings_do_not_depend_on_those_before(two_sensor_press: Press) -> None:
    """Light that an earlier set of displacements has left is only used where recipes are the same."""
    page = set_in(FOUR_INKS)
    landmarks = landmarks_of(page, two_sensor_press)
    overlaps = overlaps_of(page, landmarks, good_mm=GOOD_MM)
    assert overlaps is not None
    scan = scan_of(page, two_sensor_press, IN_PLACE)
    registration = register(landmarks, scan)
    many = [tuple(steps) for steps in np.random.default_rng(1).integers(-2, 3, (40, 8)).tolist()]
    costs = []
    for order in (many, many[::-1]):
        patches = Patches.of(overlaps, landmarks, scan, registration)
        assert patches is not None
        costs.append(dict(zip(order, patches.costs(order), strict=True)))
    assert costs[0] == costs[1]


def test_a_page_of_one_ink_has_no_shared_edges(two_sensor_press: Press) -> None:
    page = set_in(BLACK)
    landmarks = landmarks_of(page, two_sensor_press)
    assert overlaps_of(page, landmarks, good_mm=GOOD_MM) is None
    scan = scan_of(page, two_sensor_press, IN_PLACE)
    assert register_far_planes(page, landmarks, scan, register(landmarks, scan)) is None


@pytest.mark.parametrize("ink", [BLACK, FOUR_INKS], ids=["one ink", "four inks"])
@pytest.mark.parametrize(
    "residual_variance", [ResidualVariance(), ResidualVariance.none()], ids=["varies", "exact"]
)
def test_a_look_without_fringes_is_what_it_was(
    two_sensor_press: Press, ink: tuple[int, int, int, int], residual_variance: ResidualVariance
) -> None:
    """Bit by bit; with them it differs only where planes share edges and prints vary."""
    press, page = two_sensor_press, set_in(ink)
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    scan = scan_of(displaced(page, np.array(INK_STEPS["all"])), press, IN_PLACE)
    looks = []
    for how in ({}, {"fringes": False}, {"fringes": True}):
        known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry, **how)
        looks.append(analyse(known, scan, residual_variance=residual_variance))
    plain, off, on = looks
    np.testing.assert_array_equal(off.sums.tiles, plain.sums.tiles)
    np.testing.assert_array_equal(off.fit.pulls, plain.fit.pulls)
    np.testing.assert_array_equal(
        on.registration.planes_mm, plain.registration.planes_mm
    )  # evidence stays registration's
    followed = ink == FOUR_INKS and not residual_variance.exact
    assert np.array_equal(on.sums.tiles, plain.sums.tiles) != followed


def test_fringes_followed_leave_less(two_sensor_press: Press) -> None:
    """A good print's planes off by a raster pixel or two: its inks then need no gain to be explained."""
    press, page = two_sensor_press, set_in(FOUR_INKS)
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    scan = scan_of(displaced(page, np.array(INK_STEPS["all"])), press, IN_PLACE)
    most = []
    for fringes in (False, True):
        known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry, fringes=fringes)
        analysis = analyse(known, scan)
        most.append(float(np.abs(analysis.fit.pulls).max()))
    assert most[1] < 0.7 * most[0]


@pytest.mark.parametrize("rips_itself", [False, True], ids=["our raster", "its own RIP"])
def test_groups_that_are_flat_in_the_design_save_work_and_change_nothing(
    two_sensor_press: Press, rips_itself: bool
) -> None:
    """Planes lie off by whole raster pixels, or by parts of one: a group may differ where the design does not."""
    press, page = two_sensor_press, set_in(FOUR_INKS)
    placement = draw_placement(Amounts.stated().page, page, np.random.default_rng(5))
    scan = scan_of(displaced(page, np.array(INK_STEPS["all"])), press, placement)
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    how = {"sensors": press.sensors, "geometry": press.geometry, "fringes": True}
    prepared = prepare_page(page, expected, own_light=press.ink_light if rips_itself else None, **how)
    flat = prepared.flat
    assert flat.flat.any()
    with_flat, without = (
        analyse(one, scan)
        for one in (prepared, replace(prepared, flat=replace(flat, flat=np.zeros_like(flat.flat))))
    )
    np.testing.assert_array_equal(with_flat.sums.tiles, without.sums.tiles)
    np.testing.assert_array_equal(with_flat.marks.greatest, without.marks.greatest)
