"""What a camera shows now, against what was put into its lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.ruler.prints import ruler_press_file, seen, true_mtf50

from prooflight_line.camera_set_up.seen import line_noise, sensor_views, smoothed


@given(sigma=st.floats(3.0, 40), pages=st.booleans())
def test_noise_is_that_of_lines_that_do_not_change(sigma: float, pages: bool) -> None:
    """By 5 %, seed 2, 200 columns of 150 differences each; by 15 % where print is in a tenth of the differences.

    The least half of all differences is then 56 % of those that print left alone, whose mean is 13 % greater.
    """
    rng = np.random.default_rng(2)
    image = 1000 + sigma * rng.standard_normal((600, 200))
    if pages:
        image[::40] += 700
    found = line_noise(np.round(image).astype(np.uint16))
    assert found == pytest.approx(sigma, rel=0.15 if pages else 0.05)


def test_flatness_saturation_and_black_are_those_of_the_lines() -> None:
    pixels = 1024
    light = 1 - 0.4 * (np.arange(pixels) / pixels - 0.25) ** 2 / 0.75**2  # least, 60 %, at the right end
    rng = np.random.default_rng(1)
    lines = 100 + 3000 * light + rng.normal(0, 5, (500, pixels))
    lines[:100] = 100 + rng.normal(0, 5, (100, pixels))  # black print passes
    lines[100:110, :64] = 5000
    image = np.clip(np.round(lines), 0, 4095).astype(np.uint16)
    (view,) = sensor_views(image[None], top_code_dn=4095, where="cam 1")
    assert view.saturated == pytest.approx(10 * 64 / (500 * pixels))
    assert view.black_dn == pytest.approx(90, abs=8)
    assert view.at_zero == 0
    assert view.flatness == pytest.approx(0.6, abs=0.03)
    assert view.darkest_share == pytest.approx(1, abs=0.05)
    assert view.focus is None


def test_a_running_median_leaves_a_slope_and_takes_dust() -> None:
    slope = np.linspace(1000, 2000, 640)
    dusty = slope.copy()
    dusty[100:104] = 0
    np.testing.assert_allclose(smoothed(dusty)[20:-20], slope[20:-20], atol=8)


def test_focus_is_told_by_a_ruler_page_that_passes_and_by_one_that_lies_still() -> None:
    lines = seen()
    across, along = true_mtf50(2.8)
    (view,) = sensor_views(lines, top_code_dn=4095, where="cam 1")
    assert view.focus is not None
    assert view.focus.by == "ruler page"
    assert view.focus.across.value == pytest.approx(across, rel=0.03)
    assert view.focus.along is not None
    assert view.focus.along.value == pytest.approx(along, rel=0.03)
    assert view.focus.pixel_mm == pytest.approx(ruler_press_file().camera().pixel_pitch_mm, rel=1e-4)
    assert [place for place, _ in view.focus.places] == sorted(place for place, _ in view.focus.places)
    comb = lines[:, 140:150].mean(axis=1)  # a line through the first comb
    still = np.round(comb[:, None] + np.random.default_rng(1).normal(0, 20, (1, 256, 1280))).astype(np.uint16)
    (view,) = sensor_views(still, top_code_dn=4095, where="cam 1")
    assert view.focus is not None
    assert (view.focus.by, view.focus.along) == ("still edges", None)
    # 0.561 in closed form, without the steps of turned edges; a Gaussian in a diffraction's stead says 7 % less.
    assert view.focus.across.value == pytest.approx(0.561, rel=0.1)
