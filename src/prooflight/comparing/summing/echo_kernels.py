"""Compiled loops: how much of a page's own detail is seen again further down, in boxes."""

from __future__ import annotations

import numpy as np
from numba import njit

_LEAST = np.float32(1e-6)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def add_row(n, d, e, echo, sums):  # type: ignore[no-untyped-def]
    """Add N' e, D' e^2 and the edges' e^2 of a row to sums (3, w)."""
    pushes, powers, edges = sums[0], sums[1], sums[2]
    for x in range(echo.size):
        pushes[x] += n[x] * echo[x]
    for x in range(echo.size):
        powers[x] += d[x] * (echo[x] * echo[x])
    for x in range(echo.size):
        edges[x] += e[x] * (echo[x] * echo[x])


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def between(row, first, last):  # type: ignore[no-untyped-def]
    """Sum of a row from ``first`` to before ``last``."""
    total = np.float32(0)
    for x in range(first, last):
        total += row[x]
    return total


@njit(cache=True, nogil=True)
def echo_tables(own, power, of_edges, detail, lags, rows, columns, tables):  # type: ignore[no-untyped-def]
    """Sums of N' e, D' e^2 and the edges' e^2 above and left of cuts; e: ``detail`` a lag further up, 0 above.

    own, power, of_edges, detail (h, w); lags (l,); rows (n,), columns (m,): where cuts lie, rising; tables
    (l, 3, n, m), from the first cuts on.
    """
    sums = np.empty((3, own.shape[1]), np.float32)
    for index in range(lags.size):
        lag, table = lags[index], tables[index]
        table[:, 0] = 0
        for k in range(1, rows.size):
            sums[:] = 0
            for y in range(max(rows[k - 1], lag), rows[k]):
                add_row(own[y], power[y], of_edges[y], detail[y - lag], sums)
            for part in range(3):
                so_far = 0.0
                table[part, k, 0] = 0
                for m in range(1, columns.size):
                    if rows[k] > lag:
                        so_far += between(sums[part], columns[m - 1], columns[m])
                    table[part, k, m] = table[part, k - 1, m] + so_far


@njit(cache=True, nogil=True)
def boxed(tables, rows, columns, out):  # type: ignore[no-untyped-def]
    """Boxes that begin and end at cuts, rows (n, 2) and columns (m, 2), summed by tables: out (lags, 3, n, m)."""
    for index in range(out.shape[0]):
        for part in range(3):
            of = tables[index, part]
            for n in range(rows.shape[0]):
                low, high = of[rows[n, 0]], of[rows[n, 1]]
                for m in range(columns.shape[0]):
                    first, last = columns[m, 0], columns[m, 1]
                    out[index, part, n, m] = high[last] - high[first] - low[last] + low[first]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def t_of_boxes(sums, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """T of sums (n, 3, m) into out (n, m); 0 where there is no more information than ``least``."""
    for n in range(out.shape[0]):
        pushes, powers, edges, row = sums[n, 0], sums[n, 1], sums[n, 2], out[n]
        for m in range(row.size):
            d, e = powers[m], max(edges[m], np.float32(0))
            spread = noise * max(d - e, np.float32(0)) + at_edges * e + tolerance * d * d
            t = pushes[m] / np.sqrt(spread + _LEAST)
            row[m] = t if d > least else np.float32(0)
