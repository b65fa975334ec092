from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.false_alarm_rate import conformal_threshold, least_false_alarm_rate
from prooflight_studies.harness.operating import (
    Scored,
    area_under_roc,
    at_threshold,
    bill,
    bootstrap_cost,
    bootstrap_oracle,
    caught_at,
    counted,
    drawn_clusters,
    least_cost,
    rate_below,
    resampled_costs,
    roc,
)

ALPHAS = np.array([0.001, 0.01, 0.1, 1.0, 10.0, 100.0])


def scored(good: list[float], bad: list[float], days: int = 3) -> Scored:
    score = np.array([*good, *bad], np.float64)
    place = np.arange(score.size, dtype=np.int64)
    return Scored(score=score, bad=place >= len(good), design=place, day=place % days)


finite = st.floats(-1e6, 1e6)
any_pages = st.builds(
    scored, st.lists(finite, min_size=1, max_size=30), st.lists(finite, min_size=1, max_size=30)
)


def test_least_cost_by_hand() -> None:
    pages = scored([1, 2, 3, 6], [2, 5, 7, 8])
    cheap, dear = least_cost(pages, 0.1), least_cost(pages, 100)
    # a miss that costs little: no false alarm, two of four missed; one that costs much: two false alarms, none missed
    assert (cheap.threshold, cheap.false_alarms, cheap.misses) == (6.5, 0.0, 0.5)
    assert (dear.threshold, dear.false_alarms, dear.misses) == (1.5, 0.75, 0.0)
    assert least_cost(pages, 1).cost(1) == 0.5


@given(pages=any_pages, threshold=finite)
def test_no_threshold_costs_less_than_the_least(pages: Scored, threshold: float) -> None:
    for alpha in ALPHAS:
        best = least_cost(pages, alpha)
        assert best.cost(alpha) <= at_threshold(pages, threshold).cost(alpha) + 1e-12
        assert at_threshold(pages, best.threshold).cost(alpha) == pytest.approx(best.cost(alpha), abs=1e-12)


@given(pages=any_pages)
def test_with_oracle_thresholds_cost_rises_is_concave_and_beats_always_and_never(pages: Scored) -> None:
    cost = np.array([least_cost(pages, alpha).cost(alpha) for alpha in ALPHAS])
    slope = np.diff(cost) / np.diff(ALPHAS)
    assert (slope >= -1e-12).all()
    assert (np.diff(slope) <= 1e-9).all()
    assert (cost <= np.minimum(1, ALPHAS) + 1e-12).all()


