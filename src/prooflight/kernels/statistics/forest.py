"""A compiled loop: rows down the trees of a forest."""

from __future__ import annotations

from prooflight.kernels.compiled import kernel


@kernel("columns (N, _), column (M), cut (M), left (M), right (M), share (M), root (_), out (N)")
def shares_of(columns, column, cut, left, right, share, root, out):  # type: ignore[no-untyped-def]
    """Mean over trees of what each row's end holds: columns (rows, columns) float32 -> out (rows,)."""
    for row in range(columns.shape[0]):
        total = 0.0
        for tree in range(root.size):
            node = root[tree]
            while column[node] >= 0:
                node = right[node] if columns[row, column[node]] > cut[node] else left[node]
            total += share[node]
        out[row] = total / root.size
