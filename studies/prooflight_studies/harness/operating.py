"""Thresholds, error rates, costs and their uncertainty from scores of good prints and misprints (paper, section 5).

A page alarms if its score is above the threshold. Pages of one press day share its inks, lamp and sensors, so the
bootstrap resamples press days, never designs or copies. Bounds by count (``rate_below``) treat pages as independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import special

from prooflight.detectors.weighted_conformal import exact_interval

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts

RESAMPLES: Final = 1000
PERCENTILES: Final = (2.5, 97.5)
SURE: Final = 0.95
"""Confidence level of a rate's one-sided bound by count."""
BOUND_NOTE: Final = (
    f"In brackets after a count: upper limit of its rate with {100 * SURE:g} % confidence, if the events are "
    "independent (Clopper and Pearson 1934, one-sided)."
)
"""Explanation that accompanies every rate that ``counted`` formats."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """Scores that one detector gave a set of pages; higher is worse."""

    score: NDArray[np.float64]
    """(pages,)"""
    bad: NDArray[np.bool_]
    """Whether each page is a misprint. (pages,)"""
    design: NDArray[np.int64]
    """Page design that each page is a print of. (pages,)"""
    day: NDArray[np.int64]
    """Press day on which each page was printed. (pages,)"""

    def __post_init__(self) -> None:
        if not len(self.score) == len(self.bad) == len(self.design) == len(self.day):
            of = f"{len(self.design)} designs, {len(self.day)} days"
            message = f"{len(self.score)} scores, {len(self.bad)} labels, {of}"
            raise ValueError(message)
        if np.isnan(self.score).any():
            message = "a score is not a number"
            raise ValueError(message)
        if self.bad.all() or not self.bad.any():
            message = "needs good pages and misprints"
            raise ValueError(message)

    def pages(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Scored:
        """Return some of the pages, selected by a mask or by index."""
        return Scored(
            score=self.score[which], bad=self.bad[which], design=self.design[which], day=self.day[which]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A value and its bootstrap 95 % interval.

    The limits are NaN if there is only one press day, from which no spread can be estimated.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Operating:
    """A threshold and the error rates that it leads to."""

    threshold: float
    false_alarms: float
    """F, the share of good pages that alarm. [-]"""
    misses: float
    """M, the share of misprints that do not alarm. [-]"""

    def cost(self, alpha: float) -> float:
        """Return C = F + alpha M (paper, equation 7). [-]"""
        return self.false_alarms + alpha * self.misses


def at_threshold(pages: Scored, threshold: float) -> Operating:
    """Return the error rates of a threshold on these pages."""
    alarm = pages.score > threshold
    return Operating(
        threshold=float(threshold),
        false_alarms=float(alarm[~pages.bad].mean()),
        misses=float((~alarm[pages.bad]).mean()),
    )


def least_cost(pages: Scored, alpha: float) -> Operating:
    """Return the threshold with the least F + alpha M on these pages.

    Candidates include always and never alarming. It is midway between two neighbouring scores; of thresholds of equal
    cost, it is the highest. It is an oracle's if the pages are also those it is evaluated on (as in the paper), and an
    honest one if they are others.
    """
    thresholds, false_alarms, misses = _curve(pages)
    cost = false_alarms + alpha * misses
    best = len(cost) - 1 - int(np.argmin(cost[::-1]))
    return Operating(
        threshold=float(thresholds[best]), false_alarms=float(false_alarms[best]), misses=float(misses[best])
    )


def roc(pages: Scored) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the false-alarm rate and the share of misprints caught over all thresholds, both rising from 0 to 1."""
    _, false_alarms, misses = _curve(pages)
    return false_alarms[::-1], 1 - misses[::-1]


def area_under_roc(pages: Scored) -> float:
    """Return the probability that a misprint scores higher than a good page, ties counting half. [-]"""
    false_alarms, caught = roc(pages)
    return float(np.trapezoid(caught, false_alarms))


def caught_at(pages: Scored, false_alarm_rate: float) -> float:
    """Return the greatest share of misprints caught with at most this false-alarm rate on these pages. [-]"""
    false_alarms, caught = roc(pages)
    return float(caught[false_alarms <= false_alarm_rate].max())


