"""Compiled loops for edges at which inks exchange, so that hardly any step of light shows."""

from __future__ import annotations

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.residuals.fit import shows

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
