"""Whether a run's pages are like those that the promise rests on: a conformal test martingale.

Each page is ranked, by several summaries of what its scan said, among the press's own good pages and the run's pages
before it. Where all of these are exchangeable the ranks are independent and uniform (Vovk, Gammerman, Shafer 2005,
theorem 8.1), and a gambler who bets on small ones gains a factor of 1 / a or more, ever, with a probability of a at
most (Ville 1939). Wealth beyond that says that they are not: the press does what its good pages did not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.model import DetectorModel

FALSELY: Final = 0.001
"""Of runs whose pages are exchangeable with the press's own, how many are ever called otherwise, at most."""
STAKES: Final = np.array([0.1, 0.2, 0.35, 0.5, 0.7, 0.85])
"""Exponents e of the bets e p^(e - 1), each of which has the mean 1; their wealths are averaged."""
MISPRINTS: Final = 0.05
"""Share of a run's pages that may be misprints: no rank counts as smaller. (assumed: presses are stopped before)"""


def summaries(model: DetectorModel, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
    """Mean deviation of each group of statistics (those of one first word): (pages, groups)."""
    words = np.array([one.word for one in model.statistics])
    return np.stack(
        [deviations[:, words == one].mean(axis=1) for one in dict.fromkeys(words.tolist())], axis=1
    )


@dataclass(slots=True, kw_only=True, eq=False)
class ExchangeabilityTest:
    """One run's wealth, page by page."""

    known: list[NDArray[np.float64]]
    """Summaries of pages by which the next are ranked."""
    names: tuple[str, ...]
    log_wealth: NDArray[np.float64]
    """(groups, stakes)"""
    most: float = 0.0
    """Greatest logarithm of the whole wealth so far."""

    @classmethod
    def of(cls, ours: CalibratedDetector) -> ExchangeabilityTest:
        """Before a run's first page."""
        words = tuple(dict.fromkeys(one.word for one in ours.model.statistics))
        pages = ours.model.deviations(ours.pages.values, ours.pages.page_features)
        return cls(
            known=list(summaries(ours.model, pages)),
            names=words,
            log_wealth=np.zeros((len(words), STAKES.size)),
        )

    def add(self, summary: NDArray[np.float64], rng: np.random.Generator) -> None:
        """One more page of the run, (groups,); rng: breaks ties."""
        before = np.stack(self.known)
        above = (before > summary).sum(axis=0)
        alike = (before == summary).sum(axis=0) + 1
        p = (above + rng.random(summary.size) * alike) / (len(before) + 1)
        p = MISPRINTS + (1 - MISPRINTS) * p
        self.log_wealth += np.log(_bet(p))
        self.known.append(summary)
        self.most = max(self.most, self.log_of_all)

    @property
    def log_of_all(self) -> float:
        """Logarithm of the mean wealth of all groups and stakes."""
        greatest = self.log_wealth.max()
        return float(greatest + np.log(np.exp(self.log_wealth - greatest).mean()))

    @property
    def suspended(self) -> bool:
        """Whether the run's pages were ever too unlike the press's own for its promise to hold."""
        return self.most >= -np.log(FALSELY)

    @property
    def strangest(self) -> str:
        """The group of statistics that gained most."""
        return self.names[int(self.log_wealth.max(axis=1).argmax())]


def _bet(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors (groups, stakes) of ranks (groups,) in MISPRINTS..1, of mean 1 where ranks are uniform there."""
    low = MISPRINTS
    mean = (1 - low**STAKES) / (1 - low)
    return STAKES * p[:, None] ** (STAKES - 1) / mean
