"""Screening: statistics that are computed for every page, and the ranking by them, which alone decides.

All other statistics, four times as many, did not improve decisions (docs/results/detector/ranking.md), and cost more
than all the rest. They explain what is wrong with a page that is called a misprint; good pages do not need
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.matched_filter.ranking import (
    Forest,
    every_column,
    evidence_of,
    marks_of,
    ranked,
    scores_of,
)
from prooflight.detectors.matched_filter.statistics.statistic import in_screen
from prooflight.files.schema import Misfit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.statistic import Statistic

ARRAYS: Final = ("statistic", "family", "quantiles", "tail")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Screen:
    """Ranking of pages by some of a model's statistics, from the deviations of ``DetectorModel``."""

    statistic: NDArray[np.int32]
    """(n,) indices of its statistics in the model's, rising."""
    families: tuple[str, ...]
    """Causes of these statistics, sorted."""
    family: NDArray[np.int32]
    """(n,) index of each one's family."""
    quantiles: NDArray[np.float64]
    """(families, steps) as ``DetectorModel.quantiles``, for these statistics alone."""
    tail: NDArray[np.float64]
    """(families, 3)"""
    tail_from: float
    forest: Forest
    kind_forests: tuple[Forest, ...]

    def evidence(self, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return evidence (pages, families) from deviations of all the model's statistics.

        Those of other statistics may be NaN.
        """
        own = deviations[:, self.statistic]
        return evidence_of(own, self.family, self.quantiles, self.tail, self.tail_from)

    def score(
        self, deviations: NDArray[np.floating], page_features: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the evidence of pages for a misprint, (pages,), from these deviations; higher is worse."""
        evidence = self.evidence(deviations)
        every = every_column(evidence, page_features, deviations[:, self.statistic])
        return ranked(
            self.forest.score(every), scores_of(self.kind_forests, every), evidence, marks_of(self.families)
        )


def screened(statistics: Sequence[Statistic]) -> tuple[NDArray[np.int32], tuple[str, ...], NDArray[np.int32]]:
    """Return ``Screen.statistic``, ``families`` and ``family`` of a model of these statistics."""
    which = [index for index, one in enumerate(statistics) if in_screen(one)]
    causes = [statistics[index].cause for index in which]
    families = tuple(sorted(set(causes)))
    family = np.array([families.index(cause) for cause in causes], np.int32)
    return np.array(which, np.int32), families, family


def check(arrays: Mapping[str, NDArray[Any]], statistics: Sequence[Statistic], *, under: str) -> None:
    """Raise Misfit unless a screen's arrays state its statistics, and the family of each."""
    which, _, family = screened(statistics)
    for name, expected in (("statistic", which), ("family", family)):
        if not np.array_equal(arrays[name], expected):
            raise Misfit(f"{under}{name}", "must be that of the statistics that every page is analysed for")
    if (arrays["tail"][:, 0] != arrays["quantiles"][:, -1]).any():
        raise Misfit(f"{under}tail", "must begin where quantiles end")
