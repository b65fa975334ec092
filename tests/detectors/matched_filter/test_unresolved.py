"""Places of a design that are finer than binned pixels resolve."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.binning import binned_geometry, bins_of, thinned
from prooflight.detectors.matched_filter.fit.special_places import REACH, WINDOW, unresolved_places
from prooflight.detectors.matched_filter.statistics.marks import classify
from prooflight.kernels.statistics.marks import NOT_INSPECTED
from prooflight.pages.raster import Page

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

BLOCK = slice(300, 500)


def lines_of(press: Press, period_pixels: float, *, width: float = 0.5) -> Page:
    """A white page with a block of black lines of such a period in binned pixels, and such a share of it."""
    bins = bins_of(press.geometry)
    at = binned_geometry(press.geometry, bins)
    period = period_pixels * at.pixel_pitch_mm / 25.4 * press.dpi
    columns = np.arange(600) % period < width * period
    cmyk = np.zeros((700, 600, 4), np.uint8)
    cmyk[BLOCK, BLOCK, 3] = np.where(columns, 255, 0)[BLOCK]
    return Page(cmyk=cmyk, dpi=press.dpi, name="lines", number=1)


@pytest.mark.parametrize(
    ("period", "unresolved"),
    [(1.0, True), (1.5, True), (1.9, True), (2.6, False), (4.0, False), (12.0, False)],
)
def test_lines_below_two_pixels_alone_are_unresolved(press: Press, period: float, unresolved: bool) -> None:
    """With room for the raster's own pixels, of which there are four to a binned one."""
    bins = bins_of(press.geometry)
    at = binned_geometry(press.geometry, bins)
    page = lines_of(press, period)
    places = unresolved_places(page, thinned(page, bins), at)
    assert (places is not None) == unresolved
    if places is not None:
        assert places.shape == (at.lines(page.height_mm), at.pixels)
        lines, pixels = np.nonzero(places)
        margin_mm = (WINDOW / 2 + REACH + 2) * at.pixel_pitch_mm
        low_mm, high_mm = (edge / page.dpi * 25.4 for edge in (BLOCK.start, BLOCK.stop))
        y_mm = lines * at.line_pitch_mm - at.lead_in_mm
        x_mm = pixels * at.pixel_pitch_mm - at.left_mm(page.width_mm)
        for place_mm in (x_mm, y_mm):
            assert low_mm - margin_mm < place_mm.min() < low_mm + margin_mm
            assert high_mm - margin_mm < place_mm.max() < high_mm + margin_mm


def test_a_hairline_and_a_tint_are_resolved(press: Press) -> None:
    bins = bins_of(press.geometry)
    at = binned_geometry(press.geometry, bins)
    page = lines_of(press, 40.0, width=0.02)
    assert unresolved_places(page, thinned(page, bins), at) is None
    tint = replace(page, cmyk=np.full_like(page.cmyk, 90))
    assert unresolved_places(tint, thinned(tint, bins), at) is None


def test_windows_that_reach_into_such_places_are_left_out() -> None:
    shape = 64, 64
    light, white = np.full((1, *shape), 100, np.float32), np.full((1, 64), 100, np.float32)
    unresolved = np.zeros(shape, bool)
    unresolved[30:34, 30:34] = True
    places = classify(light, white, np.ones(shape, bool), pixel_mm=0.25, unresolved=unresolved)
    plain = classify(light, white, np.ones(shape, bool), pixel_mm=0.25)
    left_out = places.of_windows != plain.of_windows
    assert [np.count_nonzero(one) for one in left_out] == [16, 36, 64, 144]  # (4 + 2 (window // 2))^2
    assert (places.of_windows[left_out] == NOT_INSPECTED).all()
    assert np.count_nonzero(plain.flat != places.flat) == 16
