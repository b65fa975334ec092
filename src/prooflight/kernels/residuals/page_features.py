"""Compiled loops over the modes of a page: its features, and edges at which inks exchange with hardly any light."""

from __future__ import annotations

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.residuals.fit import shows

_SOLID = np.float32(0.9)
_PRINTED = np.float32(0.05)
_HEAVY = np.float32(2)


@inner_kernel(fastmath=True, error_model="numpy")
def area_row(cyan, magenta, yellow, black, texture, inside, out):  # type: ignore[no-untyped-def]
    """Add a row's sums within the page to out (11,), see ``page_feature_sums``; return its pixels within."""
    total = np.zeros(11, np.float32)
    count = np.int32(0)
    for x in range(texture.size):
        there = np.float32(inside[x])
        c, m, y, k = there * cyan[x], there * magenta[x], there * yellow[x], there * black[x]
        total_area = c + m + y + k
        count += np.int32(inside[x])
        total[0] += c
        total[1] += m
        total[2] += y
        total[3] += k
        total[4] += np.float32(c > _SOLID)
        total[5] += np.float32(m > _SOLID)
        total[6] += np.float32(y > _SOLID)
        total[7] += np.float32(k > _SOLID)
        total[8] += np.float32(total_area > _PRINTED)
        total[9] += np.float32(total_area > _HEAVY)
        total[10] += there * texture[x]
    for i in range(total.size):
        out[i] += total[i]
    return count


@inner_kernel(fastmath=True, error_model="numpy")
def edge_row(cyan, magenta, yellow, black, out):  # type: ignore[no-untyped-def]
    """Add steps along a row to out (3,): of black, of the others' sum, and the second greatest of all four."""
    of_black, of_others, of_two = np.float32(0), np.float32(0), np.float32(0)
    for x in range(cyan.size - 1):
        by_c, by_m, by_y = cyan[x + 1] - cyan[x], magenta[x + 1] - magenta[x], yellow[x + 1] - yellow[x]
        c, m, y, k = abs(by_c), abs(by_m), abs(by_y), abs(black[x + 1] - black[x])
        of_black += k
        of_others += abs(by_c + by_m + by_y)
        of_two += max(min(max(c, m), max(y, k)), max(min(c, m), min(y, k)))
    out[0] += of_black
    out[1] += of_others
    out[2] += of_two


@kernel("cover (4, L, P), texture (L, P), inside (L, P), every")
def page_feature_sums(cover, texture, inside, every):  # type: ignore[no-untyped-def]
    """Compute sums over every so many-th line of cover (4, lines, pixels), texture and inside (lines, pixels).

    (14,): within the page each ink's area, where each is solid, where anything is printed, where more than
    two solids are, and texture; then ``edge_row`` everywhere. Returned with the number of pixels within and
    of steps.
    """
    sums, pixels_within, steps = np.zeros(14), 0, 0
    for line in range(0, texture.shape[0], every):
        c, m, y, k = cover[0, line], cover[1, line], cover[2, line], cover[3, line]
        pixels_within += area_row(c, m, y, k, texture[line], inside[line], sums[:11])
        edge_row(c, m, y, k, sums[11:])
        steps += c.size - 1
    return sums, pixels_within, steps


_LEAST_AREA = np.float32(0.02)
"""Ink area below which the effect of a displaced plane is not computed, as in ``take_ink``."""


@inner_kernel(fastmath=True, error_model="numpy")
def add_slopes(gain, above, here, below, sums, squares):  # type: ignore[no-untyped-def]
    """Add one ink's slopes of light along a row to sums (2, pixels), across and along, and their squares to squares.

    gain (pixels,): effect of the ink; above, here, below (pixels,): its area. The row's ends are unchanged.
    """
    half = np.float32(0.5)
    for x in range(1, here.size - 1):
        per_area = half * gain[x] / here[x] if here[x] > _LEAST_AREA else np.float32(0)
        across = per_area * (here[x + 1] - here[x - 1])
        along = per_area * (below[x] - above[x])
        sums[0, x] += across
        sums[1, x] += along
        squares[x] += across * across + along * along


@inner_kernel(fastmath=True, error_model="numpy")
def take_sums(sums, squares):  # type: ignore[no-untyped-def]
    """Subtract the squared slope of the sum of all inks from a row of squares; return the greatest remainder."""
    most = np.float32(0)
    for x in range(squares.size):
        squares[x] = max(squares[x] - sums[0, x] * sums[0, x] - sums[1, x] * sums[1, x], np.float32(0))
        most = max(most, squares[x])
    return most


@kernel("gain (4, L, P), cover (4, L, P), first, last, out (L, P)", where="0 <= first, last <= L")
def hidden_slopes(gain, cover, first, last, out):  # type: ignore[no-untyped-def]
    """Compute how much greater planes' squared slopes are than that of their light; return the greatest.

    gain (4, lines, pixels) [DN]: ``Modes.gain`` of one sensor; cover (4, lines, pixels): ``Modes.cover``. out
    (lines, pixels) [DN^2/pixel^2]: max(sum_i |s_i|^2 - |sum_i s_i|^2, 0), s_i the slope of the light of ink i.
    It is 0 for one ink, and for inks that begin at the same place. Lines first .. last - 1 are written.
    """
    lines, pixels = out.shape
    sums, most = np.zeros((2, pixels), np.float32), np.float32(0)
    for line in range(first, last):
        row = out[line]
        row[:] = np.float32(0)
        if line == 0 or line == lines - 1:
            continue
        sums[:] = np.float32(0)
        for ink in range(INKS):
            if shows(gain[ink, line]):
                of = cover[ink, line - 1], cover[ink, line], cover[ink, line + 1]
                add_slopes(gain[ink, line], of[0], of[1], of[2], sums, row)
        most = max(most, take_sums(sums, row))
    return most
