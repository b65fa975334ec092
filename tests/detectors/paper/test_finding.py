"""Pages that lie off their place: found, followed, or called the misprint that they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.base import PlannedPage
from prooflight.detectors.paper.finding import PlacedPage, SoughtPage, find
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


def scanned(page: Page, press: Press, placement: Placement = IN_PLACE, *, seed: int = 1) -> np.ndarray:
    """A good print but for its place: noise is the camera's alone."""
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement)
    return ideal_scan(seen, press, np.random.default_rng(seed))


def verdict(page: Page, scan: np.ndarray, press: Press) -> Verdict:
    return Inspector.of(press, "chi-square").inspect(page, scan).verdict


def find_page(page: Page, scan: np.ndarray, press: Press) -> PlacedPage:
    return find(SoughtPage.of(PlannedPage(page, press.press_context())), scan, press.press_context())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_page_in_its_place_is_not_moved_by_noise(press: Press, page: Page, seed: int) -> None:
    found = find_page(page, scanned(page, press, seed=seed), press)
    assert found.placement is IN_PLACE
    assert found.shift_mm is not None
    assert not found.wrong_page


@pytest.mark.parametrize("bright", [1.01, 40.0])
def test_a_page_in_its_place_is_predicted_under_the_light_of_now(
    press: Press, page: Page, bright: float
) -> None:
    """40: where a mean lies at the top code, what its light is can only be found anew."""
    brighter, now = (
        replace(
            press, sensors=tuple(replace(one, column_gain=one.column_gain * times) for one in press.sensors)
        )
        for times in (bright, bright * 0.98)
    )
    sought = SoughtPage.of(PlannedPage(page, brighter.press_context())).relit(now.press_context())
    expected = predict(page, sensors=now.sensors, geometry=press.geometry)
    found = find(sought, ideal_scan(expected, now, np.random.default_rng(1)), now.press_context())
    assert found.placement is IN_PLACE
    # relighting rounds once more than predicting
    assert found.prediction.expected_dn == pytest.approx(expected.expected_dn, rel=1e-5)
    assert found.prediction.variance_dn2 == pytest.approx(expected.variance_dn2, rel=1e-5)


@pytest.mark.parametrize(
    "placement",
    [
        Placement(shift_mm=(0.4, -0.3)),
        Placement(shift_mm=(-0.05, 0.6), skew_deg=0.08),
        Placement(shift_mm=(0.0, 0.2), stretch_percent=(0.03, -0.03)),
    ],
)
def test_a_page_off_its_place_is_followed(press: Press, page: Page, placement: Placement) -> None:
    found = find_page(page, scanned(page, press, placement), press)
    assert found.shift_mm == pytest.approx(placement.shift_mm, abs=0.05 * press.geometry.pixel_pitch_mm)
    area = (slice(None), *found.area)
    left = scanned(page, press, placement)[area] - found.prediction.expected_dn[area]
    z = left / np.sqrt(found.prediction.variance_dn2[area])
    # z is 1 where nothing but noise is left; a twentieth of a pixel at this page's edges adds less than another
    assert np.sqrt(np.mean(z**2)) < 1.4


def test_a_page_far_off_its_place_is_a_wrong_page(press: Press, page: Page) -> None:
    far = Placement(shift_mm=(2.4, 0.5))
    found = verdict(page, scanned(page, press, far), press)
    assert (found.verdict, found.kind) == ("misprint", "wrong-page")
    assert found.shift_mm == pytest.approx(far.shift_mm, abs=0.1)


def test_another_page_is_a_wrong_page(press: Press, page: Page, make_page: Callable[..., Page]) -> None:
    found = verdict(page, scanned(make_page(23), press), press)
    assert (found.verdict, found.kind) == ("misprint", "wrong-page")


def test_a_page_turned_by_180_degrees_is_said_to_be(press: Press, page: Page) -> None:
    turned = replace(page, cmyk=np.ascontiguousarray(page.cmyk[::-1, ::-1]))
    found = verdict(page, scanned(turned, press), press)
    assert (found.verdict, found.kind) == ("misprint", "wrong-page")
    assert found.reason == "the page is turned by 180 degrees"
