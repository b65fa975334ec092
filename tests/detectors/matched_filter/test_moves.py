"""Where residuals say that a page lies, it is predicted anew: on a small page of rules, 30 x 30 mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.detectors.matched_filter.test_nuisance import nuisance_fit

from prooflight.detectors.matched_filter.fit.modes import Modes, moved, pixel_map, prepare_modes
from prooflight.detectors.matched_filter.fit.nuisance import (
    PlacedScan,
    ResidualVariance,
    page_colours,
)
from prooflight.detectors.matched_filter.fit.residuals import (
    CORRECTED_SHARE,
    LOCAL_PIXELS,
    by_prediction,
    corrected,
    local_moves,
    residual_images,
    take_moves,
)
from prooflight.detectors.print_prior import PrintPrior
from prooflight.pages.raster import Page
from prooflight.prediction.predict import Prediction, predict
from prooflight.scans.placement import IN_PLACE, Placement, Warp
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

DPI = 254.0
"""Raster pixels of 0.1 mm, about the camera's own: a rule of one is sharper than the camera tells."""
OFF_MM = 0.012


@pytest.fixture(scope="module")
def rules() -> Page:
    cmyk = np.zeros((300, 300, 4), np.uint8)
    cmyk[20:280, 20:280:23, 3] = 255
    cmyk[20:280:31, 20:280, 3] = 255
    return Page(cmyk=cmyk, dpi=DPI, name="rules", number=1)


def seen_at(press: Press, page: Page, placement: Placement) -> Prediction:
    return predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)


def placed_in(press: Press, page: Page, scan: NDArray[np.uint16]) -> PlacedScan:
    own = prepare_modes(page, sensors=press.sensors, geometry=press.geometry)
    where = pixel_map(page, press.geometry, IN_PLACE)
    return PlacedScan(
        measured_dn=scan,
        seen=seen_at(press, page, IN_PLACE),
        modes=Modes(images=moved(own.images, where), sensors=len(press.sensors)),
        where=where,
        sensors=press.sensors,
        colours=page_colours(own.cover),
    )


def test_rules_that_lie_a_little_off_are_all_but_gone_once_predicted_anew(press: Press, rules: Page) -> None:
    truth = seen_at(press, rules, Placement(shift_mm=(OFF_MM, -OFF_MM)))
    scan = ideal_scan(truth, press, np.random.default_rng(1))
    placed, variance = placed_in(press, rules, scan), ResidualVariance()
    fit = nuisance_fit(
        placed,
        planes=np.zeros((4, 2)),
        pixel_mm=press.geometry.pixel_pitch_mm,
        prior=PrintPrior(),
        residual_variance=variance,
    )
    light = placed.light()
    left, weight, of_edges, _ = residual_images(placed, fit, light, residual_variance=variance)
    at_rules = (of_edges > 0.5) & (weight > 0)

    def energy(residuals: NDArray[np.float32]) -> float:
        return float((residuals[at_rules].astype(np.float64) ** 2).mean())

    raw, linear = energy(left), left.copy()
    for _ in range(2):
        take_moves(linear, weight, light, local_moves(linear, weight, light))
    moves = local_moves(left, weight, light)
    placement = corrected(IN_PLACE, moves, press.geometry, rules.width_mm)
    by_prediction(left, weight, placed.seen.expected_dn, seen_at(press, rules, placement).expected_dn)
    take_moves(left, weight, light, local_moves(left, weight, light))
    # Seen where this was written: 19,500 at first, 10,500 after two linear steps, 1,440 after this, 48 by noise alone.
    assert energy(left) < raw / 8
    assert energy(left) < energy(linear) / 4


def test_what_was_fitted_stays_and_what_is_unknown_too() -> None:
    rng = np.random.default_rng(2)
    before, after = rng.random((2, 1, 40, 30)).astype(np.float32)
    left = rng.random((1, 40, 30)).astype(np.float32)
    weight = (rng.random((1, 40, 30)) < 0.7).astype(np.float32)
    found = left.copy()
    by_prediction(found, weight, before, after, threads=2)
    np.testing.assert_allclose(found, np.where(weight > 0, left - (after - before), left), atol=1e-6)


@pytest.mark.parametrize(
    "before",
    [
        IN_PLACE,
        Placement(
            shift_mm=(0.3, -0.2), warp=Warp(nodes_mm=np.full((3, 3, 2), 0.05, np.float32), pitch_mm=20.0)
        ),
    ],
)
def test_a_page_goes_as_far_as_its_squares_do(press: Press, rules: Page, before: Placement) -> None:
    """A field that rises evenly across, half a pixel at the right."""
    pitch_mm = press.geometry.pixel_pitch_mm
    squares = 24
    across = np.linspace(0, 0.5, squares, dtype=np.float32)
    moves = np.stack(
        [np.broadcast_to(across, (squares, squares)), np.full((squares, squares), -0.25, np.float32)]
    )
    after = corrected(before, moves, press.geometry, rules.width_mm)
    x0, y0 = press.geometry.centres_x_mm(rules.width_mm)[0], press.geometry.centres_y_mm(1)[0]
    middles = (LOCAL_PIXELS - 1) / 2 + LOCAL_PIXELS * np.arange(squares)
    x, y = np.meshgrid(x0 + middles * pitch_mm, y0 + middles * press.geometry.line_pitch_mm)
    size = {"page_width_mm": rules.width_mm, "page_height_mm": rules.height_mm}
    (was_x, was_y), (is_x, is_y) = before.seen_mm(x, y, **size), after.seen_mm(x, y, **size)
    # What lies further right is seen further left on the page.
    np.testing.assert_allclose((was_x - is_x) / pitch_mm, CORRECTED_SHARE * moves[0], atol=2e-3)
    np.testing.assert_allclose(
        (was_y - is_y) / press.geometry.line_pitch_mm, CORRECTED_SHARE * moves[1], atol=2e-3
    )
