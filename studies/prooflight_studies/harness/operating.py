"""Scores of good prints and of misprints -> thresholds, rates, costs, and how sure they are (paper, section 5).

A page alarms if its score lies above the threshold. Copies of one page design resemble one another, so intervals are
bootstrapped over designs, never over copies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts

RESAMPLES: Final = 1000
PERCENTILES: Final = (2.5, 97.5)
RULE_OF_THREE: Final = 3.0
"""With no alarm in n good pages, F < 3 / n at 95 % (Hanley and Lippman-Hand 1983; -ln 0.05 = 2.996)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """What one detector gave a set of pages; higher is worse."""

    score: NDArray[np.float64]
    """(pages,)"""
    bad: NDArray[np.bool_]
    """(pages,) whether it is a misprint."""
    design: NDArray[np.int64]
    """(pages,) which page design it is a print of."""

    def __post_init__(self) -> None:
        if not len(self.score) == len(self.bad) == len(self.design):
            message = f"{len(self.score)} scores, {len(self.bad)} labels, {len(self.design)} designs"
            raise ValueError(message)
        if np.isnan(self.score).any():
            message = "a score is not a number"
            raise ValueError(message)
        if self.bad.all() or not self.bad.any():
            message = "needs good pages and misprints"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A value and its bootstrap 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Operating:
    """One threshold and what it leads to."""

    threshold: float
    false_alarms: float
    """F, share of good pages that alarm. [-]"""
    misses: float
    """M, share of misprints that do not. [-]"""

    def cost(self, alpha: float) -> float:
        """C = F + alpha M (paper, equation 7). [-]"""
        return self.false_alarms + alpha * self.misses


def at_threshold(pages: Scored, threshold: float) -> Operating:
    """What a threshold leads to on these pages."""
    alarm = pages.score > threshold
    return Operating(
        threshold=float(threshold),
        false_alarms=float(alarm[~pages.bad].mean()),
        misses=float((~alarm[pages.bad]).mean()),
    )


def least_cost(pages: Scored, alpha: float) -> Operating:
    """The threshold with the least F + alpha M on these pages, always and never alarming among them.

    It lies midway between two neighbouring scores; of thresholds that cost the same, it is the highest. An oracle's if
    the pages are those it is judged on (as in the paper), an honest one if they are others.
    """
    thresholds, false_alarms, misses = _curve(pages)
    cost = false_alarms + alpha * misses
    best = len(cost) - 1 - int(np.argmin(cost[::-1]))
    return Operating(
        threshold=float(thresholds[best]), false_alarms=float(false_alarms[best]), misses=float(misses[best])
    )


