"""Compiled sums down the columns of a page, one core, nothing allocated."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def column_sums(measured, expected, first, last, seen, due):  # type: ignore[no-untyped-def]
    """Add lines first to last - 1 of measured uint16 and expected float32 (lines, pixels) [DN] to seen and due.

    seen (pixels,) uint32, due (pixels,) float64.
    """
    for line in range(first, last):
        for pixel in range(seen.size):
            seen[pixel] += measured[line, pixel]
        for pixel in range(due.size):
            due[pixel] += expected[line, pixel]
