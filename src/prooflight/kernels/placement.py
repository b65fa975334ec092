"""Compiled loop of placement: interpolation of a warp between its nodes."""

from __future__ import annotations

from prooflight.kernels.compiled import kernel


@kernel(
    "nodes (R, C, 2), pitch, first_x, first_y, x (N), y (N), out_x (N), out_y (N)",
    where="0 < R, 0 < C",
    error_model="numpy",
)
def between_nodes(nodes, pitch, first_x, first_y, x, y, out_x, out_y):  # type: ignore[no-untyped-def]
    """Interpolate nodes (rows, columns, 2) bilinearly, constant beyond; at x, y (n,) -> out_x, out_y."""
    last_row, last_column = nodes.shape[0] - 1, nodes.shape[1] - 1
    for k in range(x.size):
        across = min(max((x[k] - first_x) / pitch, 0.0), float(last_column))
        along = min(max((y[k] - first_y) / pitch, 0.0), float(last_row))
        j, i = min(int(across), max(last_column - 1, 0)), min(int(along), max(last_row - 1, 0))
        u, v = across - j, along - i
        right, below = min(j + 1, last_column), min(i + 1, last_row)
        for axis in range(2):
            above = float(nodes[i, j, axis]) * (1 - u) + float(nodes[i, right, axis]) * u
            under = float(nodes[below, j, axis]) * (1 - u) + float(nodes[below, right, axis]) * u
            value = above * (1 - v) + under * v
            if axis == 0:
                out_x[k] = value
            else:
                out_y[k] = value
