"""Compiled loops of comparison: one pass over a scan and its prediction, in 16-bit integers.

Every loop runs over a short piece of one line and does little, so that it becomes vector instructions of 16-bit words
(a test looks for them); pieces of eight lines stay in the fastest cache.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.comparison.dither import (
    LOWEST_CODE,
    TILE,
    dither_row,
    dither_soft_row,
    plain_row,
    settle_row,
)
from prooflight.kernels.comparison.int16_simd import add, left_unsigned, right, right_unsigned
from prooflight.kernels.compiled import inner_kernel, kernel

Z_STEPS = 128
"""z is summed in steps of sigma / 128, to the nearest, ..."""
Z_MOST = 4095
"""... and cut off at so many steps, 32 sigma: eight of them still fit a word."""
FINE_MOST = np.uint16(8 * Z_MOST - 1)
STRIP = 2048
"""Pixels of a line that are worked on at once, whole tiles."""
LINES = 8
"""Lines that are folded at once, and the side of a block."""


@inner_kernel()
def normalise_row(measured, mean, inverse, top_code, mean_bits, drop, z):  # type: ignore[no-untyped-def]
    """Z of a piece of a line in steps of sigma / 1024, rounded down, cut off at 32 sigma: (pixels,) int16.

    measured, mean, inverse (pixels,) uint16, the latter two as ``compact`` gives them; drop: mean_bits +
    inverse_bits - 10. Returns whether a pixel lies at an end of the converter's range, and the greatest inverse.
    """
    keep = np.uint16(np.uint16(16) - drop)
    most = np.uint16((1 << (drop - 1)) - 1)
    farthest = np.uint16(0)  # 0 DN is as far as can be: it wraps
    surest = np.uint16(0)
    for i in range(z.size):
        farthest = max(farthest, np.uint16(measured[i] - np.uint16(1)))
        surest = max(surest, inverse[i])
        seen = left_unsigned(min(measured[i], top_code), mean_bits)
        expected = mean[i]
        distance = np.uint16(max(seen, expected) - min(seen, expected))
        upper = np.uint16((np.uint32(distance) * np.uint32(inverse[i])) >> np.uint32(16))
        lower = np.uint16(distance * inverse[i])
        steps = np.uint16(left_unsigned(upper, keep) | right_unsigned(lower, drop))
        steps = FINE_MOST if upper > most else min(steps, FINE_MOST)
        z[i] = np.int16(steps) if seen >= expected else np.int16(~steps)
    return farthest >= np.uint16(top_code - np.uint16(1)), surest


@inner_kernel()
def sum_row(z):  # type: ignore[no-untyped-def]
    """Sum of a piece of a line's z, each to the nearest 128th. [sigma / 128]"""
    total = np.int32(0)
    for i in range(z.size):
        total = np.int32(total + np.int32(right(add(z[i], 4), 3)))
    return total


@inner_kernel()
def fold_lines(z, sums, extremes, energy):  # type: ignore[no-untyped-def]
    """Eight lines' z, each to the nearest 128th, column by column: sums are set, extremes and energy grow.

    z: eight lines STRIP apart; sums, energy (pixels,) int16, int32; extremes: the least, STRIP on the greatest. All
    1-D and few: the compiler must see that they are different memory.
    """
    for i in range(sums.size):
        a, b = right(add(z[i], 4), 3), right(add(z[i + STRIP], 4), 3)
        c, d = right(add(z[i + 2 * STRIP], 4), 3), right(add(z[i + 3 * STRIP], 4), 3)
        e, f = right(add(z[i + 4 * STRIP], 4), 3), right(add(z[i + 5 * STRIP], 4), 3)
        g, h = right(add(z[i + 6 * STRIP], 4), 3), right(add(z[i + 7 * STRIP], 4), 3)
        sums[i] = add(add(add(a, b), add(c, d)), add(add(e, f), add(g, h)))
        extremes[i] = min(extremes[i], min(min(min(a, b), min(c, d)), min(min(e, f), min(g, h))))
        extremes[i + STRIP] = max(
            extremes[i + STRIP], max(max(max(a, b), max(c, d)), max(max(e, f), max(g, h)))
        )
        squares = np.int32(a) * np.int32(a) + np.int32(b) * np.int32(b) + np.int32(c) * np.int32(c)
        squares += np.int32(d) * np.int32(d) + np.int32(e) * np.int32(e) + np.int32(f) * np.int32(f)
        energy[i] += np.int32(squares + np.int32(g) * np.int32(g) + np.int32(h) * np.int32(h))


