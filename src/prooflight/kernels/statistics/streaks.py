"""Compiled loops for streaks: columns without the light around them, and lines at every slope.

Sums along lines are by the fast discrete Radon transform.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.extremes import greatest_of
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.statistics.boxes import add_to
from prooflight.kernels.vectors import GROUP, LONG, Group, Rows, filled, whole_groups

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
                copy_row(columns[i, mode, begin], sums[i])
                for k in range(begin + 1, end):
                    add_to(columns[i, mode, k], sums[i])
            own, rest = out[0, mode, part], out[1, mode, part]
            edges, uneven = out[2, mode, part], out[3, mode, part]
            copy_row(sums[0], own)
            copy_row(sums[1], rest)
            copy_row(sums[3], edges)
            uneven[:] = np.float32(0)
            if mode == 0:
                copy_row(sums[0], common[0])
                copy_row(sums[1], common[1])
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


@inner_kernel()
def row_of_line(strip, slope, level):  # type: ignore[no-untyped-def]
    """Return the row in which the lines of a strip of ``2 ** level`` rows are: the slope's bits are reversed."""
    row = strip
    for bit in range(level):
        row = 2 * row + ((slope >> bit) & 1)
    return row


@intrinsic
def join_lines(context, sums, upper, lower, lean, wide):  # type: ignore[no-untyped-def]
    """Replace sums along halves of lines that lean by ``lean``, two rows of sums (rows, w), by those of whole lines.

    Lines that lean by twice that replace the upper halves, and those that lean by 1 more the lower ones. The first
    ``wide`` columns, whole groups, are processed; as many 0 as lines may lean follow.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows = Rows(context, builder, signature.args[0], args[0])
        upper, lower, lean, wide = args[1:]
        steeper = builder.add(lean, ir.Constant(LONG, 1))
        with cgutils.for_range_slice(builder, ir.Constant(LONG, 0), wide, ir.Constant(LONG, GROUP)) as (x, _):
            above, near, far = (
                rows.at(upper, x),
                rows.at(lower, builder.add(x, lean)),
                rows.at(lower, builder.add(x, steeper)),
            )
            rows.store(upper, x, above + near)
            rows.store(lower, x, above + far)
        return context.get_dummy_value()

    place = types.int64
    return types.void(sums, place, place, place, place), generate


@intrinsic
def any_beyond(context, push, power, upper, lower, step, x, least, most, fewest):  # type: ignore[no-untyped-def]
    """Return whether n |n| / d of any of sixteen lines from x on is above ``most`` or below ``-fewest``.

    The upper halves of n and d are in row ``upper`` from x on, the lower ones in row ``lower`` from x + step on.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pushes, powers = (Rows(context, builder, signature.args[k], args[k]) for k in (0, 1))
        upper, lower, step, x = args[2:6]
        least, most, fewest = (Group(builder, filled(builder, number, GROUP)) for number in args[6:])
        there = builder.add(x, step)
        n, d = (rows.at(upper, x) + rows.at(lower, there) for rows in (pushes, powers))
        excess = n * n - most.chosen(n, ">", 0.0, fewest) * d.at_least(least)
        return excess.any_above(0.0)

    place, number = types.int64, types.float32
    return types.boolean(push, power, place, place, place, place, number, number, number), generate


