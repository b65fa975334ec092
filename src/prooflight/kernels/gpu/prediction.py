"""Prediction by place: look-up, the passes across and along, lens correction, columns' levels.

The arithmetic is that of ``kernels.prediction``; sums are in another order.
"""

from __future__ import annotations

import math

import numpy as np

from prooflight.kernels.gpu.body import body, inner

f32, i32, i64, u32 = np.float32, np.int32, np.int64, np.uint32
ZERO, ONE, HALF = f32(0), f32(1), f32(0.5)


@inner
def plane_at(packed, y, x, mask):  # type: ignore[no-untyped-def]
    """Return one ink of a raster pixel, 0 beyond the raster."""
    if 0 <= y < packed.shape[0] and 0 <= x < packed.shape[1]:
        return u32(packed[y, x] & mask)
    return u32(0)


@inner
def composed(packed, row, column, planes):  # type: ignore[no-untyped-def]
    """Return the recipe of a raster pixel with its planes displaced, as ``kernels.planes.compose_row``.

    planes (5, 2): as in ``PrintedPage``; the last row is not 0 where any plane is displaced.
    """
    if planes[4, 0] == 0:
        return packed[row, column]
    cyan = plane_at(packed, row - planes[0, 1], column - planes[0, 0], u32(0xFF))
    magenta = plane_at(packed, row - planes[1, 1], column - planes[1, 0], u32(0xFF00))
    yellow = plane_at(packed, row - planes[2, 1], column - planes[2, 0], u32(0xFF0000))
    black = plane_at(packed, row - planes[3, 1], column - planes[3, 0], u32(0xFF000000))
    return u32(cyan | magenta | yellow | black)


@inner
def light_of(packed_inks, codes, b0, b1, b2, b3, unit, level):  # type: ignore[no-untyped-def]
    """Return the light of a recipe from the sixteen corners of its cell, exact in whole numbers up to the root.

    codes (65536, 4) int64: ``QuantisedTable.codes``, four corners a word.
    """
    c, m = i32(packed_inks & u32(255)), i32((packed_inks >> u32(8)) & u32(255))
    y, k = i32((packed_inks >> u32(16)) & u32(255)), i32(packed_inks >> u32(24))
    r0, r1, r2, r3 = i32(8 - b0), i32(8 - b1), i32(8 - b2), i32(8 - b3)
    cell = i32(i32(i32(i32(i32(i32(k >> r3) << b2) | i32(y >> r2)) << b1) | i32(m >> r1)) << b0) | i32(
        c >> r0
    )
    cf, mf = i32(c & i32(i32(1 << r0) - 1)), i32(m & i32(i32(1 << r1) - 1))
    yf, kf = i32(y & i32(i32(1 << r2) - 1)), i32(k & i32(i32(1 << r3) - 1))
    c1, m1 = i32(i32(1 << r0) - cf), i32(i32(1 << r1) - mf)
    y1, k1 = i32(i32(1 << r2) - yf), i32(i32(1 << r3) - kf)
    w0, w1, w2, w3 = i32(m1 * c1), i32(m1 * cf), i32(mf * c1), i32(mf * cf)
    total = i32(0)
    for q in range(4):
        v = codes[cell, q]
        lower, upper = i32(v & i64(0xFFFFFFFF)), i32(v >> i64(32))
        a, b = i32(lower & i32(0xFFFF)), i32((lower >> i32(16)) & i32(0xFFFF))
        d, e = i32(upper & i32(0xFFFF)), i32((upper >> i32(16)) & i32(0xFFFF))
        part = i32(i32(i32(a * w0) + i32(b * w1)) + i32(i32(d * w2) + i32(e * w3)))
        outer = i32((kf if q >= 2 else k1) * (yf if q % 2 else y1))
        total = i32(total + i32(part * outer))
    root = f32(total)
    return f32(f32(root * root) * unit - level)


@body
def lookup(r, x, packed, planes, codes, b0, b1, b2, b3, unit, level, light):  # type: ignore[no-untyped-def]
    """Look a raster pixel up: light (rows, columns) above the backing's."""
    light[r, x] = light_of(composed(packed, r, x, planes), codes, b0, b1, b2, b3, unit, level)


