"""Compiled loops of the lens correction: block means, small convolutions, and their sum with every line."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.vectors import FUSED, LONG, filled, number_at, vector_at

AT_ONCE = 16
_PAIRS = ((3, 3), (2, 4), (1, 5), (0, 6))
"""Lines of the seven that are equally far from the middle one."""
NEAR_REACH = 3
"""Number of camera pixels to each side that a lens correction weights one by one."""
FAR_BLOCK, FARTHER_BLOCK = 4, 16
"""Sides of the square blocks of camera pixels that it weights beyond these."""
BLOCK = FAR_BLOCK
"""Pixels per block side, and blocks per side of a larger block: known to the compiler, so that loops run in
vectors."""
assert FAR_BLOCK == 4
assert FARTHER_BLOCK == 16
WINDOW = 2 * NEAR_REACH + 1


@intrinsic
def mix_rows(context, rows, starts, at, weights, out, width):  # type: ignore[no-untyped-def]
    """Mix seven lines into four, sixteen pixels of each.

    out[width x + at + i] = sum over y < 4 of weights[4 y + x] (line y above the middle + line y below), x <
    4, i < 16. rows, weights, out (n,) float32; starts (7,) int64: where in rows the seven lines begin.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows, starts, weights, out = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 4)
        )
        at, width = args[2], args[5]

        def line(n: int) -> Any:
            start = builder.load(number_at(builder, starts, ir.Constant(LONG, n)))
            return builder.load(vector_at(builder, rows, builder.add(start, at), AT_ONCE), align=4)

        sums = [
            line(above) if above == below else builder.fadd(line(above), line(below))
            for above, below in _PAIRS
        ]
        for x in range(4):
            total = None
            for y in range(4):
                place = number_at(builder, weights, ir.Constant(LONG, 4 * y + x))
                part = builder.fmul(filled(builder, builder.load(place), AT_ONCE), sums[y], flags=FUSED)
                total = part if total is None else builder.fadd(total, part, flags=FUSED)
            target = builder.add(builder.mul(width, ir.Constant(LONG, x)), at)
            builder.store(total, vector_at(builder, out, target, AT_ONCE), align=4)
        return context.get_dummy_value()

    return types.void(rows, starts, types.int64, weights, out, types.int64), generate


@kernel("image (L, P), means (-(-L // BLOCK), -(-P // BLOCK))")
def block_means(image, means):  # type: ignore[no-untyped-def]
    """Compute means of image (lines, pixels) over squares of 4 x 4; outside the image is 0."""
    lines, pixels = image.shape
    share = np.float32(1 / BLOCK**2)
    whole = pixels // BLOCK
    for row in range(means.shape[0]):
        out = means[row]
        out[:] = 0
        for line in range(row * BLOCK, min((row + 1) * BLOCK, lines)):
            source, inner = image[line], out[:whole]
            for cell in range(inner.size):
                at = BLOCK * cell
                inner[cell] += share * ((source[at] + source[at + 1]) + (source[at + 2] + source[at + 3]))
            for i in range(whole * BLOCK, pixels):
                out[whole] += share * source[i]


@kernel("image (H, W), weights (N, N), out (H, W)")
def convolve(image, weights, out):  # type: ignore[no-untyped-def]
    """Convolve a small image directly with symmetric weights (2 n + 1, 2 n + 1); outside the image is 0."""
    rows, columns = image.shape
    reach = weights.shape[0] // 2
    out[:] = 0
    for row in range(rows):
        target = out[row]
        for dy in range(max(-reach, -row), min(reach, rows - 1 - row) + 1):
            source = image[row + dy]
            for dx in range(max(-reach, 1 - columns), min(reach, columns - 1) + 1):
                weight = weights[reach + dy, reach + dx]
                start = max(0, -dx)
                count = columns - abs(dx)
                seen = source[start + dx : start + dx + count]
                part = target[start : start + count]
                for i in range(count):
                    part[i] += weight * seen[i]


@inner_kernel(error_model="numpy")
def between_rows(image, line, out):  # type: ignore[no-untyped-def]
    """Interpolate the row of block values at a line, linear between the blocks' centres, constant beyond."""
    place = min(max((line + 0.5) / BLOCK - 0.5, 0.0), image.shape[0] - 1.0)
    above = int(place)
    share = np.float32(place - above)
    before, after = image[above], image[min(above + 1, image.shape[0] - 1)]
    for i in range(out.size):
        out[i] = before[i] + share * (after[i] - before[i])


