"""How strong a defect must be to be caught on each page, from prints with defects of strengths chosen on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

STRENGTHS: Final = np.geomspace(1, 1000, 121)
SPREADS: Final = np.geomspace(0.08, 1.5, 12)
"""Of the logarithm of the strength at which single prints of a page begin to alarm."""
BETWEEN: Final = np.geomspace(0.1, 1.6, 6)
"""Standard deviations of pages' middles, of their logarithm."""
LAPSE: Final = 0.002
"""Share of prints in which a defect passes however strong it is; assumed: so that one such print does not decide."""
LEAST: Final = 1e-300
"""Likelihood below which nothing is told from nothing."""
SURE: Final = 0.99
ASKED: Final = (0.5, 0.98)
"""Between which chances of being caught the next strength is drawn: what 99 % takes is told from below."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Psychometric:
    """What is known of the chance that a defect of some strength is caught, page by page.

    P(strength) = F + (1 - F - lapse) Phi((ln strength - middle) / spread). All middles and spreads are weighed by what
    was seen (Watson 2017, QUEST+). Pages have one spread; their middles scatter about a common one, by as much as is
    seen as well: what other pages say counts for a page, the less the more prints of it were seen.
    """

    false_alarms: float
    said: Mapping[int, NDArray[np.float64]]
    """By page: logarithm of how likely its prints are for (middles, spreads)."""
    prints: int = 0

    @classmethod
    def unknown(cls, false_alarms: float) -> Self:
        """Nothing seen yet."""
        return cls(false_alarms=false_alarms, said={})

    def chances(self, strength: float) -> NDArray[np.float64]:
        """Of being caught, (middles, spreads)."""
        off = (np.log(strength) - np.log(STRENGTHS))[:, None] / SPREADS
        return np.asarray(self.false_alarms + (1 - self.false_alarms - LAPSE) * special.ndtr(off))

    def seen(self, page: int, strength: float, *, caught: bool) -> Psychometric:
        """One more print."""
        chance = self.chances(strength)
        more = self.said.get(page, 0) + np.log(chance if caught else 1 - chance)
        return replace(self, said={**self.said, page: more}, prints=self.prints + 1)

    def weight(self, page: int) -> NDArray[np.float64]:
        """What all prints say of one page: (middles, spreads), sum 1."""
        in_common = np.zeros((BETWEEN.size, STRENGTHS.size, SPREADS.size))
        for other, said in self.said.items():
            if other != page:
                in_common += np.log(np.maximum(_ABOUT @ np.exp(said - said.max()), LEAST))
        expected = np.einsum("bcm,bcs->ms", _ABOUT, np.exp(in_common - in_common.max()))
        own = self.said.get(page, np.zeros_like(expected))
        weight = expected * np.exp(own - own.max())
        return np.asarray(weight / weight.sum())

    def strength(self, page: int, chance: float) -> float:
        """The least that is caught with that chance, all told; infinite: none of ``STRENGTHS``."""
        weight = self.weight(page)
        mean = np.array([(self.chances(one) * weight).sum() for one in STRENGTHS])
        enough = np.flatnonzero(mean >= chance)
        return float(STRENGTHS[enough[0]]) if enough.size else np.inf

    def strengths(self, page: int, chance: float, quantiles: Sequence[float]) -> list[float]:
        """Quantiles of the least strength that is caught with that chance, over all middles and spreads."""
        wanted = (chance - self.false_alarms) / (1 - self.false_alarms - LAPSE)
        at = np.log(STRENGTHS)[:, None] + SPREADS * special.ndtri(np.clip(wanted, LEAST, 1 - LAPSE))
        order = np.argsort(at, axis=None)
        known = np.cumsum(self.weight(page).ravel()[order])
        places = np.searchsorted(known, quantiles).clip(0, order.size - 1)
        return [float(one) for one in np.exp(at.ravel()[order][places])]

    def next(self, page: int, rng: np.random.Generator) -> float:
        """A strength to try."""
        return min(self.strength(page, float(rng.uniform(*ASKED))), float(STRENGTHS[-1]))


def _about() -> NDArray[np.float64]:
    """(between, common middles, middles): how pages' middles lie about the common one, sum 1 over the last."""
    at = np.log(STRENGTHS)
    dense = np.exp(-(((at - at[:, None]) / BETWEEN[:, None, None]) ** 2) / 2)
    return np.asarray(dense / dense.sum(axis=-1, keepdims=True))


_ABOUT: Final = _about()
