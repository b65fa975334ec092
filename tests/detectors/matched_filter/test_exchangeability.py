"""The gamblers of a run's test: fair games, how rarely any wins falsely, and what they see and let pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, kstest

from prooflight.detectors.matched_filter.exchangeability import (
    FALSELY,
    MISPRINTS,
    OF_SCORE,
    STAKES,
    ExchangeabilityTest,
    _bet,
    shares,
)
from prooflight.detectors.weighted_conformal import LabelledPages

OWN, PAGES, WORDS = 119, 30, 20
"""Good pages of a press as built, pages of a run, and groups of statistics."""


def fresh(own: np.ndarray) -> ExchangeabilityTest:
    """Before a run, with a press's own pages (pages, groups)."""
    names = ("score", *(f"word-{k}" for k in range(1, own.shape[1])))
    return ExchangeabilityTest(
        reference_pages=list(own), room=10**6, names=names, log_wealth=np.zeros((own.shape[1], STAKES.size))
    )


def after(own: np.ndarray, pages: np.ndarray, rng: np.random.Generator) -> ExchangeabilityTest:
    """After a run's pages (pages, groups)."""
    test = fresh(own)
    for page in pages:
        test.add(page, rng)
    return test


def alike(rng: np.random.Generator, pages: int) -> np.ndarray:
    """(pages, 1 + WORDS), all of which hang together half, as those of good pages do."""
    return (rng.standard_normal((pages, 1)) + rng.standard_normal((pages, 1 + WORDS))) / np.sqrt(2)


def test_a_bet_has_the_mean_1() -> None:
    """Over 200,000 ranks at the middles of even steps; tolerance: the midpoint rule's, far below 1e-6."""
    steps = (np.arange(200_000) + 0.5) / 200_000
    mean = _bet(MISPRINTS + (1 - MISPRINTS) * steps).mean(axis=0)
    np.testing.assert_allclose(mean, 1, atol=1e-6)


@pytest.mark.parametrize("groups", [2, 5, 21])
def test_shares_add_up_to_1_and_the_score_has_half(groups: int) -> None:
    assert shares(groups).sum() == pytest.approx(1)
    assert shares(groups)[0] == OF_SCORE


def test_the_greatest_wealth_times_its_share_counts() -> None:
    """One page above all 19 in the score and in one of two groups; its rank there is u / 20, of u that is drawn."""
    test = fresh(np.zeros((19, 3)))
    test.add(np.array([1.0, 1.0, -1.0]), np.random.default_rng(15))
    u = np.random.default_rng(15).random(3)
    p = MISPRINTS + (1 - MISPRINTS) * np.array([u[0], u[1], 19 + u[2]]) / 20
    own = (1 - MISPRINTS) * STAKES * p[:, None] ** (STAKES - 1) / (1 - MISPRINTS**STAKES)
    wealth = own.mean(axis=1) * [0.5, 0.25, 0.25]
    np.testing.assert_allclose(np.exp(test.gained), wealth)
    assert test.most == pytest.approx(np.log(wealth.max()))
    assert test.strangest == "word-1"


def test_what_one_summary_said_tells_of_the_next_page_by_another() -> None:
    """Why wealths are not added up: of three pages whose second summary falls where the first is above its middle, the
    third is lowest in 2 of 3 cases where the first two disagree, and not in 1 of 3 (seed 14; tolerance: 4 sigma).
    """
    first = np.random.default_rng(14).random((40_000, 3))
    second = np.where(first < 0.5, first, 1.5 - first)
    lowest = first[:, 2] < first[:, :2].min(axis=1)
    disagree = (first[:, 0] < first[:, 1]) != (second[:, 0] < second[:, 1])
    assert lowest.mean() == pytest.approx(1 / 3, abs=0.01)
    assert lowest[disagree].mean() == pytest.approx(2 / 3, abs=0.02)


