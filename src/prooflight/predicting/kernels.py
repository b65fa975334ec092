"""Compiled loops of prediction: look up, filter and area-sample a page line by line, in constant memory."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.predicting.tables import NODE_STEP, NODES

STRIDE_C, STRIDE_M, STRIDE_Y = NODES**3, NODES**2, NODES
CELL_BITS = 3
FRACTION = NODE_STEP - 1
PHASES = 64
"""At least so many of a raster pixel at which weights are tabulated: between them they err by 5 / (128^2 8) of an edge,
0.004 %, at two raster pixels a camera pixel (the lens's line spread rises by at most 5 a pixel and pixel)."""


@njit(cache=True, nogil=True)
def look_up_row(cmyk, nodes, mean, variance):  # type: ignore[no-untyped-def]
    """Quadrilinear look-up of one raster row: cmyk (columns, 4) uint8, nodes (33^4, 2) -> mean, variance (columns,).

    A run of equal pixels is looked up once: half of every page is paper.
    """
    m = np.float32(0.0)
    v = np.float32(0.0)
    for x in range(cmyk.shape[0]):
        c, g, y, k = cmyk[x, 0], cmyk[x, 1], cmyk[x, 2], cmyk[x, 3]
        if x == 0 or c != cmyk[x - 1, 0] or g != cmyk[x - 1, 1] or y != cmyk[x - 1, 2] or k != cmyk[x - 1, 3]:
            base = (
                (c >> CELL_BITS) * STRIDE_C
                + (g >> CELL_BITS) * STRIDE_M
                + (y >> CELL_BITS) * STRIDE_Y
                + (k >> CELL_BITS)
            )
            fc = np.float32(c & FRACTION) / np.float32(NODE_STEP)
            fm = np.float32(g & FRACTION) / np.float32(NODE_STEP)
            fy = np.float32(y & FRACTION) / np.float32(NODE_STEP)
            fk = np.float32(k & FRACTION) / np.float32(NODE_STEP)
            m = np.float32(0.0)
            v = np.float32(0.0)
            for corner in range(16):
                weight = fc if corner & 8 else np.float32(1) - fc
                weight *= fm if corner & 4 else np.float32(1) - fm
                weight *= fy if corner & 2 else np.float32(1) - fy
                weight *= fk if corner & 1 else np.float32(1) - fk
                if weight > 0:
                    node = (
                        base
                        + (corner >> 3) * STRIDE_C
                        + ((corner >> 2) & 1) * STRIDE_M
                        + ((corner >> 1) & 1) * STRIDE_Y
                        + (corner & 1)
                    )
                    m += weight * nodes[node, 0]
                    v += weight * nodes[node, 1]
        mean[x] = m
        variance[x] = v


@njit(cache=True, nogil=True)
def split_row(row, backing, pad, split):  # type: ignore[no-untyped-def]
    """A row above the backing's level, its pixels dealt out by ``stride``: split (stride, places), zeros around it.

    Pixel p lies at split[(p + pad) % stride, (p + pad) // stride], so pixels a stride apart lie side by side.
    """
    stride = split.shape[0]
    for phase in range(stride):
        first = (phase - pad) % stride
        place = (first + pad) // stride
        count = max((row.size - first + stride - 1) // stride, 0)
        target = split[phase, place : place + count]
        source = row[first::stride]
        for i in range(count):
            target[i] = source[i] - backing


@njit(cache=True, nogil=True)
def place_row(nodes, pitch, row, places):  # type: ignore[no-untyped-def]
    """What one row sees at node columns, linear between rows of nodes (nodes down, nodes across)."""
    cell = min(row // pitch, nodes.shape[0] - 2)
    share = (row - cell * pitch) / pitch
    for k in range(places.size):
        places[k] = nodes[cell, k] + share * (nodes[cell + 1, k] - nodes[cell, k])


@njit(cache=True, nogil=True)
def weigh(edge, step, cumulative, drift, weights, slopes):  # type: ignore[no-untyped-def]
    """Weights (taps,) of raster pixels in one footprint, and what they change by as it moves on by ``drift``.

    edge: of the first raster pixel in the footprint's cumulative spread, in its steps; step: a raster pixel's.
    """
    last = cumulative.size - 1
    before = 0.0
    spread_before = 0.0
    for t in range(weights.size):
        u = edge + (t + 1) * step
        if u >= last:
            upto = 1.0
            spread = 0.0
        else:
            i = max(int(u), 0)
            spread = cumulative[i + 1] - cumulative[i]
            upto = cumulative[i] + (max(u, 0.0) - i) * spread
        weights[t] = upto - before
        slopes[t] = (spread_before - spread) * step * drift
        before = upto
        spread_before = spread


@njit(cache=True, nogil=True)
def aim(places, pixels, segment, stride, cumulative, step, first, weights, slopes):  # type: ignore[no-untyped-def]
    """Weights of raster pixels at the middle of every segment of camera pixels, and how they change along it.

    places: where camera pixels 0, segment, 2 segment, ... look [raster pixels]. cumulative: of the footprint; step:
    its steps in a raster pixel. Written: first (segments,), the first raster pixel that the middle one,
    (start + stop) // 2, sees; weights, slopes (segments, taps): a pixel further on it is weights + slopes, of raster
    pixels ``stride`` further on.
    """
    reach = (cumulative.size - 1) / (2 * step)
    for k in range(first.size):
        start = k * segment
        middle = (start + min(start + segment, pixels)) // 2
        advance = (places[k + 1] - places[k]) / segment
        at = places[k] + advance * (middle - start) - reach
        first[k] = int(np.floor(at))
        weigh((first[k] - at) * step, step, cumulative, advance - stride, weights[k], slopes[k])


@njit(cache=True, nogil=True)
def phases(cumulative, step, taps):  # type: ignore[no-untyped-def]
    """``weigh`` at even phases of a raster pixel, 0 to 1: two (phases + 1, taps), for ``aim_between``.

    As many phases as the spread has steps in a raster pixel, which may be many camera pixels wide.
    """
    count = max(PHASES, int(np.ceil(step)))
    weights = np.empty((count + 1, taps), np.float32)
    slopes = np.empty((count + 1, taps), np.float32)
    for phase in range(count + 1):
        weigh(-phase / count * step, step, cumulative, 1.0, weights[phase], slopes[phase])
    return weights, slopes


@njit(cache=True, nogil=True)
def aim_between(  # type: ignore[no-untyped-def]
    places, pixels, segment, stride, reach, phase_weights, phase_slopes, first, weights, slopes
):
    """``aim`` by linear interpolation between ``phases``, for the many segments of a page off its place.

    reach: of the footprint [raster pixels].
    """
    count = phase_weights.shape[0] - 1
    for k in range(first.size):
        start = k * segment
        middle = (start + min(start + segment, pixels)) // 2
        advance = (places[k + 1] - places[k]) / segment
        at = places[k] + advance * (middle - start) - reach
        whole = np.floor(at)
        first[k] = int(whole)
        place = (at - whole) * count
        phase = min(int(place), count - 1)
        share = np.float32(place - phase)
        drift = np.float32(advance - stride)
        low, high = phase_weights[phase], phase_weights[phase + 1]
        slope = phase_slopes[phase]
        row, slope_row = weights[k], slopes[k]
        for t in range(row.size):
            row[t] = low[t] + share * (high[t] - low[t])
            slope_row[t] = slope[t] * drift


@njit(cache=True, nogil=True)
def add_weighted(source, weight, slope, origin, target):  # type: ignore[no-untyped-def]
    """Target += (weight + slope x (i - origin)) x source, one array at a time so that it runs in vectors."""
    if slope == 0:
        for i in range(target.size):
            target[i] += weight * source[i]
    else:
        weight -= slope * np.float32(origin)
        for i in range(target.size):
            target[i] += (weight + slope * np.float32(i)) * source[i]


@njit(cache=True, nogil=True)
def add_four(one, two, three, four, weights, slopes, origin, target):  # type: ignore[no-untyped-def]
    """``add_weighted`` of four sources at once: the target is read and written a quarter as often."""
    a, b, c, d = weights[0], weights[1], weights[2], weights[3]
    e, f, g, h = slopes[0], slopes[1], slopes[2], slopes[3]
    if e == 0 and f == 0 and g == 0 and h == 0:
        for i in range(target.size):
            target[i] += (a * one[i] + b * two[i]) + (c * three[i] + d * four[i])
    else:
        first = np.float32(origin)
        for i in range(target.size):
            j = np.float32(i) - first
            target[i] += ((a + e * j) * one[i] + (b + f * j) * two[i]) + (
                (c + g * j) * three[i] + (d + h * j) * four[i]
            )


@njit(cache=True, nogil=True)
def filter_across(split, pad, columns, segment, first, weights, slopes, out):  # type: ignore[no-untyped-def]
    """One raster row at camera columns: split as ``split_row`` leaves it, weights as ``aim`` does; out (pixels,).

    What is off the page counts as 0, the level of the backing.
    """
    stride = split.shape[0]
    taps = weights.shape[1]
    out[:] = 0
    for k in range(first.size):
        start = k * segment
        stop = min(start + segment, out.size)
        middle = (start + stop) // 2
        # Pixel i sees raster pixels from first + stride (i - middle); only those that touch the row are done.
        start = max(start, middle - (first[k] + taps - 1) // stride)
        stop = min(stop, middle + (columns - 1 - first[k]) // stride + 1)
        if start >= stop:
            continue
        target = out[start:stop]
        origin = middle - start
        place = first[k] + pad
        t = 0
        while t + 4 <= taps:
            add_four(
                part_of(split, place + t, stride, origin, target.size),
                part_of(split, place + t + 1, stride, origin, target.size),
                part_of(split, place + t + 2, stride, origin, target.size),
                part_of(split, place + t + 3, stride, origin, target.size),
                weights[k, t : t + 4],
                slopes[k, t : t + 4],
                origin,
                target,
            )
            t += 4
        for rest in range(t, taps):
            source = part_of(split, place + rest, stride, origin, target.size)
            add_weighted(source, weights[k, rest], slopes[k, rest], origin, target)


@njit(cache=True, nogil=True)
def part_of(split, place, stride, origin, count):  # type: ignore[no-untyped-def]
    """Every stride-th pixel of a split row, count of them, the one at index ``origin`` being pixel ``place`` - pad."""
    begin = place // stride - origin
    return split[place % stride, begin : begin + count]


@njit(cache=True, nogil=True)
def filter_along(ring, rows, segment, first, weights, slopes, out):  # type: ignore[no-untyped-def]
    """One line from the ring of filtered rows (depth, pixels), row r at r % depth; out (pixels,).

    Rows off the page, below 0 or from ``rows`` on, count as 0, the level of the backing.
    """
    depth = ring.shape[0]
    out[:] = 0
    for k in range(first.size):
        start = k * segment
        stop = min(start + segment, out.size)
        target = out[start:stop]
        origin = (stop - start) // 2
        t = max(-first[k], 0)
        last = min(weights.shape[1], rows - first[k])
        while t + 4 <= last:
            row = first[k] + t
            add_four(
                ring[row % depth, start:stop],
                ring[(row + 1) % depth, start:stop],
                ring[(row + 2) % depth, start:stop],
                ring[(row + 3) % depth, start:stop],
                weights[k, t : t + 4],
                slopes[k, t : t + 4],
                origin,
                target,
            )
            t += 4
        for rest in range(t, last):
            source = ring[(first[k] + rest) % depth, start:stop]
            add_weighted(source, weights[k, rest], slopes[k, rest], origin, target)


@njit(cache=True, nogil=True)
def look_up_words(words, nodes, out):  # type: ignore[no-untyped-def]
    """Quadrilinear look-up of one raster row in one table: words (columns,) uint32, cyan lowest; nodes (33^4,)."""
    value = np.float32(0)
    for x in range(words.size):
        if x == 0 or words[x] != words[x - 1]:
            value = look_up_word(words[x], nodes)
        out[x] = value


@njit(cache=True, nogil=True)
def look_up_word(word, nodes):  # type: ignore[no-untyped-def]
    """One recipe's value: the innermost ink, black, lies side by side in the table."""
    c = word & np.uint32(255)
    m = (word >> np.uint32(8)) & np.uint32(255)
    y = (word >> np.uint32(16)) & np.uint32(255)
    k = word >> np.uint32(24)
    base = (
        (c >> CELL_BITS) * STRIDE_C
        + (m >> CELL_BITS) * STRIDE_M
        + (y >> CELL_BITS) * STRIDE_Y
        + (k >> CELL_BITS)
    )
    share = np.float32(1 / NODE_STEP)
    fc = np.float32(c & FRACTION) * share
    fm = np.float32(m & FRACTION) * share
    fy = np.float32(y & FRACTION) * share
    fk = np.float32(k & FRACTION) * share
    values = nodes[base : base + STRIDE_C + STRIDE_M + STRIDE_Y + 2]
    upper = nodes[base + STRIDE_C : base + STRIDE_C + STRIDE_M + STRIDE_Y + 2]
    low = in_three(values, fm, fy, fk)
    return low + fc * (in_three(upper, fm, fy, fk) - low)


@njit(cache=True, nogil=True)
def in_three(nodes, fm, fy, fk):  # type: ignore[no-untyped-def]
    """Trilinear between the eight nodes from the first on; without branches, which photographs would mispredict."""
    a = nodes[0] + fk * (nodes[1] - nodes[0])
    b = nodes[STRIDE_Y] + fk * (nodes[STRIDE_Y + 1] - nodes[STRIDE_Y])
    c = nodes[STRIDE_M] + fk * (nodes[STRIDE_M + 1] - nodes[STRIDE_M])
    d = nodes[STRIDE_M + STRIDE_Y] + fk * (nodes[STRIDE_M + STRIDE_Y + 1] - nodes[STRIDE_M + STRIDE_Y])
    low = a + fy * (b - a)
    return low + fm * (c + fy * (d - c) - low)


@njit(cache=True, nogil=True)
def filter_lines(  # type: ignore[no-untyped-def]
    words,
    nodes,
    backing,
    stride,
    across_places,
    across_pitch,
    across_segment,
    across_cumulative,
    along_places,
    along_pitch,
    along_segment,
    along_cumulative,
    step,
    depth,
    line_from,
    line_to,
    light,
):
    """What lines line_from .. line_to - 1 see of a page in one table, above the backing's level.

    words (rows, columns) uint32; nodes (33^4,); light (lines, pixels) float32 is written at those lines only, so bands
    may run in several threads. Rows pass once through a ring of ``depth`` filtered rows: as many as there are taps
    along, and as a line crosses. Other arguments as in ``Course`` and ``Footprint``. ``correct_light`` comes next.
    """
    rows, columns = words.shape
    pixels = light.shape[1]
    taps = int(np.ceil((across_cumulative.size - 1) / step)) + 1
    pad = taps + stride
    row = np.empty(columns, np.float32)
    split = np.zeros((stride, (columns + 2 * pad) // stride + 1), np.float32)
    ring = np.empty((depth, pixels), np.float32)
    x_places = np.empty(across_places.shape[1])
    x_first = np.empty(x_places.size - 1, np.int64)
    x_weights = np.empty((x_first.size, taps), np.float32)
    x_slopes = np.empty((x_first.size, taps), np.float32)
    y_places = np.empty(along_places.shape[1])
    y_first = np.empty(y_places.size - 1, np.int64)
    y_weights = np.empty((y_first.size, taps), np.float32)
    y_slopes = np.empty((y_first.size, taps), np.float32)
    moving = np.any(across_places[1:] != across_places[0])
    reach = (across_cumulative.size - 1) / (2 * step)
    across_phases = phases(across_cumulative, step, taps)
    along_phases = phases(along_cumulative, step, taps)
    aimed = False
    next_row = -1
    for line in range(line_from, line_to):
        place_row(along_places, along_pitch, line, y_places)
        if y_first.size == 1:
            aim(y_places, pixels, along_segment, 0, along_cumulative, step, y_first, y_weights, y_slopes)
        else:
            table, slopes = along_phases
            aim_between(
                y_places, pixels, along_segment, 0, reach, table, slopes, y_first, y_weights, y_slopes
            )
        if next_row < 0:
            next_row = max(y_first.min(), 0)
        while next_row < min(y_first.max() + taps, rows):
            if moving:
                place_row(across_places, across_pitch, next_row, x_places)
                table, slopes = across_phases
                aim_between(
                    x_places,
                    pixels,
                    across_segment,
                    stride,
                    reach,
                    table,
                    slopes,
                    x_first,
                    x_weights,
                    x_slopes,
                )
            elif not aimed:
                aimed = True
                x_places[:] = across_places[0]
                aim(
                    x_places,
                    pixels,
                    across_segment,
                    stride,
                    across_cumulative,
                    step,
                    x_first,
                    x_weights,
                    x_slopes,
                )
            look_up_words(words[next_row], nodes, row)
            split_row(row, backing, pad, split)
            slot = ring[next_row % depth]
            filter_across(split, pad, columns, across_segment, x_first, x_weights, x_slopes, slot)
            next_row += 1
        filter_along(ring, rows, along_segment, y_first, y_weights, y_slopes, light[line])


@njit(cache=True, nogil=True)
def to_columns(  # type: ignore[no-untyped-def]
    backing,
    backing_variance,
    shot_slope,
    column_offset,
    column_gain,
    dark_variance,
    top_code,
    line_from,
    line_to,
    mean,
    variance,
):
    """Light above the backing's -> expected DN and variance in the columns, in place, lines line_from .. line_to - 1.

    mean, variance (lines, pixels). shot_slope: variance is so many times the light; or 0: it is in ``variance``, above
    the backing's.
    """
    above_dark = backing_variance - dark_variance
    for line in range(line_from, line_to):
        mean_row, variance_row = mean[line], variance[line]
        if shot_slope > 0:
            for i in range(mean_row.size):
                variance_row[i] = shot_slope * mean_row[i]
        for i in range(mean_row.size):
            variance_row[i] = dark_variance + max(
                column_gain[i] * (variance_row[i] + above_dark), np.float32(0)
            )
            level = column_offset[i] + column_gain[i] * (mean_row[i] + backing)
            mean_row[i] = min(max(level, np.float32(0)), top_code)
