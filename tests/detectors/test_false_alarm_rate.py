"""Thresholds by count and by a tail drawn on; samples from known laws, seeds fixed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.false_alarm_rate import FURTHEST, GoodScores, Promise, conformal_threshold


def good(count: int, seed: int, *, scale: float = 1.0) -> GoodScores:
    rng = np.random.default_rng(seed)
    return GoodScores(worst=np.sort(rng.exponential(scale, count)))


def test_a_design_counts_once_with_its_worst_copy() -> None:
    scores = GoodScores.of(np.array([3.0, 1.0, 2.0, 5.0]), np.array([7, 7, 9, 9]))
    np.testing.assert_array_equal(scores.worst, [3, 5])


def test_what_the_designs_can_promise_is_by_count() -> None:
    scores = good(99, 1)
    threshold, by_count = scores.threshold(0.01)
    assert by_count
    assert threshold == conformal_threshold(scores.worst, np.arange(99), false_alarm_rate=0.01)
    assert not scores.threshold(0.0099)[1]
    assert scores.least_rate == pytest.approx(0.01 / FURTHEST)


def test_an_exponential_tail_is_drawn_on_to_the_safe_side() -> None:
    # The upper bound of the mean excess of 20 in the tail is too low in one of ten; ln(0.2 / 0.001) = 5.3 times it.
    exact = -np.log(1e-3)
    thresholds = np.array([good(100, seed).threshold(1e-3)[0] for seed in range(300)])
    assert 0.8 < (thresholds > exact).mean() < 0.98
    assert np.median(thresholds) < 1.5 * exact


@given(st.integers(20, 200), st.integers(0, 50))
def test_p_values_fall_and_agree_with_thresholds(count: int, seed: int) -> None:
    scores = good(count, seed)
    at = np.linspace(0, 12, 60)
    p = np.array([scores.p_value(float(score)) for score in at])
    assert (np.diff(p) <= 0).all()
    assert p[0] <= 1
    assert p[-1] > 0
    rate = scores.least_rate
    threshold, _ = scores.threshold(rate)
    assert scores.p_value(threshold) <= rate * (1 + 1e-9)


def test_a_promise_says_what_it_rests_on() -> None:
    by_count = str(Promise(rate=0.01, simulated=0, real=120))
    assert "one good page in 100" in by_count
    assert "by count, from 120 real good pages" in by_count
    drawn = str(Promise(rate=0.001, simulated=200, conformal=False, asked=1e-5))
    assert "extrapolated: 200 simulated good designs promise one in 201 by count" in drawn
    assert "one in 100,000 was asked for, and is refused" in drawn
