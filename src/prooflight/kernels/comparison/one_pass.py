"""Compiled loops of comparison: one pass over a scan and its prediction, in 16-bit integers.

Every loop runs over a short piece of one line and does little, so that it becomes vector instructions of 16-bit words
(a test checks this); pieces of eight lines stay in the fastest cache. The loops that undo a converter's rounding draw
the unrounded signal, given its digital number.

Words are computed thirty-two at once in a 512-bit register. Numba widens integers to 64 bits by itself, and the
compiler then keeps 32 of them; these stay words. A shift to the left by a count that the compiler knows is moved into
the product before it, which then needs 32 bits; so take the count from outside the loop where a product is shifted.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from prooflight.kernels.compiled import inner_kernel, kernel

ROUNDING_VARIANCE_DN2 = 1 / 12
"""Variance of a digital number's rounding; no pixel has less. [DN^2]"""
TILE = 64
"""Side of a tile. [pixel]"""
CODE_STEPS = 64
"""Steps of the histograms per sigma."""
LOWEST_CODE = np.int8(-128)
"""Least code: histograms are cut off at 2 sigma, and all their edges are above this."""
HALVES = 22
"""Correction of the bias of rounding down in ``dither_row``, the mean over pixels, measured. [sigma /
32768]"""


@inner_kernel()
def dither_row(z, inverse, inverse_drop, noise, codes):  # type: ignore[no-untyped-def]
    """Draw z before the converter's rounding, given the rounded value, in steps of sigma / 64, cut off at 2: int8.

    z as from ``normalise_row``; noise uint16: 2^16 times a number w + 1/2 uniform in [0, 1), one a pixel;
    inverse_drop: inverse_bits - 14. With r = 1 / sigma [1/DN], sigma with rounding's 1/12 DN^2 in it, the
    distribution of the signal within one digital number is that of

      z + r w + r^2 z (w^2/2 - 1/12) + r^3 (w^3/6 + z^2 (w^3/3 - w/12))
      + r^4 (z^3 (w^4/4 - w^2/12 + 1/192) + z (7 w^4/24 - w^2/24 - 1/192)),

    the series in r of Phi^-1 of a number uniform between Phi at that digital number's two ends. Numbers after
    the code lines are bits after the binary point.
    """
    one = np.int16(np.int16(right_unsigned(inverse_drop, 15)) + np.int16(1))  # counts unknown to the compiler
    two, three, five = np.int16(one + 1), np.int16(one + 2), np.int16(one + 4)
    for i in range(z.size):
        w = np.int16(noise[i] ^ np.uint16(0x8000))  # 16
        r = left(min(np.int16(right_unsigned(inverse[i], inverse_drop)), np.int16(16383)), 1)  # 15
        near = min(max(z[i], np.int16(-4095)), np.int16(4095))  # 10
        rw = high(w, r)  # 15
        rr = high(r, ~r)  # -r^2, 14
        ww = high(w, ~w)  # -w^2, 16
        wwww = high(ww, ~ww)  # -w^4, 16
        sixth = add(high(ww, 10923), 2731)  # 1/24 - w^2/6, 16
        zz = high(left(near, 3), ~left(near, 3))  # -z^2, 10
        rrz = high(left(near, 3), rr)  # -r^2 z, 11
        second = high(rrz, left(add(ww, 10923), one))  # 13
        tilt = sub(
            right(sixth, 2), add(left(high(zz, left(sixth, three)), two), 683)
        )  # -(..) of r^3 w (..), 14
        third = high(rr, left(high(rw, tilt), two))  # 13
        cubic = sub(right(add(wwww, 4096), 2), right(sixth, 1))  # -(..) of r^4 z^3 (..), 16
        linear = sub(sub(right(sixth, 2), high(wwww, 19115)), 1024)  # (..) of r^4 z (..), 16
        both = add(high(zz, left(cubic, five)), right(linear, 1))  # 15
        fourth = high(rr, left(high(rrz, left(both, three)), two))  # 13
        y = add(left(near, 2), right(add(rw, HALVES), 3))  # 12
        y = add(y, right(add(add(second, third), fourth), 1))
        codes[i] = np.int8(min(max(right(y, 6), np.int16(-128)), np.int16(127)))


