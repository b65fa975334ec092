"""Whether a run's pages are like those that the promise rests on: conformal test martingales.

Each page is ranked, by several summaries of what its scan said, among the press's own good pages and the run's pages
before it. Where all of these are exchangeable, the ranks by one summary are independent and uniform (Vovk, Gammerman,
Shafer 2005, theorem 8.1), and a gambler who bets on small ones gains a factor of 1 / a or more, ever, with a
probability of a at most (Ville 1939). Wealth beyond that says that they are not: the press does what its good pages did
not show.

Each summary has a gambler of its own, and a share of ``FALSELY``. It is the greatest of their wealths that counts, each
times its share, and not their sum: what one summary said before tells of the next page's rank by another, so that all
gamblers together play no fair game. That none of them wins falsely is the union bound.

In a long run pages are forgotten, so that no more are kept than ``REMEMBERED``. Which one is drawn without regard to
its age, the newest among them, and that leaves the theorem as it is: given all pages that were kept, the newest was any
of them alike, and what is kept for later says nothing of which. Were the oldest forgotten, later ranks would tell.

Of a press whose threshold people's words set, the promise rests on the pages that they told, and these were not drawn
alike: every alarm, and few of those that passed. Each is kept with a probability in proportion to its weight, 1 over
that with which it was drawn. So every good sheet of those runs is kept with one and the same probability, whatever it
scored, and those that were kept are independent draws of the law that the promise is of (rejection; von Neumann 1951).
Of each design one is kept. A run's pages are ranked among these by the one score that the threshold is of, and all of
the above holds with one gambler. He has all of ``FALSELY``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.weighted_conformal import ToldPages

FALSELY: Final = 0.001
"""Of runs whose pages are exchangeable with the press's own, how many are ever called otherwise, at most."""
STAKES: Final = np.array([0.1, 0.35, 0.7])
"""Exponents e of the bets e p^(e - 1), each of which has the mean 1; a gambler's wealth is the mean of all."""
MISPRINTS: Final = 0.05
"""Share of a run's pages that may be misprints: no rank is taken to be smaller. (assumed: presses stop before)"""
REMEMBERED: Final = 2000
"""Pages of a run that are kept beside as many as the press has of its own: a page then ranks to 1 in 2000."""
SCORE: Final = "score"
"""The summary that is no group of statistics: false alarms come of it."""
OF_SCORE: Final = 0.5
"""Its share of ``FALSELY``; first words of statistics share the rest."""


def groups_of(model: DetectorModel) -> tuple[str, ...]:
    """Names of the summaries: ``SCORE``, and first words of those statistics that every page is looked at for."""
    return (SCORE, *dict.fromkeys(model.statistics[index].word for index in of_every_page(model)))


def summaries(
    model: DetectorModel, deviations: NDArray[np.floating], score: NDArray[np.floating]
) -> NDArray[np.float64]:
    """What pages are ranked by: their scores (pages,), and the mean of their deviations (pages, statistics) in each
    group of one first word; (pages, ``groups_of``).
    """
    looked_at = of_every_page(model)
    words = [model.statistics[index].word for index in looked_at]
    number = {word: index for index, word in enumerate(dict.fromkeys(words))}
    group = np.array([number[word] for word in words])
    means = [deviations[:, looked_at[group == index]].mean(axis=1) for index in range(len(number))]
    return np.column_stack([score, *means])


def of_every_page(model: DetectorModel) -> NDArray[np.int32]:
    """Which statistics every page is looked at for."""
    return (
        np.arange(len(model.statistics), dtype=np.int32) if model.screen is None else model.screen.statistic
    )


def shares(groups: int) -> NDArray[np.float64]:
    """Of ``FALSELY``, (groups,), which add up to 1; the first is the score."""
    if groups == 1:
        return np.ones(1)
    return np.array([OF_SCORE, *[(1 - OF_SCORE) / (groups - 1)] * (groups - 1)])


@dataclass(slots=True, kw_only=True, eq=False)
class ExchangeabilityTest:
    """One run's wealth, page by page."""

    known: list[NDArray[np.float64]]
    """Summaries of pages by which the next are ranked; no group looks at another's."""
    room: int
    """For so many of them."""
    names: tuple[str, ...]
    log_wealth: NDArray[np.float64]
    """(groups, stakes)"""
    most: float = -np.inf
    """Greatest logarithm so far of any group's wealth times its share."""

    @classmethod
    def of(cls, ours: CalibratedDetector) -> ExchangeabilityTest:
        """Before a run's first page.

        A page's own score is one that the other pages of the press made fit, as a new page's is.
        """
        names = groups_of(ours.model)
        deviations = ours.model.deviations(ours.pages.values, ours.pages.page_features)
        known = list(summaries(ours.model, deviations, ours.own.worst))
        return cls._before(known, names)

    @classmethod
    def of_told(cls, told: ToldPages, rng: np.random.Generator) -> ExchangeabilityTest:
        """Before a run's first page, by what people told; rng: which of these pages are kept."""
        return cls._before([np.array([score]) for score in told.alike(rng)], (SCORE,))

    @classmethod
    def _before(cls, known: list[NDArray[np.float64]], names: tuple[str, ...]) -> ExchangeabilityTest:
        return cls(
            known=known,
            room=len(known) + REMEMBERED,
            names=names,
            log_wealth=np.zeros((len(names), STAKES.size)),
        )

    def add(self, summary: NDArray[np.float64], rng: np.random.Generator) -> None:
        """One more page of the run, (groups,); rng: breaks ties, and forgets."""
        before = np.stack(self.known)
        above = (before > summary).sum(axis=0)
        alike = (before == summary).sum(axis=0) + 1
        p = (above + rng.random(summary.size) * alike) / (len(before) + 1)
        p = MISPRINTS + (1 - MISPRINTS) * p
        self.log_wealth += np.log(_bet(p))
        self.known.append(summary)
        if len(self.known) > self.room:
            forgotten, last = int(rng.integers(len(self.known))), self.known.pop()
            if forgotten < len(self.known):
                self.known[forgotten] = last
        self.most = max(self.most, float(self.gained.max()))

    @property
    def gained(self) -> NDArray[np.float64]:
        """(groups,) logarithm of each one's wealth, the mean of its stakes, times its share."""
        wealth = np.logaddexp.reduce(self.log_wealth, axis=1) - np.log(STAKES.size)
        return np.asarray(wealth + np.log(shares(len(self.names))))

    @property
    def suspended(self) -> bool:
        """Whether the run's pages were ever too unlike the press's own for its promise to hold."""
        return self.most >= -np.log(FALSELY)

    @property
    def strangest(self) -> str:
        """The first word of those statistics that gained most; ``SCORE`` where there are none."""
        if len(self.names) == 1:
            return SCORE
        return self.names[1 + int(self.gained[1:].argmax())]


def _bet(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors (groups, stakes) of ranks (groups,) in MISPRINTS..1, of mean 1 where ranks are uniform there."""
    low = MISPRINTS
    mean = (1 - low**STAKES) / (1 - low)
    return STAKES * p[:, None] ** (STAKES - 1) / mean
