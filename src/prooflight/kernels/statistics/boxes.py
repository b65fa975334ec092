"""Compiled loops for sums over cells of tiles, and for echoes of a page's own detail in boxes of them."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

_LEAST = np.float32(1e-6)


@kernel(
    "cells (4, N, H, W), gains (H), level (H, W), prior_power, mode, out (3, H, W)",
    where="0 < mode, mode < N",
    fastmath=True,
    error_model="numpy",
)
def own_of_cells(cells, gains, level, prior_power, mode, out):  # type: ignore[no-untyped-def]
    """Compute N', D' and the edges' part of D' of one mode's cells, each by itself, into out (3, h, w).

    cells (4, modes, h, w): N, D, C, edges, of modes of which the first is common to all; gains (h,), level
    (h, w): shares of C subtracted from N; known: 1 / the common mode's prior variance.
    """
    for y in range(out.shape[1]):
        taken, share = gains[y], level[y]
        push, power, shared, edges = (
            cells[0, mode, y],
            cells[1, mode, y],
            cells[2, mode, y],
            cells[3, mode, y],
        )
        push0, power0, shared0 = cells[0, 0, y], cells[1, 0, y], cells[2, 0, y]
        own, rest, of_edges = out[0, y], out[1, y], out[2, y]
        for x in range(own.size):
            smooth = taken + share[x]
            common = (push0[x] - shared0[x] * smooth) / (power0[x] + prior_power)
            own[x] = push[x] - shared[x] * smooth - shared[x] * common
        for x in range(rest.size):
            rest[x] = max(power[x] - shared[x] * shared[x] / (power0[x] + prior_power), np.float32(0))
        for x in range(of_edges.size):
            of_edges[x] = edges[x] * min(rest[x] / max(power[x], np.float32(1e-9)), np.float32(1))


@kernel("maps (N, H, W), out (N, H // 2, W // 2)", fastmath=True, error_model="numpy")
def squares(maps, out):  # type: ignore[no-untyped-def]
    """Compute sums of 2 x 2 of maps (n, h, w), out (n, h // 2, w // 2)."""
    for n in range(out.shape[0]):
        for y in range(out.shape[1]):
            above, below, row = maps[n, 2 * y], maps[n, 2 * y + 1], out[n, y]
            for x in range(row.size):
                row[x] = above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]


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


@inner_kernel(fastmath=True, error_model="numpy")
def t_row(push, power, edges, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """Compute T of a row; 0 where there is no more information than ``least``."""
    for x in range(out.size):
        d, e = power[x], max(edges[x], np.float32(0))
        spread = noise * max(d - e, np.float32(0)) + at_edges * e + tolerance * d * d
        t = push[x] / np.sqrt(spread + _LEAST)
        out[x] = t if d > least else np.float32(0)


@kernel("sums (N, 3, K), noise, at_edges, tolerance, least, out (N, K)")
def t_of_boxes(sums, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """Compute T of sums (n, 3, lags) into out (n, lags); 0 where there is no more information than ``least``."""
    for n in range(out.shape[0]):
        t_row(sums[n, 0], sums[n, 1], sums[n, 2], noise, at_edges, tolerance, least, out[n])


@inner_kernel(fastmath=True, error_model="numpy")
def square_row(above, here, line, out):  # type: ignore[no-untyped-def]
    """Compute sums of 2 x 2 tiles that end in each tile of a row, out (w,); the first ends twice in itself."""
    for x in range(line.size):
        line[x] = above[x] + here[x]
    out[0] = line[0] + line[0]
    right, rest = line[1:], out[1:]
    for x in range(rest.size):
        rest[x] = line[x] + right[x]


@kernel("push (H, W), power (H, W), edges (H, W), rows (R), columns (C), scatter (3), least, out (R, C)")
def t_of_squares(push, power, edges, rows, columns, scatter, least, out):  # type: ignore[no-untyped-def]
    """Compute T of 2 x 2 tiles that end in a tile of each of rows and columns, out (r, c); the first counts twice.

    push, power, edges (h, w): N, D and the edges' part of D of tiles; scatter: noise, edges, tolerance.
    """
    width = push.shape[1]
    line, sums, t = np.empty(width, np.float32), np.empty((3, width), np.float32), np.empty(width, np.float32)
    for k in range(rows.size):
        y = rows[k]
        above = max(y - 1, 0)
        square_row(push[above], push[y], line, sums[0])
        square_row(power[above], power[y], line, sums[1])
        square_row(edges[above], edges[y], line, sums[2])
        t_row(sums[0], sums[1], sums[2], scatter[0], scatter[1], scatter[2], least, t)
        for j in range(columns.size):
            out[k, j] = t[columns[j]]
