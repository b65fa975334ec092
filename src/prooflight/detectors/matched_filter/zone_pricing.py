"""Calibration of the matched-filter detector's zones by good prints of the pages that have them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.false_alarm_rate import FURTHEST
from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE
from prooflight.detectors.matched_filter.glyphs.scoring import NONE
from prooflight.detectors.matched_filter.zones import MOST_OF_RATE, ZonedJudge, baseline_of, careful_scores
from prooflight.errors import RequestError
from prooflight.pages.zones.zone import Calibration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.base import Inspection
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.optional import GoodPrint

LEARNING: Final = 3
"""Number of prints of which one measures the usual statistics of careful areas; the others calibrate them."""
FEWEST_PRINTS: Final = 12
LUCK: Final = 1.5
"""Factor on the number of prints where only some pages have a careful area, since fewer may be drawn than expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchedFilterPricing:
    """See ``ZonePricing``."""

    calibrated: CalibratedDetector

    @property
    def rate(self) -> float:
        """See ``ZonePricing``: the ranking's share, since glyphs and floor know no zones."""
        return self.calibrated.ranking_rate

    def fewest_prints(self, careful_share: float) -> int:
        """See ``ZonePricing``.

        Of the prints that show a careful area, all but one in ``LEARNING`` calibrate, their tail extrapolated,
        and one less of them: each is judged by the others.
        """
        if not careful_share:
            return FEWEST_PRINTS
        needed = (1 / (FURTHEST * MOST_OF_RATE * self.rate) + 1) * LEARNING / (LEARNING - 1) / careful_share
        return max(math.ceil(needed * (1.0 if careful_share == 1 else LUCK)), FEWEST_PRINTS)

    def score(self, inspection: Inspection) -> float:
        """See ``ZonePricing``."""
        score = self.calibrated.score_again(StoredArrays(inspection.stored_arrays, self.calibrated.name))
        return score if np.isfinite(score) else WRONG_PAGE

    def alarms(self, score: float) -> bool:
        """See ``ZonePricing``."""
        return score > self.calibrated.threshold

    def calibration(self, prints: Sequence[GoodPrint]) -> Calibration:
        """See ``ZonePricing``."""
        careful = [one.careful for one in prints if one.careful is not None]
        learned = np.array(careful[::LEARNING])
        others = np.array([one for at, one in enumerate(careful) if at % LEARNING])
        mean = sd = scores = np.zeros(0)
        if careful:
            if len(others) < 2 or len(learned) < 2:
                raise RequestError("prints", "too few show a careful area", remedy="give more of them")
            baseline = baseline_of(learned)
            mean, sd = baseline
            scores = careful_scores(others, baseline)
        return Calibration(
            page_scores=tuple(round(one.after, 6) for one in prints),
            careful_scores=tuple(np.round(scores, 6).tolist()),
            careful_mean=tuple(np.round(mean, 6).tolist()),
            careful_sd=tuple(np.round(sd, 6).tolist()),
        )

    def alarmed(
        self, prints: Sequence[GoodPrint], calibration: Calibration, share: float
    ) -> tuple[list[tuple[GoodPrint, bool]], float]:
        """See ``ZonePricing``."""
        judges = {
            careful: ZonedJudge.by(calibration, share, careful=careful)
            for careful in {one.careful is not None for one in prints}
        }
        careful_rate = max(judge.rates(self.rate)[1] for judge in judges.values())  # may be refused
        scored = [one for at, one in enumerate(prints) if at % LEARNING]
        return [
            (one, self._alarms(one, scored, judges[one.careful is not None])) for one in scored
        ], careful_rate

    def _alarms(self, one: GoodPrint, scored: Sequence[GoodPrint], judge: ZonedJudge) -> bool:
        """Return whether a good print alarms, judged by the others."""
        others = [other for other in scored if other is not one]
        left = replace(judge, page_good=np.sort([other.after for other in others]))
        values = np.zeros(judge.baseline.shape[1]) if one.careful is None else one.careful
        if judge.careful_good.size:
            theirs = np.array([other.careful for other in others if other.careful is not None])
            left = replace(left, careful_good=np.sort(careful_scores(theirs, judge.baseline)))
        return self.calibrated.decided(left.decide(self.calibrated, one.after, values), NONE).misprint
