"""Thresholds by count and by a tail drawn on; samples from known laws, seeds fixed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.false_alarm_rate import (
    ALONE,
    FURTHEST,
    GoodScores,
    Guarantee,
    PressScores,
    ReferenceScores,
    conformal_threshold,
    posterior_bound,
)


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
    assert FURTHEST == 10


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
    by_count = str(Guarantee(rate=0.01, simulated=0, real=120, requested_rate=0.01))
    assert by_count == "at most one good page in 100 alarms; by count, from 120 real good pages"
    both = str(Guarantee(rate=0.002, simulated=200, real=50, conformal=False))
    assert both == (
        "at most one good page in 500 alarms; extrapolated: 50 real good pages and 200 simulated good designs support "
        "one in 251 by count, and their tail beyond that"
    )
    others = str(Guarantee(rate=0.01, simulated=120, reference=1480, requested_rate=0.01))
    assert others == (
        "at most one good page in 100 alarms; by count, from 120 simulated good designs of this press and 1,480 of "
        "those that trained the ranking"
    )
    few = str(Guarantee(rate=0.01, simulated=0, real=38, reference=1480, requested_rate=0.01))
    assert few.endswith("those that trained the ranking; these 38 pages alone support one in 39")
    further = str(Guarantee(rate=1e-4, simulated=0, real=19, reference=1480, conformal=False))
    assert (
        "19 real good pages of this press and 1,480 of those that trained the ranking support one in 1,500"
        in further
    )
    drawn = str(Guarantee(rate=0.001, simulated=200, conformal=False, requested_rate=1e-5))
    assert "extrapolated: 200 simulated good designs support one in 201 by count" in drawn
    assert "one in 100,000 was requested, and is refused" in drawn


ONE_TO_NINE = GoodScores(worst=np.arange(1.0, 10.0))
"""Its tail, by hand: the five beyond 4, whose mean excess is 3, and 3 (1 + 1.28 / sqrt 5) at its upper bound."""
TAIL_EXCESS = 3 * (1 + 1.28 / np.sqrt(5))


# --- a press's own pages beside those of others, by hand ---

REFERENCE = GoodScores(worst=np.arange(1.0, 100.0))
"""Its quantiles at 80, 90 and 95 % are 79.4, 89.2 and 94.1."""


def beside(*own: float) -> PressScores:
    return PressScores(reference=REFERENCE, own=GoodScores(worst=np.sort(own)))


@pytest.mark.parametrize(
    ("own", "ratio"),
    [
        ([0.0] * 20, 0.8),  # never sharper than this: 4 / 8, 4 / 6 and 4 / 5 were less
        ([0.0] * 16 + [79.5, 80.0, 85.0, 86.0], (1 + 4 / 6 + 4 / 5) / 3),  # as elsewhere beyond 80 %
        ([0.0] * 14 + [80.0] * 6, (10 / 8 + 4 / 6 + 4 / 5) / 3),
        ([0.0] * 14 + [90.0] * 6, (10 / 8 + 10 / 6 + 4 / 5) / 3),
        ([0.0] * 14 + [95.0] * 6, (10 / 8 + 10 / 6 + 10 / 5) / 3),
        ([200.0] * 2, (6 / 4.4 + 6 / 4.2 + 6 / 4.1) / 3),
        ([200.0] * 2000, (2004 / 404 + 2004 / 204 + 2004 / 104) / 3),
    ],
    ids=["better", "alike", "beyond 80", "beyond 90", "beyond 95", "two", "all out"],
)
def test_how_often_a_press_reaches_into_the_tail_is_counted_and_drawn_to_others(
    own: list[float], ratio: float
) -> None:
    assert beside(*own).ratio == pytest.approx(ratio)


def test_the_references_tail_is_taken_as_many_times_rarer() -> None:
    scores = beside(*[0.0] * 8, *[80.0] * 4, *[90.0] * 2, *[95.0] * 6)  # twice as often
    assert scores.threshold(0.1) == REFERENCE.threshold(0.05) == (95.0, True)
    assert scores.threshold(0.001) == REFERENCE.threshold(0.0005)
    for score in (50.0, 94.0, 150.0):
        assert scores.p_value(score, 0.1) == pytest.approx(min(2 * REFERENCE.p_value(score), 1))
    assert scores.p_value(0.0, 0.1) == 1
    assert scores.least_rate == pytest.approx(2 * REFERENCE.least_rate)


def test_the_reference_is_that_of_as_many_pages_or_more() -> None:
    references = ReferenceScores(pages=np.array([20, 40, 100]), worst=np.array([[1.0, 2], [3, 4], [5, 6]]))
    found = {count: references.by(count).worst[0] for count in (2, 20, 21, 40, 41, 100, 101, 10_000)}
    assert found == {2: 1, 20: 1, 21: 3, 40: 3, 41: 5, 100: 5, 101: 5, 10_000: 5}
    alone = ReferenceScores.alone(REFERENCE)
    assert all(np.array_equal(alone.by(count).worst, REFERENCE.worst) for count in (1, 5, 10_000))


def test_many_pages_of_a_press_decide_by_themselves() -> None:
    own = np.arange(1000.0, 1100.0)
    scores = beside(*own)
    assert scores.alone(0.05)
    assert not scores.alone(0.049)
    assert ALONE == 5
    assert scores.threshold(0.05) == (1095.0, True)  # ceil(101 x 0.95) = 96th smallest
    assert scores.p_value(1095.5, 0.05) == pytest.approx(5 / 101)
    assert scores.p_value(1095.5, 0.04) == pytest.approx(REFERENCE.p_value(1095.5) * scores.ratio)


@given(st.integers(2, 30_000), st.integers(0, 50), st.floats(0.3, 3))
def test_no_rate_is_promised_that_neither_scores_allow(count: int, seed: int, scale: float) -> None:
    """Where a press's own pages are too few to decide, others' tail is drawn on no further than theirs may be."""
    scores = PressScores(reference=good(100, 1), own=good(count, seed, scale=scale))
    rate = scores.least_rate
    of_reference = REFERENCE_OF_100 * scores.ratio
    assert rate == pytest.approx(of_reference if count < ALONE / of_reference else ALONE / count)
    assert scores.alone(rate) == (count >= ALONE / of_reference)
    threshold, _ = scores.threshold(rate)
    assert scores.p_value(threshold + 1e-9, rate) <= rate * (1 + 1e-6)


REFERENCE_OF_100 = 1 / 1010


def test_a_press_that_is_like_others_promises_what_it_keeps() -> None:
    """Exponential scores, seeds 0 to 199: 60 own pages and 1000 of others, at 1 %.

    Exact is ln 100 = 4.61; the ratio, known to a fifth, is in the mean what it is.
    """
    kept = []
    for seed in range(200):
        scores = PressScores(reference=good(1000, 1000 + seed), own=good(60, seed))
        kept.append(np.exp(-scores.threshold(0.01)[0]))
    assert 0.008 < np.mean(kept) < 0.012
    wide, unscaled = [], []
    for seed in range(200):  # a press that scatters 1.5 times as widely is held back, not wholly
        scores = PressScores(reference=good(1000, 1000 + seed), own=good(60, seed, scale=1.5))
        wide.append(np.exp(-scores.threshold(0.01)[0] / 1.5))
        unscaled.append(np.exp(-scores.reference.threshold(0.01)[0] / 1.5))
    assert np.mean(wide) < 0.9 * np.mean(unscaled)


@pytest.mark.parametrize(("score", "designs_as_high"), [(0.5, 9), (1.0, 9), (1.5, 8), (3.0, 7), (4.0, 6)])
def test_p_values_count_designs_that_score_as_high_or_higher(score: float, designs_as_high: int) -> None:
    assert ONE_TO_NINE.p_value(score) == pytest.approx((1 + designs_as_high) / 10)


def test_beyond_its_beginning_the_tail_may_say_less_than_the_count_never_more() -> None:
    share = 6 / 10  # the five in the tail, one more counted
    far = share * np.exp(-(20 - 4) / TAIL_EXCESS)
    assert far < 1 / 10
    assert ONE_TO_NINE.p_value(20.0) == pytest.approx(far)
    assert share * np.exp(-1 / TAIL_EXCESS) < 6 / 10
    assert ONE_TO_NINE.p_value(5.0) == pytest.approx(share * np.exp(-1 / TAIL_EXCESS))
    assert 0 < ONE_TO_NINE.p_value(1e9) < 1e-200
    apart = GoodScores(worst=np.array([0, 0, 0, 0, 1, 1, 1, 1, 100.0]))
    assert apart.p_value(1.5) == pytest.approx(2 / 10)


def test_a_tail_is_drawn_on_by_its_mean_excess() -> None:
    threshold, by_count = ONE_TO_NINE.threshold(0.01)
    assert not by_count
    assert threshold == pytest.approx(4 + TAIL_EXCESS * np.log(0.6 / 0.01))
    of_forty = GoodScores(
        worst=np.arange(40.0)
    )  # a fifth of them is the tail: 8 beyond 31, of mean excess 4.5
    excess = 4.5 * (1 + 1.28 / np.sqrt(8))
    assert of_forty.threshold(0.005)[0] == pytest.approx(31 + excess * np.log(9 / 41 / 0.005))


def test_no_tail_is_drawn_below_the_greatest_score_seen() -> None:
    """One design of 99 far out: the mean excess of twenty says less than that one showed."""
    scores = GoodScores(worst=np.append(np.zeros(98), 100.0))
    assert scores.threshold(0.0099) == (100.0, False)


def test_designs_that_all_score_alike_have_a_tail_of_no_length() -> None:
    scores = GoodScores(worst=np.full(20, 3.0))
    assert scores.threshold(0.01)[0] == pytest.approx(3.0, abs=0.01)
    assert scores.p_value(3.0) == 1
    assert scores.p_value(3.1) < 1e-9


@pytest.mark.parametrize(("p_value", "of_a_good_page"), [(0.05, 0.289), (0.01, 0.111), (0.001, 0.0184)])
def test_what_p_values_can_support_is_as_published(p_value: float, of_a_good_page: float) -> None:
    """Sellke, Bayarri and Berger 2001, table 1: least probability of the hypothesis, at even odds before."""
    assert 1 - posterior_bound(p_value, 0.5) == pytest.approx(of_a_good_page, rel=5e-3)


def test_rare_misprints_need_more_evidence() -> None:
    assert posterior_bound(0.01, 0.01) == pytest.approx(1 / (1 + 99 * -np.e * 0.01 * np.log(0.01)))
    assert posterior_bound(1 / np.e, 0.01) == posterior_bound(1.0, 0.01) == 0.01
    assert posterior_bound(0.36, 0.01) == pytest.approx(0.01, rel=1e-3)  # there is no step at 1 / e
    assert posterior_bound(0.0, 0.01) == 1
