"""Residuals by place: binning, moved images, block sums of the fit, subtraction, variances, local displacements.

The arithmetic is that of ``kernels.residuals``; sums are in another order. Images of modes are one array (channels,
lines, pixels); ``gain_at`` .. ``cover_at`` are a sensor's first channels in it.
"""

from __future__ import annotations

import math

import numpy as np

from prooflight.kernels.gpu.body import body, inner
from prooflight.kernels.gpu.prediction import between

f32, i32 = np.float32, np.int32
ZERO, ONE, HALF = f32(0), f32(1), f32(0.5)
FLOOR = f32(1e-12)
LEAST_AREA = f32(0.02)
"""As in ``take_ink``."""
STRETCH = 16
"""As in ``kernels.residuals.moving``."""
BELLS_AT, SLOPES_AT = 14, 30
"""As ``SHAPE_AT`` and ``SLOPE_AT`` of ``kernels.residuals.fit``."""


@body
def binned(y, x, scan, bins, out):  # type: ignore[no-untyped-def]
    """Compute the mean over bins x bins pixels; the last line is repeated, and lines past ``-(-L // bins)`` are 0."""
    total = ZERO
    if y * bins < scan.shape[0]:
        for j in range(bins):
            for i in range(bins):
                total += f32(scan[min(y * bins + j, scan.shape[0] - 1), x * bins + i])
    out[y, x] = total * f32(ONE / f32(bins * bins))


