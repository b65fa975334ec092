"""Test of likeness: its level where pages are alike, its power, and the closed form of the conformal bound."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.false_alarm_rate import (
    LEVEL,
    POWER,
    GoodScores,
    Likeness,
    PressScores,
    least_false_alarm_rate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

TRIALS = 2000
FIVE_SD = 5 * np.sqrt(0.25 / TRIALS)
"""Binomial bound: five standard deviations of a share of ``TRIALS``, at most."""


def share_told_apart(power: float, pages: int, seed: int) -> float:
    """Return the share of presses that are told apart if P(p <= u) = u^power, of 1,480 simulated pages."""
    rng = np.random.default_rng(seed)
    told = [
        Likeness.of(-power_of(rng, pages, power), np.sort(-rng.random(1480))).is_distinct
        for _ in range(TRIALS)
    ]
    return float(np.mean(told))


def power_of(rng: np.random.Generator, pages: int, power: float) -> NDArray[np.float64]:
    return rng.random(pages) ** (1 / power)


@pytest.mark.parametrize("pages", [20, 80])
def test_presses_like_the_simulated_ones_are_told_apart_at_the_stated_level(pages: int) -> None:
    assert share_told_apart(1.0, pages, 1) == pytest.approx(LEVEL, abs=FIVE_SD)


@pytest.mark.parametrize("pages", [20, 40, 80])
def test_pages_that_alarm_as_often_as_stated_are_told_apart_with_the_stated_power(pages: int) -> None:
    ratio = Likeness(p_value=1.0, pages=pages).detectable(0.01)
    power = 1 + np.log(ratio) / np.log(0.01)
    assert share_told_apart(power, pages, 2) == pytest.approx(POWER, abs=FIVE_SD)
    assert ratio > Likeness(p_value=1.0, pages=2 * pages).detectable(0.01) > 1


def test_pages_that_score_lower_are_not_told_apart() -> None:
    rng = np.random.default_rng(3)
    assert Likeness.of(rng.random(40) - 1, np.sort(rng.random(1000))).p_value > 0.999


@pytest.mark.parametrize("pages", [20, 40])
def test_own_pages_alone_keep_exactly_what_they_support(pages: int) -> None:
    """Uniform scores: the greatest of n is exceeded with the probability 1 / (n + 1), of standard deviation as much."""
    rng, rate, simulated = (
        np.random.default_rng(4),
        least_false_alarm_rate(pages),
        GoodScores(worst=np.arange(99.0)),
    )
    beyond = []
    for _ in range(TRIALS):
        own = GoodScores(worst=np.sort(rng.random(pages)))
        scores = PressScores(reference=simulated, own=own, own_only=True)
        assert scores.least_rate == rate
        beyond.append(1 - scores.threshold(rate)[0])
    assert np.mean(beyond) == pytest.approx(rate, abs=5 * rate / np.sqrt(TRIALS))