@inner_kernel()
def count_lines(codes, edges, counts):  # type: ignore[no-untyped-def]
    """How many of eight lines' codes, STRIP apart, reach each edge, column by column: counts (edges, pixels) grow."""
    for j in range(edges.size):
        edge, count = edges[j], counts[j]
        for i in range(count.size):
            count[i] = np.uint8(
                count[i]
                + np.uint8(codes[i] >= edge)
                + np.uint8(codes[i + STRIP] >= edge)
                + np.uint8(codes[i + 2 * STRIP] >= edge)
                + np.uint8(codes[i + 3 * STRIP] >= edge)
                + np.uint8(codes[i + 4 * STRIP] >= edge)
                + np.uint8(codes[i + 5 * STRIP] >= edge)
                + np.uint8(codes[i + 6 * STRIP] >= edge)
                + np.uint8(codes[i + 7 * STRIP] >= edge)
            )


@inner_kernel()
def total(counts):  # type: ignore[no-untyped-def]
    """Sum of (n,) counts."""
    result = np.int32(0)
    for i in range(counts.size):
        result = np.int32(result + np.int32(counts[i]))
    return result


@inner_kernel()
def large_total(values):  # type: ignore[no-untyped-def]
    """Sum of (n,) int32 that may go beyond them."""
    result = np.int64(0)
    for i in range(values.size):
        result += np.int64(values[i])
    return result


@inner_kernel()
def least(values):  # type: ignore[no-untyped-def]
    """The least of (n,) int16 and 0."""
    result = np.int16(0)
    for i in range(values.size):
        result = min(result, values[i])
    return result


@inner_kernel()
def greatest(values):  # type: ignore[no-untyped-def]
    """The greatest of (n,) int16 and 0."""
    result = np.int16(0)
    for i in range(values.size):
        result = max(result, values[i])
    return result


@inner_kernel()
def add_blocks(sums, blocks):  # type: ignore[no-untyped-def]
    """Column sums of eight lines (pixels,) -> sums over 8 x 8 pixels (pixels // 8,)."""
    for block in range(blocks.size):
        at = 8 * block
        pairs = np.int32(sums[at]) + np.int32(sums[at + 1]) + np.int32(sums[at + 2]) + np.int32(sums[at + 3])
        blocks[block] = (
            pairs
            + np.int32(sums[at + 4])
            + np.int32(sums[at + 5])
            + np.int32(sums[at + 6])
            + np.int32(sums[at + 7])
        )


@inner_kernel()
def code_piece(z, seen, expected, sure, camera, random, edges, reach, dither, codes):  # type: ignore[no-untyped-def]
    """Z and codes of a piece of a line, (pixels,) each. Returns the sum of z."""
    clipped, surest = normalise_row(seen, expected, sure, camera.top_code, camera.mean_bits, camera.drop, z)
    if not dither:
        plain_row(z, codes)
    elif surest > camera.sharp:
        dither_row(z, sure, camera.inverse_drop, random, codes)
    else:
        dither_soft_row(z, sure, camera.inverse_drop, random, codes)
    if dither and (clipped or surest > camera.unsure):
        settle_row(seen, expected, sure, camera, random, edges, reach, codes)
    return sum_row(z)


