"""How rarely a good page may alarm by its glyphs, and the two tests of a page as one decision.

A page alarms if its ranking does or its glyphs do. The ranking has ``1 - SHARE`` of the promised rate, the glyphs have
``SHARE``; a good page alarms by one or the other with at most the sum (Boole's inequality), whatever hangs together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.glyphs.weighing import NONE

if TYPE_CHECKING:
    from numpy.typing import NDArray

SHARE: Final = 0.1
"""Of the promised rate that the glyphs have. A wrong digit is worth some tens of what good pages scatter by, and takes
no more; the ranking hardly loses by it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GlyphPromise:
    """Thresholds of S from a press's own good pages."""

    own: NDArray[np.float64]
    """(pages,) S of good pages; ``NONE`` of those without glyphs that stand out."""
    rate: float
    """One good page in 1 / rate alarms. [-]"""

    @property
    def tail(self) -> tuple[float, float]:
        """The share of good pages whose S is above 0, one more counted, and the mean of S there.

        Of pages that scatter as stated the mean is 1 at most (``weighing``); one such page is counted beside the
        press's own, and the mean is never taken for less.
        """
        above = self.own[self.own > 0]
        mean = (1 + float(above.sum())) / (1 + above.size)
        return (1 + above.size) / (1 + self.own.size), max(1.0, mean)

    @property
    def threshold(self) -> float:
        """What S of a good page exceeds so rarely: ln(1 / rate), or more where the press's own good pages say so."""
        share, mean = self.tail
        drawn = mean * math.log(max(share / self.rate, 1.0))
        return max(-math.log(self.rate), drawn, float(self.own.max(initial=NONE)))

    def p_value(self, score: float) -> float:
        """How rarely a good page's S is so high; 1 where nothing speaks for a wrong glyph."""
        if score <= 0:
            return 1.0
        share, mean = self.tail
        by_tail = max(math.exp(-min(score, 700.0)), share * math.exp(-min(score / mean, 700.0)))
        if score > self.threshold:
            return min(by_tail, self.rate)
        return max(by_tail, self.rate)


def together(score: float, threshold: float, glyphs: float, glyphs_threshold: float) -> float:
    """One score of both tests, above the ranking's threshold if and only if one of them alarms."""
    if not math.isfinite(score) or glyphs <= glyphs_threshold:
        return score
    return max(score, threshold + glyphs - glyphs_threshold)
