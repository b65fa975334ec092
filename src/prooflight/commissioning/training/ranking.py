"""Forests that rank pages, trained on misprints and good pages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.ranking import Forest
from prooflight.kernels.statistics.forest import Examples, TreeNodes, grow

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAST_ROWS: Final = 2


def even(which: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights with which both classes count the same."""
    return np.where(which, 0.5 / which.mean(), 0.5 / (~which).mean())


def fitted_forest(
    columns: NDArray[np.floating],
    bad: NDArray[np.bool_],
    weight: NDArray[np.floating],
    *,
    rng: np.random.Generator,
    trees: int = 300,
    column_share: float = 0.2,
    rising: NDArray[np.bool_] | None = None,
) -> Forest:
    """Train extremely randomised trees (Geurts, Ernst, Wehenkel 2006): of cuts drawn in some columns the best counts.

    rising: (columns,) along which columns the share of ``bad`` never falls; None: along none.
    """
    pages, tries = len(columns), max(int(column_share * columns.shape[1]), 1)
    across = np.ascontiguousarray(columns.T, dtype=np.float32)
    rising = np.zeros(len(across), bool) if rising is None else rising
    examples = Examples(columns=across, bad=bad, weight=np.asarray(weight, np.float64), rising=rising)
    column, left, right = np.empty((3, 2 * pages), np.int32)
    cut, share = np.empty((2, 2 * pages), np.float32)
    day = TreeNodes(column=column, cut=cut, left=left, right=right, share=share)
    grown, root = [], [0]
    for _ in range(trees):
        nodes = grow(examples, tries, LEAST_ROWS, rng, day)
        ends = column[:nodes] < 0
        down = [np.where(ends, -1, side[:nodes] + root[-1]) for side in (left, right)]
        grown.append((column[:nodes].copy(), cut[:nodes].copy(), *down, share[:nodes].copy()))
        root.append(root[-1] + nodes)
    columns_, cuts, lefts, rights, shares = (np.concatenate(part) for part in zip(*grown, strict=True))
    return Forest(
        column=columns_,
        cut=cuts,
        left=lefts.astype(np.int32),
        right=rights.astype(np.int32),
        share=shares,
        root=np.array(root[:-1], np.int32),
    )
