"""Conformal test martingales: whether a run's pages are exchangeable with those that the guarantee rests on.

Each page is ranked, by several summaries of its scan, among the press's own good pages and the run's pages
before it. If all of these are exchangeable, the ranks by one summary are independent and uniform (Vovk,
Gammerman, Shafer 2005, theorem 8.1), and a gambler who bets on small ones ever gains a factor of 1 / a or
more with a probability of at most a (Ville 1939). Greater wealth shows that they are not exchangeable: the
press does what its good pages did not show.

Each summary has a gambler of its own, and a share of ``FALSELY``. The test uses the greatest of their
wealths, each times its share, and not their sum: earlier values of one summary inform on the next page's rank
by another, so that all gamblers together do not play a fair game. The union bound limits the probability that
any of them wins falsely.

In a long run pages are forgotten, so that no more than ``REMEMBERED`` are stored. The one to forget is drawn
regardless of its age, the newest among them, which leaves the theorem valid: given all stored pages, the
newest was equally likely any of them, and what is stored for later does not depend on which. Forgetting the
oldest would make later ranks informative.

If labelled pages set a press's threshold, the guarantee rests on these, and they were not drawn with equal
probability: every alarm, and few of the pages that passed. Each is retained with a probability in proportion
to its weight, which is the inverse of the probability with which it was drawn. So every good sheet of those
runs is retained with one and the same probability, whatever its score, and the retained ones are independent
draws from the law that the guarantee refers to (rejection; von Neumann 1951). One page of each design is
retained. A run's pages are ranked among these by the one score that the threshold applies to, and all of the
above holds with one gambler, who has all of ``FALSELY``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.naming import family_text
from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.weighted_conformal import LabelledPages

FALSELY: Final = 0.001
"""Maximum share of runs with exchangeable pages that are ever called otherwise."""
STAKES: Final = np.array([0.1, 0.35, 0.7])
"""Exponents e of the bets e p^(e - 1), each of which has the mean 1; a gambler's wealth is the mean of
all."""
MISPRINTS: Final = 0.05
"""Share of a run's pages that may be misprints: no smaller rank is used. (assumed: presses stop before)"""
REMEMBERED: Final = 2000
"""Maximum number of a run's pages that are stored in addition to the press's own: a page then ranks to 1 in
2000."""
SCORE: Final = "score"
"""Name of the summary that is no group of statistics: false alarms depend on it."""
OF_SCORE: Final = 0.5
"""Share of ``FALSELY`` that the score has; first words of statistics share the rest."""
PAGES_TO_LEARN: Final = 40
"""Number of good pages that a person is asked to inspect. (assumed: what a person inspects in one session)"""
TRAINING_REMEDY: Final = (
    f"check {PAGES_TO_LEARN} good pages and run `prooflight press learn X.press JOB SCANS --good`"
)
FEEDBACK_REMEDY: Final = (
    "watch runs with --sample, label their sheets, and run `prooflight press recalibrate`"
)


def groups_of(model: DetectorModel) -> tuple[str, ...]:
    """Return the names of the summaries: ``SCORE``, and first words of the statistics that every page has."""
    return (SCORE, *dict.fromkeys(model.statistics[index].label for index in of_every_page(model)))


