"""Compiled loops for streaks: columns without the light around them, and lines at every slope.

Sums along lines are by the fast discrete Radon transform.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.extremes import greatest_of, smallest_of
from prooflight.kernels.statistics.boxes import add_to

ABOUT = 16
"""Side of the window about a tile from which the local scatter is estimated: 8 mm, of which a line takes 6 %.
[tiles]"""


@inner_kernel()
def running(row, reach_before, reach_after, prefix, out):  # type: ignore[no-untyped-def]
    """Compute sums of a row (w,) from ``reach_before`` before to ``reach_after`` after each place.

    The first and the last value are repeated beyond the row. out (w,) float64 is written; prefix (w + 1,) float64 is
    working space.
    """
    size = row.size
    prefix[0] = 0.0
    for x in range(size):
        prefix[x + 1] = prefix[x] + row[x]
    for x in range(size):
        first, last = x - reach_before, x + reach_after + 1
        total = prefix[min(last, size)] - prefix[max(first, 0)]
        total += max(-first, 0) * row[0] + max(last - size, 0) * row[size - 1]
        out[x] = total


@kernel(
    "columns (4, M, S, W), length, step, prior_power, wide, out (4, M, Q, W)",
    where="0 < length, 0 < step, (Q - 1) * step + length <= S",
)
def levelled_parts(columns, length, step, prior_power, wide, out):  # type: ignore[no-untyped-def]
    """Compute N', D', the edges' part of D' and the effect of uneven light on N', out (4, modes, parts, w).

    Each part is ``length`` segments of columns (4, modes, segments, w), one part every ``step`` of them. The
    effect of light as a whole, known: 1 / its prior variance, and the mean amount over ``wide`` columns about
    each are subtracted from N'. Light greater by a share s in one segment alone leaves s (C_s - D0_s C / D0):
    the squares of that, without s, are summed.
    """
    modes, parts, width = out.shape[1], out.shape[2], out.shape[3]
    sums, common = np.empty((4, width), np.float32), np.empty((2, width), np.float32)
    share = np.empty(width, np.float32)
    prefix, push, power = np.empty(width + 1), np.empty(width), np.empty(width)
    for part in range(parts):
        begin, end = part * step, part * step + length
        for mode in range(modes):
            for i in range(4):
                sums[i] = columns[i, mode, begin]
                for k in range(begin + 1, end):
                    sums[i] += columns[i, mode, k]
            own, rest = out[0, mode, part], out[1, mode, part]
            edges, uneven = out[2, mode, part], out[3, mode, part]
            own[:], rest[:], edges[:], uneven[:] = sums[0], sums[1], sums[3], np.float32(0)
            if mode == 0:
                common[0], common[1] = sums[0], sums[1]
            else:
                for x in range(width):
                    share[x] = sums[2, x] / (common[1, x] + prior_power)
                    own[x] -= share[x] * common[0, x]
                    rest[x] = max(sums[1, x] - share[x] * sums[2, x], np.float32(0))
                for k in range(begin, end):
                    light, shared = columns[1, 0, k], columns[2, mode, k]
                    for x in range(width):
                        difference = shared[x] - share[x] * light[x]
                        uneven[x] += difference * difference
            for x in range(width):
                edges[x] *= min(rest[x] / max(sums[1, x], np.float32(1e-9)), np.float32(1))
            running(own, wide // 2, wide - wide // 2 - 1, prefix, push)
            running(rest, wide // 2, wide - wide // 2 - 1, prefix, power)
            for x in range(width):
                own[x] -= push[x] / (power[x] + 1e-6 * wide) * rest[x]


@kernel("maps (N, W), count, out (N, W)")
def widened(maps, count, out):  # type: ignore[no-untyped-def]
    """Compute sums over ``count`` columns about each of maps (n, w), out (n, w); 0 beyond the ends."""
    width = maps.shape[1]
    for n in range(maps.shape[0]):
        row, sums = maps[n], out[n]
        sums[:] = np.float32(0)
        for shift in range(-min(count // 2, width), min(count - count // 2, width)):
            if shift < 0:
                add_to(row[: width + shift], sums[-shift:])
            else:
                add_to(row[shift:], sums[: width - shift])


@inner_kernel(fastmath=True, error_model="numpy")
def doubled(sums, out):  # type: ignore[no-untyped-def]
    """Combine sums along lines of height h, (strips, h, w), to those of twice the height, out (strips // 2, 2 h, w).

    ``[k, a, x]``: of the line that begins at the top of strip k, at x, and is a further right at its foot.
    Beyond the right side is 0.
    """
    width = sums.shape[2]
    for k in range(out.shape[0]):
        for a in range(out.shape[1]):
            above, row = sums[2 * k, a // 2], out[k, a]
            below = sums[2 * k + 1, a // 2, min((a + 1) // 2, width) :]
            for x in range(below.size):
                row[x] = above[x] + below[x]
            beyond, rest = above[below.size :], row[below.size :]
            for x in range(rest.size):
                rest[x] = beyond[x]


@inner_kernel(fastmath=True, error_model="numpy")
def signed_squares(push, power, least, out):  # type: ignore[no-untyped-def]
    """Compute n |n| / d of lines, (strips, h, w) each."""
    for k in range(out.shape[0]):
        for a in range(out.shape[1]):
            n, d, row = push[k, a], power[k, a], out[k, a]
            for x in range(row.size):
                row[x] = n[x] * abs(n[x]) / max(d[x], least)


@inner_kernel(fastmath=True, error_model="numpy")
def limited_squares(above, below, whole, lean, most_of_half, out):  # type: ignore[no-untyped-def]
    """Write n |n| / d of lines into out (w,), limited by that of their halves; return the greatest and the least.

    The lines lean right by ``lean``; the extremes are at least and at most 0. No line counts for more than
    ``most_of_half`` times as much as either of its halves, and for nothing where these do not agree, or where
    it leaves the page.
    """
    zero = np.float32(0)
    within, step = max(out.size - lean, 0), (lean + 1) // 2
    # Slices of one length, so that the compiler knows that no index is negative, and loops run in vectors.
    above, below, whole, line = above[:within], below[step : step + within], whole[:within], out[:within]
    for x in range(line.size):
        one, other = above[x], below[x]
        most, least = max(min(one, other), zero), min(max(one, other), zero)
        line[x] = max(min(whole[x], most_of_half * most), most_of_half * least)
    out[within:] = zero
    return greatest_of(line), smallest_of(line)


@inner_kernel()
def place_of(row, value):  # type: ignore[no-untyped-def]
    """Return the first place of a value in a row that contains it."""
    x = 0
    while x < row.size - 1 and row[x] != value:
        x += 1
    return x


@inner_kernel()
def extremes_by_slope(halves, wholes, first, most_of_half, above, values, places):  # type: ignore[no-untyped-def]
    """Find the greatest and least n / sqrt(d) of lines of every slope from ``first`` on.

    halves (strips, h, w) and wholes (strips // 2, 2 h, w): ``signed_squares`` of the lines' halves and of the lines.
    above: strips of whole lines above these. Updated: values (2 h, 2), the least with its sign turned; places (2 h, 2,
    2): strip and x of each.
    """
    line = np.empty(wholes.shape[2], np.float32)
    for a in range(first, wholes.shape[1]):
        for k in range(wholes.shape[0]):
            greatest, smallest = limited_squares(
                halves[2 * k, a // 2], halves[2 * k + 1, a // 2], wholes[k, a], a, most_of_half, line
            )
            for end in range(2):
                square = -smallest if end else greatest
                if square > values[a, end] ** 2:
                    values[a, end] = np.sqrt(square)
                    places[a, end, 0] = above + k
                    places[a, end, 1] = place_of(line, smallest if end else greatest)


@inner_kernel()
def copy_strip(tiles, top, mirrored, out):  # type: ignore[no-untyped-def]
    """Copy rows of tiles from ``top`` on into out (rows, 1, w), mirrored where asked; 0 below the last one."""
    for y in range(out.shape[0]):
        row = out[y, 0]
        if top + y >= tiles.shape[0]:
            row[:] = np.float32(0)
        elif mirrored:
            row[:] = tiles[top + y, ::-1]
        else:
            row[:] = tiles[top + y]


@kernel(
    "push (H, W), power (H, W), mirrored, smallest, first (L), least, most_of_half, values (L, S, 2), "
    "places (L, S, 2, 2)",
    where="0 < smallest, smallest * 2 ** (L - 1) == S",
)
def slanted(push, power, mirrored, smallest, first, least, most_of_half, values, places):  # type: ignore[no-untyped-def]
    """Find the greatest and least n / sqrt(d) along lines that lean right, of every slope and of L heights.

    n and d are sums along a line. mirrored: the lines lean left, and columns count from the right. Heights are
    smallest, twice that, ..., S rows; slopes a = 0..height of a height are whole columns to the right over it, of
    which those below first of that height are left out. least: of d, so that little information has little effect;
    most_of_half: as in ``limited_squares``. Written: values (L, S, 2), places (L, S, 2, 2) strip and column at its
    top; 0 without information.
    """
    values[:] = 0
    places[:] = 0
    width, tallest = push.shape[1], values.shape[1]
    for top in range(0, push.shape[0], tallest):  # these rows stay in the cache through all levels
        n, d = np.empty((tallest, 1, width), np.float32), np.empty((tallest, 1, width), np.float32)
        copy_strip(push, top, mirrored, n)
        copy_strip(power, top, mirrored, d)
        squares = np.empty((tallest, 1, width), np.float32)
        if smallest == 2:
            signed_squares(n, d, np.float32(least), squares)
        level = 0
        while level < values.shape[0]:
            tall = 2 * n.shape[1]
            shape = (tallest // tall, tall, width)
            longer_n, longer_d = np.empty(shape, np.float32), np.empty(shape, np.float32)
            doubled(n, longer_n)
            doubled(d, longer_d)
            longer_squares = np.empty(shape, np.float32)
            if 2 * tall >= smallest:
                signed_squares(longer_n, longer_d, np.float32(least), longer_squares)
            if tall >= smallest:
                extremes_by_slope(
                    squares,
                    longer_squares,
                    first[level],
                    np.float32(most_of_half),
                    top // tall,
                    values[level],
                    places[level],
                )
                level += 1
            n, d, squares = longer_n, longer_d, longer_squares


@kernel(
    "own (H, W), power (H, W), edges (H, W), scatter (3), least, t (H, W), information (H, W)",
    fastmath=True,
    error_model="numpy",
)
def tile_scores(own, power, edges, scatter, least, t, information):  # type: ignore[no-untyped-def]
    """Compute T of tiles, and their information on an amount N' / D', (h, w) each, from N', D' and edges.

    scatter (3,): coefficients of the scatter of N': noise, edges, tolerance; tiles of no more D' than
    ``least`` have none.
    """
    noise, at_edges, tolerance = scatter[0], scatter[1], scatter[2]
    zero = np.float32(0)
    for y in range(own.shape[0]):
        push, sure, steep, out, of = own[y], power[y], edges[y], t[y], information[y]
        for x in range(out.size):
            d, e = max(sure[x], zero), max(steep[x], zero)
            spread = noise * max(d - e, zero) + at_edges * e + tolerance * d * d + np.float32(1e-6)
            out[x] = push[x] / np.sqrt(spread) if d > least else zero
            of[x] = d * d / spread if d > least else zero


@inner_kernel(fastmath=True, error_model="numpy")
def limited_row(t, scale, most, out):  # type: ignore[no-untyped-def]
    """Compute |t| of a row of tiles, limited to ``most`` times their scale."""
    for x in range(out.size):
        out[x] = min(abs(t[x]), most * scale[x])


@inner_kernel(fastmath=True, error_model="numpy")
def slide_down(new, old, columns):  # type: ignore[no-untyped-def]
    """Move the sums of columns (w,) on by a row; the new row replaces the old one."""
    for x in range(columns.size):
        columns[x] += new[x] - old[x]
    for x in range(old.size):
        old[x] = new[x]


@inner_kernel(fastmath=True, error_model="numpy")
def pairs_of(row, step, out):  # type: ignore[no-untyped-def]
    """Add each number of a row to the one ``step`` further on; out: shorter by that."""
    right = row[step:]
    for x in range(out.size):
        out[x] = row[x] + right[x]


@inner_kernel(fastmath=True, error_model="numpy")
def scale_row(sums, count, prior, mean, out):  # type: ignore[no-untyped-def]
    """Compute the scale of a row of tiles from sums over their windows, at least 1."""
    for x in range(out.size):
        out[x] = max((sums[x] / mean + prior) / (count[x] + prior), np.float32(1))


@kernel(
    "t (H, W), informative (H, W), clipped, mean, prior, rounds, scale (H, W)",
    fastmath=True,
    error_model="numpy",
)
def scales_about(t, informative, clipped, mean, prior, rounds, scale):  # type: ignore[no-untyped-def]
    """Compute the scale of |t| of tiles in the window about each, (h, w), at least 1.

    The mean of |t|, each limited to ``clipped`` times the scale there, over the mean of limited normal numbers, with
    ``prior`` more tiles of scale 1; repeated so many times. informative: bytes; other tiles do not count.
    """
    height, width = t.shape
    counts = np.empty((height, width), np.float32)
    row = np.empty(width, np.float32)
    wide = width + ABOUT
    first, second = np.empty(wide, np.float32), np.empty(wide, np.float32)
    scale[:] = np.float32(1)
    for turn in range(rounds + 1):
        ring, columns = np.zeros((ABOUT, width), np.float32), np.zeros(wide, np.float64)
        inner = columns[ABOUT // 2 : ABOUT // 2 + width]
        for y in range(height + ABOUT // 2 - 1):
            if y >= height:
                row[:] = np.float32(0)
            elif turn == 0:  # the number of tiles that count
                row[:] = informative[y]
            else:
                limited_row(t[y], scale[y], clipped, row)
            slide_down(row, ring[y % ABOUT], inner)
            middle = y - ABOUT // 2 + 1
            if middle < 0:
                continue
            pairs_of(columns, 1, first[: wide - 1])
            pairs_of(first, 2, second[: wide - 3])
            pairs_of(second, 4, first[: wide - 7])
            pairs_of(first, 8, second[:width])
            if turn == 0:
                counts[middle] = second[:width]
            else:
                scale_row(second, counts[middle], prior, mean, scale[middle])


@kernel("t (H, W), scale (H, W), information (H, W), most, out (H, W)", fastmath=True, error_model="numpy")
def limited_pushes(t, scale, information, most, out):  # type: ignore[no-untyped-def]
    """Compute N' of tiles, (h, w), from T over its scale, limited to ``most`` of either sign."""
    for y in range(out.shape[0]):
        own, about, sure, row = t[y], scale[y], information[y], out[y]
        for x in range(row.size):
            row[x] = min(max(own[x] / about[x], -most), most) * np.sqrt(sure[x])
