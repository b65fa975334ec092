"""Compiled loops for extremes of a statistic relative to its scatter at places of the same class on the same page."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.extremes import greatest_of
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.statistics.boxes import add_to
from prooflight.kernels.vectors import GROUP, LONG, Group, Rows, filled, whole_groups

SHARES = 4
"""Number of classes of the edges' share of the information, and as many of the information itself."""
CLASSES = SHARES * SHARES
NO_CLASS = CLASSES
"""Class of places without information."""
BINS = 96
"""Number of bins of log2 |T|, eight an octave from 2^-4 on."""
ONE_SIGMA = 0.6827
PRIOR = 30.0
"""Weight of the whole page's scatter in that of a class, in independent places."""
PAGE_PRIOR = 10.0
"""Weight of 1 in the page's scatter, in independent places."""
LEAST_SCALE = 0.5
_MOST_SQUARE = np.float32(100)
_EIGHTHS = tuple(int(np.float32(2 ** (j / 8)).view(np.int32)) & 0x7FFFFF for j in range(1, 8))
"""Mantissas at which eighths of an octave begin."""


@inner_kernel()
def quantile_of(histogram, count):  # type: ignore[no-untyped-def]
    """Return |T| below which ``ONE_SIGMA`` of so many lie."""
    wanted = ONE_SIGMA * count
    below = 0.0
    for i in range(BINS):
        if below + histogram[i] >= wanted and histogram[i] > 0:
            return 2.0 ** ((i + (wanted - below) / histogram[i]) / 8 - 4)
        below += histogram[i]
    return 2.0 ** (BINS / 8 - 4)


@inner_kernel(fastmath=True, error_model="numpy")
def row_of_t(own, power, edges, noise, at_edges, tolerance, least, t):  # type: ignore[no-untyped-def]
    """Compute T of a row of places into t, 0 without information; return the sum of T^2, each at most 100."""
    squares = np.float32(0)
    for x in range(t.size):
        d = power[x]
        e = min(max(edges[x], np.float32(0)), d)
        spread = noise * (d - e) + at_edges * e + tolerance * d * d
        value = own[x] / np.sqrt(spread + np.float32(1e-6))
        value = value if d > least else np.float32(0)
        t[x] = value
        squares += min(value * value, _MOST_SQUARE)
    return squares


@inner_kernel(fastmath=True, error_model="numpy")
def row_of_classes(power, edges, most, least, kinds):  # type: ignore[no-untyped-def]
    """Classify each place of a row by the edges' share of its information, and by the amount of information."""
    for x in range(kinds.size):
        d = power[x]
        e = min(max(edges[x], np.float32(0)), d)
        share = np.int32(e >= np.float32(0.25) * d) + np.int32(e >= np.float32(0.5) * d)
        share += np.int32(e >= np.float32(0.75) * d)
        level = np.int32(d <= np.float32(0.25) * most) + np.int32(d <= np.float32(0.0625) * most)
        level += np.int32(d <= np.float32(0.015625) * most)
        kinds[x] = share * np.int32(SHARES) + level if d > least else np.int32(NO_CLASS)


@inner_kernel(fastmath=True, error_model="numpy")
def row_of_bins(t, shifted, bins):  # type: ignore[no-untyped-def]
    """Compute the eighth of an octave of each |T| of a row from its bits; shifted (w,) float32 is working space."""
    for x in range(t.size):
        shifted[x] = abs(t[x]) + np.float32(1e-4)
    bits = shifted.view(np.int32)
    for x in range(t.size):
        mantissa = bits[x] & np.int32(0x7FFFFF)
        eighth = np.int32(0)
        for begin in _EIGHTHS:
            eighth += np.int32(mantissa >= np.int32(begin))
        place = ((bits[x] >> np.int32(23)) - np.int32(127 - 4)) * np.int32(8) + eighth
        bins[x] = min(max(place, np.int32(0)), np.int32(BINS - 1))


@inner_kernel()
def sort_row(t, kinds, bins, y, histogram, bounds, ends, at):  # type: ignore[no-untyped-def]
    """Count a row of T (w,) by class and size, and store each class's greatest and least with their places.

    Places without information have a class too, so that no branch depends on it.
    """
    for x in range(t.size):
        kind = np.uint32(kinds[x])  # unsigned, so that no negative index is tested for
        histogram[kind, np.uint32(bins[x])] += np.uint32(1)
        if abs(t[x]) > bounds[kind]:
            end = np.uint32(t[x] < 0)
            if abs(t[x]) > abs(ends[kind, end]):
                ends[kind, end], at[kind, end, 0], at[kind, end, 1] = t[x], y, x
                bounds[kind] = min(ends[kind, 0], -ends[kind, 1])


