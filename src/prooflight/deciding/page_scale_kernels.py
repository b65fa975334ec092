"""Compiled loop: the most and the least of a statistic against what places of the same sort on this page scatter by."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.comparing.summing.box_kernels import box_row, plain_box_row

SHARES = 4
"""Classes of the edges' share of the information, times as many of the information itself."""
CLASSES = SHARES * SHARES
BINS = 96
"""Of log2 |T|, eight an octave from 2^-4 on."""
ONE_SIGMA = 0.6827
PRIOR = 30.0
"""Independent places of a class whose scatter is taken from the whole page's."""
PAGE_PRIOR = 10.0
"""Independent places by which the page's is held to 1."""
LEAST_SCALE = 0.5
MOST_SQUARE = 100.0


@njit(cache=True, nogil=True)
def quantile_of(histogram, count):  # type: ignore[no-untyped-def]
    """|T| below which ``ONE_SIGMA`` of so many lie."""
    wanted = ONE_SIGMA * count
    below = 0.0
    for i in range(BINS):
        if below + histogram[i] >= wanted and histogram[i] > 0:
            return 2.0 ** ((i + (wanted - below) / histogram[i]) / 8 - 4)
        below += histogram[i]
    return 2.0 ** (BINS / 8 - 4)


@njit(cache=True, nogil=True)
def against_own(own, power, edges, scatter, least, overlap, values, places):  # type: ignore[no-untyped-def]
    """Extremes of T, and of T over the scatter of T at places of the same class on the same page.

    own, power, edges (h, w): N', D' and the edges' part of it; scatter (3,); overlap: places that count as one.
    Written: values (5,): greatest and least T, the same over that scatter, mean of T^2, each at most 100; 0 where
    nothing is informed; places (4, 2): row and column of the extremes.
    """
    height, width = own.shape
    most = np.float32(0)
    for y in range(height):
        for x in range(width):
            most = max(most, power[y, x])
    t = np.zeros((height, width), np.float32)
    kind = np.full((height, width), -1, np.int8)
    histogram = np.zeros((CLASSES + 1, BINS))
    values[:] = 0
    places[:] = 0
    for y in range(height):
        for x in range(width):
            d = power[y, x]
            if d <= least:
                continue
            e = min(max(edges[y, x], np.float32(0)), d)
            spread = scatter[0] * (d - e) + scatter[1] * e + scatter[2] * d * d
            t[y, x] = own[y, x] / np.sqrt(spread + np.float32(1e-6))
            ratio = d / most
            level = 0 if ratio > 0.25 else (1 if ratio > 0.0625 else (2 if ratio > 0.015625 else 3))
            kind[y, x] = min(int(e / d * SHARES), SHARES - 1) * SHARES + level
            values[4] += min(t[y, x] ** 2, MOST_SQUARE)
            if t[y, x] > values[0]:
                values[0], places[0, 0], places[0, 1] = t[y, x], y, x
            if t[y, x] < values[1]:
                values[1], places[1, 0], places[1, 1] = t[y, x], y, x
            place = int((np.log2(abs(t[y, x]) + np.float32(1e-4)) + 4) * 8)
            place = min(max(place, 0), BINS - 1)
            histogram[kind[y, x], place] += 1
            histogram[CLASSES, place] += 1
    total = histogram[CLASSES].sum()
    if total == 0:
        return
    values[4] /= total
    n = total / overlap
    of_page = (n * quantile_of(histogram[CLASSES], total) ** 2 + PAGE_PRIOR) / (n + PAGE_PRIOR)
    scale = np.ones(CLASSES, np.float32)
    for k in range(CLASSES):
        count = histogram[k].sum()
        if count > 0:
            n = count / overlap
            squared = (n * quantile_of(histogram[k], count) ** 2 + PRIOR * of_page) / (n + PRIOR)
            scale[k] = max(np.sqrt(squared), LEAST_SCALE)
    for y in range(height):
        for x in range(width):
            if kind[y, x] >= 0:
                ratio = t[y, x] / scale[kind[y, x]]
                if ratio > values[2]:
                    values[2], places[2, 0], places[2, 1] = ratio, y, x
                if ratio < values[3]:
                    values[3], places[3, 0], places[3, 1] = ratio, y, x


@njit(cache=True, nogil=True, fastmath=True)
def box_maps(cells, gains, level, known, out):  # type: ignore[no-untyped-def]
    """N', D' and the edges' part of D' of boxes, out (3, modes, h, w); the rest as in ``box_statistics``."""
    modes, height, width = out.shape[1], cells.shape[2], cells.shape[3]
    rows = np.empty((4, width), np.float32)
    common = np.empty((2, width), np.float32)
    line = np.empty(width, np.float32)
    for y in range(height):
        share = level[y]
        for mode in range(modes):
            box_row(cells[0, mode], y, gains, cells[2, mode], line, rows[0])
            for part in range(1, 4):
                plain_box_row(cells[part, mode], y, line, rows[part])
            for x in range(width):
                rows[0, x] -= rows[2, x] * share[x]
            if mode == 0:
                common[0], common[1] = rows[0], rows[1]
            own, left, of_edges = out[0, mode, y], out[1, mode, y], out[2, mode, y]
            if mode == 0:
                own[:], left[:], of_edges[:] = rows[0], rows[1], rows[3]
                continue
            for x in range(width):
                part_common = rows[2, x] / (common[1, x] + known)
                d = rows[1, x]
                rest = max(d - rows[2, x] * part_common, np.float32(0))
                own[x] = rows[0, x] - part_common * common[0, x]
                left[x] = rest
                of_edges[x] = rows[3, x] * min(rest / max(d, np.float32(1e-9)), np.float32(1))
