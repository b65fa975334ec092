"""Compiled loops: sums over boxes of tiles, from size to size.

Cells tile the map; boxes are 2 x 2 cells and overlap by half; four cells make one of the next size.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def box_row(cells, y, gains, pushes, line, out):  # type: ignore[no-untyped-def]
    """Sums of 2 x 2 cells from row y of cells (h, w) on, (w,); gains (h,) of ``pushes`` (h, w) are taken away first."""
    height, width = cells.shape
    if y + 1 < height:
        g, h = gains[y], gains[y + 1]
        top, bottom, p, q = cells[y], cells[y + 1], pushes[y], pushes[y + 1]
        for x in range(width):
            line[x] = top[x] + bottom[x] - (g * p[x] + h * q[x])
    else:
        g = gains[y]
        top, p = cells[y], pushes[y]
        for x in range(width):
            line[x] = top[x] - g * p[x]
    for x in range(width - 1):
        out[x] = line[x] + line[x + 1]
    out[width - 1] = line[width - 1]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def plain_box_row(cells, y, line, out):  # type: ignore[no-untyped-def]
    """``box_row`` with nothing taken away."""
    height, width = cells.shape
    top, bottom = cells[y], cells[min(y + 1, height - 1)]
    share = np.float32(1) if y + 1 < height else np.float32(0)
    for x in range(width):
        line[x] = top[x] + share * bottom[x]
    for x in range(width - 1):
        out[x] = line[x] + line[x + 1]
    out[width - 1] = line[width - 1]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def merged(cells, gains, out):  # type: ignore[no-untyped-def]
    """Cells (4, modes, h, w) of twice the side into out (4, modes, ., .); gains (h,) as in ``box_row``."""
    modes, height, width = out.shape[1], cells.shape[2], cells.shape[3]
    line = np.empty(width + 1, np.float32)
    line[width] = 0
    for part in range(4):
        for mode in range(modes):
            of, c = cells[part, mode], cells[2, mode]
            for k in range(out.shape[2]):
                y = 2 * k
                z = min(y + 1, height - 1)
                share = np.float32(1) if y + 1 < height else np.float32(0)
                if part == 0:
                    g, h = gains[y], gains[z]
                    for x in range(width):
                        line[x] = of[y, x] - g * c[y, x] + share * (of[z, x] - h * c[z, x])
                else:
                    for x in range(width):
                        line[x] = of[y, x] + share * of[z, x]
                target = out[part, mode, k]
                for i in range(target.size):
                    target[i] = line[2 * i] + line[2 * i + 1]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def squares(maps, out):  # type: ignore[no-untyped-def]
    """Sums of 2 x 2 of maps (n, h, w), out (n, h // 2, w // 2)."""
    for n in range(out.shape[0]):
        for y in range(out.shape[1]):
            above, below, row = maps[n, 2 * y], maps[n, 2 * y + 1], out[n, y]
            for x in range(row.size):
                row[x] = above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]
