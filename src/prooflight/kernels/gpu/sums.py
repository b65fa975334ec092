"""Sums of evidence by place: columns' gains, sums down columns and over tiles, ink area of tiles.

The arithmetic is that of ``column_gains`` and of ``kernels.statistics.tiles``; sums are in another order.
"""

from __future__ import annotations

import math

import numpy as np

from prooflight.kernels.gpu.body import body, inner

f32 = np.float32
ZERO, ONE, HALF = f32(0), f32(1), f32(0.5)
FLOOR = f32(1e-12)
LIGHT, VOID = 0, 9
"""Numbers of the modes that need no ink's own image, as in ``kernels.statistics.tiles``."""


@body
def gain_parts(part, x, left, weight, light, each, out):  # type: ignore[no-untyped-def]
    """Sum what a column's residuals say of its gain over some lines: out (2, parts, pixels)."""
    push, power = ZERO, ZERO
    for line in range(max(part * each, 2), min((part + 1) * each, left.shape[0] - 2)):
        w = weight[line, x]
        if w > ZERO:
            r = left[line, x]
            z = r * r * w
            if z > f32(9):
                r *= f32(3) / f32(math.sqrt(z))
            push += light[line, x] * r * w
            power += light[line, x] * light[line, x] * w
    out[0, part, x], out[1, part, x] = push, power


@body
def column_gains(sensor, x, parts, prior_power, out):  # type: ignore[no-untyped-def]
    """Compute a column's gain from its parts (sensors, 2, parts, pixels): out (sensors, pixels)."""
    push, power = ZERO, prior_power
    for part in range(parts.shape[2]):
        push += parts[sensor, 0, part, x]
        power += parts[sensor, 1, part, x]
    out[sensor, x] = push / power


@body
def taken_gains(line, x, left, weight, light, gains):  # type: ignore[no-untyped-def]
    """Subtract a column's gain from its residuals, in place."""
    if weight[line, x] > ZERO:
        left[line, x] -= light[line, x] * gains[x]


@inner
def mode_at(mode, line, x, light, white):  # type: ignore[no-untyped-def]
    """Return the effect of a mode at a pixel: all light, or bare paper in place of what should be there."""
    return light[line, x] if mode == LIGHT else f32(white[x] - light[line, x])


@body
def line_sums(  # type: ignore[no-untyped-def]
    row, x, left, weight, light, of_edges, white, which, shift, most_edges, segment_lines, more, out
):
    """Sum a segment of a column, row = (edge class x modes + mode) x segments + segment; out as ``line_sums``."""
    modes, segments = out.shape[2], out.shape[3]
    segment, place, n = row % segments, row // segments % modes, row // segments // modes
    most, mode = most_edges[n], which[place]
    s0, s1, s2, s3 = ZERO, ZERO, ZERO, ZERO
    if more:
        s0, s1, s2, s3 = (
            out[n, 0, place, segment, x],
            out[n, 1, place, segment, x],
            out[n, 2, place, segment, x],
            out[n, 3, place, segment, x],
        )
    lines, pixels = left.shape
    end = lines if segment == segments - 1 else (segment + 1) * segment_lines
    for line in range(max(segment * segment_lines, 2), min(end, lines - 2)):
        at = x + shift[line]
        if 0 <= at < pixels:
            w = weight[line, at] if of_edges[line, at] <= most else ZERO
            r, p = left[line, at], mode_at(mode, line, at, light, white)
            push = r * w * min(ONE, f32(4) / f32(math.sqrt(f32(r * r * w + FLOOR))))
            s0 += p * push
            s1 += p * p * w
            s2 += p * light[line, at] * w
            s3 += p * p * of_edges[line, at] * w
    out[n, 0, place, segment, x], out[n, 1, place, segment, x] = s0, s1
    out[n, 2, place, segment, x], out[n, 3, place, segment, x] = s2, s3


@body
def tile_sums(ty, tx, left, weight, light, of_edges, white, which, side, more, out):  # type: ignore[no-untyped-def]
    """Sum all modes over a tile, and the energy: out (4, modes + 1, rows, columns) as ``tile_sums``."""
    begin, end = max(ty * side, 2), min((ty + 1) * side, left.shape[0] - 2)
    last = which.size
    for place in range(last):
        s0, s1, s2, s3 = ZERO, ZERO, ZERO, ZERO
        for line in range(begin, end):
            for x in range(tx * side, (tx + 1) * side):
                r, w, p = left[line, x], weight[line, x], mode_at(which[place], line, x, light, white)
                push = r * w * min(ONE, f32(10) / f32(math.sqrt(f32(r * r * w + FLOOR))))
                s0 += p * push
                s1 += p * p * w
                s2 += p * light[line, x] * w
                s3 += p * p * of_edges[line, x] * w
        if more:
            s0, s1 = s0 + out[0, place, ty, tx], s1 + out[1, place, ty, tx]
            s2, s3 = s2 + out[2, place, ty, tx], s3 + out[3, place, ty, tx]
        out[0, place, ty, tx], out[1, place, ty, tx] = s0, s1
        out[2, place, ty, tx], out[3, place, ty, tx] = s2, s3
    energy, count = ZERO, ZERO
    for line in range(begin, end):
        for x in range(tx * side, (tx + 1) * side):
            energy += min(left[line, x] * left[line, x] * weight[line, x], f32(25))
            count += ONE if weight[line, x] > ZERO else ZERO
    if more:
        energy, count = energy + out[0, last, ty, tx], count + out[1, last, ty, tx]
    out[0, last, ty, tx], out[1, last, ty, tx] = energy, count
    out[2, last, ty, tx], out[3, last, ty, tx] = ZERO, ZERO


@body
def tile_cover(row, tx, modes, cover_at, side, out):  # type: ignore[no-untyped-def]
    """Compute the mean area of an ink over a tile, row = ink x rows + tile row: out (4, rows, columns)."""
    ink, ty = row // out.shape[1], row % out.shape[1]
    total = ZERO
    for line in range(ty * side, (ty + 1) * side):
        for x in range(tx * side, (tx + 1) * side):
            total += modes[cover_at + ink, line, x]
    out[ink, ty, tx] = total * f32(ONE / f32(side * side))
