"""False-alarm rate of the glyph test, and its combination with the ranking's test in one decision.

A page alarms if its ranking does or its glyphs do. The ranking has ``1 - SHARE`` of the guaranteed rate, the
glyphs have ``SHARE``; a good page alarms by one or the other with at most the sum (Boole's inequality),
however the two depend on each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.glyphs.scoring import NONE

if TYPE_CHECKING:
    from numpy.typing import NDArray

SHARE: Final = 0.1
"""Share of the guaranteed false-alarm rate that the glyph test has. A wrong digit deviates by some tens of
standard deviations of good pages and needs no larger share; the ranking loses hardly any power."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GlyphThreshold:
    """Threshold and p-values of the glyph score S, from a press's own good pages."""

    own: NDArray[np.float64]
    """(pages,) S of good pages; ``NONE`` for pages without outlying glyphs."""
    rate: float
    """False-alarm rate of the glyph test: one good page in 1 / rate alarms. [-]"""

    @property
    def tail(self) -> tuple[float, float]:
        """The share of good pages whose S is above 0, with one more counted, and the mean of S there.

        On pages that scatter as stated the mean is 1 at most (``weighing``); one such page is counted in
        addition to the press's own, and the mean is never less.
        """
        above = self.own[self.own > 0]
        mean = (1 + float(above.sum())) / (1 + above.size)
        return (1 + above.size) / (1 + self.own.size), max(1.0, mean)

    @property
    def threshold(self) -> float:
        """S that good pages exceed at ``rate``: ln(1 / rate), or more if its own good pages require it."""
        share, mean = self.tail
        drawn = mean * math.log(max(share / self.rate, 1.0))
        return max(-math.log(self.rate), drawn, float(self.own.max(initial=NONE)))

    def p_value(self, score: float) -> float:
        """Return a bound on the probability that a good page's S is so high.

        It is 1 where there is no evidence of a wrong glyph.
        """
        if score <= 0:
            return 1.0
        share, mean = self.tail
        by_tail = max(math.exp(-min(score, 700.0)), share * math.exp(-min(score / mean, 700.0)))
        if score > self.threshold:
            return min(by_tail, self.rate)
        return max(by_tail, self.rate)


def combined_score(score: float, threshold: float, glyphs: float, glyphs_threshold: float) -> float:
    """Combine the scores of both tests.

    The result is above the ranking's threshold if and only if one of them alarms.
    """
    if not math.isfinite(score) or glyphs <= glyphs_threshold:
        return score
    return max(score, threshold + glyphs - glyphs_threshold)
