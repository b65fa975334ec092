"""The press world's effects appear in a scan as they should, and as the full spectral path has them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.placement import Placement, Warp
from prooflight.simulation.fast import fast_mean_variance, fast_scan, noisy
from prooflight.simulation.prints import Print, Speck
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts
from prooflight_studies.edges.rig import Rig
from prooflight_studies.exact.exposure import page_electrons
from prooflight_studies.exact.scans import PrintedInks, Specimen, exact_mean_variance

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile


WIDTH_MM, HEIGHT_MM = 14.0, 12.0


LOOKED_UP_ONCE = 0.04
"""What looking up squares of nearly equal pixels only once may cost [sigma rms]: 0.030 seen, a third above it."""


@pytest.fixture(scope="module")
def rig(prototype: PressFile) -> Rig:
    return Rig.build(prototype, pixels=190)


@pytest.fixture(scope="module")
def specimen(rig: Rig) -> Specimen:
    return Specimen(
        press=rig.press,
        camera=rig.camera,
        inks=rig.press_file.inks(),
        backing_reflectance=rig.press_file.backing_reflectance,
    )


@pytest.fixture(scope="module")
def small(rig: Rig, make_page: Callable[..., Page]) -> Page:
    return make_page(3, width_mm=WIDTH_MM, height_mm=HEIGHT_MM, dpi=rig.press.dpi)


@pytest.fixture(scope="module")
def still(rig: Rig, small: Page) -> tuple[Session, Print]:
    """A session and a print that vary in nothing."""
    session = Session.draw(Amounts.stated({"all_times": 0.0}), rig.press, stream(1, "session"))
    return session, Print.draw(session, rig.press, small, np.random.default_rng(1))


def tint(rig: Rig, **inks: int) -> Page:
    cmyk = np.zeros(
        (round(HEIGHT_MM / 25.4 * rig.press.dpi), round(WIDTH_MM / 25.4 * rig.press.dpi), 4), np.uint8
    )
    for ink, value in inks.items():
        cmyk[..., "cmyk".index(ink)] = value
    return Page(cmyk=cmyk, dpi=rig.press.dpi, name="p0001", number=1)


def middle(press: Press, page: Page) -> tuple[slice, slice, slice]:
    """All sensors, and pixels well inside the page."""
    rows, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    return slice(None), slice(rows.start + 12, rows.stop - 12), slice(columns.start + 12, columns.stop - 12)


def changed(
    rig: Rig, page: Page, still: tuple[Session, Print], **fields: Any
) -> tuple[Prediction, Prediction]:
    """Without and with a change of the print."""
    session, print_ = still
    return (
        fast_mean_variance(page, rig.press, session, print_),
        fast_mean_variance(page, rig.press, session, replace(print_, **fields)),
    )


def test_where_nothing_varies_the_page_is_the_predicted_one(
    rig: Rig, small: Page, still: tuple[Session, Print]
) -> None:
    seen = fast_mean_variance(small, rig.press, *still)
    good = predict(small, sensors=rig.press.sensors, geometry=rig.press.geometry)
    sigma = np.sqrt(good.variance_dn2)
    z = (seen.expected_dn - good.expected_dn) / sigma
    assert np.sqrt(np.mean(z**2)) < LOOKED_UP_ONCE
    np.testing.assert_allclose(seen.variance_dn2, good.variance_dn2, rtol=0.01)


@pytest.mark.parametrize(("warp_mm", "most"), [(0.0, LOOKED_UP_ONCE), (0.03, 0.6)], ids=["turned", "bent"])
def test_the_page_moves_as_placed(
    rig: Rig, small: Page, still: tuple[Session, Print], warp_mm: float, most: float
) -> None:
    """A turn shears footprints alike in both orders of filtering, and a warp does not.

    Prediction, along first, leaves out how the warp shears a footprint across, and simulation along. This warp is five
    times as steep as the press world's: 0.03 mm in 5 mm instead of 25.
    """
    nodes = np.random.default_rng(1).normal(0, warp_mm, (4, 4, 2)).astype(np.float32)
    placement = Placement(
        shift_mm=(0.3, -0.2),
        skew_deg=0.1,
        stretch_percent=(0.03, -0.02),
        warp=Warp(nodes_mm=nodes, pitch_mm=5.0),
    )
    _, seen = changed(rig, small, still, placement=placement)
    moved = predict(small, sensors=rig.press.sensors, geometry=rig.press.geometry, placement=placement)
    z = (seen.expected_dn - moved.expected_dn) / np.sqrt(moved.variance_dn2)
    assert np.sqrt(np.mean(z**2)) < most


@pytest.mark.parametrize("ink", range(4))
def test_a_plane_moves_by_whole_raster_pixels(
    rig: Rig, small: Page, still: tuple[Session, Print], ink: int
) -> None:
    register = np.zeros((4, 2))
    register[ink] = (2.2 * small.pixel_mm, -0.9 * small.pixel_mm)
    _, seen = changed(rig, small, still, register_mm=register)
    cmyk = small.cmyk.copy()
    cmyk[..., ink] = 0
    cmyk[:-1, 2:, ink] = small.cmyk[1:, :-2, ink]
    moved = fast_mean_variance(replace(small, cmyk=cmyk), rig.press, *still)
    np.testing.assert_array_equal(seen.expected_dn, moved.expected_dn)


def test_ink_gain_is_more_ink(rig: Rig, still: tuple[Session, Print]) -> None:
    """A tint of 100 with a gain of 10 % is one of 110; a dot gain of 2 % adds 8 % a (1 - a)."""
    page, more = tint(rig, c=100, k=40), tint(rig, c=110, k=40)
    _, seen = changed(rig, page, still, ink_gain=np.array([0.1, 0, 0, 0]))
    plain = fast_mean_variance(more, rig.press, *still)
    where = middle(rig.press, page)
    np.testing.assert_allclose(seen.expected_dn[where], plain.expected_dn[where], rtol=1e-5)
    a = 100 / 255
    grown = a + 4 * 0.02 * a * (1 - a)
    _, dots = changed(rig, page, still, dot_gain=np.array([0.02, 0, 0, 0]))
    _, gain = changed(rig, page, still, ink_gain=np.array([grown / a - 1, 0, 0, 0]))
    np.testing.assert_allclose(dots.expected_dn[where], gain.expected_dn[where], rtol=1e-5)


def test_a_tilt_is_a_gain_that_grows_over_the_page(rig: Rig, still: tuple[Session, Print]) -> None:
    page = tint(rig, m=120)
    tilt = np.zeros((4, 2))
    tilt[1, 0] = 0.02  # right
    plain, seen = changed(rig, page, still, ink_tilt=tilt)
    where = middle(rig.press, page)
    change = (seen.expected_dn / plain.expected_dn)[where][0].mean(axis=0) - 1
    x = rig.press.geometry.centres_x_mm(page.width_mm)[where[2]]
    fit = np.polyfit(2 * x / page.width_mm - 1, change, 1)
    _, gained = changed(rig, page, still, ink_gain=np.array([0, 0.01, 0, 0]))
    slope = 2 * ((gained.expected_dn / plain.expected_dn)[where].mean() - 1)
    assert fit[0] == pytest.approx(float(slope), rel=0.05)
    assert fit[1] == pytest.approx(0, abs=0.1 * abs(float(slope)))  # light is curved in ink


def test_light_and_paper_multiply(rig: Rig, small: Page, still: tuple[Session, Print]) -> None:
    session, print_ = still
    rng = np.random.default_rng(2)
    white, lamp = np.array([1.02]), 1 + rng.normal(0, 0.01, print_.lamp.size)
    flicker = 1 + rng.normal(0, 0.01, print_.flicker.size)
    day = replace(session.sensors[0], table_gain=0.97, sigma_error=1.4)
    day = replace(day, column_gain=1 + rng.normal(0, 0.01, print_.lamp.size))
    today = replace(session, sensors=(day,), lamp=1 + rng.normal(0, 0.01, print_.lamp.size))
    plain = fast_mean_variance(small, rig.press, session, print_)
    seen = fast_mean_variance(
        small, rig.press, today, replace(print_, white=white, lamp=lamp, flicker=flicker)
    )
    model = rig.press.sensors[0]
    where = middle(rig.press, small)
    signal, before = (
        (s.expected_dn - model.column_offset_dn)[where][0].astype(np.float64) for s in (seen, plain)
    )
    factor = 0.97 * 1.02 * (today.lamp * lamp * day.column_gain) * flicker[:, None]
    np.testing.assert_allclose(signal, before * factor[where[1:]], rtol=1e-4)
    above_dark = plain.variance_dn2[where][0] - model.dark_variance_dn2
    temporal = model.dark_variance_dn2 - 1 / 12 + above_dark * factor[where[1:]]
    np.testing.assert_allclose(seen.variance_dn2[where][0], 1.4**2 * temporal + 1 / 12, rtol=5e-3)
    off = np.s_[0, 2:-2, 1]  # beside the page, far from it: paper does not matter there
    backing = (seen.expected_dn - model.column_offset_dn)[off] / (plain.expected_dn - model.column_offset_dn)[
        off
    ]
    np.testing.assert_allclose(backing, (factor / 1.02)[2:-2, 1], rtol=2e-3)


def test_clouds_lie_on_the_page_only(rig: Rig, still: tuple[Session, Print]) -> None:
    page = tint(rig)
    cloud = np.full_like(still[1].cloud, 0.05)
    plain, seen = changed(rig, page, still, cloud=cloud)
    where = middle(rig.press, page)
    offset = rig.press.sensors[0].column_offset_dn
    ratio = (seen.expected_dn - offset) / (plain.expected_dn - offset)
    np.testing.assert_allclose(ratio[where], 1.05, rtol=1e-5)
    np.testing.assert_array_equal(ratio[0, :, :2], 1)


def test_a_speck_darkens_its_place(rig: Rig, still: tuple[Session, Print]) -> None:
    page = tint(rig)
    speck = Speck(x_mm=5.0, y_mm=7.0, diameter_mm=0.5, ink=3, share=0.1)
    plain, seen = changed(rig, page, still, specks=(speck,))
    lost = (plain.expected_dn - seen.expected_dn)[0]
    solid = fast_mean_variance(tint(rig, k=26), rig.press, *still).expected_dn
    depth = (plain.expected_dn - solid)[middle(rig.press, page)].mean()
    pitch = rig.press.geometry.pixel_pitch_mm
    assert lost.sum() * pitch**2 == pytest.approx(depth * np.pi * 0.25**2, rel=0.1)
    y, x = rig.press.geometry.centres_y_mm(len(lost)), rig.press.geometry.centres_x_mm(page.width_mm)
    assert (lost.sum(axis=0) * x).sum() / lost.sum() == pytest.approx(5.0, abs=0.03)
    assert (lost.sum(axis=1) * y).sum() / lost.sum() == pytest.approx(7.0, abs=0.03)


def test_halftone_is_variance_and_no_mean(rig: Rig, still: tuple[Session, Print]) -> None:
    """c^2 J^2 a (1 - a), J from two tints; c = 0.03 x 0.254 mm / pitch."""
    session, print_ = still
    amounts = replace(session.amounts, ink=replace(session.amounts.ink, halftone_contrast=0.03))
    page = tint(rig, c=128)
    where = middle(rig.press, page)
    plain = fast_mean_variance(page, rig.press, session, print_)
    seen = fast_mean_variance(page, rig.press, replace(session, amounts=amounts), print_)
    np.testing.assert_array_equal(seen.expected_dn, plain.expected_dn)
    low, high = (fast_mean_variance(tint(rig, c=c), rig.press, session, print_) for c in (120, 136))
    slope = ((high.expected_dn - low.expected_dn)[where] * (255 / 16)).astype(np.float64)
    contrast = 0.03 * 0.254 / rig.press.geometry.pixel_pitch_mm
    a = 128 / 255
    np.testing.assert_allclose(
        (seen.variance_dn2 - plain.variance_dn2)[where], contrast**2 * slope**2 * a * (1 - a), rtol=0.02
    )


def test_noise_is_normal_white_and_reproducible(rig: Rig, still: tuple[Session, Print]) -> None:
    seen = fast_mean_variance(tint(rig, k=60), rig.press, *still)
    seen.expected_dn[:] = 2000.3
    seen.variance_dn2[:] = 900.0
    n = seen.expected_dn.size
    dn = noisy(seen, rig.press, np.random.default_rng(5))
    z = (dn[0].astype(np.float64) - 2000.3) / 30
    assert z.mean() == pytest.approx(0, abs=5 / np.sqrt(n))
    assert z.std() == pytest.approx(1, abs=5 / np.sqrt(2 * n))
    # rounding is 1/30 of sigma: the steps are lost in the test's own error
    assert stats.kstest(z.ravel(), "norm").pvalue > 1e-3
    for one, other in ((z[:-1], z[1:]), (z[:, :-1], z[:, 1:]), (z[:, :-2], z[:, 2:])):
        assert np.corrcoef(one.ravel(), other.ravel())[0, 1] == pytest.approx(0, abs=5 / np.sqrt(n))
    np.testing.assert_array_equal(dn, noisy(seen, rig.press, np.random.default_rng(5)))
    assert (dn != noisy(seen, rig.press, np.random.default_rng(6))).mean() > 0.9


def test_a_scan_is_its_mean_and_variance(rig: Rig, small: Page) -> None:
    session = Session.draw(Amounts.stated(), rig.press, stream(3, "session"))
    print_ = Print.draw(session, rig.press, small, np.random.default_rng(3))
    seen = fast_mean_variance(small, rig.press, session, print_)
    scans = [
        fast_scan(small, rig.press, session, print_, rng=np.random.default_rng(seed)) for seed in range(60)
    ]
    z = (np.stack(scans) - seen.expected_dn) / np.sqrt(seen.variance_dn2)
    clear = (seen.expected_dn > 5 * np.sqrt(seen.variance_dn2)) & (seen.expected_dn < 4000)  # no clipping
    assert np.mean(z[:, clear]) == pytest.approx(0, abs=5 / np.sqrt(z[:, clear].size))
    assert np.mean(z[:, clear] ** 2) == pytest.approx(1, rel=5 * np.sqrt(2 / z[:, clear].size))


def test_both_paths_agree_in_the_press_world(rig: Rig, specimen: Specimen, small: Page) -> None:
    """The study of worlds has the figures of 20 designs; this page is half edges, and dark, which is harder.

    Without tilt, whose blending takes the full path nine times as long.
    """
    session = Session.draw(Amounts.stated(), rig.press, stream(2, "session"))
    print_ = Print.draw(session, rig.press, small, np.random.default_rng(2))
    print_ = replace(print_, ink_tilt=np.zeros((4, 2)))
    fast = fast_mean_variance(small, rig.press, session, print_)
    full = exact_mean_variance(small, specimen, session, print_)
    z = (fast.expected_dn - full.expected_dn) / np.sqrt(full.variance_dn2)
    assert np.sqrt(np.mean(z**2)) < 0.2  # 0.16; 0.15 over the study's pages
    relative = fast.variance_dn2 / full.variance_dn2 - 1
    assert np.sqrt(np.mean(relative**2)) < 0.03


def test_a_placed_exposure_is_an_exposure_at_that_place(
    rig: Rig, specimen: Specimen, small: Page, still: tuple[Session, Print]
) -> None:
    """Interpolated between fine exposures, against the camera's own pixels at the worst phases."""
    session, print_ = still
    geometry = rig.press.geometry
    shift = (geometry.pixel_pitch_mm / 16, geometry.pixel_pitch_mm / 8)
    seen = exact_mean_variance(small, specimen, session, replace(print_, placement=Placement(shift_mm=shift)))
    electrons = page_electrons(
        rig.camera,
        specimen.inks,
        small,
        centres_x_mm=geometry.centres_x_mm(small.width_mm, shift_mm=shift[0]),
        centres_y_mm=geometry.centres_y_mm(geometry.lines(small.height_mm), shift_mm=shift[1]),
        backing_reflectance=specimen.backing_reflectance,
        falloff=False,
    )[0]
    model = rig.press.sensors[0]
    direct = model.column_offset_dn + model.column_gain * electrons * rig.camera.sensors[0].dn_per_e
    z = (seen.expected_dn[0] - direct.clip(min=0)) / np.sqrt(seen.variance_dn2[0])
    assert np.sqrt(np.mean(z**2)) < 0.15


def test_printed_inks_change_what_is_printed(specimen: Specimen) -> None:
    session = Session.draw(Amounts.stated({"all_times": 0.0}), specimen.press, stream(1, "session"))
    inks = PrintedInks(
        inks=specimen.inks,
        gain=np.array([0.1, 0, 0, -1.0]),
        dot_gain=np.zeros(4),
        white=1.1,
        day=session.sensors[0],
        weight=np.ones(36),
    )
    recipe = np.array([[0.5, 0.2, 0.0, 0.7]])
    expected = 1.1 * specimen.inks.reflectance(np.array([[0.55, 0.2, 0.0, 0.0]]))
    np.testing.assert_allclose(inks.reflectance(recipe), expected)
    # beyond a solid, at 110 %: on as over the last step, which ends at 256/255
    last, before = (specimen.inks.reflectance(np.array([[c / 255, 0, 0, 0]])) for c in (256, 248))
    factor = (last.sum() / before.sum()) ** ((1.1 - 256 / 255) * 255 / 8)
    np.testing.assert_allclose(inks.reflectance(np.array([[1.0, 0, 0, 0]])), 1.1 * last * factor)