@inner
def off_at(nodes, line, x, pixels):  # type: ignore[no-untyped-def]
    """Return whole pixels and the remainder by which a pixel looks aside; whole ones by stretches, as ``aimed``."""
    cell = min(line // STRETCH, nodes.shape[0] - 2)
    share = f32(f32(line - cell * STRETCH) / f32(STRETCH))
    k = x // STRETCH
    a = f32(nodes[cell, k] + share * (nodes[cell + 1, k] - nodes[cell, k]))
    b = f32(nodes[cell, k + 1] + share * (nodes[cell + 1, k + 1] - nodes[cell, k + 1]))
    slope = f32((b - a) / f32(STRETCH))
    count = min(STRETCH, pixels - k * STRETCH)
    whole = i32(math.floor(f32(a + slope * f32(count) * HALF)))
    return whole, f32(f32(a - f32(whole)) + slope * f32(x - k * STRETCH))


@body
def moved(line, x, images, right, down, out):  # type: ignore[no-untyped-def]
    """Sample all images at a displaced place, bilinear, 0 beyond: out (channels, lines, pixels)."""
    lines, pixels = images.shape[1], images.shape[2]
    wx, u = off_at(right, line, x, pixels)
    wy, v = off_at(down, line, x, pixels)
    left, top = x + wx, line + wy
    within = left >= 0 and left + 1 < pixels and top >= 0 and top + 1 < lines
    for n in range(images.shape[0]):
        if within:
            p = images[n, top, left] + u * (images[n, top, left + 1] - images[n, top, left])
            q = images[n, top + 1, left] + u * (images[n, top + 1, left + 1] - images[n, top + 1, left])
            out[n, line, x] = p + v * (q - p)
        else:
            total = ZERO
            for j in range(2):
                for i in range(2):
                    if 0 <= left + i < pixels and 0 <= top + j < lines:
                        total += (u if i else ONE - u) * (v if j else ONE - v) * images[n, top + j, left + i]
            out[n, line, x] = total


@body
def with_hidden(line, x, modes, hidden_at, share, texture_at):  # type: ignore[no-untyped-def]
    """Add the variance of edges that do not show in the light to that of halftones, in place."""
    modes[texture_at, line, x] += share * modes[hidden_at, line, x]


@body
def lights(line, x, expected, offset, out):  # type: ignore[no-untyped-def]
    """Compute expected light less a column's dark signal."""
    out[line, x] = expected[line, x] - offset[x]


@inner
def nearest_level(area):  # type: ignore[no-untyped-def]
    """Return the nearest tabulated level of an ink area."""
    return i32(min(max(area, ZERO), ONE) * f32(255) + HALF)


@body
def block_bells(b, j, light, modes, cover_at, inside, bells, corners, side, out):  # type: ignore[no-untyped-def]
    """Sum one bell times light over one block."""
    lines, pixels = light.shape
    total = ZERO
    for line in range(max(corners[b, 0], 1), min(corners[b, 0] + side, lines - 1)):
        for x in range(max(corners[b, 1], 1), min(corners[b, 1] + side, pixels - 1)):
            if inside[line, x]:
                c = nearest_level(modes[cover_at, line, x])
                m = nearest_level(modes[cover_at + 1, line, x])
                y = nearest_level(modes[cover_at + 2, line, x])
                k = nearest_level(modes[cover_at + 3, line, x])
                total += bells[0, c, j] * bells[1, m, j] * bells[2, y, j] * bells[3, k, j] * light[line, x]
    out[b, BELLS_AT + j] = total


@body
def block_lights(  # type: ignore[no-untyped-def]
    b, x8, measured, expected, light, variance, modes, texture_at, inside, corners, side, out
):
    """Compute six sums down one column of one block: out (blocks, side, 22)."""
    lines, pixels = measured.shape
    s0, s1, s2, s3, s4, s5 = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    x = corners[b, 1] + x8
    if 1 <= x < pixels - 1:
        for line in range(max(corners[b, 0], 1), min(corners[b, 0] + side, lines - 1)):
            if inside[line, x]:
                dx = (expected[line, x + 1] - expected[line, x - 1]) * HALF
                dy = (expected[line + 1, x] - expected[line - 1, x]) * HALF
                s0 += ONE
                s1 += measured[line, x] - expected[line, x]
                s2 += light[line, x]
                s3 += variance[line, x]
                s4 += dx * dx + dy * dy
                s5 += modes[texture_at, line, x]
    out[b, x8, 0], out[b, x8, 1], out[b, x8, 2] = s0, s1, s2
    out[b, x8, 3], out[b, x8, 4], out[b, x8, 5] = s3, s4, s5


@body
def block_inks(b, place, modes, gain_at, dot_at, cover_at, inside, corners, side, out):  # type: ignore[no-untyped-def]
    """Compute the same of one ink: place = ink x side + column of the block."""
    lines, pixels = inside.shape
    ink, x8 = place // side, place % side
    s0, s1, s2, s3 = ZERO, ZERO, ZERO, ZERO
    x = corners[b, 1] + x8
    at = cover_at + ink
    if 1 <= x < pixels - 1:
        for line in range(max(corners[b, 0], 1), min(corners[b, 0] + side, lines - 1)):
            if inside[line, x]:
                gain, area = modes[gain_at + ink, line, x], modes[at, line, x]
                s0 += gain
                s1 += modes[dot_at + ink, line, x]
                if area > LEAST_AREA:
                    per = gain / area * HALF
                    s2 += per * (modes[at, line, x + 1] - modes[at, line, x - 1])
                    s3 += per * (modes[at, line + 1, x] - modes[at, line - 1, x])
    out[b, x8, 6 + ink], out[b, x8, 10 + ink] = s0, s1
    out[b, x8, 14 + ink], out[b, x8, 18 + ink] = s2, s3


@body
def block_totals(b, j, rows, out):  # type: ignore[no-untyped-def]
    """Sum a block's columns, in one order whatever the number of threads."""
    total = ZERO
    for i in range(rows.shape[1]):
        total += rows[b, i, j]
    out[b, j if j < BELLS_AT else j + SLOPES_AT - BELLS_AT] = total


@inner
def level_place(area):  # type: ignore[no-untyped-def]
    """Return an ink area in tabulated levels."""
    return min(max(area, ZERO), ONE) * f32(255)


@inner
def level_below(place):  # type: ignore[no-untyped-def]
    """Return the tabulated level below a place among levels, of which one more lies above."""
    return min(i32(place), 254)


@inner
def colour_shift(c, m, y, k, bells, weights):  # type: ignore[no-untyped-def]
    """Return the smooth function of colour, as ``shape_row``, of each pixel by itself."""
    ac, am, ay, ak = level_place(c), level_place(m), level_place(y), level_place(k)
    ic, im, iy, ik = level_below(ac), level_below(am), level_below(ay), level_below(ak)
    uc, um, uy, uk = f32(ac - f32(ic)), f32(am - f32(im)), f32(ay - f32(iy)), f32(ak - f32(ik))
    total = ZERO
    for j in range(16):
        of_c = bells[0, ic, j] + uc * (bells[0, ic + 1, j] - bells[0, ic, j])
        of_m = bells[1, im, j] + um * (bells[1, im + 1, j] - bells[1, im, j])
        of_y = bells[2, iy, j] + uy * (bells[2, iy + 1, j] - bells[2, iy, j])
        of_k = bells[3, ik, j] + uk * (bells[3, ik + 1, j] - bells[3, ik, j])
        total += weights[j] * (of_c * of_m) * (of_y * of_k)
    return total


@body
def residual(  # type: ignore[no-untyped-def]
    line, x, measured, expected, light, inside, modes, gain_at, dot_at, cover_at, bells, weights, columns,
    gains, dots, planes, out,
):  # fmt: skip
    """Compute a residual after the fitted nuisances, as ``residuals``; 0 outside."""
    lines, pixels = measured.shape
    if line == 0 or x == 0 or line == lines - 1 or x == pixels - 1 or not inside[line, x]:
        out[line, x] = ZERO
        return
    relative = colour_shift(
        modes[cover_at, line, x],
        modes[cover_at + 1, line, x],
        modes[cover_at + 2, line, x],
        modes[cover_at + 3, line, x],
        bells,
        weights,
    )
    left = f32(measured[line, x]) - expected[line, x] - light[line, x] * (relative + columns[x])
    v = f32(f32(2) * (f32(line) + HALF) / f32(lines) - ONE)
    u = f32(f32(2 * x + 1) / f32(pixels) - ONE)
    for ink in range(4):
        gain, at = modes[gain_at + ink, line, x], cover_at + ink
        area = modes[at, line, x]
        left -= gain * (gains[ink, 0] + gains[ink, 2] * v + gains[ink, 1] * u)
        left -= modes[dot_at + ink, line, x] * dots[ink]
        if area > LEAST_AREA:
            way = (modes[at, line, x + 1] - modes[at, line, x - 1]) * planes[ink, 0]
            way += (modes[at, line + 1, x] - modes[at, line - 1, x]) * planes[ink, 1]
            left += gain * HALF * way / area
    out[line, x] = left


@body
def flat_square(y, x, left, variance, light, modes, texture_at, inside, most, out):  # type: ignore[no-untyped-def]
    """Compute the second difference of a square of 2 x 2, as ``flat_squares``; -1 where it is not flat.

    out (2, rows, columns): the squared difference over four times the stated variance, and texture over that variance.
    """
    lines, pixels = left.shape
    line, i = 2 * y, 2 * x
    there = True
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            j, k = min(max(line + dy, 0), lines - 1), min(max(i + dx, 0), pixels - 1)
            there = there and inside[j, k]
    stated = variance[line, i]
    step = light[line + 1, i + 1] - light[line, i]
    if there and step * step < most * stated:
        crossed = left[line, i] - left[line, i + 1] - left[line + 1, i] + left[line + 1, i + 1]
        out[0, y, x] = crossed * crossed / (f32(4) * stated)
        out[1, y, x] = modes[texture_at, line, i] / stated
    else:
        out[0, y, x] = f32(-1)
        out[1, y, x] = ZERO


@body
def weighted(  # type: ignore[no-untyped-def]
    line, x, light, variance, modes, texture_at, inside, noise, sensor, edge, contrast, share, dark, white,
    weight, of_edges,
):  # fmt: skip
    """Compute a residual's inverse variance and the edges' share of the variance, as ``variances``; 0 outside."""
    lines, pixels = light.shape
    weight[line, x] = ZERO
    of_edges[line, x] = ZERO
    if line < 2 or x < 2 or line >= lines - 2 or x >= pixels - 2 or not inside[line, x]:
        return
    here, slope = light[line, x], ZERO
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            j, i = line + dy, x + dx
            a = (light[j, i + 1] - light[j, i - 1]) * HALF
            b = (light[j + 1, i] - light[j - 1, i]) * HALF
            slope += a * a + b * b
    slope *= f32(1 / 9)
    depth = f32(math.log(f32(white / min(max(here, f32(0.01) * white), white))))
    level = f32((share + dark * depth * depth) * here)
    rest = noise[sensor] * variance[line, x] + edge * slope + contrast * modes[texture_at, line, x]
    weight[line, x] = ONE / (rest + level * level)
    at_white = share * here
    of_edges[line, x] = edge * slope / (rest + at_white * at_white)


@body
def left_out(line, x, faulty, left, weight):  # type: ignore[no-untyped-def]
    """Clear what a faulty column saw, in place."""
    if faulty[x]:
        left[line, x] = weight[line, x] = ZERO


@body
def resolved(line, x, modes, unresolved_at, most, weight):  # type: ignore[no-untyped-def]
    """Clear the weight of places where the design is finer than pixels resolve, in place."""
    if modes[unresolved_at, line, x] > most:
        weight[line, x] = ZERO


@body
def slope_columns(tile, x, left, weight, light, side, out):  # type: ignore[no-untyped-def]
    """Sum down one column of a row of tiles, as ``slope_sums``: out (5, tile rows, pixels)."""
    lines, pixels = left.shape
    rows = out.shape[1]
    s0, s1, s2, s3, s4 = ZERO, ZERO, ZERO, ZERO, ZERO
    stop = lines - 2 if tile == rows - 1 else (tile + 1) * side
    for line in range(max(tile * side, 2), min(stop, lines - 2)):
        r, w = left[line, x], weight[line, x]
        push = r * w * min(ONE, f32(16) / f32(math.sqrt(f32(r * r * w + FLOOR))))
        a = (light[line, x + 1] - light[line, x - 1]) * HALF if 0 < x < pixels - 1 else ZERO
        b = (light[line + 1, x] - light[line - 1, x]) * HALF
        s0 += a * push
        s1 += b * push
        s2 += a * a * w
        s3 += b * b * w
        s4 += a * b * w
    out[0, tile, x], out[1, tile, x], out[2, tile, x] = s0, s1, s2
    out[3, tile, x], out[4, tile, x] = s3, s4


@body
def slope_tiles(row, tile, columns, side, more, out):  # type: ignore[no-untyped-def]
    """Sum columns (5, tile rows, pixels) over tiles, to what out (5, tile rows, tile columns) has where ``more``."""
    part, y = row // out.shape[1], row % out.shape[1]
    total = out[part, y, tile] if more else ZERO
    end = columns.shape[2] if tile == out.shape[2] - 1 else (tile + 1) * side
    for x in range(tile * side, end):
        total += columns[part, y, x]
    out[part, y, tile] = total


@body
def taken_moves(line, x, left, weight, light, moves):  # type: ignore[no-untyped-def]
    """Subtract local displacements (2, rows, columns), bilinear between squares, in place, as ``take_slopes``."""
    lines, pixels = left.shape
    if line < 2 or x < 2 or line >= lines - 2 or x >= pixels - 2 or not weight[line, x] > ZERO:
        return
    a = (light[line, x + 1] - light[line, x - 1]) * HALF
    b = (light[line + 1, x] - light[line - 1, x]) * HALF
    down, right = f32(f32(moves.shape[1]) / f32(lines)), f32(f32(moves.shape[2]) / f32(pixels))
    left[line, x] += a * between(moves[0], line, x, down, right) + b * between(moves[1], line, x, down, right)


@body
def predicted_again(line, x, left, weight, before, after):  # type: ignore[no-untyped-def]
    """Change a residual from the expectation ``before`` to ``after``, in place."""
    if weight[line, x] > ZERO:
        left[line, x] -= after[line, x] - before[line, x]
