"""Ranking of pages by forests that were trained on misprints, and the columns that these use.

Screening is the ranking by statistics that are computed for every page, which alone decides. All other statistics, four
times as many, did not improve decisions (docs/results/detector/ranking.md), and cost more than all the rest. They
explain what is wrong with a page that is called a misprint; good pages do not need them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.statistics.statistic import Statistic, in_screen
from prooflight.files.schema import ArraySpec, Misfit, check_arrays
from prooflight.kernels.statistics.forest import shares_of

LEAST_CHANCE: Final = 0.01
MARK: Final = "mark/"
"""First word of the families of small windows by class of place (``statistics.marks``)."""
ADDED_FROM, ADDED_SLOPE = 2.0, 2.0
"""The evidence e of the strongest family, -log10 p after Bonferroni (``strongest_alone``), adds
``ADDED_SLOPE`` x (e - ``ADDED_FROM``) to the forests' log odds."""
ALONE_FROM, ALONE_SLOPE = 3.0, 6.0
"""A page scores at least ``ALONE_SLOPE`` x (e - ``ALONE_FROM``), whatever the forests' log odds.
(both chosen on the ranking's own folds, seed 31)"""
RANKS: Final = (0, 2, 5, 10, 20, 40)
"""Ranks of the sorted evidence of families that the forest uses in addition to each family's."""
ARRAYS: Final = ("statistic", "family", "quantiles", "tail")


def evidence_of(
    deviations: NDArray[np.floating],
    family: NDArray[np.integer],
    quantiles: NDArray[np.floating],
    tail: NDArray[np.floating],
    tail_from: float,
) -> NDArray[np.float64]:
    """Return -log10 p of each family's greatest deviation, (pages, families); deviations (pages, statistics).

    family (statistics,); quantiles, tail, tail_from: as in ``DetectorModel``.
    """
    steps = np.linspace(0, tail_from, quantiles.shape[1])
    order = np.argsort(family, kind="stable")
    begins = np.searchsorted(family[order], np.arange(len(quantiles)))
    greatest = np.maximum.reduceat(deviations[:, order], begins, axis=1)
    share = np.array(
        [np.interp(of_pages, each, steps) for of_pages, each in zip(greatest.T, quantiles, strict=True)]
    ).T
    begin, scale, shape = tail.T
    beyond = 1 + shape * (np.maximum(greatest, begin) - begin) / scale
    of_tail = np.log10(beyond) / shape - np.log10(1 - tail_from)
    return np.where(greatest > begin, of_tail, -np.log10(1 - share))


def deviation_at(
    evidence: float, quantiles: NDArray[np.floating], tail: NDArray[np.floating], tail_from: float
) -> NDArray[np.float64]:
    """Return the greatest deviation of each family, (families,), at which its evidence is ``evidence``.

    This inverts ``evidence_of``; quantiles, tail, tail_from: as in ``DetectorModel``.
    """
    share = 1 - 10.0**-evidence
    steps = np.linspace(0, tail_from, quantiles.shape[1])
    within = np.array([np.interp(share, steps, one) for one in quantiles])
    begin, scale, shape = tail.T
    beyond = 10 ** (shape * (evidence + np.log10(1 - tail_from)))
    return np.where(share > tail_from, begin + scale / shape * (beyond - 1), within)


def alarming_evidence(threshold: float, families: int) -> float:
    """Return -log10 p of one of ``families`` families of a group from which a page alarms by it alone."""
    return threshold / ALONE_SLOPE + ALONE_FROM + float(np.log10(families))


