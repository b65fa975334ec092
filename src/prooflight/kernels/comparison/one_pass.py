"""Compiled loops of comparison: one pass over a scan and its prediction, in 16-bit integers.

Every loop runs over a short piece of one line and does little, so that it becomes vector instructions of
16-bit words (a test checks this); pieces of eight lines stay in the fastest cache.
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
"""Steps of z per sigma in sums, rounded to the nearest."""
Z_MOST = 4095
"""Limit of z in steps, 32 sigma: eight of them still fit a word."""
FINE_MOST = np.uint16(8 * Z_MOST - 1)
STRIP = 2048
"""Pixels of a line that are processed at once, whole tiles."""
LINES = 8
"""Lines that are summed at once, and the side of a block."""


@inner_kernel()
def normalise_row(measured, mean, inverse, top_code, mean_bits, drop, z):  # type: ignore[no-untyped-def]
    """Compute z of a piece of a line in steps of sigma / 1024, rounded down, cut off at 32 sigma: (pixels,) int16.

    measured, mean, inverse (pixels,) uint16, the latter two as ``compact`` gives them; drop: mean_bits +
    inverse_bits - 10. Returns whether a pixel is at an end of the converter's range, and the greatest
    inverse.
    """
    keep = np.uint16(np.uint16(16) - drop)
    most = np.uint16((1 << (drop - 1)) - 1)
    farthest = np.uint16(0)  # 0 DN must give the greatest value: it wraps
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
def fold_lines(z, sums):  # type: ignore[no-untyped-def]
    """Sum z of eight lines, STRIP apart, each to the nearest 128th, column by column: sums (pixels,) int16."""
    for i in range(sums.size):
        a, b = right(add(z[i], 4), 3), right(add(z[i + STRIP], 4), 3)
        c, d = right(add(z[i + 2 * STRIP], 4), 3), right(add(z[i + 3 * STRIP], 4), 3)
        e, f = right(add(z[i + 4 * STRIP], 4), 3), right(add(z[i + 5 * STRIP], 4), 3)
        g, h = right(add(z[i + 6 * STRIP], 4), 3), right(add(z[i + 7 * STRIP], 4), 3)
        sums[i] = add(add(add(a, b), add(c, d)), add(add(e, f), add(g, h)))


@inner_kernel()
def count_lines(codes, edges, counts):  # type: ignore[no-untyped-def]
    """Count the codes of eight lines, STRIP apart, that reach each edge, by column; added to counts (edges, pixels)."""
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
    """Return the sum of (n,) counts."""
    result = np.int32(0)
    for i in range(counts.size):
        result = np.int32(result + np.int32(counts[i]))
    return result


@inner_kernel()
def add_blocks(sums, blocks):  # type: ignore[no-untyped-def]
    """Add column sums of eight lines (pixels,) up to sums over 8 x 8 pixels (pixels // 8,)."""
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
    """Compute z and codes of a piece of a line, (pixels,) each."""
    clipped, surest = normalise_row(seen, expected, sure, camera.top_code, camera.mean_bits, camera.drop, z)
    if not dither:
        plain_row(z, codes)
    elif surest > camera.sharp:
        dither_row(z, sure, camera.inverse_drop, random, codes)
    else:
        dither_soft_row(z, sure, camera.inverse_drop, random, codes)
    if dither and (clipped or surest > camera.unsure):
        settle_row(seen, expected, sure, camera, random, edges, reach, codes)


@inner_kernel()
def close_strip(first, counts, row, out):  # type: ignore[no-untyped-def]
    """Add counts (edges, pixels) of a strip that begins at pixel ``first`` to its tiles of row ``row``."""
    size, tiles = counts.shape[1], out.reached.shape[1]
    for start in range(0, size, TILE):
        tile = min((first + start) // TILE, tiles - 1)
        end = min(start + TILE, size)
        for j in range(counts.shape[0]):
            out.reached[row, tile, j] += total(counts[j, start:end])


@inner_kernel()
def compare_row(  # type: ignore[no-untyped-def]
    measured, mean, inverse, top, bottom, camera, noise, starts, edges, reach, dither, pixels, row, out
):
    """Compare lines top .. bottom - 1, at most 127, of a row of tiles; other arguments as in ``compare_lines``."""
    seen, expected, sure = measured.values, mean.values, inverse.values
    strips = (pixels + STRIP - 1) // STRIP
    z = np.zeros((strips, LINES * STRIP), np.int16)
    codes = np.empty((strips, LINES * STRIP), np.int8)
    sums = np.empty(STRIP, np.int16)
    counts = np.zeros((strips, edges.size, STRIP), np.uint8)
    for first in range(top, bottom, LINES):
        for line in range(first, first + LINES):
            for strip in range(strips):
                begin, end = strip * STRIP, min((strip + 1) * STRIP, pixels)
                to = slice((line - first) * STRIP, (line - first) * STRIP + end - begin)
                if line >= bottom:
                    z[strip, to] = 0
                    codes[strip, to] = LOWEST_CODE
                    continue
                code_piece(
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
            fold_lines(z[strip], sums[:size])
            count_lines(codes[strip], edges, counts[strip, :, :size])
            if first + LINES <= bottom:
                add_blocks(sums[:size], out.block_sum[first // LINES, begin // 8 : (begin + size) // 8])
    for strip in range(strips):
        begin, size = strip * STRIP, min(STRIP, pixels - strip * STRIP)
        close_strip(begin, counts[strip, :, :size], row, out)


@kernel(
    "measured.values (_), mean.values (_), inverse.values (_), camera, noise (_), starts (L), "
    "edges (E), reach (E), dither, pixels, out.reached (R, C, E), "
    "out.block_sum (L // LINES, pixels // LINES)",
    where="R == max(L // TILE, 1), C == max(pixels // TILE, 1)",
)
def compare_lines(  # type: ignore[no-untyped-def]
    measured, mean, inverse, camera, noise, starts, edges, reach, dither, pixels, out
):
    """Compare some rows of tiles of one sensor; ``Lines`` of uint16 each, read line by line in memory order.

    camera: ``Camera``; noise uint16 and starts (lines,): where in it each line's random numbers begin;
    dither: False for the naive histogram; pixels: of a line; out: ``Counts``, whose arrays are filled.
    """
    lines, rows = starts.size, out.reached.shape[0]
    for row in range(rows):
        bottom = lines if row == rows - 1 else (row + 1) * TILE
        compare_row(
            measured,
            mean,
            inverse,
            row * TILE,
            bottom,
            camera,
            noise,
            starts,
            edges,
            reach,
            dither,
            pixels,
            row,
            out,
        )
