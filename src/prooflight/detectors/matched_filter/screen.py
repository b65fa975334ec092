"""The first look: which pages are worth being looked at for every statistic, by those alone that cost little.

A page that it does not pass on is let through: so an alarm needs both looks, and the first one makes none. What a press
promises is promised of both together: good pages are scored as every page is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.matched_filter.ranking import (
    Forest,
    every_column,
    evidence_of,
    ranked,
    scores_of,
)
from prooflight.detectors.matched_filter.statistics.statistic import in_screen
from prooflight.files.schema import Misfit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.statistic import Statistic

NOT_PASSED_ON: Final = -10.0
"""Score of a page that is just not worth a second look; that of all statistics is never below -9.3
(``ranking.LEAST_CHANCE``, twice)."""
ARRAYS: Final = ("statistic", "family", "quantiles", "tail")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Screen:
    """A ranking of pages by statistics that cost little; of what a press does it knows what ``DetectorModel`` knows."""

    statistic: NDArray[np.int32]
    """(n,) which of the model's statistics they are, rising."""
    families: tuple[str, ...]
    """Their causes, sorted."""
    family: NDArray[np.int32]
    """(n,) which family each is of."""
    quantiles: NDArray[np.float64]
    """(families, steps) as ``DetectorModel.quantiles``; of these statistics alone."""
    tail: NDArray[np.float64]
    """(families, 3)"""
    tail_from: float
    forest: Forest
    kind_forests: tuple[Forest, ...]
    least: float
    """Score above which pages are passed on ..."""
    least_taught: float
    """... and were where reference pages were scored; a press may pass fewer on."""

    def as_taught(self) -> Screen:
        """The first look by which reference pages were scored."""
        return replace(self, least=self.least_taught)

    def evidence(self, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
        """(pages, families) from deviations of all the model's statistics, of which others than its own may be NaN."""
        own = deviations[:, self.statistic]
        return evidence_of(own, self.family, self.quantiles, self.tail, self.tail_from)

    def score(
        self, deviations: NDArray[np.floating], page_features: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """How much pages are worth a second look, (pages,), from the same."""
        evidence = self.evidence(deviations)
        every = every_column(evidence, page_features, deviations[:, self.statistic])
        return ranked(self.forest.score(every), scores_of(self.kind_forests, every), evidence)


def of_both(
    first: NDArray[np.floating], second: NDArray[np.floating], least: float | NDArray[np.floating]
) -> NDArray[np.float64]:
    """Scores of both looks, (pages,): the second's of pages above ``least``; others lie below all these, in order."""
    return np.where(first > least, second, NOT_PASSED_ON + np.minimum(first - least, 0))


def screened(statistics: Sequence[Statistic]) -> tuple[NDArray[np.int32], tuple[str, ...], NDArray[np.int32]]:
    """``Screen.statistic``, ``families`` and ``family`` of a model of these statistics."""
    which = [index for index, one in enumerate(statistics) if in_screen(one)]
    causes = [statistics[index].cause for index in which]
    families = tuple(sorted(set(causes)))
    family = np.array([families.index(cause) for cause in causes], np.int32)
    return np.array(which, np.int32), families, family


def check(arrays: Mapping[str, NDArray[Any]], statistics: Sequence[Statistic], *, under: str) -> None:
    """Misfit unless a screen's arrays say of which statistics it is, and of which family each."""
    which, _, family = screened(statistics)
    for name, asked in (("statistic", which), ("family", family)):
        if not np.array_equal(arrays[name], asked):
            raise Misfit(f"{under}{name}", "must be that of the statistics that a first look is at")
    if (arrays["tail"][:, 0] != arrays["quantiles"][:, -1]).any():
        raise Misfit(f"{under}tail", "must begin where quantiles end")