class Tally(NamedTuple):
    """Values of T of the maps of several modes, row after row."""

    t: NDArray[np.float32]
    """(w,) T of a row; this and the next three are working space."""
    shifted: NDArray[np.float32]
    kinds: NDArray[np.int32]
    bins: NDArray[np.int32]
    histogram: NDArray[np.uint32]
    """(modes, classes, BINS) number of |T| by class and size; here and below, the last class is ``NO_CLASS``."""
    bounds: NDArray[np.float32]
    """(modes, classes) |T| up to which a class has no new extreme."""
    ends: NDArray[np.float32]
    """(modes, classes, 2) greatest and least T."""
    at: NDArray[np.int64]
    """(modes, classes, 2, 2) row and column of these."""


@inner_kernel()
def empty_tally(modes, width):  # type: ignore[no-untyped-def]
    """Return a ``Tally`` of no rows."""
    t, shifted = np.empty(width, np.float32), np.empty(width, np.float32)
    kinds, bins = np.empty(width, np.int32), np.empty(width, np.int32)
    histogram = np.zeros((modes, CLASSES + 1, BINS), np.uint32)
    bounds, ends = np.zeros((modes, CLASSES + 1), np.float32), np.zeros((modes, CLASSES + 1, 2), np.float32)
    return Tally(
        t, shifted, kinds, bins, histogram, bounds, ends, np.zeros((modes, CLASSES + 1, 2, 2), np.int64)
    )


@inner_kernel()
def add_row(own, power, edges, scatter, least, most, y, mode, tally):  # type: ignore[no-untyped-def]
    """Add row y of a mode's map to a ``Tally``; return the sum of T^2, each at most 100.

    own, power, edges (w,): N', D' and the edges' part of it; scatter (3,); most: greatest D' of the map.
    """
    t, shifted, kinds, bins = tally.t, tally.shifted, tally.kinds, tally.bins
    histogram, bounds, ends, at = tally.histogram[mode], tally.bounds[mode], tally.ends[mode], tally.at[mode]
    squares = row_of_t(own, power, edges, scatter[0], scatter[1], scatter[2], least, t)
    row_of_classes(power, edges, most, least, kinds)
    row_of_bins(t, shifted, bins)
    sort_row(t, kinds, bins, y, histogram, bounds, ends, at)
    return squares


@inner_kernel()
def extremes_of_tally(tally, mode, squares, overlap, values, places):  # type: ignore[no-untyped-def]
    """Write the extremes of T, and of T over the scatter of T at places of the same class on the same page.

    squares: sum of T^2; overlap: number of places that count as one. Written: values (5,): greatest and least T, the
    same over that scatter, mean of T^2; 0 without information; places (4, 2): row and column of the extremes.
    """
    values[:] = 0
    places[:] = 0
    histogram, ends, at = tally.histogram[mode], tally.ends[mode], tally.at[mode]
    counts, of_all, total = np.zeros(CLASSES, np.int64), np.zeros(BINS, np.int64), 0
    for k in range(CLASSES):
        add_to(histogram[k], of_all)
        for i in range(BINS):
            counts[k] += histogram[k, i]
        total += counts[k]
    if total == 0:
        return
    values[4] = squares / total
    n = total / overlap
    of_page = (n * quantile_of(of_all, total) ** 2 + PAGE_PRIOR) / (n + PAGE_PRIOR)
    for k in range(CLASSES):
        count = counts[k]
        if count == 0:
            continue
        n = count / overlap
        squared = (n * quantile_of(histogram[k], count) ** 2 + PRIOR * of_page) / (n + PRIOR)
        scale = np.float32(max(np.sqrt(squared), LEAST_SCALE))
        for end in range(2):
            sign = np.float32(1 - 2 * end)
            for place, value in ((end, ends[k, end]), (2 + end, ends[k, end] / scale)):
                if sign * value > sign * values[place]:
                    values[place] = value
                    places[place, 0], places[place, 1] = at[k, end, 0], at[k, end, 1]


@kernel("maps (3, M, H, W), scatter (M, 3), least, overlap, values (M, 5), places (M, 4, 2)")
def each_against_own(maps, scatter, least, overlap, values, places):  # type: ignore[no-untyped-def]
    """Find the extremes of T of every mode, as ``extremes_of_tally`` writes them: values and places (modes, ...).

    maps (3, modes, h, w): N', D' and the edges' part of it; scatter (modes, 3).
    """
    tally = empty_tally(maps.shape[1], maps.shape[3])
    for mode in range(maps.shape[1]):
        own, power, edges, squares = maps[0, mode], maps[1, mode], maps[2, mode], 0.0
        most = greatest_of(power.ravel())
        for y in range(own.shape[0] if most > least else 0):
            squares += add_row(own[y], power[y], edges[y], scatter[mode], least, most, y, mode, tally)
        extremes_of_tally(tally, mode, squares, overlap, values[mode], places[mode])


