"""Compiled loops for extremely randomised trees (Geurts, Ernst, Wehenkel 2006): growing and evaluation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel


class Examples(NamedTuple):
    """Training examples of a tree."""

    columns: NDArray[np.float32]
    """Features, (columns, pages)."""
    bad: NDArray[np.bool_]
    """Whether a page is bad, (pages,)."""
    weight: NDArray[np.float64]
    """Weight of each page, (pages,)."""
    rising: NDArray[np.bool_]
    """Whether a cut of the column must have no smaller share of bad rows above it than below, (columns,)."""


class TreeNodes(NamedTuple):
    """Nodes of one tree as in ``Forest``, with room for the greatest possible number."""

    column: NDArray[np.int32]
    cut: NDArray[np.float32]
    left: NDArray[np.int32]
    right: NDArray[np.int32]
    share: NDArray[np.float32]


@inner_kernel(error_model="numpy")
def best_cut(examples, rows, of_bad, of_all, order, tries, least, rng):  # type: ignore[no-untyped-def]
    """Return the best of several random cuts, as column and position.

    ``tries`` columns are drawn, each cut at a place drawn uniformly between its least and greatest. rows: of
    the node, of_bad and of_all: their weights; order: all columns in any order, shuffled as far as they are
    drawn. -1: none leaves ``least`` rows on either side.
    """
    columns, bad, weight, rising = examples
    best, at, most = -1, np.float32(0), 0.0
    for drawn in range(tries):
        swap = drawn + int(rng.random() * (order.size - drawn))
        which = order[swap]
        order[swap] = order[drawn]
        order[drawn] = which
        column = columns[which]
        low = high = column[rows[0]]
        for row in rows:
            low, high = min(low, column[row]), max(high, column[row])
        cut = low + (high - low) * np.float32(rng.random())
        count, above, bad_above = 0, 0.0, 0.0
        for row in rows:
            if column[row] > cut:
                count += 1
                above += weight[row]
                bad_above += weight[row] * bad[row]
        if count < least or rows.size - count < least:
            continue
        if rising[which] and bad_above * (of_all - above) < (of_bad - bad_above) * above:
            continue
        gain = bad_above**2 / above + (of_bad - bad_above) ** 2 / (of_all - above)
        if gain > most:
            best, at, most = which, cut, gain
    return best, at


@kernel(
    "examples.columns (K, N), examples.bad (N), examples.weight (N), examples.rising (K), tries, least, rng, "
    "nodes.column (M), nodes.cut (M), nodes.left (M), nodes.right (M), nodes.share (M)",
    where="0 < N, tries <= K, 2 * N <= M",
    error_model="numpy",
)
def grow(examples, tries, least, rng, nodes):  # type: ignore[no-untyped-def]
    """Grow a tree of ``Examples`` into ``TreeNodes`` for (2 pages,); return the number of nodes.

    A rising column is cut only where the share of bad rows is no smaller on its right: no cut prefers a
    larger value. (Bounds on all ends below, which would hold across cuts as well, cost 3 points of detection:
    decision 42.)
    """
    columns, bad, weight, _ = examples
    column, cut, left, right, share = nodes
    pages = bad.size
    rows = np.arange(pages)
    order = np.arange(columns.shape[0])
    begin, end, parent = np.zeros((3, pages + 1), np.int64)
    end[0], parent[0] = pages, -1
    waiting, count = 1, 0
    while waiting:
        waiting -= 1
        first, last, above = begin[waiting], end[waiting], parent[waiting]
        here = rows[first:last]
        if above >= 0:  # the left branch is processed first
            if left[above] < 0:
                left[above] = count
            else:
                right[above] = count
        of_all = of_bad = 0.0
        for row in here:
            of_all += weight[row]
            of_bad += weight[row] * bad[row]
        share[count] = of_bad / of_all
        which, at = -1, np.float32(0)
        if 0 < of_bad < of_all and here.size >= 2 * least:
            which, at = best_cut(examples, here, of_bad, of_all, order, tries, least, rng)
        column[count], cut[count], left[count], right[count] = which, at, -1, -1
        if which >= 0:
            middle = first
            for place in range(first, last):
                row = rows[place]
                if columns[which, row] <= at:
                    rows[place] = rows[middle]
                    rows[middle] = row
                    middle += 1
            begin[waiting], end[waiting], parent[waiting] = middle, last, count
            begin[waiting + 1], end[waiting + 1], parent[waiting + 1] = first, middle, count
            waiting += 2
        count += 1
    return count


@kernel("columns (N, _), column (M), cut (M), left (M), right (M), share (M), root (_), out (N)")
def shares_of(columns, column, cut, left, right, share, root, out):  # type: ignore[no-untyped-def]
    """Compute the mean over trees of each row's leaf value: columns (rows, columns) float32 -> out (rows,)."""
    for row in range(columns.shape[0]):
        total = 0.0
        for tree in range(root.size):
            node = root[tree]
            while column[node] >= 0:
                node = right[node] if columns[row, column[node]] > cut[node] else left[node]
            total += share[node]
        out[row] = total / root.size
