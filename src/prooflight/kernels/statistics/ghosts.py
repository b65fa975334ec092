"""Compiled loops for the correlation of a page with its own detail further up, in boxes."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

_LEAST = np.float32(1e-6)


@inner_kernel(fastmath=True, error_model="numpy")
def add_lags(n, d, e, ghost, sums):  # type: ignore[no-untyped-def]
    """Add N' e, D' e^2 and the edges' e^2 of one place at all lags to sums (3 lags,); ghost (lags,): detail there.

    One array is written: with more, the compiler could not rule out aliasing and would not vectorise.
    """
    lags = ghost.size
    for lag in range(lags):
        value = ghost[lag]
        square = value * value
        sums[lag] += n * value
        sums[lags + lag] += d * square
        sums[2 * lags + lag] += e * square


@kernel(
    "own (H, W), power (H, W), of_edges (H, W), detail (W, D), lags, rows (R), columns (C), "
    "out (R - 1, C - 1, 3 * lags)",
    where="H + lags - 1 <= D",
)
def ghost_parts(own, power, of_edges, detail, lags, rows, columns, out):  # type: ignore[no-untyped-def]
    """Compute sums of N' e, D' e^2 and the edges' e^2 between cuts, at so many lags.

    own, power, of_edges (h, w); detail (w, h + most lag): of each column downwards, as many 0 as the most lag
    above; rows (n + 1,), columns (m + 1,): positions of cuts, rising; out (n, m, 3 lags), from the most lag
    down.
    """
    out[:] = 0
    for k in range(out.shape[0]):
        for y in range(rows[k], rows[k + 1]):
            for m in range(out.shape[1]):
                sums = out[k, m]
                for x in range(columns[m], columns[m + 1]):
                    if power[y, x] > 0:
                        add_lags(own[y, x], power[y, x], of_edges[y, x], detail[x, y : y + lags], sums)


@inner_kernel(fastmath=True, error_model="numpy")
def add_to(row, out):  # type: ignore[no-untyped-def]
    """Add a row to another."""
    for i in range(out.size):
        out[i] += row[i]


@kernel("parts (_, _, K), rows (N, 2), columns (M, 2), out (N, M, K)")
def boxed(parts, rows, columns, out):  # type: ignore[no-untyped-def]
    """Sum parts (rows, columns, l) over boxes, rows (n, 2) and columns (m, 2) of cuts: out (n, m, l)."""
    across = np.zeros((parts.shape[0], columns.shape[0], parts.shape[2]), np.float32)
    for k in range(parts.shape[0]):
        for m in range(columns.shape[0]):
            for j in range(columns[m, 0], columns[m, 1]):
                add_to(parts[k, j], across[k, m])
    out[:] = 0
    for n in range(rows.shape[0]):
        for k in range(rows[n, 0], rows[n, 1]):
            for m in range(columns.shape[0]):
                add_to(across[k, m], out[n, m])


@kernel("sums (N, 3, K), noise, at_edges, tolerance, least, out (N, K)", fastmath=True, error_model="numpy")
def t_of_boxes(sums, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """Compute T of sums (n, 3, lags) into out (n, lags); 0 where there is no more information than ``least``."""
    for n in range(out.shape[0]):
        pushes, powers, edges, row = sums[n, 0], sums[n, 1], sums[n, 2], out[n]
        for lag in range(row.size):
            d, e = powers[lag], max(edges[lag], np.float32(0))
            spread = noise * max(d - e, np.float32(0)) + at_edges * e + tolerance * d * d
            t = pushes[lag] / np.sqrt(spread + _LEAST)
            row[lag] = t if d > least else np.float32(0)
