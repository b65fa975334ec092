"""Compiled loops: means over squares of pixels, in their places and from every pixel on."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def add_row(row, sums):  # type: ignore[no-untyped-def]
    """Add a row to sums (w,)."""
    for x in range(sums.size):
        sums[x] += np.float32(row[x])


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def gather_row(sums, bins, first, out):  # type: ignore[no-untyped-def]
    """Means over squares from sums down columns (w,), from pixel ``first`` on; the last pixel goes on beyond."""
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


@njit(cache=True, nogil=True)
def binned_rows(image, bins, out):  # type: ignore[no-untyped-def]
    """Means over bins x bins pixels of an image (lines, pixels), out (., .); its last line goes on."""
    sums = np.empty(image.shape[1], np.float32)
    for line in range(out.shape[0]):
        sums[:] = 0
        for i in range(bins):
            add_row(image[min(line * bins + i, image.shape[0] - 1)], sums)
        gather_row(sums, bins, 0, out[line])


@njit(cache=True, nogil=True)
def running_means(image, out):  # type: ignore[no-untyped-def]
    """Means over squares from every pixel on, by phases: out (bins, bins, ., .) of an image (lines, pixels)."""
    bins = out.shape[0]
    sums = np.empty(image.shape[1], np.float32)
    for line in range(out.shape[2]):
        for down in range(bins):
            sums[:] = 0
            for i in range(bins):
                add_row(image[min(line * bins + down + i, image.shape[0] - 1)], sums)
            for right in range(bins):
                gather_row(sums, bins, right, out[down, right, line])
