"""Trees on few rows and many columns: log odds of a misprint from statistics of pages. Boosted, or a forest.

Friedman 2001 with Newton leaves; columns are cut into quantile bins once, so that a split costs a histogram.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.deciding.trees import Forest, Trees

if TYPE_CHECKING:
    from numpy.typing import NDArray

BINS: Final = 24
LEAST_HESSIAN: Final = 2.0
LEAST_ROWS: Final = 2
SHRINKAGE: Final = 4.0
"""Added to a leaf's Hessian."""


def boosted(
    columns: NDArray[np.floating],
    bad: NDArray[np.bool_],
    weight: NDArray[np.floating],
    *,
    rng: np.random.Generator,
    trees: int = 300,
    depth: int = 3,
    rate: float = 0.06,
    column_share: float = 0.2,
    row_share: float = 0.7,
) -> Trees:
    """Trees that rank pages: columns (pages, columns), weight (pages,) of each."""
    cuts = np.quantile(columns, np.arange(1, BINS) / BINS, axis=0).T.astype(np.float32)  # (columns, BINS - 1)
    binned = np.stack(
        [np.searchsorted(cut, column, side="left") for cut, column in zip(cuts, columns.T, strict=True)],
        axis=1,
    ).astype(np.int64)
    count, width = binned.shape
    start = float(np.log((weight * bad).sum() / (weight * ~bad).sum()))
    score = np.full(count, start)
    nodes = 2**depth - 1
    which = np.zeros((trees, nodes), np.int32)
    cut_at = np.full((trees, nodes), np.inf, np.float32)
    leaf = np.zeros((trees, nodes + 1), np.float32)
    for tree in range(trees):
        chance = 1 / (1 + np.exp(-score))
        push, pull = weight * (bad - chance), weight * chance * (1 - chance)
        used = rng.random(count) < row_share
        drawn = np.sort(rng.permutation(width)[: max(int(width * column_share), 1)])
        place = np.zeros(count, np.int64)
        few = binned[:, drawn]
        for level in range(depth):
            first = 2**level - 1
            for node in range(2**level):
                rows = np.flatnonzero(used & (place == node))
                column, step = _best(few[rows], push[rows], pull[rows])
                here = place == node
                place[here] = 2 * node
                if column < 0:
                    continue
                which[tree, first + node] = drawn[column]
                cut_at[tree, first + node] = cuts[drawn[column], step]
                place[here & (few[:, column] > step)] = 2 * node + 1
        for end in range(nodes + 1):
            rows_in = used & (place == end)
            leaf[tree, end] = rate * push[rows_in].sum() / (pull[rows_in].sum() + SHRINKAGE)
        score += leaf[tree, place]
    return Trees(column=which, cut=cut_at, leaf=leaf, start=start)


def forested(
    columns: NDArray[np.floating],
    bad: NDArray[np.bool_],
    weight: NDArray[np.floating],
    *,
    rng: np.random.Generator,
    trees: int = 300,
    column_share: float = 0.2,
) -> Forest:
    """Extremely randomised trees (Geurts, Ernst, Wehenkel 2006): cuts are drawn, of some columns the best is kept."""
    narrow = columns.astype(np.float32)
    tries = max(int(column_share * columns.shape[1]), 1)
    column: list[int] = []
    cut: list[float] = []
    left: list[int] = []
    right: list[int] = []
    share: list[float] = []
    root = []
    for _ in range(trees):
        root.append(len(column))
        waiting = [(np.arange(len(narrow)), -1)]
        while waiting:
            rows, parent = waiting.pop()
            here = len(column)
            if parent >= 0:  # the left branch is taken up first
                (right if left[parent] >= 0 else left)[parent] = here
            of_bad = float(weight[rows] @ bad[rows])
            of_all = float(weight[rows].sum())
            which, at = (
                _drawn_cut(narrow, bad, weight, rows, tries, rng) if 0 < of_bad < of_all else (-1, 0.0)
            )
            column.append(which)
            cut.append(at)
            left.append(-1)
            right.append(-1)
            share.append(of_bad / of_all)
            if which >= 0:
                above = narrow[rows, which] > np.float32(at)
                waiting += [(rows[above], here), (rows[~above], here)]
    return Forest(
        column=np.array(column, np.int32),
        cut=np.array(cut, np.float32),
        left=np.array(left, np.int32),
        right=np.array(right, np.int32),
        share=np.array(share, np.float32),
        root=np.array(root, np.int32),
    )


def _drawn_cut(
    narrow: NDArray[np.float32],
    bad: NDArray[np.bool_],
    weight: NDArray[np.floating],
    rows: NDArray[np.intp],
    tries: int,
    rng: np.random.Generator,
) -> tuple[int, float]:
    """The best of so many columns, each cut at a place drawn evenly between its least and greatest; -1: none."""
    if rows.size < 2 * LEAST_ROWS:
        return -1, 0.0
    drawn = rng.choice(narrow.shape[1], tries, replace=False)
    values = narrow[np.ix_(rows, drawn)]
    low, high = values.min(axis=0), values.max(axis=0)
    cuts = (low + (high - low) * rng.random(tries)).astype(np.float32)
    above = values > cuts
    count = above.sum(axis=0)
    w, b = weight[rows], weight[rows] * bad[rows]
    w_above, b_above = w @ above, b @ above
    w_below, b_below = w.sum() - w_above, b.sum() - b_above
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = b_above**2 / w_above + b_below**2 / w_below
    gain[(count < LEAST_ROWS) | (rows.size - count < LEAST_ROWS)] = -1
    best = int(np.argmax(gain))
    return (int(drawn[best]), float(cuts[best])) if gain[best] > 0 else (-1, 0.0)


def _best(few: NDArray[np.int64], push: NDArray[np.float64], pull: NDArray[np.float64]) -> tuple[int, int]:
    """Column and bin of the split that gains most; -1: none."""
    rows, width = few.shape
    if rows < 4:
        return -1, 0
    flat = (few + np.arange(width) * BINS).ravel()
    g = np.bincount(flat, np.repeat(push, width), minlength=width * BINS).reshape(width, BINS).cumsum(axis=1)
    h = np.bincount(flat, np.repeat(pull, width), minlength=width * BINS).reshape(width, BINS).cumsum(axis=1)
    g_all, h_all = g[:, -1:], h[:, -1:]
    gain = (
        g**2 / (h + SHRINKAGE) + (g_all - g) ** 2 / (h_all - h + SHRINKAGE) - g_all**2 / (h_all + SHRINKAGE)
    )
    gain[(h < LEAST_HESSIAN) | (h_all - h < LEAST_HESSIAN)] = 0
    gain[:, -1] = 0
    best = int(np.argmax(gain))
    return (best // BINS, best % BINS) if gain.ravel()[best] > 1e-6 else (-1, 0)