def bootstrap_cost(
    pages: Scored, alpha: float, *, threshold: float, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Interval:
    """Return F + alpha M at a threshold chosen elsewhere, with its interval over press days."""
    place, drawn = drawn_clusters(pages.day, rng, resamples=resamples)
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
    """Return F + alpha M of resampled clusters, (resamples,); place, drawn: as ``drawn_clusters`` returns them.

    All are NaN where there is only one cluster: resampling it yields itself, and no spread can be estimated.
    """
    alarm, clusters = pages.score > threshold, drawn.shape[1]
    if clusters < 2:
        return np.full(len(drawn), np.nan)
    rates = []
    for side, wrong in ((~pages.bad, alarm), (pages.bad, ~alarm)):
        wrongs, count = (
            drawn @ np.bincount(place, weights=what, minlength=clusters) for what in (wrong & side, side)
        )
        rates.append(wrongs / np.maximum(count, 1))
    return np.asarray(rates[0] + alpha * rates[1])


def bootstrap_oracle(
    pages: Scored, alphas: Sequence[float], *, rng: np.random.Generator, resamples: int = RESAMPLES
) -> list[Interval]:
    """Return the least F + alpha M for each alpha, the threshold chosen again on each resample of the press days."""
    order = np.argsort(pages.score, kind="stable")
    last = np.append(
        np.diff(pages.score[order]) > 0, True
    )  # where a threshold can lie: after a run of equal scores
    bad = pages.bad[order]
    place, drawn = drawn_clusters(pages.day, rng, resamples=resamples)
    place = place[order]
    costs = np.full((len(alphas), resamples), np.nan)
    for index, times in enumerate(drawn if drawn.shape[1] > 1 else ()):
        weight = times[place]
        missed, good = np.cumsum(weight * bad)[last], np.cumsum(weight * ~bad)[last]
        misses = np.append(0, missed / max(missed[-1], 1))
        false_alarms = 1 - np.append(0, good / max(good[-1], 1))
        for row, alpha in enumerate(alphas):
            costs[row, index] = (false_alarms + alpha * misses).min()
    return [
        interval_of(least_cost(pages, alpha).cost(alpha), of_alpha)
        for alpha, of_alpha in zip(alphas, costs, strict=True)
    ]


def drawn_clusters(
    cluster: NDArray[np.int64],
    rng: np.random.Generator,
    *,
    clusters: NDArray[np.int64] | None = None,
    resamples: int = RESAMPLES,
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the index of each page's cluster (pages,), and how often each cluster is drawn (resamples, clusters).

    Clusters are drawn with replacement.

    Parameters
    ----------
    cluster : (pages,)
        What pages share, for example a press day.
    clusters : optional
        All clusters in rising order, also those that left no page, so that two sets of pages can be resampled
        alike. By default those of these pages.
    """
    distinct = np.unique(cluster) if clusters is None else clusters
    drawn = rng.multinomial(len(distinct), np.full(len(distinct), 1 / len(distinct)), size=resamples)
    return np.searchsorted(distinct, cluster), np.asarray(drawn, np.float64)


def rate_below(count: int, of: int) -> float:
    """Return the upper 95 % confidence limit of a rate, after ``count`` events among ``of`` independent pages. [-]

    Exact, one-sided (Clopper and Pearson 1934); 1 where there are no data.
    """
    return float(special.betaincinv(count + 1, of - count, SURE)) if count < of else 1.0


def counted(count: int, of: int) -> str:
    """Format a rate of misses or false alarms with its upper limit: a count of none does not prove a rate of 0.

    >>> counted(0, 778), counted(12, 1240), counted(5, 5), counted(0, 0)
    ('0 of 778 (< 0.38 %)', '12 of 1,240, 0.97 % (< 1.6 %)', '5 of 5, 100 %', '-')
    """
    if not of:
        return "-"
    rate = f", {_percent(count / of)}" if count else ""
    bound = f" (< {_percent(rate_below(count, of))})" if count < of else ""
    return f"{count:,} of {of:,}{rate}{bound}"


def share_with_interval(count: int, of: int) -> str:
    """Format a share with its exact two-sided 95 % interval, as of independent pages.

    >>> share_with_interval(0, 140), share_with_interval(3, 70), share_with_interval(0, 0)
    ('0 of 140 (0 to 2.6 %)', '3 of 70, 4.3 % (0.89 to 12 %)', '-')
    """
    if not of:
        return "-"
    low, high = exact_interval(count, of, 0.95)
    rate = f", {_percent(count / of)}" if count else ""
    return f"{count:,} of {of:,}{rate} ({_percent(low).removesuffix(' %')} to {_percent(high)})"


def _percent(share: float) -> str:
    """Format a share as a percentage of two digits."""
    return f"{float(f'{100 * share:.2g}'):g} %"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bill:
    """Cost of errors on a number of pages. [cent]"""

    with_system: float
    without: float
    """Cost if no page is checked: every misprint passes."""
    stopping_always: float


def bill(costs: RunningCosts, normalised: float, *, pages: int = 10_000) -> Bill:
    """Return C of equation 6 for a normalised cost c, and the cost of never (c = alpha) and always (c = 1) stopping.

    As printed, section 5.2 takes alpha as 0.001; its own numbers give 0.101 (errata, E1), and with that its 3.4 cents.
    """
    return Bill(
        with_system=pages * costs.cents_per_page(normalised),
        without=pages * costs.cents_per_page(costs.alpha),
        stopping_always=pages * costs.cents_per_page(1.0),
    )


def _curve(pages: Scored) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return all thresholds that differ on these pages, rising, with F and M of each."""
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
    """Return a value with the central 95 % interval of its resamples."""
    low, high = np.percentile(resampled, PERCENTILES)
    return Interval(value=float(value), low=float(low), high=float(high))
