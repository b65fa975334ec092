"""Compiled loops for extremes of a statistic relative to its scatter at places of the same class on the same page."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.extremes import greatest_of
from prooflight.kernels.statistics.boxes import box_row, take_box_row

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
_NOTHING_COMMON = np.float32(1e30)
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

    bounds (classes,): |T| up to which a class has no new extreme. Places without information are not counted.
    """
    for x in range(t.size):
        kind = np.uint32(kinds[x])  # unsigned, so that no negative index is tested for
        if kind == NO_CLASS:
            continue
        histogram[kind, np.uint32(bins[x])] += np.uint32(1)
        if abs(t[x]) > bounds[kind]:
            end = np.uint32(t[x] < 0)
            if abs(t[x]) > abs(ends[kind, end]):
                ends[kind, end], at[kind, end, 0], at[kind, end, 1] = t[x], y, x
                bounds[kind] = min(ends[kind, 0], -ends[kind, 1])


@inner_kernel()
def against_own(own, power, edges, scatter, least, overlap, values, places):  # type: ignore[no-untyped-def]
    """Find extremes of T, and of T over the scatter of T at places of the same class on the same page.

    own, power, edges (h, w): N', D' and the edges' part of it; scatter (3,); overlap: number of places that
    count as one. Written: values (5,): greatest and least T, the same over that scatter, mean of T^2, each at
    most 100; 0 without information; places (4, 2): row and column of the extremes.
    """
    height, width = own.shape
    values[:] = 0
    places[:] = 0
    most = greatest_of(power.ravel())
    if most <= least:
        return
    t, shifted = np.empty(width, np.float32), np.empty(width, np.float32)
    kinds, bins = np.empty(width, np.int32), np.empty(width, np.int32)
    histogram = np.zeros((CLASSES, BINS), np.uint32)
    bounds, ends = np.zeros(CLASSES, np.float32), np.zeros((CLASSES, 2), np.float32)
    at = np.zeros((CLASSES, 2, 2), np.int64)
    squares = 0.0
    for y in range(height):
        squares += row_of_t(own[y], power[y], edges[y], scatter[0], scatter[1], scatter[2], least, t)
        row_of_classes(power[y], edges[y], most, least, kinds)
        row_of_bins(t, shifted, bins)
        sort_row(t, kinds, bins, y, histogram, bounds, ends, at)
    total = histogram.sum()
    values[4] = squares / total
    n = total / overlap
    of_page = (n * quantile_of(histogram.sum(axis=0), total) ** 2 + PAGE_PRIOR) / (n + PAGE_PRIOR)
    for k in range(CLASSES):
        count = histogram[k].sum()
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
                    places[place] = at[k, end]


@kernel("maps (3, M, H, W), scatter (M, 3), least, overlap, values (M, 5), places (M, 4, 2)")
def each_against_own(maps, scatter, least, overlap, values, places):  # type: ignore[no-untyped-def]
    """Run ``against_own`` on every mode: maps (3, modes, h, w), scatter (modes, 3); written (modes, ...)."""
    for mode in range(maps.shape[1]):
        against_own(
            maps[0, mode],
            maps[1, mode],
            maps[2, mode],
            scatter[mode],
            least,
            overlap,
            values[mode],
            places[mode],
        )


@inner_kernel(fastmath=True, error_model="numpy")
def box_map(cells, mode, gains, level, prior, common, out):  # type: ignore[no-untyped-def]
    """Compute N', D' and the edges' part of D' of one mode's boxes, out (3, h, w), without the common mode.

    cells (4, modes, h, w): N, D, C, edges; gains (h,): share of C subtracted from N of each row of cells;
    level (h, w): the same of each box; common (2, h, w): N and D of the common mode's boxes, prior: 1 / its
    prior variance.
    """
    height, width = out.shape[1:]
    rows = np.empty((4, width), np.float32)
    for y in range(height):
        for part in range(4):
            box_row(cells[part, mode], y, rows[part])
        below = gains[y + 1] if y + 1 < height else np.float32(0)
        if gains[y] != 0 or below != 0:
            take_box_row(cells[2, mode], y, gains[y], below, rows[0])
        push, power, shared, edges = rows[0], rows[1], rows[2], rows[3]
        share, push0, power0 = level[y], common[0, y], common[1, y]
        own, rest, of_edges = out[0, y], out[1, y], out[2, y]
        for x in range(width):
            part_common = shared[x] / (power0[x] + prior)
            own[x] = push[x] - shared[x] * share[x] - part_common * push0[x]
        for x in range(width):
            part_common = shared[x] / (power0[x] + prior)
            rest[x] = max(power[x] - shared[x] * part_common, np.float32(0))
        for x in range(width):
            of_edges[x] = edges[x] * min(rest[x] / max(power[x], np.float32(1e-9)), np.float32(1))


@inner_kernel()
def has_information(power):  # type: ignore[no-untyped-def]
    """Return whether any place of a map has information; usually the first rows decide."""
    y = 0
    while y < power.shape[0] and greatest_of(power[y]) <= 0:
        y += 1
    return y < power.shape[0]


@kernel(
    "cells (4, N, H, W), gains (H), level (H, W), prior_power, scatter (M, 3), least, overlap, "
    "values (M, 5), places (M, 4, 2)",
    where="M <= N",
)
def boxes_against_own(cells, gains, level, prior_power, scatter, least, overlap, values, places):  # type: ignore[no-untyped-def]
    """Run ``against_own`` on all boxes, of each mode: cells (4, modes or more, h, w), the first mode common to all.

    Other arguments as in ``box_map`` and ``each_against_own``.
    """
    modes, height, width = scatter.shape[0], cells.shape[2], cells.shape[3]
    nothing = np.zeros((2, height, width), np.float32)
    of_all, maps = np.empty((3, height, width), np.float32), np.empty((3, height, width), np.float32)
    for mode in range(modes):
        if not has_information(cells[1, mode]):
            values[mode] = 0
            places[mode] = 0
            continue
        one = maps if mode else of_all
        prior, light = (prior_power, of_all) if mode else (_NOTHING_COMMON, nothing)
        box_map(cells, mode, gains, level, prior, light, one)
        against_own(one[0], one[1], one[2], scatter[mode], least, overlap, values[mode], places[mode])
