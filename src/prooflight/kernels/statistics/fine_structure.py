"""Compiled loops that find where a raster has a structure that pixels of the camera blur."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.statistics.boxes import add_to
from prooflight.kernels.statistics.streaks import pairs_of


@kernel("packed (H, W), out (H, W)")
def greatest_inks(packed, out):  # type: ignore[no-untyped-def]
    """Compute the greatest byte of each recipe, out (rows, columns) uint8; packed: one uint32 a recipe."""
    for row in range(packed.shape[0]):
        greatest_of_row(packed[row], out[row])


@inner_kernel()
def greatest_of_row(packed, out):  # type: ignore[no-untyped-def]
    """Run ``greatest_inks`` on a row (n,)."""
    for i in range(out.size):
        recipe = packed[i]
        a, b = np.uint8(recipe), np.uint8(recipe >> np.uint32(8))
        c, d = np.uint8(recipe >> np.uint32(16)), np.uint8(recipe >> np.uint32(24))
        one, other = a if a > b else b, c if c > d else d
        out[i] = one if one > other else other


@inner_kernel()
def slide_sums(new, old, sums, squares):  # type: ignore[no-untyped-def]
    """Move columns' sums and sums of squares (n,) int32 on by a row: add ``new``, and take ``old`` off."""
    for i in range(sums.size):
        a, b = np.int32(new[i]), np.int32(old[i])
        sums[i] += a - b
        squares[i] += a * a - b * b


@inner_kernel()
def window_sums(columns, side, doubled, out):  # type: ignore[no-untyped-def]
    """Compute the sums of ``side`` columns from each on, out (n,), of columns (n + side - 1,) int32.

    Sums of one, two, four columns and so on are made in turn, and added up to ``side``; doubled (2, n + side - 1):
    working space. Sums that would reach beyond the columns have no meaning, and enter none of out.
    """
    one, other = doubled[0], doubled[1]
    copy_row(columns, one)
    for i in range(out.size):
        out[i] = 0
    start, length = 0, 1
    while length <= side:
        if side & length:
            add_to(one[start : start + out.size], out)
            start += length
        pairs_of(one, length, other[: max(other.size - length, 0)])
        one, other = other, one
        length *= 2


@inner_kernel()
def variances(sums, squares, scale, least, out):  # type: ignore[no-untyped-def]
    """Compute variances, out (n,), from sums and sums of squares of windows; scale: 1 over their pixels.

    Return whether any is ``least`` or more.
    """
    reached = False
    for i in range(out.size):
        mean = np.float32(sums[i]) * scale
        out[i] = np.float32(squares[i]) * scale - mean * mean
        reached |= out[i] >= least
    return reached


@kernel("ink (A, B), seen (A, B), side, least, share, out (A - side + 1, B - side + 1)", where="1 <= side")
def find_blurred(ink, seen, side, least, share, out):  # type: ignore[no-untyped-def]
    """Compute where ink varies by ``least`` or more, and as ``seen`` by less than ``share`` of it: 1 there, else 0.

    ink, seen (rows + side - 1, columns + side - 1) uint8: an image, and the same blurred; both variances are those
    within squares of ``side`` pixels, the first of which begins at the images' corner.
    """
    height, width = ink.shape
    columns = np.zeros((4, width), np.int32)  # sums and sums of squares, of ink and as seen
    doubled = np.empty((2, width), np.int32)
    sums, squares = np.empty(out.shape[1], np.int32), np.empty(out.shape[1], np.int32)
    contrast, resolved = np.empty(out.shape[1], np.float32), np.empty(out.shape[1], np.float32)
    scale = np.float32(1 / (side * side))
    none = np.zeros(width, np.uint8)
    for row in range(height):
        of_ink, of_seen = (ink[row - side], seen[row - side]) if row >= side else (none, none)
        slide_sums(ink[row], of_ink, columns[0], columns[1])
        slide_sums(seen[row], of_seen, columns[2], columns[3])
        if row < side - 1:
            continue
        window_sums(columns[0], side, doubled, sums)
        window_sums(columns[1], side, doubled, squares)
        places = out[row - side + 1]
        if not variances(sums, squares, scale, least, contrast):
            for i in range(places.size):
                places[i] = 0
            continue
        window_sums(columns[2], side, doubled, sums)
        window_sums(columns[3], side, doubled, squares)
        variances(sums, squares, scale, least, resolved)
        for i in range(places.size):
            places[i] = (contrast[i] >= least) & (resolved[i] < share * contrast[i])
