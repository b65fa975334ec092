"""Compiled loops that displace a raster's ink planes."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel()
def compose_row(packed, row, planes, out):  # type: ignore[no-untyped-def]
    """One raster row as printed, (columns,) uint32 with cyan in the lowest byte: every plane displaced.

    planes (4, 2): how many pixels each lies too far right and too far down.
    """
    rows, columns = packed.shape
    out[:] = 0
    for ink in range(4):
        right = planes[ink, 0]
        source_row = row - planes[ink, 1]
        if 0 <= source_row < rows and abs(right) < columns:
            mask = np.uint32(255 << (8 * ink))
            first = max(right, 0)
            stop = min(columns + right, columns)
            source = packed[source_row, first - right : stop - right]
            target = out[first:stop]
            for i in range(target.size):
                target[i] |= source[i] & mask


@kernel("packed (H, W), planes (4, 2), out (H, W)")
def compose_rows(packed, planes, out):  # type: ignore[no-untyped-def]
    """``compose_row`` of all rows, out (rows, columns)."""
    for row in range(out.shape[0]):
        compose_row(packed, row, planes, out[row])