@inner_kernel(fastmath=True, error_model="numpy")
def box_row(cells, y, out):  # type: ignore[no-untyped-def]
    """Compute sums of 2 x 2 cells from row y of cells (h, w) on, out (at least w,); 0 beyond the map."""
    height, last = cells.shape[0], cells.shape[1] - 1
    top, bottom = cells[y], cells[min(y + 1, height - 1)]
    share = np.float32(1) if y + 1 < height else np.float32(0)
    for x in range(last):
        out[x] = top[x] + top[x + 1] + share * (bottom[x] + bottom[x + 1])
    out[last] = top[last] + share * bottom[last]


@inner_kernel(fastmath=True, error_model="numpy")
def take_box_row(cells, y, above, below, out):  # type: ignore[no-untyped-def]
    """Subtract shares of row y and of the next of cells (h, w) from sums of 2 x 2, in place."""
    height, last = cells.shape[0], cells.shape[1] - 1
    top, bottom = cells[y], cells[min(y + 1, height - 1)]
    for x in range(last):
        out[x] -= above * (top[x] + top[x + 1]) + below * (bottom[x] + bottom[x + 1])
    out[last] -= above * top[last] + below * bottom[last]


@intrinsic
def halve_row(context, rows, line, wide, out):  # type: ignore[no-untyped-def]
    """Copy every other of the first ``wide`` numbers, two groups at once, of a row of rows (n, w) to out (1, w)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source, target = (Rows(context, builder, signature.args[k], args[k]) for k in (0, 3))
        none, one, group = (ir.Constant(LONG, number) for number in (0, 1, GROUP))
        with cgutils.for_range_slice(builder, none, args[2], builder.add(group, group)) as (x, _):
            halves = source.at(args[1], x).every_other(source.at(args[1], builder.add(x, group)))
            target.store(none, builder.lshr(x, one), halves)
        return context.get_dummy_value()

    return types.void(rows, types.int64, types.int64, out), generate


@intrinsic
def sum_boxes(context, push, power, shared, edges, y, gain, gain_below, first, last, out):  # type: ignore[no-untyped-def]
    """Compute N, D, C and the edges' part of D of boxes from row y and the next of cells on, out (4, w).

    Whole groups from column ``first`` on, up to ``last``, which have neighbours on their right. push, power, shared,
    edges (h, w): of the cells; N less shares of C, ``gain`` in row y and ``gain_below`` in the next.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        *images, sums = (Rows(context, builder, signature.args[k], args[k]) for k in (0, 1, 2, 3, 9))
        y, one = args[4], ir.Constant(LONG, 1)
        gains = [Group(builder, filled(builder, number, GROUP)) for number in args[5:7]]
        with cgutils.for_range_slice(builder, args[7], args[8], ir.Constant(LONG, GROUP)) as (x, _):
            right = builder.add(x, one)
            pairs = [
                [image.at(line, x) + image.at(line, right) for line in (y, builder.add(y, one))]
                for image in images
            ]
            taken = pairs[2][0] * gains[0] + pairs[2][1] * gains[1]
            for part, (above, below) in enumerate(pairs):
                total = above + below if part else above + below - taken
                sums.store(ir.Constant(LONG, part), x, total)
        return context.get_dummy_value()

    place, number = types.int64, types.float32
    return types.void(push, power, shared, edges, place, number, number, place, place, out), generate


