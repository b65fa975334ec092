"""False-alarm rate of a threshold, by a count of good designs or by extrapolation of their scores' tail."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

LEVEL: Final = 0.2
"""Share of presses like the simulated ones that are told apart from them all the same.

Assumed: a press that is told apart falsely promises less until it has learned more pages, while one that is not told
apart breaks its promise; so the level is far above the usual 0.05.
"""
POWER: Final = 0.9
"""Probability of being told apart for which ``Likeness.detectable`` is stated."""
TAIL_SHARE: Final = 0.2
"""Share of the designs whose scores make the tail."""
LEAST_IN_TAIL: Final = 5
FURTHEST: Final = 10.0
"""Limit of extrapolation: a tail supports no rate below a tenth of what the designs guarantee by count, and a
request for less gets that."""
ALONE: Final = 5.0
"""Number of a press's own good pages beyond a threshold from which these decide alone: it is then known to a
factor of 1.6 (a standard deviation)."""
BEYOND: Final = (0.2, 0.1, 0.05)
FEWEST_OF_KIND: Final = 5
"""Least number of learned pages of a kind for which a promise stands. (assumed)"""
LIKE_OTHERS: Final = 4.0
"""Number of a press's pages that are assumed, a priori, to be like others'. (assumed)"""
LEAST_RATIO: Final = 0.8
UNSURE: Final = 1.28
"""Standard deviations by which a tail's mean excess is overestimated: its upper 90 % bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Likeness:
    """Test of whether good pages of a press reach into the tail of simulated pages' scores more often than these do.

    Each page of the press is ranked among the simulated ones, which gives conformal p-values; Fisher's combination of
    them, -sum ln p, is large where many are small. The p-values share the simulated pages and so depend on each other;
    with n pages among m its law is that of a Gamma variable of shape n, widened by sqrt(1 + n / m) about its mean
    (Bates, Candes, Lei, Romano, Sesia 2023, "Testing for outliers with conformal p-values", theorem 3, asymptotic in n
    and m). Pages that score lower than simulated ones break no promise: the test is one-sided.
    """

    p_value: float
    pages: int
    """Number of the press's own pages."""

    @classmethod
    def of(cls, own: NDArray[np.float64], simulated: NDArray[np.float64]) -> Self:
        """Compare scores of a press's own good pages (n,) with those of simulated ones (m,), rising."""
        n, m = own.size, simulated.size
        above = m - np.searchsorted(simulated, own, side="left")
        combined = -np.log((1 + above) / (m + 1)).sum()
        wider = np.sqrt(1 + n / m)
        return cls(p_value=float(special.gammaincc(n, max(n + (combined - n) / wider, 0.0))), pages=n)

    @property
    def is_distinct(self) -> bool:
        """Return whether simulated pages are shown to be unlike those of the press."""
        return self.p_value <= LEVEL

    def detectable(self, rate: float) -> float:
        """Return how many times as often pages must alarm as promised, to be told apart with ``POWER``.

        Assumed: their p-values follow Lehmann's law P(p <= u) = u^t, so that -ln p is exponential with mean 1 / t.
        rate: of the alarm. [-]
        """
        power_at = special.gammaincinv(self.pages, 1 - POWER) / special.gammaincinv(self.pages, 1 - LEVEL)
        return float(rate ** (power_at - 1))


def least_false_alarm_rate(designs: int) -> float:
    """Return the least false-alarm rate that n exchangeable good designs can guarantee: 1 / (n + 1). [-]"""
    return 1 / (designs + 1)


