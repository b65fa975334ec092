"""Compiled loops for means over squares of pixels."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel(fastmath=True, error_model="numpy")
def add_row(row, sums):  # type: ignore[no-untyped-def]
    """Add a row to sums (w,)."""
    for x in range(sums.size):
        sums[x] += np.float32(row[x])


@inner_kernel(fastmath=True, error_model="numpy")
def gather_row(sums, bins, first, out):  # type: ignore[no-untyped-def]
    """Compute means over squares from column sums (w,), from pixel ``first`` on; the last pixel is repeated beyond."""
    share = np.float32(1 / (bins * bins))
    if bins == 2 and first == 0:
        for i in range(out.size):
            out[i] = (sums[2 * i] + sums[2 * i + 1]) * share
        return
    whole = (sums.size - first) // bins
    for i in range(out.size):
        total = np.float32(0)
        if i < whole:
            for x in range(i * bins + first, (i + 1) * bins + first):
                total += sums[x]
        else:
            for x in range(i * bins + first, (i + 1) * bins + first):
                total += sums[min(x, sums.size - 1)]
        out[i] = total * share


@kernel("image (L, P), bins, out (-(-L // bins), P // bins)")
def binned_rows(image, bins, out):  # type: ignore[no-untyped-def]
    """Compute means over bins x bins pixels of an image (lines, pixels), out (., .); its last line is repeated."""
    sums = np.empty(image.shape[1], np.float32)
    for line in range(out.shape[0]):
        sums[:] = 0
        for i in range(bins):
            add_row(image[min(line * bins + i, image.shape[0] - 1)], sums)
        gather_row(sums, bins, 0, out[line])


@inner_kernel()
def take_fours(even, odd, right, out):  # type: ignore[no-untyped-def]
    """Take every second pixel of two rows in turn, as ``take_turns`` of two; right: of the first square.

    out (n,): n a multiple of 4; even, odd (2 n,).
    """
    left = 1 - right
    for k in range(out.size // 4):
        out[4 * k] = even[8 * k + right]
        out[4 * k + 1] = odd[8 * k + right + 2]
        out[4 * k + 2] = even[8 * k + left + 4]
        out[4 * k + 3] = odd[8 * k + left + 6]


@kernel("packed (H, W), bins, out (-(-H // bins), -(-W // bins))")
def take_turns(packed, bins, out):  # type: ignore[no-untyped-def]
    """Take one of each bins x bins recipes, out (rows, columns).

    Its place moves right from row to row of squares and from square to square, and down from row to row and
    column to column; the last pixels of the raster (h, w) are repeated beyond it.
    """
    height, width = packed.shape
    for i in range(out.shape[0]):
        right = i // bins % bins
        whole = width // 8 * 4 if bins == 2 and 2 * i + 1 < height else 0
        if whole:  # nearly all of a page at the usual number of bins
            rows = packed[2 * i : 2 * i + 2, : 2 * whole]
            take_fours(rows[i % 2], rows[1 - i % 2], right, out[i, :whole])
        for first in range(whole, out.shape[1], bins):
            down = i % bins
            for j in range(first, min(first + bins, out.shape[1])):
                out[i, j] = packed[min(i * bins + down, height - 1), min(j * bins + right, width - 1)]
                down = down + 1 if down + 1 < bins else 0
            right = right + 1 if right + 1 < bins else 0
