"""Compiled loop that reduces a high-resolution page, area by area."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

STEPS = 4096
"""Steps of the light that a full ink takes."""
TRACE = 1e-6
"""Tolerance for rounding of sums of steps; an overlap below it is no pixel's edge. [fine pixels]"""


@inner_kernel()
def covered(first, step, count, extent):  # type: ignore[no-untyped-def]
    """Compute which fine pixels of ``extent`` each of count pixels covers, from ``first`` on, ``step`` of them each.

    at (count,): the first of the k considered. shares (count, k): shares of the pixel that each covers; they
    sum to 1.
    """
    k = 1
    for i in range(count):
        begin, end = first + i * step, first + (i + 1) * step
        k = max(k, int(np.ceil(end - TRACE)) - int(np.floor(begin + TRACE)))
    k = min(k, extent)
    at, shares = np.empty(count, np.int64), np.zeros((count, k), np.float32)
    for i in range(count):
        begin, end = first + i * step, min(first + (i + 1) * step, extent)
        at[i] = min(int(np.floor(begin + TRACE)), extent - k)
        for j in range(k):
            covers = min(at[i] + j + 1.0, end) - max(at[i] + j + 0.0, begin)
            if covers > TRACE:
                shares[i, j] = covers / (end - begin)
    return at, shares


@inner_kernel()
def extremes_down(fine, shares, low, high):  # type: ignore[no-untyped-def]
    """Compute least and greatest of each column's bytes: rows of fine (k, W, 4) with a share, low, high (4 W)."""
    first = fine[0].ravel()
    for i in range(low.size):  # an assignment of arrays would copy byte by byte
        low[i], high[i] = first[i], first[i]
    for row in range(1, shares.size):
        if shares[row] > 0:
            widen(low, high, fine[row].ravel())


@inner_kernel()
def widen(low, high, row):  # type: ignore[no-untyped-def]
    """Update least and greatest of bytes by one more row, each (n,)."""
    for i in range(low.size):
        low[i] = min(low[i], row[i])
        high[i] = max(high[i], row[i])


@inner_kernel()
def extremes_across(low, high, k):  # type: ignore[no-untyped-def]
    """Compute least and greatest of k pixels from each on; of the last k - 1, of fewer."""
    for _ in range(k - 1):
        for i in range(low.size - 4):
            low[i] = min(low[i], low[i + 4])
            high[i] = max(high[i], high[i + 4])


@inner_kernel(fastmath=True)
def mean_down(fine, shares, mean):  # type: ignore[no-untyped-def]
    """Compute the mean (4 W) of rows of fine (k, W, 4) by their shares."""
    mean[:] = 0
    for row in range(shares.size):
        if shares[row] > 0:
            of_row, share = fine[row].ravel(), shares[row]
            for i in range(mean.size):
                mean[i] += share * of_row[i]


@inner_kernel()
def light_of(fine, at, ink, down, across, takes):  # type: ignore[no-untyped-def]
    """Return the light that one ink takes within a pixel of fine (k, W, 4), columns from ``at`` on, by shares."""
    light = np.float32(0)
    for row in range(down.size):
        of_row = np.float32(0)
        for column in range(across.size):
            of_row += across[column] * takes[fine[row, at + column, ink]]
        light += down[row] * of_row
    return light


@kernel(
    "fine (H, W, 4), first, left, step, flat, takes (4, 256), needs (4, STEPS + 1), out (R, C, 4)",
    where="0 < step, 0 <= first, 0 <= left, first + R * step <= H + 0.001, left + C * step <= W + 0.001",
)
def average_areas(fine, first, left, step, flat, takes, needs, out):  # type: ignore[no-untyped-def]
    """Reduce fine (n, m, 4) to out (rows, columns, 4), bytes both.

    A pixel covers ``step`` fine ones either way, the topmost from row ``first`` on, the leftmost from
    column ``left`` on. takes (4, 256): the light
    that a byte of an ink takes, 0..1; needs: the byte that takes each of ``STEPS`` shares of it. Inks that
    differ by less than ``flat`` within a pixel are averaged as bytes.
    """
    rows, columns = out.shape[:2]
    row_at, row_shares = covered(first, step, rows, fine.shape[0])
    column_at, column_shares = covered(left, step, columns, fine.shape[1])
    k = column_shares.shape[1]
    low, high = np.empty((2, 4 * fine.shape[1]), np.uint8)
    mean = np.empty(4 * fine.shape[1], np.float32)
    for row in range(rows):
        down = row_shares[row]
        covers = fine[row_at[row] : row_at[row] + down.size]
        extremes_down(covers, down, low, high)
        extremes_across(low, high, k)
        for i in range(low.size):
            high[i] -= low[i]
        spread, alike = high.view(np.uint32), low.view(np.uint32)
        packed = out[row].ravel().view(np.uint32)
        averaged = False
        for column in range(columns):
            at = column_at[column]
            packed[column] = alike[at]
            if spread[at] == 0:
                continue
            across = column_shares[column]
            for ink in range(4):
                differ = high[4 * at + ink]
                if differ >= flat:
                    light = light_of(covers, at, ink, down, across, takes[ink])
                    out[row, column, ink] = needs[ink, int(light * STEPS + np.float32(0.5))]
                elif differ > 0:
                    if not averaged:
                        mean_down(covers, down, mean)
                        averaged = True
                    total = np.float32(0.5)
                    for j in range(k):
                        total += across[j] * mean[4 * (at + j) + ink]
                    out[row, column, ink] = int(total)
