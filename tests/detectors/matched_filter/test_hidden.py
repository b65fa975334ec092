"""Edges at which one ink ends as others begin, so that the light hardly changes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.modes import prepare_modes
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.fit.special_places import PLANE_SD, hidden_edges, with_hidden_edges
from prooflight.kernels.residuals.page_features import hidden_slopes
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.registration.register import prepare
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.registration.landmarks import Landmarks

DPI = 481.8
GROUND = (0, 0, 0, 102)
PATCH = (128, 102, 102, 0)
"""40 % black, and a grey of three inks that is as light."""


def slopes_of(gain: NDArray[np.float32], cover: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.empty(gain.shape[1:], np.float32)
    hidden_slopes(gain, cover, 0, len(out), out)
    return out


def test_the_hidden_slope_is_that_of_planes_less_that_of_their_light() -> None:
    """Closed form: sum |s_i|^2 - |sum s_i|^2, s_i the central difference of an ink's area times its effect per area."""
    rng = np.random.default_rng(2)
    cover = rng.uniform(0.1, 0.9, (4, 12, 15)).astype(np.float32)
    gain = (rng.uniform(100, 400, (4, 1, 1)) * cover).astype(np.float32)
    per_area = gain.astype(np.float64) / cover
    along, across = np.gradient(cover.astype(np.float64), axis=(1, 2))
    each = np.stack([per_area * across, per_area * along])
    asked = np.maximum((each**2).sum(axis=(0, 1)) - (each.sum(axis=1) ** 2).sum(axis=0), 0)
    np.testing.assert_allclose(slopes_of(gain, cover)[1:-1, 1:-1], asked[1:-1, 1:-1], rtol=1e-4, atol=1e-2)


def test_one_ink_hides_nothing_and_nor_do_inks_that_begin_together() -> None:
    cover = np.zeros((4, 9, 20), np.float32)
    cover[3, :, 10:] = 0.8
    assert slopes_of(500 * cover, cover).max() == 0
    cover[0, :, 10:] = 0.5
    assert slopes_of(500 * cover, cover).max() == 0


def grey_balance() -> Page:
    """Patches of three inks on a ground of black, as light as each other, 36 x 44 mm."""
    rows, columns = (round(extent * DPI / 25.4) for extent in (44.0, 36.0))
    cmyk = np.zeros((rows, columns, 4), np.uint8)
    cmyk[80:-80, 80:-80] = GROUND
    for top in range(120, rows - 200, 150):
        for left in range(110, columns - 160, 170):
            cmyk[top : top + 100, left : left + 120] = PATCH
    return Page(cmyk=cmyk, dpi=DPI, name="grey balance", number=1)


def test_a_chart_of_greys_has_such_edges_and_black_text_has_none(two_sensor_press: Press) -> None:
    page, sensors = grey_balance(), two_sensor_press.sensors
    modes = prepare_modes(page, sensors=sensors, geometry=two_sensor_press.geometry)
    hidden = hidden_edges(modes, sensors)
    assert hidden is not None
    white = np.array([one.white_dn for one in sensors])[:, None, None]
    assert (np.sqrt(hidden) / white).max() > 0.1
    black = replace(page, cmyk=page.cmyk * np.array([0, 0, 0, 1], np.uint8))
    modes = prepare_modes(black, sensors=sensors, geometry=two_sensor_press.geometry)
    assert hidden_edges(modes, sensors) is None


def test_their_variance_is_that_of_planes_out_of_register() -> None:
    texture, hidden = np.full((1, 3, 3), 5.0, np.float32), np.full((1, 3, 3), 400.0, np.float32)
    variance = ResidualVariance()
    added = with_hidden_edges(texture, hidden, variance)
    np.testing.assert_allclose(variance.contrast * (added - texture), PLANE_SD**2 * hidden, rtol=1e-5)
    assert with_hidden_edges(texture, None, variance) is texture
    assert with_hidden_edges(texture, hidden, ResidualVariance.none()) is texture


def test_tiles_of_such_edges_do_not_place_the_page(two_sensor_press: Press) -> None:
    """Those along the ground's own outline do, and every tile does where the same chart is of black alone."""
    page, press = grey_balance(), two_sensor_press

    def landmarks_of(one: Page) -> Landmarks:
        seen = predict(one, sensors=press.sensors, geometry=press.geometry, threads=1)
        return prepare(one, seen, sensors=press.sensors, geometry=press.geometry)

    mixed = landmarks_of(page).mixed
    assert 0.2 < mixed.mean() < 0.9
    assert not landmarks_of(replace(page, cmyk=page.cmyk * np.array([0, 0, 0, 1], np.uint8))).mixed.any()


@pytest.mark.parametrize("steps", [(0, 0), (2, 0), (0, 2), (-1, 2)])
def test_a_chart_of_greys_is_placed_whatever_its_register(
    two_sensor_press: Press, steps: tuple[int, int]
) -> None:
    """Black 0.1 mm off, as good prints may be: no part of the page is placed a quarter of a pixel off for it."""
    page, press = grey_balance(), two_sensor_press
    cmyk = page.cmyk.copy()
    cmyk[..., 3] = np.roll(cmyk[..., 3], steps[::-1], axis=(0, 1))
    printed = replace(page, cmyk=cmyk)
    seen = predict(printed, sensors=press.sensors, geometry=press.geometry, placement=IN_PLACE, threads=1)
    scan = ideal_scan(seen, press, np.random.default_rng(1))
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    prepared = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry, fringes=True)
    found = analyse(prepared, scan).registration
    assert found.located, found.reason
    x_mm, y_mm = np.meshgrid(np.linspace(6, 30, 5), np.linspace(6, 38, 7))
    size = {"page_width_mm": page.width_mm, "page_height_mm": page.height_mm}
    seen_mm = np.stack(found.placement.seen_mm(x_mm, y_mm, **size)) - np.stack([x_mm, y_mm])
    own_mm = np.median(seen_mm, axis=(1, 2), keepdims=True)
    assert np.abs(seen_mm - own_mm).max() < 0.25 * press.geometry.pixel_pitch_mm
