"""Weighted split-conformal keeps its promise, by enumeration and by draws, and refuses what it cannot promise."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, norm

from prooflight.detectors.weighted_conformal import LabelledPages, SampleCounts, exact_interval
from prooflight.errors import RequestError


def told(score: np.ndarray, passed: np.ndarray, *, sample: float, rate: float, edge: float) -> LabelledPages:
    return LabelledPages(
        score=score,
        weight=np.where(passed, 1 / sample, 1.0),
        run=np.ones(score.size, np.int64),
        sheet=np.arange(score.size),
        passed=passed,
        rate=rate,
        passed_weight=1 / sample,
        alarms_from=edge,
        replaces="r" * 64,
    )


def test_of_equal_weights_it_is_split_conformal_in_every_order() -> None:
    """Of n + 1 exchangeable pages each is as often the new one: it alarms in at most a of all orders, exactly."""
    scores, rate = np.arange(1.0, 8.0), 1 / 4
    alarms = 0
    for order in permutations(range(7), 1):
        new = scores[order[0]]
        others = np.delete(scores, order[0])
        pages = told(others, np.ones(6, bool), sample=1.0, rate=rate, edge=100.0)
        alarms += new > pages.threshold
    assert alarms / 7 <= rate
    assert alarms == 1  # floor(7 / 4): no fewer either


def test_a_sample_of_known_probability_keeps_the_promise_in_the_mean() -> None:
    """Standard normal scores, all above 1.28 and 2 % of the others told: P(new > threshold) has mean 1 %.

    300 draws of 20,000 sheets: the mean's standard error is 0.5 % of the promise (the spread is 8 %); tolerated: 4.
    """
    rng = np.random.default_rng(4)
    realised = []
    for _ in range(300):
        score = rng.standard_normal(20_000)
        asked = (score > 1.28) | (rng.random(score.size) < 0.02)
        kept = score[asked]
        realised.append(norm.sf(told(kept, kept <= 1.28, sample=0.02, rate=0.01, edge=1.28).threshold))
    assert np.mean(realised) == pytest.approx(0.01, rel=0.02)


def test_alarms_alone_without_their_weights_break_it() -> None:
    """The same scores, alarms taken for good sheets: 1 % of the 10 % that alarm, a tenth of what is promised."""
    score = np.random.default_rng(5).standard_normal(20_000)
    alarms = score[score > 1.28]
    naive = told(alarms, np.ones(alarms.size, bool), sample=1.0, rate=0.01, edge=1.28)
    assert norm.sf(naive.threshold) < 0.01 / 5


def test_the_threshold_may_fall_where_the_press_is_better_than_taught() -> None:
    """Nothing alarms at 6; the sample alone says where one sheet in ten lies."""
    score = np.random.default_rng(6).standard_normal(5000)
    pages = told(score, np.ones(score.size, bool), sample=0.02, rate=0.1, edge=6.0)
    assert pages.threshold == pytest.approx(norm.isf(0.1), abs=0.08)


@settings(deadline=None, max_examples=60)
@given(
    scores=st.lists(st.integers(-5, 5), min_size=40, max_size=120),
    sample=st.sampled_from([0.01, 0.1, 1.0]),
    edge=st.integers(-4, 5),
)
def test_an_alarm_is_a_small_p_value_and_no_other(scores: list[int], sample: float, edge: int) -> None:
    score = np.array(scores, float)
    pages = told(score, score <= edge, sample=sample, rate=0.2, edge=float(edge))
    if pages.missing:
        with pytest.raises(RequestError):
            _ = pages.threshold
        return
    for new in np.arange(-6.0, 6.5, 0.25):
        assert (new > pages.threshold) == (pages.p_value(new) <= 0.2 * (1 + 1e-12))


@given(scores=st.lists(st.floats(-10, 10), min_size=5, max_size=50))
def test_a_higher_score_never_has_a_higher_p_value(scores: list[float]) -> None:
    score = np.array(scores)
    pages = told(score, score <= 0, sample=0.05, rate=0.1, edge=0.0)
    p = [pages.p_value(new) for new in np.linspace(-11, 11, 45)]
    assert (np.diff(p) <= 1e-12).all()


def test_too_few_say_how_many_more() -> None:
    pages = told(np.arange(30.0), np.ones(30, bool), sample=0.02, rate=0.01, edge=50.0)
    with pytest.raises(RequestError, match="69 more are needed"):
        _ = pages.threshold
    assert told(np.arange(99.0), np.ones(99, bool), sample=0.02, rate=0.01, edge=150.0).missing == 0


def test_old_pages_count_as_fewer() -> None:
    fresh = told(np.arange(200.0), np.ones(200, bool), sample=0.5, rate=0.01, edge=300.0)
    weight = fresh.weight * np.where(np.arange(200) < 100, 1.0, 0.1)
    aged = LabelledPages(
        **{name: getattr(fresh, name) for name in fresh.__slots__ if name != "weight"}, weight=weight
    )
    assert aged.sample == pytest.approx(110**2 / 101)
    assert aged.sample < fresh.sample


def test_figures_of_the_report_in_closed_form() -> None:
    counts = SampleCounts(
        alarms=10, alarms_good=4, alarms_misprints=6, passed=990, passed_good=19, passed_misprints=1
    )
    assert counts.missed is not None
    assert counts.missed.value == pytest.approx(990 / 20)
    low, high = binomtest(1, 20).proportion_ci(0.95, "exact")
    assert (counts.missed.low, counts.missed.high) == pytest.approx((990 * low, 990 * high))
    assert counts.false_alarms is not None
    assert counts.false_alarms.value == pytest.approx(4 / (4 + 990 * 19 / 20))


def test_half_of_the_alarms_told_widens_the_interval_and_leaves_the_figure() -> None:
    every = SampleCounts(
        alarms=8, alarms_good=8, alarms_misprints=0, passed=400, passed_good=8, passed_misprints=0
    )
    half = SampleCounts(
        alarms=8, alarms_good=4, alarms_misprints=0, passed=400, passed_good=8, passed_misprints=0
    )
    assert every.false_alarms is not None
    assert half.false_alarms is not None
    assert half.false_alarms.value == pytest.approx(every.false_alarms.value)
    assert half.false_alarms.high > every.false_alarms.high


def test_nothing_told_says_nothing() -> None:
    none = SampleCounts(
        alarms=3, alarms_good=0, alarms_misprints=0, passed=50, passed_good=0, passed_misprints=0
    )
    assert none.missed is None
    assert none.false_alarms is None
    assert exact_interval(0, 10)[0] == 0
    assert exact_interval(10, 10)[1] == 1
