"""Compiled loops that displace a raster's ink planes."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel()
def compose_row(packed, row, planes, out):  # type: ignore[no-untyped-def]
    """Compose one raster row as printed, (columns,) uint32 with cyan in the lowest byte, with every plane displaced.

    planes (4, 2): number of pixels by which each lies too far right and too far down.
    """
    rows, columns = packed.shape
    right, above = planes[:, 0], row - planes[:, 1]
    first, stop = max(0, right.max()), min(columns, columns + right.min())
    if first < stop and above.min() >= 0 and above.max() < rows:
        compose_inner(packed, above, right, out[first:stop], first)
        compose_pixels(packed, row, planes, out, 0, first)
        compose_pixels(packed, row, planes, out, stop, columns)
    else:
        compose_pixels(packed, row, planes, out, 0, columns)


@inner_kernel()
def compose_inner(packed, rows, right, out, at):  # type: ignore[no-untyped-def]
    """Compose part of a row, out (n,) from pixel ``at`` on, where all planes have pixels.

    They are taken from rows (4,), right (4,) aside.
    """
    count = out.size
    c = packed[rows[0], at - right[0] : at - right[0] + count]
    m = packed[rows[1], at - right[1] : at - right[1] + count]
    y = packed[rows[2], at - right[2] : at - right[2] + count]
    k = packed[rows[3], at - right[3] : at - right[3] + count]
    for i in range(count):
        out[i] = (
            (c[i] & np.uint32(0xFF))
            | (m[i] & np.uint32(0xFF00))
            | (y[i] & np.uint32(0xFF0000))
            | (k[i] & np.uint32(0xFF000000))
        )


@inner_kernel()
def compose_pixels(packed, row, planes, out, begin, end):  # type: ignore[no-untyped-def]
    """Compose pixels begin .. end - 1 as in ``compose_row``, where planes may lack some."""
    rows, columns = packed.shape
    out[begin:end] = 0
    for ink in range(4):
        right = planes[ink, 0]
        source_row = row - planes[ink, 1]
        if 0 <= source_row < rows and abs(right) < columns:
            mask = np.uint32(255 << (8 * ink))
            first = max(right, begin)
            stop = max(min(columns + right, end), first)
            source = packed[source_row, first - right : stop - right]
            target = out[first:stop]
            for i in range(target.size):
                target[i] |= source[i] & mask


@kernel("packed (H, W), planes (4, 2), out (H, W)")
def compose_rows(packed, planes, out):  # type: ignore[no-untyped-def]
    """Run ``compose_row`` on all rows, out (rows, columns)."""
    for row in range(out.shape[0]):
        compose_row(packed, row, planes, out[row])