@given(pages=any_pages, seed=st.integers(0, 99))
def test_order_of_pages_and_a_rising_change_of_score_change_no_cost(pages: Scored, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(pages.score.size)
    ranks = np.unique(pages.score, return_inverse=True)[1].astype(np.float64)
    before = pages.score.copy()
    for other in (
        pages.pages(order),
        replace(pages, score=ranks),
    ):
        for alpha in ALPHAS:
            assert least_cost(other, alpha).cost(alpha) == pytest.approx(least_cost(pages, alpha).cost(alpha))
        assert area_under_roc(other) == pytest.approx(area_under_roc(pages))
    np.testing.assert_array_equal(pages.score, before)


@given(pages=any_pages)
def test_area_is_the_chance_that_a_misprint_scores_higher(pages: Scored) -> None:
    difference = pages.score[pages.bad][:, None] - pages.score[~pages.bad]
    assert area_under_roc(pages) == pytest.approx((difference > 0).mean() + (difference == 0).mean() / 2)


def test_roc_and_what_is_caught_at_few_false_alarms() -> None:
    pages = scored([0, 1, 2, 3], [1.5, 2.5, 3.5, 4.5])
    false_alarms, caught = roc(pages)
    assert false_alarms[0] == caught[0] == 0
    assert false_alarms[-1] == caught[-1] == 1
    assert (np.diff(false_alarms) >= 0).all()
    assert (np.diff(caught) >= 0).all()
    assert [caught_at(pages, rate) for rate in (0, 0.24, 0.25, 0.5, 1)] == [0.5, 0.5, 0.75, 1, 1]


def test_infinite_scores_are_scores() -> None:
    pages = scored([-np.inf, 0.0], [0.0, np.inf])
    assert least_cost(pages, 1).cost(1) == 0.5
    assert caught_at(pages, 0) == 0.5


def of_days(alarming: int, days: int, pages_a_day: int) -> Scored:
    """All good pages of so many of the days alarm, each a design of its own; a misprint a day, which always does."""
    day = np.repeat(np.arange(days), pages_a_day)
    score = np.concatenate([day < alarming, np.ones(days)]).astype(np.float64)
    place = np.arange(score.size)
    return Scored(
        score=score, bad=place >= day.size, design=place, day=np.concatenate([day, np.arange(days)])
    )


@pytest.mark.parametrize("pages_a_day", [1, 8])
def test_an_interval_is_that_of_as_many_pages_as_there_are_days(pages_a_day: int) -> None:
    """All pages of half of 100 days alarm: the sd of F is that of 100 pages, 0.05, however many designs a day has."""
    pages = of_days(50, 100, pages_a_day)
    rng = np.random.default_rng(1)
    for found in (
        bootstrap_cost(pages, 1.0, threshold=0.5, rng=rng),
        bootstrap_oracle(pages, [1e9], rng=rng)[0],
    ):
        assert found.value == pytest.approx(0.5)
        # 1.96 x 0.05 either side; 1000 resamples know a 97.5 % quantile to about 8 % of that
        assert found.high - found.value == pytest.approx(0.098, rel=0.25)
        assert found.value - found.low == pytest.approx(0.098, rel=0.25)


def test_days_that_are_alike_are_drawn_as_a_binomial_draws_them() -> None:
    """2 of 5 days alarm: of 20,000 resamples k / 5 alarm as often as Binomial(5, 0.4) says, give or take 4 sd."""
    pages = of_days(2, 5, 6)
    place, drawn = drawn_clusters(pages.day, np.random.default_rng(3), resamples=20_000)
    costs = resampled_costs(pages, 0.0, threshold=0.5, place=place, drawn=drawn)
    seen = np.bincount(np.rint(5 * costs).astype(int), minlength=6) / costs.size
    chance = stats.binom.pmf(np.arange(6), 5, 0.4)
    np.testing.assert_allclose(seen, chance, atol=float(4 * np.sqrt(chance.max() / costs.size)))
    assert np.unique(np.rint(5 * costs)).size == 6


def test_days_without_pages_are_drawn_too() -> None:
    pages = of_days(1, 3, 2)
    place, drawn = drawn_clusters(
        pages.day, np.random.default_rng(4), clusters=np.array([-5, 0, 1, 2, 9]), resamples=50
    )
    assert drawn.shape == (50, 5)
    assert (drawn.sum(axis=1) == 5).all()
    assert place.tolist() == (pages.day + 1).tolist()


def test_one_day_says_nothing_of_another() -> None:
    pages, rng = of_days(1, 1, 40), np.random.default_rng(5)
    for found in (
        bootstrap_cost(pages, 1.0, threshold=0.5, rng=rng),
        bootstrap_oracle(pages, [1.0], rng=rng, resamples=20)[0],
    ):
        assert found.value == 1.0
        assert np.isnan([found.low, found.high]).all()


def test_the_oracles_interval_holds_what_the_oracle_found() -> None:
    rng = np.random.default_rng(2)
    pages = scored(rng.normal(0, 1, 300).tolist(), rng.normal(1, 1, 300).tolist(), days=60)
    for alpha, found in zip(
        ALPHAS, bootstrap_oracle(pages, ALPHAS.tolist(), rng=rng, resamples=200), strict=True
    ):
        assert found.value == least_cost(pages, alpha).cost(alpha)
        assert found.low <= found.value * 1.001
        assert found.low <= found.high <= min(1, alpha) + 1e-12


def test_a_promise_needs_enough_designs() -> None:
    assert least_false_alarm_rate(199) == 0.005
    score, design = np.arange(199.0), np.arange(199)
    assert conformal_threshold(score, design, false_alarm_rate=0.005) == 198
    assert conformal_threshold(score, design, false_alarm_rate=0.01) == 197
    with pytest.raises(ValueError, match=r"199 designs cannot support a rate below 0\.005"):
        conformal_threshold(score, design, false_alarm_rate=0.004)
    with pytest.raises(ValueError, match="cannot support"):  # copies are no designs
        conformal_threshold(score, design // 2, false_alarm_rate=0.005)


def test_a_promise_is_kept_by_new_designs() -> None:
    """20 designs of one copy, rate 0.1: over 4000 trials the realised rate has sd 0.0047, plus the rank's own slack."""
    rng = np.random.default_rng(6)
    alarms = 0
    for _ in range(4000):
        scores = rng.normal(size=21)
        alarms += scores[20] > conformal_threshold(scores[:20], np.arange(20), false_alarm_rate=0.1)
    # rank ceil(21 x 0.9) = 19 of 20: exactly 2 / 21
    assert alarms / 4000 == pytest.approx(2 / 21, abs=4 * 0.0047)


@pytest.mark.parametrize(("count", "of"), [(0, 778), (0, 1), (3, 40), (39, 40), (12, 3000)])
def test_a_bound_by_count_is_the_rate_at_which_so_few_are_seen_once_in_twenty(count: int, of: int) -> None:
    """Clopper and Pearson's definition; with none seen it is 1 - 0.05^(1/n)."""
    bound = rate_below(count, of)
    assert stats.binom.cdf(count, of, bound) == pytest.approx(0.05, rel=1e-6)
    if count == 0:
        assert bound == pytest.approx(1 - 0.05 ** (1 / of), rel=1e-9)


def test_nobody_says_zero() -> None:
    assert counted(0, 3000) == "0 of 3,000 (< 0.1 %)"
    assert counted(6, 3000) == "6 of 3,000, 0.2 % (< 0.39 %)"
    assert counted(40, 40) == "40 of 40, 100 %"
    assert counted(0, 0) == "-"
    assert rate_below(0, 0) == 1.0


def test_the_bill_of_section_5_2() -> None:
    # the paper's table 1 at alpha 0.1; without the system, 1 % of 10,000 pages cost 0.1 cent each
    told = bill(RunningCosts(), 0.0338)
    assert told.with_system == pytest.approx(3.4, rel=0.02)
    assert told.without == pytest.approx(10.0)
    assert told.stopping_always == pytest.approx(99.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"score": np.array([0.0, np.nan])}, "not a number"),
        ({"bad": np.array([False, False])}, "misprints"),
        ({"bad": np.array([True, True])}, "good pages"),
        ({"design": np.array([1])}, "1 designs"),
        ({"day": np.array([1])}, "1 days"),
    ],
)
def test_sets_that_say_nothing_are_refused(change: dict[str, np.ndarray], message: str) -> None:
    good = {
        "score": np.arange(2.0),
        "bad": np.array([False, True]),
        "design": np.arange(2),
        "day": np.arange(2),
    }
    with pytest.raises(ValueError, match=message):
        Scored(**(good | change))


def test_of_thresholds_that_cost_the_same_the_highest_is_taken() -> None:
    """1.5 alarms for one of two good pages, 3.5 misses one of two misprints; between them both go wrong."""
    pages = scored([1, 3], [2, 4])
    assert [at_threshold(pages, at).cost(1.0) for at in (1.5, 2.5, 3.5)] == [0.5, 1.0, 0.5]
    best = least_cost(pages, 1.0)
    assert (best.threshold, best.false_alarms, best.misses) == (3.5, 0.0, 0.5)
    never = least_cost(
        scored([1.0], [0.0]), 1.0
    )  # nothing can be told: never to alarm costs what always does
    assert (never.threshold, never.misses) == (np.inf, 1.0)