@inner_kernel(error_model="numpy")
def add_between(row, line):  # type: ignore[no-untyped-def]
    """Add a row of block values to line (pixels,), linear between their centres, constant at the ends."""
    last = row.size - 1
    half = BLOCK // 2
    first, second = np.float32(0.5 / BLOCK), np.float32(1.5 / BLOCK)
    third, fourth = np.float32(2.5 / BLOCK), np.float32(3.5 / BLOCK)
    for i in range(min(half, line.size)):
        line[i] += row[0]
    full = max(min(last, (line.size - half) // BLOCK), 0)
    inner, after = line[half : half + full * BLOCK], row[1:]
    for cell in range(full):
        at, here = BLOCK * cell, row[cell]
        rise = after[cell] - here
        inner[at] += here + first * rise
        inner[at + 1] += here + second * rise
        inner[at + 2] += here + third * rise
        inner[at + 3] += here + fourth * rise
    for i in range(half + full * BLOCK, line.size):
        cell = min((i - half) // BLOCK, last)
        share = np.float32((i - half - cell * BLOCK + 0.5) / BLOCK)
        line[i] += row[cell] + share * (row[min(cell + 1, last)] - row[cell])


@kernel("blocks (R, C), image (_, _)", where="0 < R, 0 < C")
def add_blocks(blocks, image):  # type: ignore[no-untyped-def]
    """Add block values to image (lines, pixels), bilinear between their centres."""
    row = np.empty(blocks.shape[1], np.float32)
    for line in range(image.shape[0]):
        between_rows(blocks, line, row)
        add_between(row, image[line])


@inner_kernel()
def near_line(rows, starts, weights, mixed, out):  # type: ignore[no-untyped-def]
    """Filter one line by its neighbours: out (pixels,).

    rows (n,): seven lines, from the one three above on, begin at starts (7,), each with three pixels on
    either side. weights (4, 4): of pixels so many lines and pixels away. mixed (4, width >= pixels + 6),
    width whole multiples of 16, is working space.
    """
    flat, of = mixed.reshape(-1), weights.reshape(-1)
    width = mixed.shape[1]
    for at in range(0, width, AT_ONCE):
        mix_rows(rows, starts, at, of, flat, width)
    middle, left, right = mixed[0, 3:], mixed[1, 2:], mixed[1, 4:]
    left_2, right_2, left_3, right_3 = mixed[2, 1:], mixed[2, 5:], mixed[3], mixed[3, 6:]
    for i in range(out.size):
        near = middle[i] + (left[i] + right[i])
        out[i] = near + ((left_2[i] + right_2[i]) + (left_3[i] + right_3[i]))


@kernel(
    "light (L, P), above (NEAR_REACH, P), below (NEAR_REACH, P), "
    "weights (NEAR_REACH + 1, NEAR_REACH + 1), far (-(-L // BLOCK), -(-P // BLOCK)), line_from, "
    "line_to",
    where="0 <= line_from, line_to <= L",
)
def correct_lines(light, above, below, weights, far, line_from, line_to):  # type: ignore[no-untyped-def]
    """Correct lines line_from .. line_to - 1 of light (lines, pixels) in place.

    above, below (3, pixels): the uncorrected lines before and after these, which another thread may be
    changing. weights (4, 4) as in ``near_line``; far: block values to be added.
    """
    pixels = light.shape[1]
    width = (pixels + 2 * NEAR_REACH + AT_ONCE - 1) // AT_ONCE * AT_ONCE
    ring = np.zeros((WINDOW, width), np.float32)
    rows = ring.reshape(-1)
    mixed = np.empty((NEAR_REACH + 1, width), np.float32)
    starts = np.empty(WINDOW, np.int64)
    far_row = np.empty(far.shape[1], np.float32)
    for line in range(line_from - NEAR_REACH, line_to + NEAR_REACH):
        slot = (line - line_from + WINDOW) % WINDOW
        target = ring[slot, NEAR_REACH : NEAR_REACH + pixels]
        if line < line_from:
            copy_row(above[line - line_from + NEAR_REACH], target)
        elif line < line_to:
            copy_row(light[line], target)
        else:
            copy_row(below[line - line_to], target)
        done = line - NEAR_REACH
        if done < line_from:
            continue
        for n in range(WINDOW):
            starts[n] = (slot + 1 + n) % WINDOW * width
        near_line(rows, starts, weights, mixed, light[done])
        between_rows(far, done, far_row)
        add_between(far_row, light[done])
