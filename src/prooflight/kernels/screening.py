"""Compiled loops that screen plates of device pixels: thresholds on a lattice, error diffusion, and a blue-noise tile.

Between what a device can print, its levels, a byte of an ink is stated as the level below it and the share of the way
to the next one, in units of light: ``low`` and ``share``, tables by byte.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import kernel

WHOLE = 65535
"""Share that prints the next level at every threshold; thresholds are 0 to ``WHOLE`` - 1."""
BLUR_REACH = 8
"""Reach of the filter that measures how crowded a pixel is. [pixels]"""


@kernel(
    "plates (H, W, 4), tile (N, N), shift, starts (H, 4, 2), steps (4, 2), low (4, 256), share (4, 256), levels (_), "
    "out (H, W, 4)",
    where="0 < shift, shift < 32",
)
def screen_by_threshold(plates, tile, shift, starts, steps, low, share, levels, out):  # type: ignore[no-untyped-def]
    """Screen bytes by thresholds that repeat on a lattice; ``out`` may be ``plates``.

    tile (2^(32 - shift) a side): thresholds of one cell, by its two coordinates. starts, steps: cell coordinates of
    each row's first pixel, and from one pixel to the next, by ink, in units of 2^-32 of a cell (uint32, whose overflow
    is the next cell). levels: the byte that each level prints.
    """
    for row in range(plates.shape[0]):
        packed_inks = plates[row].ravel().view(np.uint32)
        printed = out[row].ravel().view(np.uint32)
        for column in range(packed_inks.size):
            inks = packed_inks[column]
            if inks == 0:
                printed[column] = 0
                continue
            result = np.uint32(0)
            for ink in range(4):
                bits = np.uint32(8 * ink)
                byte = (inks >> bits) & np.uint32(255)
                if byte == 0:
                    continue
                level, part = low[ink, byte], share[ink, byte]
                if part > 0:
                    u = np.uint32(starts[row, ink, 0] + np.uint32(column) * steps[ink, 0]) >> np.uint32(shift)
                    v = np.uint32(starts[row, ink, 1] + np.uint32(column) * steps[ink, 1]) >> np.uint32(shift)
                    level += part > tile[v, u]
                result |= np.uint32(levels[level]) << bits
            printed[column] = result


@kernel("plates (H, W, 4), low (4, 256), share (4, 256), levels (_), out (H, W, 4)")
def diffuse_error(plates, low, share, levels, out):  # type: ignore[no-untyped-def]
    """Screen bytes by error diffusion (Floyd and Steinberg 1976), every other row backwards.

    ``out`` may be ``plates``.

    Paper and solids are printed as they are, and no error is carried across them, so that neither gets specks.
    """
    rows, columns = plates.shape[:2]
    last = levels.size - 1
    here, below = np.zeros((2, columns + 2), np.float32)
    for ink in range(4):
        here[:] = 0
        below[:] = 0
        for row in range(rows):
            forward = 1 if row & 1 == 0 else -1
            for n in range(columns):
                column = n if forward > 0 else columns - 1 - n
                at = column + 1
                byte = plates[row, column, ink]
                if byte == 0 or byte == 255:
                    out[row, column, ink] = byte
                    continue
                wanted = (
                    np.float32(low[ink, byte]) + np.float32(share[ink, byte]) / np.float32(WHOLE) + here[at]
                )
                level = min(max(int(np.floor(wanted + np.float32(0.5))), 0), last)
                error = (wanted - np.float32(level)) / np.float32(16)
                here[at + forward] += np.float32(7) * error
                below[at - forward] += np.float32(3) * error
                below[at] += np.float32(5) * error
                below[at + forward] += error
                out[row, column, ink] = levels[level]
            here, below = below, here
            below[:] = 0


@kernel("crowded (N, N), blur (2 * BLUR_REACH + 1, 2 * BLUR_REACH + 1), sign, row, column")
def crowd(crowded, blur, sign, row, column):  # type: ignore[no-untyped-def]
    """Add, or with ``sign`` -1 take away, one dot's part of how crowded each pixel of a tile is."""
    size = crowded.shape[0]
    for i in range(blur.shape[0]):
        for j in range(blur.shape[1]):
            crowded[(row + i - BLUR_REACH) % size, (column + j - BLUR_REACH) % size] += sign * blur[i, j]


@kernel("crowded (N, N), dots (N, N), among")
def most_crowded(crowded, dots, among):  # type: ignore[no-untyped-def]
    """Return row and column of the most crowded dot (``among`` 1), or of the largest void (``among`` 0)."""
    best, best_row, best_column = -np.inf, 0, 0
    for row in range(dots.shape[0]):
        for column in range(dots.shape[1]):
            if dots[row, column] == among:
                value = crowded[row, column] if among else -crowded[row, column]
                if value > best:
                    best, best_row, best_column = value, row, column
    return best_row, best_column
