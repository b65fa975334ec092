"""Compiled loops: how much of a page's own detail is seen again further down, in boxes."""

from __future__ import annotations

import numpy as np
from numba import njit

_LEAST = np.float32(1e-6)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def add_lags(n, d, e, echo, pushes, powers, edges):  # type: ignore[no-untyped-def]
    """Add N' e, D' e^2 and the edges' e^2 of one place at all lags, echo (lags,): what was printed there."""
    for lag in range(echo.size):
        pushes[lag] += n * echo[lag]
    for lag in range(echo.size):
        powers[lag] += d * (echo[lag] * echo[lag])
    for lag in range(echo.size):
        edges[lag] += e * (echo[lag] * echo[lag])


@njit(cache=True, nogil=True)
def echo_parts(own, power, of_edges, detail, rows, columns, out):  # type: ignore[no-untyped-def]
    """Sums of N' e, D' e^2 and the edges' e^2 between cuts, at all lags.

    own, power, of_edges (h, w); detail (w, h + most lag): of each column downwards, as many 0 as the most lag above;
    rows (n + 1,), columns (m + 1,): where cuts lie, rising; out (n, m, 3, lags), from the most lag down.
    """
    lags = out.shape[3]
    out[:] = 0
    for k in range(out.shape[0]):
        for y in range(rows[k], rows[k + 1]):
            for m in range(out.shape[1]):
                sums = out[k, m]
                for x in range(columns[m], columns[m + 1]):
                    if power[y, x] > 0:
                        echo = detail[x, y : y + lags]
                        how = own[y, x], power[y, x], of_edges[y, x]
                        add_lags(*how, echo, sums[0], sums[1], sums[2])


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def add_to(row, out):  # type: ignore[no-untyped-def]
    """Add a row to another."""
    for i in range(out.size):
        out[i] += row[i]


@njit(cache=True, nogil=True)
def boxed(parts, rows, columns, out):  # type: ignore[no-untyped-def]
    """Boxes, rows (n, 2) and columns (m, 2) of cuts, from parts (rows, columns, l): out (n, m, l)."""
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def t_of_boxes(sums, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """T of sums (n, 3, lags) into out (n, lags); 0 where there is no more information than ``least``."""
    for n in range(out.shape[0]):
        pushes, powers, edges, row = sums[n, 0], sums[n, 1], sums[n, 2], out[n]
        for lag in range(row.size):
            d, e = powers[lag], max(edges[lag], np.float32(0))
            spread = noise * max(d - e, np.float32(0)) + at_edges * e + tolerance * d * d
            t = pushes[lag] / np.sqrt(spread + _LEAST)
            row[lag] = t if d > least else np.float32(0)
