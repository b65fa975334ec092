"""The paper's statistical detector: is the error's histogram that of N(0, 1)? (equation 3, section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prooflight.detectors.false_alarm_rate import posterior_bound
from prooflight.detectors.paper.evidence import Evidence, interval_shares, only
from prooflight.detectors.verdict import Decision

if TYPE_CHECKING:
    from prooflight.detectors.base import StoredArrays

MOST_COUNT: Final = 2**40
"""Limit of the pixel count of one interval and tile, far beyond any."""


def pearson(histogram: NDArray[np.int64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Pearson's statistic of counts (..., intervals) against a good page's (paper, equation 3): (...).

    shares (intervals,): the intervals' probabilities, ``detectors.paper.evidence.interval_shares``.
    """
    expected = histogram.sum(axis=-1, keepdims=True) * shares
    return np.asarray(((histogram - expected) ** 2 / expected).sum(axis=-1))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquare:
    """Pearson's chi-square over nearly equally likely intervals, with digital numbers treated as integers.

    It tests the page's histogram, as in the paper, and that of each tile of 64 x 64 pixels: a missing word is
    lost among six million pixels, but not among four thousand. Page and tiles have half of the allowed false
    alarms each, tiles share theirs evenly (Bonferroni), and sensors are summed. Degrees of freedom: intervals
    - 1 for each sensor, because the tables have no free parameter. The score is the greater of the two
    statistics over its own alarm level, so that a page alarms above 1.

    The guarantee, one alarm in good_pages_per_false_alarm good pages, holds in the paper's own world, where a
    good page is the prediction plus sensor noise.
    """

    good_pages_per_false_alarm: float
    misprint_rate: float
    tiles: bool = True
    """Whether tiles are tested; False: the page alone, as in the paper."""
    name: str = "chi-square"

    @property
    def false_alarm_rate(self) -> float:
        """See ``EvidenceDetector``."""
        return 1 / self.good_pages_per_false_alarm

    @property
    def guarantee(self) -> str:
        """See ``EvidenceDetector``."""
        odds = f"{self.good_pages_per_false_alarm:,.0f}"
        return f"at most one good page in {odds} alarms, if it differs by sensor noise alone"

    def stored_arrays(self, evidence: Evidence) -> dict[str, NDArray[Any]]:
        """See ``EvidenceDetector``."""
        counts = evidence.tile_histogram
        return {"tile_histogram": counts.astype(np.min_scalar_type(int(counts.max(initial=0))))}

    def evidence_of(self, stored: StoredArrays, *, sensors: int) -> Evidence:
        """See ``EvidenceDetector``."""
        counts = stored.array("tile_histogram", "ui", (sensors, None, None, interval_shares().size))
        if int(counts.min()) < 0 or float(counts.max()) >= MOST_COUNT or not counts.any(axis=3).all():
            raise stored.refusal("'tile_histogram' contains values that are not counts of pixels")
        return only(tile_histogram=counts.astype(np.int64))

    def decide(self, evidence: Evidence) -> Decision:
        """Decide on one page; the p-value is for people, the decision compares statistics."""
        of_page = float(pearson(evidence.histogram, interval_shares()).sum())
        # scipy.stats is avoided: its import takes longer than the judgement of a page.
        freedom = evidence.histogram.shape[0] * (evidence.histogram.shape[1] - 1)
        allowed = 1 / self.good_pages_per_false_alarm
        p_of_page = float(special.chdtrc(freedom, of_page))
        if not self.tiles:
            return self._judgement(of_page / float(special.chdtri(freedom, allowed)), p_of_page)
        of_tiles = tile_statistics(evidence)
        worst = float(of_tiles.max())
        most_of_page, most = special.chdtri(freedom, [allowed / 2, allowed / 2 / of_tiles.size])
        # np.maximum and np.minimum, because Python's max and min may drop a NaN.
        score = float(np.maximum(of_page / most_of_page, worst / most))
        p_value = 2 * float(np.minimum(p_of_page, special.chdtrc(freedom, worst) * of_tiles.size))
        return self._judgement(score, float(np.minimum(p_value, 1.0)))

    def _judgement(self, score: float, p_value: float) -> Decision:
        return Decision(
            misprint=bool(score > 1),
            score=float(score),
            threshold=1.0,
            p_value=p_value,
            probability=posterior_bound(p_value, self.misprint_rate),
        )


def tile_statistics(evidence: Evidence) -> NDArray[np.float64]:
    """Return Pearson's statistic of each tile, summed over sensors: (tile rows, tile columns)."""
    return np.asarray(pearson(evidence.tile_histogram, interval_shares()).sum(axis=0))
