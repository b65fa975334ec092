"""Compiled loops of registration: tiles of a page rendered where they are thought to lie, and by how much they err."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.predicting.kernels import CELL_BITS, FRACTION, STRIDE_C, STRIDE_M, STRIDE_Y
from prooflight.predicting.tables import NODE_STEP

HUBER = 3.0
"""Pixels further off than so many standard deviations weigh less: specks, dust, defects."""
SUMS = 15
EVEN_EDGE = 0.01
"""Squared difference from which edges count alike: a tenth of white from pixel to pixel."""


@njit(cache=True, nogil=True)
def between(table, at, step, share):  # type: ignore[no-untyped-def]
    """A table between two nodes ``step`` apart."""
    low = table[at]
    return low + share * (table[at + step] - low)


@njit(cache=True, nogil=True)
def mean_row(cmyk, table, signal):  # type: ignore[no-untyped-def]
    """Mean alone of a raster row, as ``look_up_row``: cmyk (columns, 4) uint8, table (33^4,) -> signal (columns,)."""
    m = np.float32(0)
    per = np.float32(1 / NODE_STEP)
    for x in range(cmyk.shape[0]):
        c, g, y, k = cmyk[x, 0], cmyk[x, 1], cmyk[x, 2], cmyk[x, 3]
        if x == 0 or c != cmyk[x - 1, 0] or g != cmyk[x - 1, 1] or y != cmyk[x - 1, 2] or k != cmyk[x - 1, 3]:
            base = (
                (c >> CELL_BITS) * STRIDE_C
                + (g >> CELL_BITS) * STRIDE_M
                + (y >> CELL_BITS) * STRIDE_Y
                + (k >> CELL_BITS)
            )
            fc, fm = np.float32(c & FRACTION) * per, np.float32(g & FRACTION) * per
            fy, fk = np.float32(y & FRACTION) * per, np.float32(k & FRACTION) * per
            sides = (np.float32(0), np.float32(0))
            for side in range(2):
                at = base + side * STRIDE_C
                a = between(table, at, 1, fk)
                a += fy * (between(table, at + STRIDE_Y, 1, fk) - a)
                at += STRIDE_M
                b = between(table, at, 1, fk)
                b += fy * (between(table, at + STRIDE_Y, 1, fk) - b)
                sides = (sides[1], a + fm * (b - a))
            m = sides[0] + fc * (sides[1] - sides[0])
        signal[x] = m


@njit(cache=True, nogil=True)
def tile_signals(cmyk, rows, columns, table, backing, signals):  # type: ignore[no-untyped-def]
    """Mean signal of raster windows (tiles, height, width) float32 whose corners lie at rows, columns of the raster.

    table (33^4,): mean at the nodes. What is off the page is ``backing``.
    """
    height, width = signals.shape[1:]
    for tile in range(rows.size):
        left = max(columns[tile], 0)
        right = min(columns[tile] + width, cmyk.shape[1])
        for r in range(height):
            row = rows[tile] + r
            signals[tile, r] = backing
            if 0 <= row < cmyk.shape[0] and left < right:
                inside = signals[tile, r, left - columns[tile] : right - columns[tile]]
                mean_row(cmyk[row, left:right], table, inside)


@njit(cache=True, nogil=True, fastmath=True)
def tile_information(  # type: ignore[no-untyped-def]
    expected, variance, offset, per_gain, gradient_noise, signal_noise2, size, margin, information
):
    """Adds to information (tile rows, tile columns, 2) what tiles tell of displacements across and along [1/pixel^2].

    expected, variance (lines, pixels) [DN, DN^2]; offset, per_gain (pixels,) bring it to light signal. The sum of
    squared slopes over twice the variance, a share of the slopes squared and of the signal squared; those nearer to a
    tile's border than ``margin`` do not count.
    """
    rows, columns = information.shape[:2]
    pixels = expected.shape[1]
    light = np.empty((3, pixels), np.float32)
    half = np.float32(0.5)
    two = np.float32(2)
    across = np.zeros(columns * size, np.float32)
    along = np.zeros(columns * size, np.float32)
    last = expected.shape[0] - 1
    for line in range(-1, rows * size):
        coming = min(line + 1, last)
        row = light[(line + 1) % 3]
        for i in range(pixels):
            row[i] = (expected[coming, i] - offset[i]) * per_gain[i]
        if line < 0:
            light[2] = row
            continue
        before, here, after = light[(line - 1) % 3], light[line % 3], light[(line + 1) % 3]
        counts = margin <= line % size < size - margin
        for i in range(1, min(columns * size, pixels - 1) if counts else 1):
            gx = half * (here[i + 1] - here[i - 1])
            gy = half * (after[i] - before[i])
            gx, gy = gx * gx, gy * gy
            weight = two * variance[line, i] + gradient_noise * (gx + gy) + signal_noise2 * here[i] * here[i]
            across[i] += gx / weight
            along[i] += gy / weight
        if line % size == size - 1:
            for column in range(columns):
                for i in range(column * size + margin, (column + 1) * size - margin):
                    information[line // size, column, 0] += across[i]
                    information[line // size, column, 1] += along[i]
            across[:] = 0
            along[:] = 0


@njit(cache=True, nogil=True)
def edge_shares(cmyk, rows, columns, size, stride_x, stride_y, logs, backing, shares):  # type: ignore[no-untyped-def]
    """How much of each tile's edges, across and along, each plane makes: adds to shares (tiles, 2, 6).

    rows, columns: raster pixel of each tile's corner, size: its camera pixels, stride_x, stride_y raster pixels apart.
    logs (4, 256): logarithm of the light that an ink of that byte leaves; inks multiply (close enough for a share).
    Light is in shares of white. Of the six sums four are an ink's part of squared differences, the fifth the part of
    the page's own edge, the last all of it; strong edges count less, as they do where tiles are measured.
    """
    last_row, last_column = cmyk.shape[0] - 1, cmyk.shape[1] - 1
    parts = np.empty(5)
    for tile in range(rows.size):
        for line in range(size):
            for i in range(size):
                row, column = rows[tile] + line * stride_y, columns[tile] + i * stride_x
                for axis in range(2):
                    other_row, other = row + axis * stride_y, column + (1 - axis) * stride_x
                    inside = 0 <= row <= last_row and 0 <= column <= last_column
                    beyond = not (0 <= other_row <= last_row and 0 <= other <= last_column)
                    if inside == beyond:  # one of the two lies off the page
                        r, c = (row, column) if inside else (other_row, other)
                        light = logs[0, cmyk[r, c, 0]] + logs[1, cmyk[r, c, 1]]
                        light = np.exp(light + logs[2, cmyk[r, c, 2]] + logs[3, cmyk[r, c, 3]])
                        parts[:4] = 0
                        parts[4] = light - backing
                    elif inside:
                        level, total = 0.0, 0.0
                        for ink in range(4):
                            here, there = (
                                logs[ink, cmyk[row, column, ink]],
                                logs[ink, cmyk[other_row, other, ink]],
                            )
                            parts[ink] = there - here
                            level += (there + here) / 2
                            total += abs(there - here)
                        if total == 0:
                            continue
                        light = np.exp(level)
                        for ink in range(4):
                            parts[ink] *= light
                        parts[4] = 0
                    else:
                        continue
                    edge = parts.sum()
                    weight = 1 / (EVEN_EDGE + edge * edge)
                    for part in range(5):
                        shares[tile, axis, part] += weight * edge * parts[part]
                    shares[tile, axis, 5] += weight * edge * edge


@njit(cache=True, nogil=True, fastmath=True)
def render_tile(  # type: ignore[no-untyped-def]
    window, x, y, ratio_x, ratio_y, taps_x, slopes_x, taps_y, slopes_y, along, upright, out
):
    """One tile at the camera's pixels and its derivatives by the page's displacement: out (3, columns, lines).

    x, y: raster coordinates, in the window, of the first camera pixel's centre, less the footprint's reach. taps,
    slopes (phases, taps): weights of raster pixels by where in a raster pixel a footprint begins. along (2, width) and
    upright (2, width, lines): room. Columns lie outside lines, so that both passes run in vectors.
    """
    phases = taps_x.shape[0]
    columns, lines = out.shape[1:]
    width = window.shape[1]
    value, slope = along[0], along[1]
    for line in range(lines):
        at = y + line * ratio_y
        first = int(at)
        phase = int((at - first) * phases)
        value[:] = 0
        slope[:] = 0
        for t in range(taps_y.shape[1]):
            w = taps_y[phase, t]
            s = slopes_y[phase, t]
            row = window[first + t]
            for k in range(width):
                value[k] += w * row[k]
                slope[k] += s * row[k]
        for k in range(width):
            upright[0, k, line] = value[k]
            upright[1, k, line] = slope[k]
    for i in range(columns):
        at = x + i * ratio_x
        first = int(at)
        phase = int((at - first) * phases)
        m, by_x, by_y = out[0, i], out[1, i], out[2, i]
        m[:] = 0
        by_x[:] = 0
        by_y[:] = 0
        for t in range(taps_x.shape[1]):
            w = taps_x[phase, t]
            s = slopes_x[phase, t]
            v = upright[0, first + t]
            d = upright[1, first + t]
            for line in range(lines):
                m[line] += w * v[line]
                by_x[line] += s * v[line]
                by_y[line] += w * d[line]


@njit(cache=True, nogil=True, fastmath=True)
def subtract(error, image, noise, base):  # type: ignore[no-untyped-def]
    """Light of a column (lines,) -> what it is above the image's, in place; base = 1 / variance; the image's sum."""
    value, by_x, by_y = image[0], image[1], image[2]
    total = np.float32(0)
    for i in range(error.size):
        m = value[i]
        error[i] -= m
        flat = max(noise[0] + noise[1] * m + noise[2] * m * m, noise[0])
        base[i] = np.float32(1) / (flat + noise[3] * (by_x[i] * by_x[i] + by_y[i] * by_y[i]))
        total += m
    return total


@njit(cache=True, nogil=True, fastmath=True)
def weigh(error, image, base, level, gain, move_x, move_y, robust, mean, sums):  # type: ignore[no-untyped-def]
    """Normal equations of offset, gain and displacement of one tile; images (columns, lines) cut to what is seen.

    error: scan minus image; image (3, ...): value, derivatives; base: 1 / variance. With ``robust`` the weight of those
    that the estimate (level, gain, move_x, move_y) leaves far off is lowered.
    """
    # Scalars, not an array: the loop then runs in vectors.
    none = np.float32(0)
    s0, s1, s2, s3, s4, s5, s6, s7 = none, none, none, none, none, none, none, none
    s8, s9, s10, s11, s12, s13, s14 = none, none, none, none, none, none, none
    limit = np.float32(HUBER) if robust else np.float32(1e9)
    tiny = np.float32(1e-6)
    one = np.float32(1)
    for column in range(error.shape[0]):
        errors, weights = error[column], base[column]
        value, by_x, by_y = image[0, column], image[1, column], image[2, column]
        for i in range(errors.size):
            r = value[i] - mean
            gx = by_x[i]
            gy = by_y[i]
            e = errors[i]
            w = weights[i]
            left = e - level - gain * r - move_x * gx - move_y * gy
            w *= min(one, limit / np.sqrt(left * left * w + tiny))
            wr = w * r
            wx = w * gx
            wy = w * gy
            we = w * e
            s0 += w
            s1 += wr
            s2 += wx
            s3 += wy
            s4 += wr * r
            s5 += wr * gx
            s6 += wr * gy
            s7 += wx * gx
            s8 += wx * gy
            s9 += wy * gy
            s10 += we
            s11 += we * r
            s12 += we * gx
            s13 += we * gy
            s14 += we * e
    for k, s in enumerate((s0, s1, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13, s14)):
        sums[k] = s


@njit(cache=True, nogil=True)
def measure_tiles(  # type: ignore[no-untyped-def]
    scan,
    offset,
    per_gain,
    windows,
    x_origin,
    y_origin,
    ratio_x,
    ratio_y,
    taps_x,
    slopes_x,
    taps_y,
    slopes_y,
    lines,
    columns,
    tiles,
    moves,
    size,
    noise,
    sums,
):
    """Sums of ``weigh`` for chosen tiles of one sensor, the page displaced by ``moves`` (tiles, 2) pixels x, y.

    scan (lines, pixels) uint16; offset, per_gain (pixels,) bring it to light signal. windows (all tiles, ...) as
    ``tile_signals`` leaves them; x_origin, y_origin, lines, columns (all tiles,): where a tile's first pixel lies in
    its window and in the scan of a page in its place. tiles (n,): which to measure. noise: variance without light, by
    signal, by signal squared, by gradient squared. sums (n, SUMS + 1): the last is the number of pixels, 0 where the
    tile lies outside the scan.
    """
    width = windows.shape[2]
    image = np.empty((3, size, size), np.float32)
    along = np.empty((2, width), np.float32)
    upright = np.empty((2, width, size), np.float32)
    error = np.empty((size, size), np.float32)
    base = np.empty((size, size), np.float32)
    for n in range(tiles.size):
        tile = tiles[n]
        whole_x, whole_y = int(np.rint(moves[n, 0])), int(np.rint(moves[n, 1]))
        left, top = columns[tile] + whole_x, lines[tile] + whole_y
        i0, i1 = max(-left, 0), min(size, scan.shape[1] - left)
        l0, l1 = max(-top, 0), min(size, scan.shape[0] - top)
        sums[n] = 0
        if i1 - i0 < size // 2 or l1 - l0 < size // 2:
            continue
        x = x_origin[tile] - (moves[n, 0] - whole_x) * ratio_x
        y = y_origin[tile] - (moves[n, 1] - whole_y) * ratio_y
        render_tile(
            windows[tile],
            x,
            y,
            ratio_x,
            ratio_y,
            taps_x,
            slopes_x,
            taps_y,
            slopes_y,
            along,
            upright,
            image,
        )
        total = np.float32(0)
        for line in range(l0, l1):
            for i in range(i0, i1):
                light = (np.float32(scan[top + line, left + i]) - offset[left + i]) * per_gain[left + i]
                error[i, line] = light
        for i in range(i0, i1):
            total += subtract(error[i, l0:l1], image[:, i, l0:l1], noise, base[i, l0:l1])
        count = (l1 - l0) * (i1 - i0)
        mean = total / np.float32(count)
        e, im, w = error[i0:i1, l0:l1], image[:, i0:i1, l0:l1], base[i0:i1, l0:l1]
        zero = np.float32(0)
        weigh(e, im, w, zero, zero, zero, zero, False, mean, sums[n])
        level, gain, move_x, move_y = solved(sums[n])
        weigh(e, im, w, level, gain, move_x, move_y, True, mean, sums[n])
        sums[n, SUMS] = count


@njit(cache=True, nogil=True)
def solved(s):  # type: ignore[no-untyped-def]
    """Offset, gain and displacement x, y that the sums of one tile ask for."""
    a = np.empty((4, 4))
    b = np.empty(4)
    k = 0
    for i in range(4):
        for j in range(i, 4):
            a[i, j] = s[k]
            a[j, i] = s[k]
            k += 1
        b[i] = s[10 + i]
    for i in range(4):  # a hair of damping: a tile may have edges of one direction only
        a[i, i] = a[i, i] * (1 + 1e-4) + 1e-9
    x = np.linalg.solve(a, b)
    return np.float32(x[0]), np.float32(x[1]), np.float32(x[2]), np.float32(x[3])
