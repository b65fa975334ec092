"""The compiled loop that says how much ink was to be printed where."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import kernel

INKS = 4


@kernel("packed (_, _), lines (R, _), columns (C, _), ink (R, C, INKS)")
def block_inks(packed, lines, columns, ink):  # type: ignore[no-untyped-def]
    """Add to ink (rows, across, 4) the mean ink fractions of the raster, packed (lines, columns) uint32, in blocks.

    lines (rows, n), columns (across, n): the n lines and columns of the raster that stand for a row of blocks.
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
                    word = source[column]
                    cyan += word & byte
                    magenta += (word >> np.uint32(8)) & byte
                    yellow += (word >> np.uint32(16)) & byte
                    black += word >> np.uint32(24)
                out[block, 0] += share * np.float32(cyan)
                out[block, 1] += share * np.float32(magenta)
                out[block, 2] += share * np.float32(yellow)
                out[block, 3] += share * np.float32(black)