def roc(pages: Scored) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of false alarms and share of misprints caught over all thresholds, both rising from 0 to 1."""
    _, false_alarms, misses = _curve(pages)
    return false_alarms[::-1], 1 - misses[::-1]


def area_under_roc(pages: Scored) -> float:
    """Probability that a misprint scores higher than a good page, ties counting half. [-]"""
    false_alarms, caught = roc(pages)
    return float(np.trapezoid(caught, false_alarms))


def caught_at(pages: Scored, false_alarm_rate: float) -> float:
    """Greatest share of misprints caught by a threshold with at most so many false alarms on these pages. [-]"""
    false_alarms, caught = roc(pages)
    return float(caught[false_alarms <= false_alarm_rate].max())


def bootstrap_cost(
    pages: Scored, alpha: float, *, threshold: float, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Interval:
    """F + alpha M at a threshold chosen elsewhere, with its interval over designs."""
    place, drawn = _drawn_designs(pages.design, rng, resamples)
    value = at_threshold(pages, threshold).cost(alpha)
    return interval_of(value, resampled_costs(pages, alpha, threshold=threshold, place=place, drawn=drawn))


def resampled_costs(
    pages: Scored,
    alpha: float,
    *,
    threshold: float,
    place: NDArray[np.intp],
    drawn: NDArray[np.floating | np.int64],
) -> NDArray[np.float64]:
    """F + alpha M with page designs drawn again, (resamples,).

    place (pages,): which design each is a print of; drawn (resamples, designs): how often each is drawn.
    """
    alarm, designs = pages.score > threshold, drawn.shape[1]
    rates = []
    for side, wrong in ((~pages.bad, alarm), (pages.bad, ~alarm)):
        wrongs, count = (
            drawn @ np.bincount(place, weights=what, minlength=designs) for what in (wrong & side, side)
        )
        rates.append(wrongs / np.maximum(count, 1))
    return np.asarray(rates[0] + alpha * rates[1])


def bootstrap_oracle(
    pages: Scored, alphas: Sequence[float], *, rng: np.random.Generator, resamples: int = RESAMPLES
) -> list[Interval]:
    """Least F + alpha M for each alpha, the threshold chosen anew on each resample of the designs, as on the pages."""
    order = np.argsort(pages.score, kind="stable")
    last = np.append(
        np.diff(pages.score[order]) > 0, True
    )  # where a threshold can lie: after a run of equal scores
    bad = pages.bad[order]
    place, drawn = _drawn_designs(pages.design, rng, resamples)
    place = place[order]
    found = np.empty((len(alphas), resamples))
    for index, times in enumerate(drawn):
        weight = times[place]
        missed, good = np.cumsum(weight * bad)[last], np.cumsum(weight * ~bad)[last]
        misses = np.append(0, missed / max(missed[-1], 1))
        false_alarms = 1 - np.append(0, good / max(good[-1], 1))
        for row, alpha in enumerate(alphas):
            found[row, index] = (false_alarms + alpha * misses).min()
    return [
        interval_of(least_cost(pages, alpha).cost(alpha), of_alpha)
        for alpha, of_alpha in zip(alphas, found, strict=True)
    ]


def _drawn_designs(
    design: NDArray[np.int64], rng: np.random.Generator, resamples: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Place of each page's design (pages,), and how often each is drawn with replacement (resamples, designs)."""
    _, place = np.unique(design, return_inverse=True)
    count = int(place.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples)
    return place, np.asarray(drawn, np.float64)


def false_alarms_in_words(alarms: int, good_pages: int) -> str:
    """F for people: nobody who saw no alarm may say 0.

    >>> false_alarms_in_words(0, 6000), false_alarms_in_words(3, 6000)
    ('< 5.0e-04', '5.0e-04')
    """
    if alarms == 0:
        return f"< {RULE_OF_THREE / good_pages:.1e}"
    return f"{alarms / good_pages:.1e}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bill:
    """What errors cost on so many pages. [cent]"""

    with_system: float
    without: float
    """Nothing is checked: every misprint passes."""
    stopping_always: float


def bill(costs: RunningCosts, normalised: float, *, pages: int = 10_000) -> Bill:
    """C of equation 6 for a normalised cost c, and beside it what never (c = alpha) and always (c = 1) stopping cost.

    As printed, section 5.2 takes alpha for 0.001; its own numbers give 0.101 (errata, E1), and with that its 3.4 cents.
    """
    return Bill(
        with_system=pages * costs.cents_per_page(normalised),
        without=pages * costs.cents_per_page(costs.alpha),
        stopping_always=pages * costs.cents_per_page(1.0),
    )


def _curve(pages: Scored) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """All thresholds that differ on these pages, rising, with F and M of each."""
    scores, place = np.unique(pages.score, return_inverse=True)
    good = np.bincount(place[~pages.bad], minlength=len(scores))
    bad = np.bincount(place[pages.bad], minlength=len(scores))
    with np.errstate(invalid="ignore", over="ignore"):  # scores may be infinite
        middle = (scores[:-1] + scores[1:]) / 2
    # the middle of neighbouring numbers rounds to the upper, that of infinities is none
    between = np.where(middle < scores[1:], middle, scores[:-1])
    thresholds = np.concatenate([[-np.inf], between, [np.inf]])
    false_alarms = 1 - np.append(0, np.cumsum(good)) / good.sum()
    misses = np.append(0, np.cumsum(bad)) / bad.sum()
    return thresholds, false_alarms, misses


def interval_of(value: float, resampled: NDArray[np.float64]) -> Interval:
    """A value with the 95 % of its resamples."""
    low, high = np.percentile(resampled, PERCENTILES)
    return Interval(value=float(value), low=float(low), high=float(high))
