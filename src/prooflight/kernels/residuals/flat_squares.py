"""Compiled loop for second differences of residuals over squares of flat paper, from which noise is estimated."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel()
def all_inside(inside, line, out):  # type: ignore[no-untyped-def]
    """Compute whether each pixel of a line and all its neighbours are inside (lines, pixels), out (pixels,); 1 or 0."""
    bits = inside.view(np.uint8)
    above, here, below = bits[max(line - 1, 0)], bits[line], bits[min(line + 1, bits.shape[0] - 1)]
    last = out.size - 1
    for x in range(out.size):
        out[x] = above[x] & here[x] & below[x]
    before = out[0]
    for x in range(out.size):
        own = out[x]
        out[x] = before & own & out[min(x + 1, last)]
        before = own


@kernel(
    "left (L, P), variance (L, P), light (L, P), texture (L, P), inside (L, P), steepest, "
    "squares (2, (L // 2) * (P // 2))",
    error_model="numpy",
)
def flat_squares(left, variance, light, texture, inside, steepest, squares):  # type: ignore[no-untyped-def]
    """Compute second differences of residuals in flat squares of 2 x 2 pixels; return the number of squares.

    Written to squares (2, squares): squared second difference over four times the stated variance, and texture
    over that variance. r[i, j] - r[i + 1, j] - r[i, j + 1] + r[i + 1, j + 1] is free of columns' gains and
    lines' flicker. A square is flat if its first pixel and all neighbours of that are inside, and light
    changes over the diagonal by less than ``steepest`` standard deviations.
    """
    lines, pixels = left.shape
    there = np.empty(pixels, np.uint8)
    most, count = np.float32(steepest * steepest), 0
    for line in range(0, lines - 1, 2):
        all_inside(inside, line, there)
        for x in range(0, pixels - 1, 2):
            stated, step = variance[line, x], light[line + 1, x + 1] - light[line, x]
            if there[x] and step * step < most * stated:
                crossed = left[line, x] - left[line, x + 1] - left[line + 1, x] + left[line + 1, x + 1]
                squares[0, count] = crossed * crossed / (np.float32(4) * stated)
                squares[1, count] = texture[line, x] / stated
                count += 1
    return count
