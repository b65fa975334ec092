"""Compiled sums over a page: light down its columns, and nominal ink in its blocks."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import kernel

LINES = 8
"""Greatest number of lines added in single precision: the sum is then good to 1e-7 of itself."""


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


@kernel("packed (_, _), lines (R, _), columns (C, _), ink (R, C, INKS)")
def block_inks(packed, lines, columns, ink):  # type: ignore[no-untyped-def]
    """Add to ink (rows, across, 4) the mean ink fractions of the raster, packed (lines, columns) uint32, in blocks.

    lines (rows, n), columns (across, n): the n lines and columns of the raster that represent a row of
    blocks.
    """
    share = np.float32(1 / (255 * lines.shape[1] * columns.shape[1]))
    byte = np.uint32(255)
    for row in range(lines.shape[0]):
        out = ink[row]
        for line in lines[row]:
            source = packed[line]
            for block in range(columns.shape[0]):
                cyan, magenta, yellow, black = np.uint32(0), np.uint32(0), np.uint32(0), np.uint32(0)
                for column in columns[block]:
                    recipe = source[column]
                    cyan += recipe & byte
                    magenta += (recipe >> np.uint32(8)) & byte
                    yellow += (recipe >> np.uint32(16)) & byte
                    black += recipe >> np.uint32(24)
                out[block, 0] += share * np.float32(cyan)
                out[block, 1] += share * np.float32(magenta)
                out[block, 2] += share * np.float32(yellow)
                out[block, 3] += share * np.float32(black)
