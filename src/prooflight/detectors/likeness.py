"""Test of whether good pages of a press reach into the tail of simulated pages' scores more often than these do.

Each page of the press is ranked among the simulated ones, which gives conformal p-values; Fisher's combination of
them, -sum ln p, is large where many are small. The p-values share the simulated pages and so depend on each other;
with n pages among m its law is that of a Gamma variable of shape n, widened by sqrt(1 + n / m) about its mean (Bates,
Candes, Lei, Romano, Sesia 2023, "Testing for outliers with conformal p-values", theorem 3, asymptotic in n and m).
Pages that score lower than simulated ones break no promise: the test is one-sided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEVEL: Final = 0.2
"""Share of presses like the simulated ones that are told apart from them all the same.

Assumed: a press that is told apart falsely promises less until it has learned more pages, while one that is not told
apart breaks its promise; so the level is far above the usual 0.05.
"""
POWER: Final = 0.9
"""Probability of being told apart for which ``Likeness.detectable`` is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Likeness:
    """Result of the test."""

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
