from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.operating import (
    Scored,
    area_under_roc,
    at_threshold,
    bill,
    bootstrap_cost,
    bootstrap_oracle,
    caught_at,
    conformal_threshold,
    false_alarms_in_words,
    least_cost,
    least_false_alarm_rate,
    roc,
)

ALPHAS = np.array([0.001, 0.01, 0.1, 1.0, 10.0, 100.0])


def scored(good: list[float], bad: list[float], designs: int = 3) -> Scored:
    score = np.array([*good, *bad], np.float64)
    return Scored(
        score=score,
        bad=np.arange(score.size) >= len(good),
        design=np.arange(score.size, dtype=np.int64) % designs,
    )


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
        Scored(score=pages.score[order], bad=pages.bad[order], design=pages.design[order]),
        Scored(score=ranks, bad=pages.bad, design=pages.design),
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


@pytest.mark.parametrize("copies", [1, 8])
def test_an_interval_knows_that_copies_of_a_design_are_one_page(copies: int) -> None:
    """Half of 100 designs alarm, with all their copies: the sd of F is that of 100 pages, 0.05, however many copies."""
    alarms = np.repeat(np.arange(100) < 50, copies)
    design = np.repeat(np.arange(100), copies)
    score = np.concatenate([alarms, np.ones(100)]).astype(np.float64)
    pages = Scored(
        score=score,
        bad=np.arange(score.size) >= alarms.size,
        design=np.concatenate([design, np.arange(100)]),
    )
    rng = np.random.default_rng(1)
    for found in (
        bootstrap_cost(pages, 1.0, threshold=0.5, rng=rng),
        bootstrap_oracle(pages, [1e9], rng=rng)[0],
    ):
        assert found.value == pytest.approx(0.5)
        # 1.96 x 0.05 either side; 1000 resamples know a 97.5 % quantile to about 8 % of that
        assert found.high - found.value == pytest.approx(0.098, rel=0.25)
        assert found.value - found.low == pytest.approx(0.098, rel=0.25)


def test_the_oracles_interval_holds_what_the_oracle_found() -> None:
    rng = np.random.default_rng(2)
    pages = scored(rng.normal(0, 1, 300).tolist(), rng.normal(1, 1, 300).tolist(), designs=60)
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
    with pytest.raises(ValueError, match=r"199 designs cannot promise less than 0\.005"):
        conformal_threshold(score, design, false_alarm_rate=0.004)
    with pytest.raises(ValueError, match="cannot promise"):  # copies are no designs
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


def test_nobody_says_zero() -> None:
    assert false_alarms_in_words(0, 3000) == "< 1.0e-03"
    assert false_alarms_in_words(6, 3000) == "2.0e-03"


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
    ],
)
def test_sets_that_say_nothing_are_refused(change: dict[str, np.ndarray], message: str) -> None:
    good = {"score": np.arange(2.0), "bad": np.array([False, True]), "design": np.arange(2)}
    with pytest.raises(ValueError, match=message):
        Scored(**(good | change))