@inner_kernel(fastmath=True, error_model="numpy")
def box_rows(cells, mode, y, gains, larger, half, out):  # type: ignore[no-untyped-def]
    """Compute N, D, C and the edges' part of D of row y of a mode's boxes, out (4, w); N less a share of C.

    Every other box of every other row is a cell of ``larger``; half (1, w): working space.
    """
    push, power, shared, edges = cells[0, mode], cells[1, mode], cells[2, mode], cells[3, mode]
    last = push.shape[1] - 1
    below = gains[y + 1] if y + 1 < gains.size else np.float32(0)
    if y + 1 < gains.size and last >= GROUP:
        for first in (0, last - GROUP):  # the last group overlaps the one before
            sum_boxes(push, power, shared, edges, y, gains[y], below, first, last - GROUP + 1, out)
        for part in range(4):
            out[part, last] = cells[part, mode, y, last] + cells[part, mode, y + 1, last]
        out[0, last] -= gains[y] * shared[y, last] + below * shared[y + 1, last]
    else:
        for part in range(4):
            box_row(cells[part, mode], y, out[part])
        take_box_row(shared, y, gains[y], below, out[0])
    for part in range(4 if y % 2 == 0 else 0):
        halve_row(out, part, half.shape[1], half)
        copy_row(half[0, : larger.shape[3]], larger[part, mode, y // 2])


@inner_kernel(fastmath=True, error_model="numpy")
def take_level(level, row):  # type: ignore[no-untyped-def]
    """Subtract a share of C, level (w,), from N of a row of boxes, row (4, at least w)."""
    push, shared = row[0], row[2]
    for x in range(level.size):
        push[x] -= shared[x] * level[x]


@inner_kernel(fastmath=True, error_model="numpy")
def rest_row(power, shared, power0, prior, out):  # type: ignore[no-untyped-def]
    """Compute D' of a row of boxes, out (w,), from D and C of it and D of light."""
    for x in range(out.size):
        out[x] = max(power[x] - shared[x] * (shared[x] / (power0[x] + prior)), np.float32(0))


@inner_kernel(fastmath=True, error_model="numpy")
def take_common(light, prior, rest, row):  # type: ignore[no-untyped-def]
    """Reduce N and the edges' part of D of a row of boxes, row (4, w), by what light (4, w) explains; rest (w,): D'."""
    push, power, shared, edges, push0, power0 = row[0], row[1], row[2], row[3], light[0], light[1]
    for x in range(push.size):
        push[x] -= shared[x] / (power0[x] + prior) * push0[x]
    for x in range(edges.size):
        edges[x] *= min(rest[x] / max(power[x], np.float32(1e-9)), np.float32(1))


@inner_kernel()
def most_information(cells, mode, prior, rows):  # type: ignore[no-untyped-def]
    """Return the greatest D' of a mode's boxes; rows (at least 4, w): working space."""
    most, power, shared, power0, rest = np.float32(0), rows[0], rows[1], rows[2], rows[3]
    for y in range(cells.shape[2]):
        box_row(cells[1, mode], y, power)
        greatest = greatest_of(power)
        if greatest <= most:  # D' is no greater than D
            continue
        if mode:
            box_row(cells[2, mode], y, shared)
            box_row(cells[1, 0], y, power0)
            rest_row(power, shared, power0, prior, rest)
            greatest = greatest_of(rest)
        most = max(most, greatest)
    return most


@kernel(
    "cells (4, N, H, W), gains (H), level (H, W), prior_power, scatter (M, 3), least, overlap, "
    "larger (4, M, -(-H // 2), -(-W // 2)), values (M, 5), places (M, 4, 2)",
    where="0 < M, M <= N",
)
def boxes_against_own(cells, gains, level, prior_power, scatter, least, overlap, larger, values, places):  # type: ignore[no-untyped-def]
    """Find the extremes of T over all boxes, of each mode, as ``each_against_own`` does; the first is common to all.

    cells (4, modes or more, h, w): N, D, C, edges; boxes are 2 x 2 cells and overlap by half; gains (h,): share of C
    subtracted from N of each row of cells; level (h, w): the same of each box; prior_power: 1 / the common mode's prior
    variance. Written to larger: cells of twice the side, which are every other box each way.
    """
    modes, height, width = scatter.shape[0], cells.shape[2], cells.shape[3]
    wide = whole_groups(width)
    # Rows are some 0 longer, since every other box is copied in two groups.
    light, row = np.zeros((4, wide + GROUP), np.float32), np.zeros((4, wide + GROUP), np.float32)
    rest, half = np.empty(wide + GROUP, np.float32), np.empty((1, wide), np.float32)
    tally, squares, most = empty_tally(modes, width), np.zeros(modes), np.empty(modes, np.float32)
    for mode in range(modes):
        most[mode] = most_information(cells, mode, prior_power, row)
    row[:] = np.float32(0)
    for y in range(height):
        box_rows(cells, 0, y, gains, larger, half, light)
        take_level(level[y], light)
        squares[0] += add_row(light[0], light[1], light[3], scatter[0], least, most[0], y, 0, tally)
        for mode in range(1, modes):
            box_rows(cells, mode, y, gains, larger, half, row)
            if most[mode] <= least:
                continue
            take_level(level[y], row)
            rest_row(row[1], row[2], light[1], prior_power, rest)
            take_common(light, prior_power, rest, row)
            squares[mode] += add_row(row[0], rest, row[3], scatter[mode], least, most[mode], y, mode, tally)
    for mode in range(modes):
        extremes_of_tally(tally, mode, squares[mode], overlap, values[mode], places[mode])
