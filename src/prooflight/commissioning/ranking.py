"""Misprints and good pages -> how to rank pages: a weighted sum by ridge regression of log odds, and a forest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import optimize

from prooflight.deciding.ranking import Forest, Logit

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAST_ROWS: Final = 2
RIDGE: Final = 2.0
"""Half the inverse variance of weights of columns in standard deviations, beside log losses of one."""


def weighed(columns: NDArray[np.floating], bad: NDArray[np.bool_], weight: NDArray[np.floating]) -> Logit:
    """Logistic regression with a ridge: columns (pages, columns), weight (pages,) of each page."""
    mean, sd = columns.mean(axis=0), columns.std(axis=0) + 1e-9
    x = np.column_stack([np.ones(len(bad)), (columns - mean) / sd])
    ridge = np.full(x.shape[1], RIDGE)
    ridge[0] = 0
    sign = np.where(bad, 1.0, -1.0)

    def loss(amounts: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        right = sign * (x @ amounts)
        slope = -weight * sign / (1 + np.exp(right))
        total = weight @ np.logaddexp(0, -right) + ridge @ amounts**2
        return float(total), x.T @ slope + 2 * ridge * amounts

    found = optimize.minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B").x
    weights = found[1:] / sd
    return Logit(weights=weights, start=float(found[0] - weights @ mean))


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
