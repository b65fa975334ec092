"""Compiled sums down the columns of a page, one core."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import kernel

LINES = 8
"""Added in single precision at most: the sum is then good to 1e-7 of itself."""


@kernel("measured (L, P), expected (L, P), first, last, seen (P), due (P)", where="0 <= first, last <= L")
def column_sums(measured, expected, first, last, seen, due):  # type: ignore[no-untyped-def]
    """Add lines first to last - 1 of measured uint16 and expected float32 (lines, pixels) [DN] to seen and due.

    seen (pixels,) uint32, due (pixels,) float64.
    """
    part = np.empty(due.size, np.float32)
    for top in range(first, last, LINES):
        part[:] = 0
        for line in range(top, min(top + LINES, last)):
            measured_row, expected_row = measured[line], expected[line]
            for pixel in range(seen.size):
                seen[pixel] += measured_row[pixel]
            for pixel in range(part.size):
                part[pixel] += expected_row[pixel]
        for pixel in range(due.size):
            due[pixel] += part[pixel]