@body
def aim(r, k, places, pitch, segment, reach, bits, base, at, advance):  # type: ignore[no-untyped-def]
    """Compute where footprints begin in row r of segment k: whole raster pixels, phase, and phases a pixel."""
    cell = min(r // pitch, places.shape[0] - 2)
    share = (r - cell * pitch) / pitch
    here = places[cell, k] + share * (places[cell + 1, k] - places[cell, k])
    then = places[cell, k + 1] + share * (places[cell + 1, k + 1] - places[cell, k + 1])
    begin = here - reach
    whole = math.floor(begin)
    count = 1 << bits
    base[r, k] = i32(min(max(whole, -1e6), 1e6))
    at[r, k] = f32((begin - whole) * count + 0.5)
    advance[r, k] = f32((then - here) * (f32(count) / segment))


@inner
def begin_at(r, i, base, at, advance, segment, bits):  # type: ignore[no-untyped-def]
    """Return the first raster pixel of a camera pixel's footprint, and its phase."""
    k = i // segment
    j = i - k * segment
    place = i32(math.floor(f32(at[r, k] + advance[r, k] * f32(j))))
    return base[r, k] + (place >> bits), place & ((1 << bits) - 1)


@body
def along(line, x, light, base, at, advance, segment, bits, table, out):  # type: ignore[no-untyped-def]
    """Sum up the rows that a line sees at a raster column: out (lines, columns)."""
    first, phase = begin_at(line, x, base, at, advance, segment, bits)
    total = ZERO
    for t in range(table.shape[1]):
        y = first + t
        if 0 <= y < light.shape[0]:
            total += table[phase, t] * light[y, x]
    out[line, x] = total


@body
def across(line, i, summed, base, at, advance, segment, bits, table, out):  # type: ignore[no-untyped-def]
    """Filter a line's sums across at camera column i: out (lines, pixels)."""
    first, phase = begin_at(line, i, base, at, advance, segment, bits)
    total = ZERO
    for t in range(table.shape[1]):
        x = first + t
        if 0 <= x < summed.shape[1]:
            total += table[phase, t] * summed[line, x]
    out[line, i] = total


@body
def block_means(y, x, image, side, out):  # type: ignore[no-untyped-def]
    """Compute the mean over a square of ``side``; outside the image is 0."""
    total = ZERO
    for j in range(y * side, min((y + 1) * side, image.shape[0])):
        for i in range(x * side, min((x + 1) * side, image.shape[1])):
            total += image[j, i]
    out[y, x] = total / f32(side * side)


@body
def convolved(y, x, image, weights, out):  # type: ignore[no-untyped-def]
    """Convolve a small image with symmetric weights; outside the image is 0."""
    reach = weights.shape[0] // 2
    total = ZERO
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            j, i = y + dy, x + dx
            if 0 <= j < image.shape[0] and 0 <= i < image.shape[1]:
                total += weights[reach + dy, reach + dx] * image[j, i]
    out[y, x] = total


@inner
def between(blocks, line, pixel, along_by, across_by):  # type: ignore[no-untyped-def]
    """Return the value at a pixel between blocks' centres, bilinear, constant beyond; by: blocks a pixel."""
    v = min(max((f32(line) + HALF) * along_by - HALF, ZERO), f32(blocks.shape[0] - 1))
    u = min(max((f32(pixel) + HALF) * across_by - HALF, ZERO), f32(blocks.shape[1] - 1))
    j, i = i32(v), i32(u)
    j1, i1 = min(j + 1, blocks.shape[0] - 1), min(i + 1, blocks.shape[1] - 1)
    q, p = f32(v - f32(j)), f32(u - f32(i))
    a = blocks[j, i] + q * (blocks[j1, i] - blocks[j, i])
    b = blocks[j, i1] + q * (blocks[j1, i1] - blocks[j, i1])
    return f32(a + p * (b - a))


@body
def far_total(y, x, far, farther, out):  # type: ignore[no-untyped-def]
    """Add what reaches a block from larger blocks."""
    out[y, x] = far[y, x] + between(farther, y, x, f32(0.25), f32(0.25))


@body
def to_levels(  # type: ignore[no-untyped-def]
    line, i, light, near, far, offset, gain, backing, of_backing, dark, shot, top, mean, variance
):
    """Correct for the lens and convert to a column's expected DN and variance."""
    total = ZERO
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            j, x = line + dy, i + dx
            if 0 <= j < light.shape[0] and 0 <= x < light.shape[1]:
                total += near[abs(dy), abs(dx)] * light[j, x]
    seen = f32(total + between(far, line, i, f32(0.25), f32(0.25)))
    variance[line, i] = dark + max(gain[i] * (shot * seen + (of_backing - dark)), ZERO)
    mean[line, i] = min(max(offset[i] + gain[i] * (seen + backing), ZERO), top)