def conformal_threshold(
    score: NDArray[np.float64], design: NDArray[np.int64], *, false_alarm_rate: float
) -> float:
    """Return the threshold that a new design's good page exceeds with at most this probability.

    It is split conformal over designs. score, design (pages,) of good pages. Each design counts once, with
    the worst of its copies; the threshold is the ceil((n + 1)(1 - rate))-th smallest of these (Vovk et al.
    2005, chapter 4). ValueError: n designs cannot guarantee that rate.
    """
    worst = GoodScores.of(score, design).worst
    rank = int(np.ceil((len(worst) + 1) * (1 - false_alarm_rate) - 1e-9))
    if rank > len(worst):
        message = f"{len(worst)} designs cannot support a rate below {least_false_alarm_rate(len(worst)):.2g}"
        raise ValueError(message)
    return float(worst[rank - 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Guarantee:
    """False-alarm rate that a threshold guarantees, and its basis."""

    rate: float
    """One good page in 1 / rate alarms. [-]"""
    simulated: int
    """Number of simulated good designs of this press that set it."""
    real: int = 0
    """Number of real good pages of this press that set it."""
    reference: int = 0
    """Number of good designs of other presses that set it as well."""
    conformal: bool = True
    """False: there are too few designs for such a rate; the tail of their scores is extrapolated."""
    requested_rate: float = 0.0
    """Requested rate; 0: the same. [-]"""
    label_source: str = ""
    """Description of the labelled sheets of the press that set it; empty: there were none."""
    likeness: Likeness | None = None
    """Test of the real pages against those that taught the ranking; None: there are no real pages."""
    kinds: tuple[tuple[str, int], ...] = ()
    """Number of real pages of each kind of page."""

    def __str__(self) -> str:
        odds = f"at most one good page in {1 / self.rate:,.0f} alarms"
        if self.label_source:
            return f"{odds}; by count, from {self.label_source}"
        if 0 < self.requested_rate < self.rate * (1 - 1e-9):
            odds += f" (one in {1 / self.requested_rate:,.0f} was requested, and is refused)"
        if self.likeness is not None:
            return f"{odds}; {self._of_real_pages(self.likeness)}{self._of_kinds}"
        sources = [f"{self.real} real good pages"] if self.real else []
        sources += [f"{self.simulated} simulated good designs"] if self.simulated else []
        basis = " and ".join(sources)
        if self.reference:
            basis += f" of this press and {self.reference:,} of those that trained the ranking"
        if self.conformal:
            if 0 < self.real < 1 / self.rate - 1:
                # Real pages need not be exchangeable with those of the presses that trained the ranking.
                basis += f"; these {self.real} pages alone support one in {self.real + 1}"
            return f"{odds}; by count, from {basis}"
        least = 1 / least_false_alarm_rate(self.simulated + self.real + self.reference)
        return (
            f"{odds}; extrapolated: {basis} support one in {least:,.0f} by count, and their tail beyond that"
        )

    def _of_real_pages(self, likeness: Likeness) -> str:
        """Return what the promise rests on, where real pages were learned."""
        pages, p_value = f"{self.real} real good pages of this press", f"p = {likeness.p_value:.2g}"
        if not self.reference:
            if not likeness.is_distinct:
                return f"by count, from {pages}"
            return f"by count, from {pages} alone: simulated pages were distinguished from them ({p_value})"
        basis = "by count" if self.conformal else "extrapolated"
        return (
            f"{basis}, from {pages} and {self.reference:,} simulated pages, which were not distinguished from them "
            f"({p_value}; pages that alarm {likeness.detectable(self.rate):.1f} times as often are distinguished 9 "
            f"times in 10); these {self.real} pages alone support one in {self.real + 1}"
        )

    @property
    def _of_kinds(self) -> str:
        """Return for which kinds of page the promise stands."""
        learned = ", ".join(f"{kind} ({count})" for kind, count in self.kinds if count >= FEWEST_OF_KIND)
        few = [
            f"{kind} pages ({count} learned: one in {count + 1})" if count else f"{kind} pages (none learned)"
            for kind, count in self.kinds
            if count < FEWEST_OF_KIND
        ]
        stands = f"; it applies to pages of the kinds learned: {learned}" if learned else ""
        return stands + (f", and is not supported for {', '.join(few)}" if few else "")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodScores:
    """Scores of good pages of designs outside of the training set, the worst of each design, rising."""

    worst: NDArray[np.float64]
    """(designs,)"""

    @classmethod
    def of(cls, score: NDArray[np.float64], design: NDArray[np.int64]) -> GoodScores:
        """Reduce scores of pages (pages,) to the worst of each design; each design counts once."""
        designs, place = np.unique(design, return_inverse=True)
        worst = np.full(designs.size, -np.inf)
        np.maximum.at(worst, place, score)
        return cls(worst=np.sort(worst))

    @property
    def least_rate(self) -> float:
        """Least rate for which these designs give a threshold, by extrapolation of their tail. [-]"""
        return least_false_alarm_rate(self.worst.size) / FURTHEST

    def threshold(self, false_alarm_rate: float) -> tuple[float, bool]:
        """Return the threshold for a rate, and whether it is by count (conformal).

        A new design's good page exceeds it at most at that rate.

        If these are too few for such a rate it is the tail's beginning plus its mean excess, at its upper
        bound, times ln(share in the tail / rate), and no less than the greatest score.
        """
        count = self.worst.size
        if false_alarm_rate >= least_false_alarm_rate(count) * (1 - 1e-12):
            every = np.arange(count)
            return conformal_threshold(self.worst, every, false_alarm_rate=false_alarm_rate), True
        begin, excess, share = self._tail
        return max(begin + excess * float(np.log(share / false_alarm_rate)), float(self.worst[-1])), False

    def p_value(self, score: float) -> float:
        """Return the share of good designs that score so high.

        It is by count, with one more counted, or less by the tail.
        """
        count = self.worst.size
        above = count - int(np.searchsorted(self.worst, score, side="left"))
        begin, excess, share = self._tail
        drawn = share * float(np.exp(-min(max(score - begin, 0.0) / excess, 500.0)))
        return (1 + above) / (count + 1) if score <= begin else min((1 + above) / (count + 1), drawn)

    @property
    def _tail(self) -> tuple[float, float, float]:
        """Where the tail begins, its mean excess at the upper bound, and the share of designs in it."""
        finite = self.worst[np.isfinite(self.worst)]
        inside = min(max(round(TAIL_SHARE * finite.size), LEAST_IN_TAIL), finite.size - 1)
        begin = float(finite[-inside - 1])
        excess = float((finite[-inside:] - begin).mean()) * (1 + UNSURE / np.sqrt(inside))
        return begin, max(excess, 1e-3), (inside + 1) / (self.worst.size + 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceScores:
    """Scores of good pages of designs outside of the training set, by detectors adapted by few or many pages.

    The fewer those pages, the more widely a press is taken to scatter, and the shorter is the tail of the
    scores.
    """

    pages: NDArray[np.int64]
    """(sizes,) number of pages that a detector was adapted by, rising."""
    worst: NDArray[np.float64]
    """(sizes, designs) scores, rising along the designs."""

    @classmethod
    def alone(cls, scores: GoodScores) -> ReferenceScores:
        """Return scores that do not depend on the number of pages."""
        return cls(pages=np.array([1]), worst=scores.worst[None])

    def by(self, pages: int) -> GoodScores:
        """Return the scores of the size next above ``pages``: their tail is the longer one."""
        at = min(int(np.searchsorted(self.pages, pages)), self.pages.size - 1)
        return GoodScores(worst=self.worst[at])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressScores:
    """Scores of a press's own good pages, combined with those of many pages of other presses.

    A press's own pages are few, and the many are of other presses: so the many determine the tail of the
    scores, and the few how often this press's pages reach into it. If its own pages are many (``ALONE``),
    they decide by themselves.
    """

    reference: GoodScores
    own: GoodScores
    own_only: bool = False
    """Whether the many were told apart from this press's own pages, so that these decide alone, and by count."""

    @property
    def least_rate(self) -> float:
        """Least rate that the reference's tail, scaled by ``ratio``, or this press's own pages alone support.

        [-]
        """
        if self.own_only:
            return least_false_alarm_rate(self.own.worst.size)
        return min(self.reference.least_rate * self.ratio, ALONE / self.own.worst.size)

    def alone(self, false_alarm_rate: float) -> bool:
        """Return whether enough of a press's own pages are beyond the threshold of a rate to decide alone."""
        return self.own_only or self.own.worst.size * false_alarm_rate >= ALONE * (1 - 1e-9)

    @property
    def ratio(self) -> float:
        """Ratio of the press's own pages to the reference's beyond the reference's quantiles.

        It is the mean of the ratios beyond each of ``BEYOND``, shrunk to 1 by ``LIKE_OTHERS`` pages, and no
        less than ``LEAST_RATIO``.
        """
        beyond = np.array(BEYOND)
        from_here = np.quantile(self.reference.worst, 1 - beyond)
        above = (self.own.worst > from_here[:, None]).sum(axis=1)
        ratios = (above + LIKE_OTHERS) / (beyond * self.own.worst.size + LIKE_OTHERS)
        return max(float(ratios.mean()), LEAST_RATIO)

    def threshold(self, false_alarm_rate: float) -> tuple[float, bool]:
        """See ``GoodScores``."""
        if self.alone(false_alarm_rate):
            return self.own.threshold(false_alarm_rate)
        return self.reference.threshold(false_alarm_rate / self.ratio)

    def p_value(self, score: float, false_alarm_rate: float) -> float:
        """See ``GoodScores``; false_alarm_rate: the guaranteed one, which determines whose scores decide."""
        if self.alone(false_alarm_rate):
            return self.own.p_value(score)
        return min(self.reference.p_value(score) * self.ratio, 1.0)


def posterior_bound(p_value: float, misprint_rate: float) -> float:
    """Return the greatest probability of a misprint that a p-value can support, given the rate of misprints.

    Odds are multiplied by at most 1 / (-e p ln p) for p < 1/e (Sellke, Bayarri, Berger 2001, equation 3).
    """
    if p_value >= 1 / math.e:
        return misprint_rate
    if p_value <= 0:
        return 1.0
    against = (1 - misprint_rate) / misprint_rate * (-math.e * p_value * math.log(p_value))
    return 1 / (1 + against)