@intrinsic
def limited_squares(context, push, power, upper, lower, step, x, least, most_of_half, out):  # type: ignore[no-untyped-def]
    """Write n |n| / d of sixteen lines into out (1, 16), limited by that of their halves; the rest as ``any_beyond``.

    No line counts for more than ``most_of_half`` times as much as either of its halves, and for nothing where these do
    not agree.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pushes, powers, squares = (Rows(context, builder, signature.args[k], args[k]) for k in (0, 1, 8))
        upper, lower, step, x = args[2:6]
        least, times = (Group(builder, filled(builder, number, GROUP)) for number in args[6:8])
        there = builder.add(x, step)

        def square(n: Group, d: Group) -> Group:
            return n * n.at_least(n * -1.0) / d.at_least(least)

        n, d = pushes.at(upper, x), powers.at(upper, x)
        other_n, other_d = pushes.at(lower, there), powers.at(lower, there)
        one, other, whole = square(n, d), square(other_n, other_d), square(n + other_n, d + other_d)
        most, fewest = one.at_most(other).at_least(0.0), one.at_least(other).at_most(0.0)
        start = ir.Constant(LONG, 0)
        squares.store(start, start, whole.at_most(most * times).at_least(fewest * times))
        return context.get_dummy_value()

    place, number = types.int64, types.float32
    return types.void(push, power, place, place, place, place, number, number, out), generate


@inner_kernel()
def note_lines(push, power, upper, lower, lean, width, limits, strip, line, squares, places):  # type: ignore[no-untyped-def]
    """Raise squares (2,), the greatest n |n| / d of lines and the least with its sign turned, to those that lean so.

    push, power (rows, w): n and d of their halves, in rows ``upper`` and ``lower``, of which ``width`` columns are the
    page's. limits: least d, and ``most_of_half``. places (2, 2): strip and x of each. line (1, 16): working space.
    """
    least, most_of_half = limits
    step, within = (lean + 1) // 2, width - lean
    for first in range(0, within, GROUP):
        if not any_beyond(push, power, upper, lower, step, first, least, squares[0], squares[1]):
            continue
        limited_squares(push, power, upper, lower, step, first, least, most_of_half, line)
        for k in range(min(GROUP, within - first)):
            end = 0 if line[0, k] > 0 else 1
            if abs(line[0, k]) > squares[end]:
                squares[end] = abs(line[0, k])
                places[end, 0], places[end, 1] = strip, first + k


@inner_kernel()
def levels_of(tallest):  # type: ignore[no-untyped-def]
    """Return how often lines are doubled to be so many rows high."""
    levels = 0
    while 1 << levels < tallest:
        levels += 1
    return levels


@inner_kernel()
def copy_strip(tiles, top, upwards, out):  # type: ignore[no-untyped-def]
    """Copy rows of tiles from ``top`` on into out (rows, w), the last one first where asked; 0 below the page."""
    last, width = out.shape[0] - 1, tiles.shape[1]
    for y in range(out.shape[0]):
        row = out[last - y if upwards else y]
        if top + y < tiles.shape[0]:
            copy_row(tiles[top + y], row[:width])
        else:
            row[:] = np.float32(0)


@kernel(
    "push (H, W), power (H, W), mirrored, smallest, first (L), least, most_of_half, values (L, S, 2), "
    "places (L, S, 2, 2)",
    where="0 < smallest, smallest * 2 ** (L - 1) == S",
)
def slanted(push, power, mirrored, smallest, first, least, most_of_half, values, places):  # type: ignore[no-untyped-def]
    """Find the greatest and least n / sqrt(d) along lines that lean right, of every slope and of L heights.

    n and d are sums along a line. mirrored: the lines lean left, and columns count from the right. Heights are
    smallest, twice that, ..., S rows; slopes a = 0..height of a height are whole columns to the right over it, of
    which those below first of that height are left out; lines that leave the page are, too. least: of d, so that
    little information has little effect; most_of_half: as in ``limited_squares``. Written: values (L, S, 2), the least
    with its sign turned, and places (L, S, 2, 2), strip and column at its top; 0 without information.

    A line leans a right from its first row to its last: its upper half leans a // 2, the lower one begins (a + 1) // 2
    further right and leans as much. Two halves make two lines, whose sums replace theirs.
    """
    values[:] = 0
    places[:] = 0
    limits = np.float32(least), np.float32(most_of_half)
    width, tallest = push.shape[1], values.shape[1]
    wide = whole_groups(width)
    n, d = np.zeros((tallest, wide + tallest), np.float32), np.zeros((tallest, wide + tallest), np.float32)
    line = np.empty((1, GROUP), np.float32)
    for top in range(0, push.shape[0], tallest):  # these rows stay in the cache through all levels
        # A line that leans left on its way down leans right on its way up.
        copy_strip(push, top, mirrored, n)
        copy_strip(power, top, mirrored, d)
        if greatest_of(d.ravel()) <= 0:
            continue
        for pair in range(tallest // 2):
            level, strip = 0, pair
            while 2 << level <= tallest:  # longer lines as soon as both of their halves are there
                strips = tallest // (2 << level)
                height = level + first.size - levels_of(tallest)
                for half in range(1 << level):
                    upper, lower = (
                        row_of_line(2 * strip, half, level),
                        row_of_line(2 * strip + 1, half, level),
                    )
                    for a in range(2 * half, 2 * half + 2):
                        if height < 0 or a < first[height]:
                            continue
                        where = top // tallest * strips + (strips - 1 - strip if mirrored else strip)
                        to = values[height, a], places[height, a]
                        note_lines(n, d, upper, lower, a, width, limits, where, line, *to)
                    if strips > 1:
                        join_lines(n, upper, lower, half, wide)
                        join_lines(d, upper, lower, half, wide)
                if strip % 2 == 0:
                    break
                level, strip = level + 1, strip // 2
    for height in range(values.shape[0]):
        for a in range(tallest):
            for end in range(2):
                value, place = np.sqrt(values[height, a, end]), places[height, a, end]
                values[height, a, end] = value
                if mirrored:
                    place[1] = width - 1 - a - place[1] if value > 0 else 0


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
                copy_row(informative[y], row)
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
                copy_row(second[:width], counts[middle])
            else:
                scale_row(second, counts[middle], prior, mean, scale[middle])


@kernel("t (H, W), scale (H, W), information (H, W), most, out (H, W)", fastmath=True, error_model="numpy")
def limited_pushes(t, scale, information, most, out):  # type: ignore[no-untyped-def]
    """Compute N' of tiles, (h, w), from T over its scale, limited to ``most`` of either sign."""
    for y in range(out.shape[0]):
        own, about, sure, row = t[y], scale[y], information[y], out[y]
        for x in range(row.size):
            row[x] = min(max(own[x] / about[x], -most), most) * np.sqrt(sure[x])
