"""The paper's statistical detector: is the error's histogram that of N(0, 1)? (equation 3, section 4.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from prooflight.deciding.verdict import Judgement

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.comparing.evidence import Evidence


def pearson(histogram: NDArray[np.int64]) -> float:
    """Pearson's statistic of counts (..., intervals) against equally likely intervals, added over leading axes."""
    expected = histogram.sum(axis=-1, keepdims=True) / histogram.shape[-1]
    return float(((histogram - expected) ** 2 / expected).sum())


def degrees_of_freedom(histogram: NDArray[np.int64]) -> int:
    """Of ``pearson``: intervals - 1 for each sensor; the tables have no free parameter."""
    return histogram[..., 0].size * (histogram.shape[-1] - 1)


def posterior_bound(p_value: float, misprint_rate: float) -> float:
    """Greatest probability of a misprint that a p-value can support, given the rate of misprints.

    Odds are multiplied by at most 1 / (-e p ln p) for p < 1/e (Sellke, Bayarri, Berger 2001, equation 3).
    """
    if p_value >= 1 / math.e:
        return misprint_rate
    if p_value <= 0:
        return 1.0
    odds = misprint_rate / (1 - misprint_rate) / (-math.e * p_value * math.log(p_value))
    return odds / (1 + odds)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquare:
    """Pearson's chi-square over equally likely intervals, digital numbers taken as the integers they are.

    A page alarms when the statistic exceeds the quantile that one good page in good_pages_per_false_alarm exceeds. That
    promise holds in the paper's own world, where a good page is the prediction plus sensor noise.
    """

    good_pages_per_false_alarm: float
    misprint_rate: float
    name: str = "chi-square"

    def judge(self, evidence: Evidence) -> Judgement:
        """Weigh one page; the p-value is for people, the decision compares the statistic."""
        score = pearson(evidence.histogram)
        law = stats.chi2(degrees_of_freedom(evidence.histogram))
        threshold = float(law.isf(1 / self.good_pages_per_false_alarm))
        p_value = float(law.sf(score))
        return Judgement(
            misprint=score > threshold,
            score=score,
            threshold=threshold,
            p_value=p_value,
            probability=posterior_bound(p_value, self.misprint_rate),
        )
