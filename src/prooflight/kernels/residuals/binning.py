"""Compiled loops: means over squares of pixels, in their places and from every pixel on."""

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


@kernel("image (L, P), bins, out (-(-L // bins), P // bins)")
def binned_rows(image, bins, out):  # type: ignore[no-untyped-def]
    """Means over bins x bins pixels of an image (lines, pixels), out (., .); its last line goes on."""
    sums = np.empty(image.shape[1], np.float32)
    for line in range(out.shape[0]):
        sums[:] = 0
        for i in range(bins):
            add_row(image[min(line * bins + i, image.shape[0] - 1)], sums)
        gather_row(sums, bins, 0, out[line])


@kernel("image (L, P), out (B, B, -(-L // B), P // B)")
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


@kernel("packed (H, W), bins, out (-(-H // bins), -(-W // bins))")
def take_turns(packed, bins, out):  # type: ignore[no-untyped-def]
    """One of each bins x bins recipes, out (rows, columns): further right from row to row of squares and from square to
    square, further down from row to row and column to column; the last go on beyond the raster (h, w).
    """
    height, width = packed.shape
    for i in range(out.shape[0]):
        right = i // bins % bins
        for first in range(0, out.shape[1], bins):
            down = i % bins
            for j in range(first, min(first + bins, out.shape[1])):
                out[i, j] = packed[min(i * bins + down, height - 1), min(j * bins + right, width - 1)]
                down = down + 1 if down + 1 < bins else 0
            right = right + 1 if right + 1 < bins else 0