@inner_kernel()
def close_strip(first, extremes, energy, counts, columns, row, out):  # type: ignore[no-untyped-def]
    """Column statistics (.., pixels) of a strip that begins at pixel ``first`` into its tiles of row ``row``."""
    size = columns.size
    out.column_sum[row, first : first + size] = columns
    tiles = out.energy.shape[1]
    for start in range(0, size, TILE):
        tile = min((first + start) // TILE, tiles - 1)
        end = min(start + TILE, size)
        ends = out.extremes[row, tile]
        ends[0] = min(ends[0], least(extremes[start:end]))
        ends[1] = max(ends[1], greatest(extremes[STRIP + start : STRIP + end]))
        out.energy[row, tile] += large_total(energy[start:end])
        for j in range(counts.shape[0]):
            out.reached[row, tile, j] += total(counts[j, start:end])


@inner_kernel()
def compare_row(measured, mean, inverse, top, bottom, camera, noise, starts, edges, reach, dither, row, out):  # type: ignore[no-untyped-def]
    """Lines top .. bottom - 1, at most 127, of a row of tiles; the rest as in ``compare_lines``."""
    pixels = out.column_sum.shape[1]
    seen, expected, sure = measured.values, mean.values, inverse.values
    strips = (pixels + STRIP - 1) // STRIP
    z = np.zeros((strips, LINES * STRIP), np.int16)
    codes = np.empty((strips, LINES * STRIP), np.int8)
    sums = np.empty(STRIP, np.int16)
    extremes = np.zeros((strips, 2 * STRIP), np.int16)
    energy = np.zeros((strips, STRIP), np.int32)
    counts = np.zeros((strips, edges.size, STRIP), np.uint8)
    columns = np.zeros((strips, STRIP), np.int32)
    for first in range(top, bottom, LINES):
        for line in range(first, first + LINES):
            for strip in range(strips):
                begin, end = strip * STRIP, min((strip + 1) * STRIP, pixels)
                to = slice((line - first) * STRIP, (line - first) * STRIP + end - begin)
                if line >= bottom:
                    z[strip, to] = 0
                    codes[strip, to] = LOWEST_CODE
                    continue
                out.line_sum[line] += code_piece(
                    z[strip, to],
                    seen[line * measured.step + begin : line * measured.step + end],
                    expected[line * mean.step + begin : line * mean.step + end],
                    sure[line * inverse.step + begin : line * inverse.step + end],
                    camera,
                    noise[starts[line] + begin : starts[line] + end],
                    edges,
                    reach,
                    dither,
                    codes[strip, to],
                )
        for strip in range(strips):
            begin, size = strip * STRIP, min(STRIP, pixels - strip * STRIP)
            fold_lines(z[strip], sums[:size], extremes[strip], energy[strip])
            count_lines(codes[strip], edges, counts[strip, :, :size])
            for i in range(size):
                columns[strip, i] += np.int32(sums[i])
            if first + LINES <= bottom:
                add_blocks(sums[:size], out.block_sum[first // LINES, begin // 8 : (begin + size) // 8])
    for strip in range(strips):
        begin, size = strip * STRIP, min(STRIP, pixels - strip * STRIP)
        of_counts, of_columns = counts[strip, :, :size], columns[strip, :size]
        close_strip(begin, extremes[strip], energy[strip], of_counts, of_columns, row, out)


@kernel(
    "measured.values (_), mean.values (_), inverse.values (_), camera, noise (_), starts (L), "
    "edges (E), reach (E), dither, out.reached (R, C, E), out.energy (R, C), "
    "out.extremes (R, C, 2), out.block_sum (L // LINES, P // LINES), out.line_sum (L), "
    "out.column_sum (R, P)",
    where="R == max(L // TILE, 1), C == max(P // TILE, 1)",
)
def compare_lines(measured, mean, inverse, camera, noise, starts, edges, reach, dither, out):  # type: ignore[no-untyped-def]
    """Everything of some rows of tiles of one sensor; ``Lines`` of uint16 each, read line by line, as they lie.

    camera: ``Camera``; noise uint16 and starts (lines,): each line's random numbers begin there; dither: False for
    the naive histogram; out: ``Part``, whose arrays are filled.
    """
    lines, rows = out.line_sum.size, out.energy.shape[0]
    for row in range(rows):
        bottom = lines if row == rows - 1 else (row + 1) * TILE
        compare_row(
            measured, mean, inverse, row * TILE, bottom, camera, noise, starts, edges, reach, dither, row, out
        )