def strongest_alone(evidence: NDArray[np.floating], marks: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return -log10 of each page's p-value by its strongest family alone, (pages,).

    Families of marks and all others are two groups; within a group the strongest counts after Bonferroni.
    evidence (pages, families); marks (families,): which are of marks.
    """
    strongest = np.full(len(evidence), -np.inf)
    for group in (marks, ~marks):
        if group.any():
            np.maximum(strongest, evidence[:, group].max(axis=1) - np.log10(group.sum()), out=strongest)
    return strongest


def marks_of(families: Sequence[str]) -> NDArray[np.bool_]:
    """Return which families are of marks, (families,)."""
    return np.array([one.startswith(MARK) for one in families])


def family_columns(evidence: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the evidence of every family, and the first, third, ... greatest of them."""
    ranks = [rank for rank in RANKS if rank < evidence.shape[1]]
    return np.hstack([evidence, -np.sort(-evidence, axis=1)[:, ranks]])


def every_column(
    evidence: NDArray[np.floating], page_features: NDArray[np.floating], deviations: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return ``family_columns``, page features, and each statistic's excess above and below good pages."""
    above, below = np.maximum(deviations, 0), np.maximum(-deviations, 0)
    return np.hstack([family_columns(evidence), page_features, above, below])


def rising_columns(columns: int, *, features: int, statistics: int) -> NDArray[np.bool_]:
    """Return which columns of ``every_column``, of a given number, increase the evidence of a misprint.

    All do except the page features.
    """
    rising = np.ones(columns, bool)
    rising[columns - 2 * statistics - features : columns - 2 * statistics] = False
    return rising


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forest:
    """Mean of many deep decision trees, whose nodes are concatenated."""

    column: NDArray[np.int32]
    """(nodes,) column that a node compares; -1: it is a leaf."""
    cut: NDArray[np.float32]
    """(nodes,) threshold above which the right branch is taken."""
    left: NDArray[np.int32]
    """(nodes,) index of the left node; that of the right one is in ``right``."""
    right: NDArray[np.int32]
    share: NDArray[np.float32]
    """(nodes,) share of misprints among the training pages of the leaf."""
    root: NDArray[np.int32]
    """(trees,) root nodes."""

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], columns: int, *, under: str) -> None:
        """Raise Misfit unless ``arrays`` are a forest on ``columns`` columns in which every path ends.

        Compiled loops follow the indices without checks.
        """
        check_arrays(arrays, FOREST, {}, under=under)
        column, nodes = arrays["column"], arrays["column"].size
        if column.max() >= columns:
            raise Misfit(f"{under}column", f"holds {column.max()}, must be below {columns}")
        if arrays["root"].max() >= nodes:
            raise Misfit(f"{under}root", f"holds {arrays['root'].max()}, must be below {nodes}")
        branching = np.flatnonzero(column >= 0)
        for side in ("left", "right"):
            down = arrays[side][branching]
            if (down <= branching).any() or (down >= nodes).any():
                raise Misfit(f"{under}{side}", f"must lead from each node to one after it, of {nodes}")

    def score(self, columns: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return log odds of rows (pages, columns): (pages,).

        They are bounded, because a forest has seen a limited number of pages.
        """
        narrow, chance = np.ascontiguousarray(columns, np.float32), np.empty(len(columns))
        shares_of(narrow, self.column, self.cut, self.left, self.right, self.share, self.root, chance)
        return np.log((chance + LEAST_CHANCE) / (1 + LEAST_CHANCE - chance))


FOREST: Final = {
    "column": ArraySpec(dtype="int32", shape=("nodes",), low=-1),
    "cut": ArraySpec(dtype="float32", shape=("nodes",)),
    "left": ArraySpec(dtype="int32", shape=("nodes",), low=-1),
    "right": ArraySpec(dtype="int32", shape=("nodes",), low=-1),
    "share": ArraySpec(dtype="float32", shape=("nodes",), low=0, high=1),
    "root": ArraySpec(dtype="int32", shape=("trees",), low=0),
}


def scores_of(forests: Sequence[Forest], columns: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return log odds of rows (pages, columns) by each forest: (pages, forests), possibly none."""
    return np.array([forest.score(columns) for forest in forests]).reshape(-1, len(columns)).T


def ranked(
    of_all: NDArray[np.floating],
    of_kinds: NDArray[np.floating],
    evidence: NDArray[np.floating],
    marks: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Combine the forests' log odds and the strongest family in one score per page, (pages,).

    The plain sum ranks kinds that were not trained on better than learned weights did (decision 19; `study
    ranking`). Evidence in a single family, as in no misprint of the training data, is used by itself, so that
    forests can only add to it.

    Parameters
    ----------
    of_all : (pages,) log odds of all misprints against good pages.
    of_kinds : (pages, kinds) log odds of each kind against good pages, of which the greatest counts.
    evidence : (pages, families) -log10 p of the families.
    marks : (families,) which families are of marks.
    """
    most = of_kinds.max(axis=1) if of_kinds.shape[1] else 0.0
    alone = strongest_alone(evidence, marks)
    combined = of_all + most + ADDED_SLOPE * np.maximum(alone - ADDED_FROM, 0)
    return np.maximum(combined, ALONE_SLOPE * (alone - ALONE_FROM))


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