@inner_kernel()
def dither_soft_row(z, inverse, inverse_drop, noise, codes):  # type: ignore[no-untyped-def]
    """Draw the same to order r^2, which is enough where sigma is 4 DN or more."""
    one = np.int16(np.int16(right_unsigned(inverse_drop, 15)) + np.int16(1))
    for i in range(z.size):
        w = np.int16(noise[i] ^ np.uint16(0x8000))
        r = left(min(np.int16(right_unsigned(inverse[i], inverse_drop)), np.int16(16383)), 1)
        near = min(max(z[i], np.int16(-4095)), np.int16(4095))
        second = high(high(left(near, 3), high(r, ~r)), left(add(high(w, ~w), 10923), one))
        y = add(add(left(near, 2), right(add(high(w, r), HALVES), 3)), right(add(second, 1), 1))
        codes[i] = np.int8(min(max(right(y, 6), np.int16(-128)), np.int16(127)))


@inner_kernel()
def plain_row(z, codes):  # type: ignore[no-untyped-def]
    """Encode z itself in steps of sigma / 64, cut off at 2, as if digital numbers were not integers: int8."""
    for i in range(z.size):
        codes[i] = np.int8(min(max(right(z[i], 4), np.int16(-128)), np.int16(127)))


@inner_kernel()
def settle_row(measured, mean, inverse, camera, noise, edges, reach, codes):  # type: ignore[no-untyped-def]
    """Compute the codes of pixels for which the series of ``dither_row`` is not valid, one by one.

    These are pixels at either end of the converter's range and those with an inverse above camera.unsure.
    reach: the probability below each edge.
    """
    for start in range(0, codes.size, TILE):
        end = min(start + TILE, codes.size)
        farthest, surest = np.uint16(0), np.uint16(0)
        for i in range(start, end):
            farthest = max(farthest, np.uint16(measured[i] - np.uint16(1)))
            surest = max(surest, inverse[i])
        if farthest < np.uint16(camera.top_code - np.uint16(1)) and surest <= camera.unsure:
            continue
        for i in range(start, end):
            bottom, top = measured[i] == 0, measured[i] >= camera.top_code
            if bottom or top or inverse[i] > camera.unsure:
                sigma = (1 << camera.inverse_bits) / (inverse[i] + 0.5)
                sharpness = 1 / math.sqrt(2 * max(sigma * sigma - ROUNDING_VARIANCE_DN2, 1e-6))
                error = measured[i] - mean[i] / (1 << camera.mean_bits)
                low = 0.0 if bottom else 0.5 * math.erfc((0.5 - error) * sharpness)
                up = 1.0 if top else 0.5 * math.erfc((-0.5 - error) * sharpness)
                u = low + (up - low) * ((noise[i] + 0.5) / 65536)
                interval = 0
                for j in range(reach.size):
                    interval += u >= reach[j]
                codes[i] = edges[interval - 1] if interval else LOWEST_CODE


_WORD, _LONG = ir.IntType(16), ir.IntType(32)


def _high(_: Any, builder: ir.IRBuilder, __: Any, operands: Any) -> Any:
    product = builder.mul(builder.sext(operands[0], _LONG), builder.sext(operands[1], _LONG))
    return builder.trunc(builder.ashr(product, ir.Constant(_LONG, 16)), _WORD)


@intrinsic
def high(context, a, b):  # type: ignore[no-untyped-def]
    """Return the upper half of the product of two signed words, rounded down: a b / 2^16."""
    return types.int16(types.int16, types.int16), _high


@intrinsic
def add(context, a, b):  # type: ignore[no-untyped-def]
    """Return a + b of signed words, modulo 2^16."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.add(*operands)


@intrinsic
def sub(context, a, b):  # type: ignore[no-untyped-def]
    """Return a - b of signed words, modulo 2^16."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.sub(*operands)


@intrinsic
def left(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a 2^bits of a signed word, modulo 2^16; bits from 0 to 15."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.shl(*operands)


@intrinsic
def right(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a / 2^bits of a signed word, rounded down; bits from 0 to 15."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.ashr(*operands)


@intrinsic
def left_unsigned(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a 2^bits of an unsigned word, modulo 2^16; bits from 0 to 15."""
    return types.uint16(types.uint16, types.uint16), lambda _, builder, __, operands: builder.shl(*operands)


@intrinsic
def right_unsigned(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a / 2^bits of an unsigned word, rounded down; bits from 0 to 15."""
    return types.uint16(types.uint16, types.uint16), lambda _, builder, __, operands: builder.lshr(*operands)


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
