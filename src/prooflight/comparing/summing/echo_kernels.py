"""Compiled loops: how much of a page's own detail is seen again further down, in boxes."""

from __future__ import annotations

import numpy as np
from numba import njit

_LEAST = np.float32(1e-6)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def echo_boxes(own, power, of_edges, detail, lag, rows, columns, running, out):  # type: ignore[no-untyped-def]
    """Sums over boxes of N' e, D' e^2 and the edges' e^2, e: ``detail`` ``lag`` rows further up, 0 above that.

    own, power, of_edges, detail (h, w); rows (n, 2), columns (m, 2): where boxes begin and end; out (3, n, m). running
    (3, h + 1, w) is working space.
    """
    height, width = own.shape
    running[:, lag] = np.float32(0)
    for y in range(lag, height):
        echo, n, d, e = detail[y - lag], own[y], power[y], of_edges[y]
        for x in range(width):
            running[0, y + 1, x] = running[0, y, x] + n[x] * echo[x]
        for x in range(width):
            running[1, y + 1, x] = running[1, y, x] + d[x] * (echo[x] * echo[x])
        for x in range(width):
            running[2, y + 1, x] = running[2, y, x] + e[x] * (echo[x] * echo[x])
    band = np.empty(width + 1, np.float32)
    band[0] = np.float32(0)
    for part in range(3):
        for n in range(rows.shape[0]):
            low, high = running[part, max(rows[n, 0], lag)], running[part, max(rows[n, 1], lag)]
            so_far = np.float32(0)
            for x in range(width):
                so_far += high[x] - low[x]
                band[x + 1] = so_far
            for m in range(columns.shape[0]):
                out[part, n, m] = band[columns[m, 1]] - band[columns[m, 0]]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def greatest_echo(own, power, of_edges, detail, lags, rows, columns, noise, at_edges, tolerance, least):  # type: ignore[no-untyped-def]
    """The greatest T of ``echo_boxes`` over lags (n,), 0 at least; and the row and column of its box, -1 if none."""
    height, width = own.shape
    running = np.empty((3, height + 1, width), np.float32)
    sums = np.empty((3, rows.shape[0], columns.shape[0]), np.float32)
    best, row, column = np.float32(0), -1, -1
    for lag in lags:
        echo_boxes(own, power, of_edges, detail, lag, rows, columns, running, sums)
        for n in range(rows.shape[0]):
            for m in range(columns.shape[0]):
                d, e = sums[1, n, m], max(sums[2, n, m], np.float32(0))
                if d <= least:
                    continue
                spread = noise * max(d - e, np.float32(0)) + at_edges * e + tolerance * d * d
                t = sums[0, n, m] / np.sqrt(spread + _LEAST)
                if t > best:
                    best, row, column = t, n, m
    return best, row, column
