"""Strength at which a defect is detected on each page, estimated from prints with defects of known strengths."""

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
"""Grid of the spread of the psychometric function: the standard deviation of the strength's logarithm."""
BETWEEN: Final = np.geomspace(0.1, 1.6, 6)
"""Grid of the standard deviation of pages' middles, of their logarithm."""
LAPSE: Final = 0.002
"""Share of prints in which a defect passes however strong it is; assumed: so that one such print does not decide."""
LEAST: Final = 1e-300
"""Least likelihood; smaller ones are not distinguished from zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Psychometric:
    """Posterior of the chance that a defect of some strength is caught, page by page.

    P(strength) = F + (1 - F - lapse) Phi((ln strength - middle) / spread). All middles and spreads on the grid are
    weighted by the likelihood of the observations (Watson 2017, QUEST+). Pages have one spread; their middles scatter
    about a common one, by an amount that is estimated as well: the results of other pages count for a page, the less
    the more prints of it were observed.
    """

    false_alarms: float
    log_likelihood: Mapping[int, NDArray[np.float64]]
    """Log likelihood of each page's prints for (middles, spreads), by page."""

    @classmethod
    def unknown(cls, false_alarms: float) -> Self:
        """Return the state before any observation."""
        return cls(false_alarms=false_alarms, log_likelihood={})

    def chances(self, strength: float) -> NDArray[np.float64]:
        """Return the chances of being caught, (middles, spreads)."""
        off = (np.log(strength) - np.log(STRENGTHS))[:, None] / SPREADS
        return np.asarray(self.false_alarms + (1 - self.false_alarms - LAPSE) * special.ndtr(off))

    def seen(self, page: int, strength: float, *, caught: bool) -> Psychometric:
        """Return the posterior after one more print."""
        chance = self.chances(strength)
        more = self.log_likelihood.get(page, 0) + np.log(chance if caught else 1 - chance)
        return replace(self, log_likelihood={**self.log_likelihood, page: more})

    def weight(self, page: int) -> NDArray[np.float64]:
        """Return the posterior of one page, given all prints: (middles, spreads), sum 1."""
        in_common = np.zeros((BETWEEN.size, STRENGTHS.size, SPREADS.size))
        for other, log_likelihood in self.log_likelihood.items():
            if other != page:
                in_common += np.log(np.maximum(_ABOUT @ np.exp(log_likelihood - log_likelihood.max()), LEAST))
        expected = np.einsum("bcm,bcs->ms", _ABOUT, np.exp(in_common - in_common.max()))
        own = self.log_likelihood.get(page, np.zeros_like(expected))
        weight = expected * np.exp(own - own.max())
        return np.asarray(weight / weight.sum())

    def strengths(self, page: int, chance: float, quantiles: Sequence[float]) -> list[float]:
        """Return quantiles of the least strength that is caught with this chance, over all middles and spreads."""
        wanted = (chance - self.false_alarms) / (1 - self.false_alarms - LAPSE)
        at = np.log(STRENGTHS)[:, None] + SPREADS * special.ndtri(np.clip(wanted, LEAST, 1 - LAPSE))
        order = np.argsort(at, axis=None)
        cumulative = np.cumsum(self.weight(page).ravel()[order])
        places = np.searchsorted(cumulative, quantiles).clip(0, order.size - 1)
        return [float(one) for one in np.exp(at.ravel()[order][places])]


def _about() -> NDArray[np.float64]:
    """Return the density of pages' middles about the common one: (between, common middles, middles).

    It sums to 1 over the last axis.
    """
    at = np.log(STRENGTHS)
    dense = np.exp(-(((at - at[:, None]) / BETWEEN[:, None, None]) ** 2) / 2)
    return np.asarray(dense / dense.sum(axis=-1, keepdims=True))


_ABOUT: Final = _about()
