"""Means over windows of the error map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from prooflight.detectors.paper.bayes import window_statistics, window_unit
from prooflight_studies.harness.measures import window_means


@given(
    lines=st.integers(3, 20),
    pixels=st.integers(3, 20),
    side=st.integers(1, 3),
    overlapping=st.booleans(),
    seed=st.integers(0, 99),
)
def test_means_are_those_of_the_windows_cut_out(
    lines: int, pixels: int, side: int, overlapping: bool, seed: int
) -> None:
    z = np.random.default_rng(seed).normal(size=(2, lines, pixels)).astype(np.float32)
    before = z.copy()
    step = 1 if overlapping else side
    want = [
        [
            [plane[y : y + side, x : x + side].mean() * side for x in range(0, pixels - side + 1, step)]
            for y in range(0, lines - side + 1, step)
        ]
        for plane in z
    ]
    got = window_means(z, side=side, overlapping=overlapping)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, want, atol=2e-6)
    np.testing.assert_array_equal(z, before)


@pytest.mark.parametrize("side", [0, 9])
@pytest.mark.parametrize("overlapping", [False, True])
def test_a_window_that_does_not_fit_is_refused(side: int, overlapping: bool) -> None:
    with pytest.raises(ValueError, match="do not fit 8 x 30"):
        window_means(np.zeros((8, 30), np.float32), side=side, overlapping=overlapping)


@pytest.mark.parametrize("overlapping", [False, True])
def test_on_a_good_page_half_of_the_window_means_lie_below_0_675(overlapping: bool) -> None:
    z = np.random.default_rng(1).standard_normal((1, 640, 640)).astype(np.float32)
    means = window_means(z, side=8, overlapping=overlapping)
    mean, minimum, share = window_statistics(means)[0]
    # 6400 separate windows: the mean's sd is 1/80, the share's 0.5/80; overlapping ones know hardly more
    assert mean == pytest.approx(0, abs=4 / 80)
    assert share == pytest.approx(2 * stats.norm.cdf(0.675) - 1, abs=4 * 0.5 / 80)
    assert -6 < minimum < -3
    assert window_unit(means)[0] == pytest.approx(1, abs=0.05)
    # magnitudes: mean sqrt(2 / pi), least nearly 0, the same share
    of_magnitudes = window_statistics(means, reading="absolute")[0]
    assert of_magnitudes[0] == pytest.approx(np.sqrt(2 / np.pi), abs=0.04)
    assert 0 <= of_magnitudes[1] < 0.01
    assert of_magnitudes[2] == share
