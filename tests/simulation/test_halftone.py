"""Pages that are printed by dots take the light of the tints that they stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.pages.raster import Page
from prooflight.pages.screen import Screen, screened
from prooflight.rng import stream
from prooflight.simulation.fast import fast_mean_variance
from prooflight.simulation.halftone import PRINTED_DPI, averaged, dot_gain_factor, halftoned
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

AM = Screen(kind="am", dpi=1200.0, lpi=175.0)
SCREENS = [AM, Screen(kind="fm", dpi=1200.0), Screen(kind="error-diffusion", dpi=1200.0)]
SIDE_MM = 26.0


def tint(press: Press, recipe: tuple[int, ...]) -> Page:
    side = round(SIDE_MM / 25.4 * press.dpi)
    cmyk = np.broadcast_to(np.array(recipe, np.uint8), (side, side, 4))
    return Page(cmyk=np.ascontiguousarray(cmyk), dpi=press.dpi, name="p0001", number=1)


@pytest.fixture(scope="module")
def session(press: Press) -> Session:
    return Session.draw(Amounts.stated({"all_times": 0.0}), press, stream(1, "session"))


def light(page: Page, press: Press, session: Session, dot_gain: float = 0.0) -> float:
    """Mean light of the middle of a page, as a share of paper white."""
    print_ = Print.draw(session, press, page, np.random.default_rng(1))
    print_ = replace(print_, dot_gain=np.full(4, dot_gain))
    seen = fast_mean_variance(page, press, session, print_).expected_dn[0]
    rows, columns = press.geometry.on_page(SIDE_MM, SIDE_MM)
    middle = seen[rows.start + 24 : rows.stop - 24, columns.start + 24 : columns.stop - 24]
    return float(middle.mean()) / press.sensors[0].white_dn


# A tint of one ink: what rounding to bytes leaves, and parts of dots at the window's edges. Dots of several inks
# overlap by chance, for which tables of tints have a curve of their own: up to 0.65 % of white were seen, by AM.
@pytest.mark.parametrize("screen", SCREENS, ids=lambda screen: screen.kind)
@pytest.mark.parametrize(
    ("recipe", "tolerance"),
    [
        ((128, 0, 0, 0), 0.004),
        ((0, 0, 128, 0), 0.004),
        ((0, 0, 0, 40), 0.004),
        ((0, 0, 0, 200), 0.004),
        ((60, 60, 0, 0), 0.004),
        ((128, 128, 128, 0), 0.008),
    ],
)
def test_a_screened_tint_is_as_light_as_the_tint(
    press: Press, session: Session, screen: Screen, recipe: tuple[int, ...], tolerance: float
) -> None:
    page = tint(press, recipe)
    plain, dots = light(page, press, session), light(page, press, session.printing(screen, press))
    assert dots == pytest.approx(plain, abs=tolerance)


@pytest.mark.parametrize("screen", [AM, SCREENS[2]], ids=lambda screen: screen.kind)
def test_dot_gain_darkens_a_screened_mid_tint_as_the_tint(
    press: Press, session: Session, screen: Screen
) -> None:
    page = tint(press, (128, 0, 0, 0))
    grown = [
        light(page, press, today, 0.02) - light(page, press, today)
        for today in (session, session.printing(screen, press))
    ]
    assert grown[0] < -0.005
    # The factor is the mean over the inks, whose curves of light differ.
    assert grown[1] == pytest.approx(grown[0], rel=0.1)


def test_a_page_is_screened_in_bands_as_it_is_at_once(press: Press) -> None:
    page = tint(press, (90, 30, 0, 60))
    bands = halftoned(page, AM, press.ink_light)
    assert bands.dpi == PRINTED_DPI
    rows, columns = bands.cmyk.shape[:2]
    assert (rows, columns) == (round(SIDE_MM / 25.4 * 600), round(SIDE_MM / 25.4 * 600))
    plates = np.ascontiguousarray(np.broadcast_to(page.cmyk[0, 0], (2 * rows, 2 * columns, 4)))
    whole, dpi = averaged(screened(plates, AM, tone=press.ink_light), AM.dpi, press.ink_light)
    assert dpi == PRINTED_DPI
    assert (bands.cmyk != whole).mean() < 1e-3  # the lattice's place is rounded (``test_screen``)


def test_pixels_that_are_not_finer_than_the_raster_are_printed_as_they_are(press: Press) -> None:
    plates = np.zeros((5, 6, 4), np.uint8)
    cmyk, dpi = averaged(plates, 600.0, press.ink_light)
    assert cmyk is plates
    assert dpi == 600.0


def test_solid_and_bare_pixels_alone_leave_dot_gain_bounded(press: Press) -> None:
    assert dot_gain_factor(Screen(kind="am", dpi=600.0, lpi=106.0), press.ink_light) == pytest.approx(10.0)
