"""Compiled loops: sums over boxes of tiles, from size to size, and what is most and least among them.

Cells tile the map; boxes are 2 x 2 cells and overlap by half; four cells make one of the next size.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_TINY = np.float32(1e-9)
_LEAST = np.float32(1e-6)
_FAR = np.float32(1e30)
_LOOKED_THROUGH = 32768
_MOST_SQUARE = np.float32(100)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def box_row(cells, y, gains, pushes, line, out):  # type: ignore[no-untyped-def]
    """Sums of 2 x 2 cells from row y of cells (h, w) on, (w,); gains (h,) of ``pushes`` (h, w) are taken away first."""
    height, width = cells.shape
    if y + 1 < height:
        g, h = gains[y], gains[y + 1]
        top, bottom, p, q = cells[y], cells[y + 1], pushes[y], pushes[y + 1]
        for x in range(width):
            line[x] = top[x] + bottom[x] - (g * p[x] + h * q[x])
    else:
        g = gains[y]
        top, p = cells[y], pushes[y]
        for x in range(width):
            line[x] = top[x] - g * p[x]
    for x in range(width - 1):
        out[x] = line[x] + line[x + 1]
    out[width - 1] = line[width - 1]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def plain_box_row(cells, y, line, out):  # type: ignore[no-untyped-def]
    """``box_row`` with nothing taken away."""
    height, width = cells.shape
    top, bottom = cells[y], cells[min(y + 1, height - 1)]
    share = np.float32(1) if y + 1 < height else np.float32(0)
    for x in range(width):
        line[x] = top[x] + share * bottom[x]
    for x in range(width - 1):
        out[x] = line[x] + line[x + 1]
    out[width - 1] = line[width - 1]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def statistic_row(push, power, shared, edges, push0, power0, known, noise, at_edges, tolerance, least, out):  # type: ignore[no-untyped-def]
    """T of a row of boxes (w,) once the common mode is taken out; 0 where no more power is left than ``least``.

    push0, power0: the common mode's own; known: 1 / its prior variance. One array is written: with more, the compiler
    would not know them apart and give up vectors.
    """
    for x in range(out.size):
        share = shared[x] / (power0[x] + known)
        whole = power[x]
        d = max(whole - shared[x] * share, np.float32(0))
        e = edges[x] * min(d / max(whole, _TINY), np.float32(1))
        spread = noise * max(d - e, np.float32(0)) + at_edges * max(e, np.float32(0)) + tolerance * d * d
        t = (push[x] - share * push0[x]) / np.sqrt(spread + _LEAST)
        out[x] = t if d > least else np.float32(0)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def seen_in_row(t):  # type: ignore[no-untyped-def]
    """The greatest of a row, the least, the sum of squares, each at most 100, and how many are not 0."""
    high, low, squares, said = -_FAR, _FAR, np.float32(0), np.int32(0)
    for x in range(t.size):
        high, low = max(high, t[x]), min(low, t[x])
        squares += min(t[x] * t[x], _MOST_SQUARE)
        said += np.int32(t[x] != 0)
    return high, low, squares, said


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def first_like(row, value):  # type: ignore[no-untyped-def]
    """The first place of a value in a row that holds it."""
    for x in range(row.size):
        if row[x] == value:
            return x
    return 0


@njit(cache=True, nogil=True)
def draw_row(t, counter, drawn):  # type: ignore[no-untyped-def]
    """Every so many-th informed place's T into drawn (n,); where that is full, every second one of it stays.

    counter (3,) int64: how many are drawn, every so many-th, how many to pass over first.
    """
    count, every, skip = counter[0], counter[1], counter[2]
    for x in range(t.size):
        if t[x] != 0:
            if skip == 0:
                if count == drawn.size:
                    count = (count + 1) // 2
                    for i in range(count):
                        drawn[i] = drawn[2 * i]
                    every *= 2
                drawn[count] = t[x]
                count += 1
                skip = every
            skip -= 1
    counter[0], counter[1], counter[2] = count, every, skip


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def box_statistics(cells, gains, level, known, scatter, least, values, places, counters, drawn):  # type: ignore[no-untyped-def]
    """Extremes of T of every mode over all boxes of one size.

    cells (4, modes or more, h, w): N, D, C, edges, the first mode common to all; gains (h,): share of C taken from N of
    each row of cells; level (h, w): share of C taken from N of each box; scatter (modes, 3).
    Written: values (modes, 3): the greatest, the least, the sum of T^2; places (modes, 5): row and column of either,
    informed; counters (modes, 3), drawn (modes, n): as in ``draw_row``, of every so many-th row.
    """
    modes, height, width = scatter.shape[0], cells.shape[2], cells.shape[3]
    thin = (height * width + _LOOKED_THROUGH - 1) // _LOOKED_THROUGH
    rows = np.empty((4, width), np.float32)
    common = np.empty((2, width), np.float32)
    t, line = np.empty((2, width), np.float32)
    nothing = np.zeros(width, np.float32)
    for mode in range(modes):
        values[mode, 0], values[mode, 1], values[mode, 2] = -_FAR, _FAR, np.float32(0)
        places[mode] = 0
        counters[mode, 0], counters[mode, 1], counters[mode, 2] = 0, 1, 0
    for y in range(height):
        for mode in range(modes):
            box_row(cells[0, mode], y, gains, cells[2, mode], line, rows[0])
            for part in range(1, 4):
                plain_box_row(cells[part, mode], y, line, rows[part])
            share = level[y]
            for x in range(width):
                rows[0, x] -= rows[2, x] * share[x]
            if mode == 0:
                common[0], common[1] = rows[0], rows[1]
            c, c_known = (nothing, np.float32(1)) if mode == 0 else (rows[2], known)
            noise, at_edges, tolerance = scatter[mode]
            statistic_row(
                rows[0],
                rows[1],
                c,
                rows[3],
                common[0],
                common[1],
                c_known,
                noise,
                at_edges,
                tolerance,
                least,
                t,
            )
            high, low, squares, said = seen_in_row(t)
            values[mode, 2] += squares
            places[mode, 4] += said
            if high > values[mode, 0]:
                values[mode, 0] = high
                places[mode, 0], places[mode, 1] = y, first_like(t, high)
            if low < values[mode, 1]:
                values[mode, 1] = low
                places[mode, 2], places[mode, 3] = y, first_like(t, low)
            if said and y % thin == 0:
                draw_row(t, counters[mode], drawn[mode])


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def merged(cells, gains, out):  # type: ignore[no-untyped-def]
    """Cells (4, modes, h, w) of twice the side into out (4, modes, ., .); gains (h,) as in ``box_statistics``."""
    modes, height, width = out.shape[1], cells.shape[2], cells.shape[3]
    line = np.empty(width + 1, np.float32)
    line[width] = 0
    for part in range(4):
        for mode in range(modes):
            of, c = cells[part, mode], cells[2, mode]
            for k in range(out.shape[2]):
                y = 2 * k
                z = min(y + 1, height - 1)
                share = np.float32(1) if y + 1 < height else np.float32(0)
                if part == 0:
                    g, h = gains[y], gains[z]
                    for x in range(width):
                        line[x] = of[y, x] - g * c[y, x] + share * (of[z, x] - h * c[z, x])
                else:
                    for x in range(width):
                        line[x] = of[y, x] + share * of[z, x]
                target = out[part, mode, k]
                for i in range(target.size):
                    target[i] = line[2 * i] + line[2 * i + 1]
