"""Smallest defect that is detected at 99 %, from trials at adaptively chosen strengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SURE: Final = 0.99
SPREADS: Final = np.geomspace(0.05, 0.8, 10)
"""Spreads of the logarithm of the strength at which single prints begin to alarm."""
STEPS: Final = 161
LAPSE: Final = 0.002
"""Share of prints in which a defect passes however strong it is; assumed: one such print does not decide."""
CHANCES: Final = (0.6, 0.995)
"""Range of detection probabilities from which the next strength is drawn: 99 % is estimated best from about there."""
BETWEEN: Final = (0.05, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One print with one defect."""

    strength: float
    caught: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Least strength that is detected at 99 %, with its interval of 90 % probability.

    It is infinite where none of the range is detected.
    """

    least: float
    low: float
    high: float

    @property
    def ever(self) -> bool:
        """Return whether any strength is detected."""
        return bool(np.isfinite(self.least))


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Range of strengths of one kind of defect."""

    low: float
    high: float

    @property
    def middles(self) -> NDArray[np.float64]:
        """Return the candidate strengths of 50 % detection.

        They reach a third beyond the range either way.
        """
        edge = (self.high / self.low) ** (1 / 3)
        return np.geomspace(self.low / edge, self.high * edge, STEPS)


def weights_of(trials: Sequence[Trial], within: Range, *, false_alarms: float) -> NDArray[np.float64]:
    """Return the posterior probability (middles, spreads), sum 1: a flat prior times the likelihood of the trials.

    P(caught) = F + (1 - F - lapse) Phi((ln strength - ln middle) / spread), as in QUEST+ (Watson 2017).
    """
    log_likelihood = np.zeros((STEPS, SPREADS.size))
    for trial in trials:
        chance = _chances(trial.strength, within, false_alarms)
        log_likelihood += np.log(chance if trial.caught else 1 - chance)
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())


def strength_for(chance: float, weight: NDArray[np.float64], within: Range, *, false_alarms: float) -> float:
    """Return the least strength that is detected with that mean probability; infinite: none of the range."""
    tried = np.geomspace(within.low, within.high, STEPS)
    mean = np.array([(_chances(one, within, false_alarms) * weight).sum() for one in tried])
    enough = np.flatnonzero(mean >= chance)
    return float(tried[enough[0]]) if enough.size else np.inf


def caught(trials: Sequence[Trial], within: Range, *, false_alarms: float) -> Caught:
    """Estimate the least detected strength from trials."""
    weight = weights_of(trials, within, false_alarms=false_alarms)
    least = strength_for(SURE, weight, within, false_alarms=false_alarms)
    at = special.ndtri((SURE - false_alarms) / (1 - false_alarms - LAPSE)) if false_alarms < SURE else -np.inf
    sure_from = np.exp(np.log(within.middles)[:, None] + at * SPREADS)
    order = np.argsort(sure_from, axis=None)
    total = np.cumsum(weight.ravel()[order])
    low, high = (float(sure_from.ravel()[order][np.searchsorted(total, one)]) for one in BETWEEN)
    return Caught(
        least=least,
        low=low if low <= within.high else np.inf,
        high=high if high <= within.high and np.isfinite(least) else np.inf,
    )


def next_strength(
    trials: Sequence[Trial], within: Range, rng: np.random.Generator, *, false_alarms: float
) -> float:
    """Draw a strength to try: uniformly over the range at first, then near the strength of 99 %."""
    if not trials:
        return float(np.exp(rng.uniform(np.log(within.low), np.log(within.high))))
    weight = weights_of(trials, within, false_alarms=false_alarms)
    chance = float(rng.uniform(*CHANCES))
    return min(strength_for(chance, weight, within, false_alarms=false_alarms), within.high)


def _chances(strength: float, within: Range, false_alarms: float) -> NDArray[np.float64]:
    off = (np.log(strength) - np.log(within.middles))[:, None] / SPREADS
    return np.asarray(false_alarms + (1 - false_alarms - LAPSE) * special.ndtr(off))
