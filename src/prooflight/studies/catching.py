"""How strong a defect must be to be caught, from prints with defects of strengths that are chosen on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from numpy.typing import NDArray

STRENGTHS: Final = np.geomspace(1, 1000, 121)
SPREADS: Final = np.geomspace(0.08, 1.5, 12)
"""Of the logarithm of the strength at which single prints begin to alarm."""
SURE: Final = 0.99
ASKED: Final = (0.5, 0.98)
"""Between which chances of being caught the next strength is drawn: what 99 % takes is told from below."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Catching:
    """What is known of the chance that a defect of some strength is caught; the Bayesian way of Watson (2017).

    P(strength) = F + (1 - F) Phi((ln strength - middle) / spread), all middles and spreads weighed by what was seen.
    """

    weight: NDArray[np.float64]
    """(strengths as middles, spreads), sum 1."""
    false_alarms: float
    prints: int = 0

    @classmethod
    def unknown(cls, false_alarms: float) -> Self:
        """Nothing seen yet; middles alike in the logarithm."""
        shape = (STRENGTHS.size, SPREADS.size)
        return cls(weight=np.full(shape, 1 / np.prod(shape)), false_alarms=false_alarms)

    def chances(self, strength: float) -> NDArray[np.float64]:
        """Of being caught, (middles, spreads)."""
        off = (np.log(strength) - np.log(STRENGTHS))[:, None] / SPREADS
        return np.asarray(self.false_alarms + (1 - self.false_alarms) * special.ndtr(off))

    def seen(self, strength: float, *, caught: bool) -> Catching:
        """One more print."""
        chance = self.chances(strength)
        weight = self.weight * (chance if caught else 1 - chance)
        return Catching(weight=weight / weight.sum(), false_alarms=self.false_alarms, prints=self.prints + 1)

    def strength(self, chance: float) -> float:
        """The least that is caught with that chance, all told; infinite: none of ``STRENGTHS``."""
        mean = np.array([(self.chances(one) * self.weight).sum() for one in STRENGTHS])
        enough = np.flatnonzero(mean >= chance)
        return float(STRENGTHS[enough[0]]) if enough.size else np.inf

    def next(self, rng: np.random.Generator) -> float:
        """A strength to try."""
        return min(self.strength(float(rng.uniform(*ASKED))), float(STRENGTHS[-1]))