def summaries(
    model: DetectorModel, deviations: NDArray[np.floating], score: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the summaries by which pages are ranked, (pages, ``groups_of``).

    They are the scores (pages,), and the mean of the deviations (pages, statistics) in each group of one
    first word.
    """
    indices = of_every_page(model)
    labels = [model.statistics[index].label for index in indices]
    number = {label: index for index, label in enumerate(dict.fromkeys(labels))}
    group = np.array([number[label] for label in labels])
    means = [deviations[:, indices[group == index]].mean(axis=1) for index in range(len(number))]
    return np.column_stack([score, *means])


def of_every_page(model: DetectorModel) -> NDArray[np.int32]:
    """Return the indices of the statistics that every page has."""
    return (
        np.arange(len(model.statistics), dtype=np.int32) if model.screen is None else model.screen.statistic
    )


def shares(groups: int) -> NDArray[np.float64]:
    """Return each group's share of ``FALSELY``, (groups,), which add up to 1; the first is the score's."""
    if groups == 1:
        return np.ones(1)
    return np.array([OF_SCORE, *[(1 - OF_SCORE) / (groups - 1)] * (groups - 1)])


@dataclass(slots=True, kw_only=True, eq=False)
class ExchangeabilityTest:
    """Wealth of one run's gamblers, updated page by page."""

    reference_pages: list[NDArray[np.float64]]
    """Summaries of pages among which the next are ranked; each group uses its own column."""
    room: int
    """Maximum number of these."""
    names: tuple[str, ...]
    log_wealth: NDArray[np.float64]
    """(groups, stakes)"""
    most: float = -np.inf
    """Greatest logarithm so far of any group's wealth times its share."""

    @classmethod
    def of(cls, detector: CalibratedDetector) -> ExchangeabilityTest:
        """Start the test of a run.

        A page's own score is by a model adapted to the other pages of the press, as a new page's is.
        """
        names = groups_of(detector.model)
        deviations = detector.model.deviations(detector.pages.values, detector.pages.page_features)
        pool = list(summaries(detector.model, deviations, detector.own.worst))
        return cls._before(pool, names)

    @classmethod
    def of_labelled(cls, labelled: LabelledPages, rng: np.random.Generator) -> ExchangeabilityTest:
        """Start the test of a run from labelled pages; rng: draws which of these are retained."""
        return cls._before([np.array([score]) for score in labelled.alike(rng)], (SCORE,))

    @classmethod
    def _before(cls, pool: list[NDArray[np.float64]], names: tuple[str, ...]) -> ExchangeabilityTest:
        return cls(
            reference_pages=pool,
            room=len(pool) + REMEMBERED,
            names=names,
            log_wealth=np.zeros((len(names), STAKES.size)),
        )

    def add(self, summary: NDArray[np.float64], rng: np.random.Generator) -> None:
        """Add a page of the run, (groups,); rng: breaks ties, and draws the page that is forgotten."""
        before = np.stack(self.reference_pages)
        above = (before > summary).sum(axis=0)
        alike = (before == summary).sum(axis=0) + 1
        p = (above + rng.random(summary.size) * alike) / (len(before) + 1)
        p = MISPRINTS + (1 - MISPRINTS) * p
        self.log_wealth += np.log(_bet(p))
        self.reference_pages.append(summary)
        if len(self.reference_pages) > self.room:
            forgotten, last = int(rng.integers(len(self.reference_pages))), self.reference_pages.pop()
            if forgotten < len(self.reference_pages):
                self.reference_pages[forgotten] = last
        self.most = max(self.most, float(self.gained.max()))

    @property
    def gained(self) -> NDArray[np.float64]:
        """(groups,) logarithm of each group's wealth, the mean of its stakes, times its share."""
        wealth = np.logaddexp.reduce(self.log_wealth, axis=1) - np.log(STAKES.size)
        return np.asarray(wealth + np.log(shares(len(self.names))))

    @property
    def suspended(self) -> bool:
        """Whether the run's pages ever differed too much from the press's own for its guarantee to hold."""
        return self.most >= -np.log(FALSELY)

    @property
    def strangest(self) -> str:
        """First word of the statistics whose wealth is greatest; ``SCORE`` if there are none."""
        if len(self.names) == 1:
            return SCORE
        return self.names[1 + int(self.gained[1:].argmax())]


def _bet(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return factors (groups, stakes) of ranks (groups,) in MISPRINTS..1, of mean 1 for uniform ranks."""
    low = MISPRINTS
    mean = (1 - low**STAKES) / (1 - low)
    return STAKES * p[:, None] ** (STAKES - 1) / mean


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressRunTest:
    """Test of one run of a press; see ``RunTest``."""

    test: ExchangeabilityTest
    rng: np.random.Generator
    remedy: str = TRAINING_REMEDY
    """See ``RunTest``."""

    @classmethod
    def of(cls, detector: CalibratedDetector, *, seed: int) -> Self:
        """Start the test of a run."""
        rng = stream(seed, "exchangeability-ties")
        if detector.recalibrations:
            return cls(
                test=ExchangeabilityTest.of_labelled(detector.recalibrations[-1], rng),
                rng=rng,
                remedy=FEEDBACK_REMEDY,
            )
        return cls(test=ExchangeabilityTest.of(detector), rng=rng)

    def add(self, summary: NDArray[np.float64]) -> None:
        """See ``RunTest``."""
        self.test.add(summary, self.rng)

    @property
    def suspended(self) -> bool:
        """See ``RunTest``."""
        return self.test.suspended

    @property
    def strangest(self) -> str:
        """See ``RunTest``."""
        return family_text(self.test.strangest) or "their scores"