def test_pages_that_are_exchangeable_suspend_at_most_1_run_in_1000() -> None:
    """1,000 runs, seed 16; tolerance: the binomial's 0.1 %. One page in two ties with others."""
    rng = np.random.default_rng(16)
    most = []
    for _ in range(1000):
        rows = alike(rng, OWN + PAGES)
        rows = np.where(rng.random((len(rows), 1)) < 0.5, np.round(rows), rows)
        most.append(after(rows[:OWN], rows[OWN:], rng).most)
    above = int((np.array(most) >= -np.log(FALSELY)).sum())
    assert above <= binom.ppf(0.999, 1000, FALSELY)
    assert max(most) > 0  # the wealth moves at all


def test_scores_that_lie_higher_are_seen_where_no_group_is() -> None:
    """40 runs, seed 17: the score 1.5 standard deviations up, as where 20 of 100 pages alarm at a promise of 1 in 100,
    and each group 0.3. The earlier test, of 120 even stakes on 20 groups alone, told of 2.
    """
    rng, told, by_groups = np.random.default_rng(17), 0, 0
    for _ in range(40):
        rows = alike(rng, OWN + PAGES)
        rows[OWN:] += np.where(np.arange(1 + WORDS) == 0, 1.5, 0.3)
        test = after(rows[:OWN], rows[OWN:], rng)
        told += test.suspended
        by_groups += bool(test.gained[1:].max() >= -np.log(FALSELY))
    assert told >= 36
    assert by_groups <= 12


def test_misprints_among_good_pages_hardly_ever_suspend() -> None:
    """300 runs, seed 18, one page in 20 further out than all good ones in everything: 1 in 100 runs at most, as with
    120 even stakes (3 in 1,000 on left-out pages of a press).
    """
    rng, told = np.random.default_rng(18), 0
    for _ in range(300):
        rows = alike(rng, OWN + PAGES)
        wrong = rng.random(PAGES) < MISPRINTS
        rows[OWN:][wrong] = 10 + rng.random((int(wrong.sum()), 1))
        told += after(rows[:OWN], rows[OWN:], rng).suspended
    assert told <= 3


def sampled(rng: np.random.Generator, *, sheets: int, shift: float = 0.0) -> LabelledPages:
    """Standard normal scores: all above 1.28 and one in 50 of the others told good."""
    score = rng.standard_normal(sheets) + shift
    passed = score <= 1.28
    told = np.flatnonzero(~passed | (rng.random(sheets) < 0.02))
    return LabelledPages(
        score=score[told],
        weight=np.where(passed[told], 50.0, 1.0),
        run=np.ones(told.size, np.int64),
        sheet=told,
        passed=passed[told],
        rate=0.01,
        passed_weight=50.0,
        alarms_from=1.28,
        replaces="x",
    )


def test_told_pages_kept_by_their_weight_are_drawn_alike() -> None:
    """Seed 19, 60,000 sheets, some 1,200 kept: Kolmogorov and Smirnov's p is above 1e-4; that of all told is below."""
    rng = np.random.default_rng(19)
    told = sampled(rng, sheets=60_000)
    assert kstest(told.alike(rng), "norm").pvalue > 1e-4
    assert kstest(told.score, "norm").pvalue < 1e-4


def test_of_each_design_one_page_is_kept() -> None:
    rng = np.random.default_rng(20)
    told = sampled(rng, sheets=20_000)
    of_few = replace(told, design=np.arange(told.score.size) % 7)
    assert of_few.alike(rng).size == 7


def test_runs_like_the_told_pages_suspend_at_most_1_in_1000_and_others_are_told_of() -> None:
    """500 runs of 60 pages, each after words of its own, seed 21; tolerance: the binomial's 0.1 %. 40 more whose
    scores lie 1.5 standard deviations up: of them nine in ten are told of.
    """
    rng, alike_runs, others = np.random.default_rng(21), 0, 0
    for run in range(540):
        test = ExchangeabilityTest.of_labelled(sampled(rng, sheets=5_000), rng)
        for score in rng.standard_normal(60) + (1.5 if run >= 500 else 0.0):
            test.add(np.array([score]), rng)
        alike_runs, others = (
            alike_runs + (test.suspended and run < 500),
            others + (test.suspended and run >= 500),
        )
    assert alike_runs <= binom.ppf(0.999, 500, FALSELY)
    assert others >= 36
    assert test.strangest == "score"
