"""Compiled loops of the nuisance fit: means over blocks, and a page's smooth functions of colour by table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel

SHAPES = 16
"""Greatest number of features of colour; those that a page does not have are 0."""
LEVELS = 256
"""Levels of ink area, by which bells are tabulated."""
GAIN_AT, DOT_AT, SHAPE_AT = 6, 6 + INKS, 6 + 2 * INKS
"""First columns of ``block_sums``: inks' gains and dot gains, bells; before these, single numbers."""
SLOPE_AT = SHAPE_AT + SHAPES
"""First column of planes' slopes across, then along."""
SUMS = SLOPE_AT + 2 * INKS
_MOST = np.float32(LEVELS - 1)
_HALF = np.float32(0.5)


class InkImages(NamedTuple):
    """Effects of inks on one sensor's image; images (..., lines, pixels) as in ``Modes``."""

    gain: NDArray[np.float32]
    """Effect of each ink's gain, (4, ...). [DN]"""
    dot: NDArray[np.float32]
    """Effect of each ink's dot gain, (4, ...). [DN]"""
    texture: NDArray[np.float32]
    """Variance of halftones at unit contrast. [DN^2]"""
    cover: NDArray[np.float32]
    """Ink area, (4, ...). [-]"""


@inner_kernel()
def shows(row):  # type: ignore[no-untyped-def]
    """Return whether anything in a row (pixels,) is not 0, tested in vectors; the sign of a 0 does not count."""
    bits, bits_set = row.view(np.int32), np.int32(0)
    for x in range(bits.size):
        bits_set |= np.int32(bits[x] << np.int32(1))
    return bits_set != 0


@inner_kernel(fastmath=True, error_model="numpy")
def level_of(area):  # type: ignore[no-untyped-def]
    """Return the nearest tabulated level of an ink area."""
    return np.int32(min(max(area, np.float32(0)), np.float32(1)) * _MOST + _HALF)


@inner_kernel(fastmath=True, error_model="numpy")
def add_bells(recipe, light, bells, shapes):  # type: ignore[no-untyped-def]
    """Add bells of one recipe (levels of CMYK) times light to shapes (SHAPES,)."""
    c, m, y, k = bells[0, recipe[0]], bells[1, recipe[1]], bells[2, recipe[2]], bells[3, recipe[3]]
    for j in range(SHAPES):
        shapes[j] += c[j] * m[j] * y[j] * k[j] * light


@kernel(
    "measured (L, P), expected (L, P), offset (P), variance (L, P), inks.gain (4, L, P), "
    "inks.dot (4, L, P), inks.texture (L, P), inks.cover (4, L, P), inside (L, P), bells (4, LEVELS, SHAPES), "
    "corners (N, 2), side, out (N, SUMS)",
    fastmath=True,
    error_model="numpy",
)
def block_sums(  # type: ignore[no-untyped-def]
    measured, expected, offset, variance, inks, inside, bells, corners, side, out
):
    """Compute sums over some blocks of ``side`` pixels of one sensor, into out (blocks, SUMS).

    inks: ``InkImages``. corners (blocks, 2): first line and column. bells (4, LEVELS, SHAPES): factors of
    each bell by ink, whose product is exp(-|a - centre|^2 / length^2). Columns of out: pixels inside,
    residual, light, variance, squared slope of light, texture, ink gains (4), dot gains (4), bells times
    light, plane slopes across (4) and along (4).
    """
    lines, pixels = measured.shape
    gain, dot, texture, cover = inks
    out[:] = np.float32(0)
    begin = 0
    while begin < corners.shape[0]:
        top, end = corners[begin, 0], begin
        while end < corners.shape[0] and corners[end, 0] == top:
            end += 1
        # Blocks side by side are processed line by line, since a page's lines are far apart in memory.
        for line in range(max(top, 1), min(top + side, lines - 1)):
            for block in range(begin, end):
                sums = out[block]
                shapes = sums[SHAPE_AT:SLOPE_AT]
                none = np.float32(0)
                count, off, bright, scatter, steep, grain, alike = none, none, none, none, none, none, none
                recipe = np.int32(0), np.int32(0), np.int32(0), np.int32(0)
                for x in range(max(corners[block, 1], 1), min(corners[block, 1] + side, pixels - 1)):
                    if not inside[line, x]:
                        continue
                    light = expected[line, x] - offset[x]
                    across = (expected[line, x + 1] - expected[line, x - 1]) * _HALF
                    along = (expected[line + 1, x] - expected[line - 1, x]) * _HALF
                    count += np.float32(1)
                    off += measured[line, x] - expected[line, x]
                    bright += light
                    scatter += variance[line, x]
                    steep += across * across + along * along
                    grain += texture[line, x]
                    here = (
                        level_of(cover[0, line, x]),
                        level_of(cover[1, line, x]),
                        level_of(cover[2, line, x]),
                        level_of(cover[3, line, x]),
                    )
                    if here != recipe:
                        add_bells(recipe, alike, bells, shapes)
                        recipe, alike = here, np.float32(0)
                    alike += light
                    for ink in range(INKS):
                        if gain[ink, line, x] == 0 and dot[ink, line, x] == 0:
                            continue
                        area = cover[ink, line, x]
                        sums[GAIN_AT + ink] += gain[ink, line, x]
                        sums[DOT_AT + ink] += dot[ink, line, x]
                        if area > np.float32(0.02):
                            per_area = gain[ink, line, x] / area * _HALF
                            right, left = cover[ink, line, x + 1], cover[ink, line, x - 1]
                            below, above = cover[ink, line + 1, x], cover[ink, line - 1, x]
                            sums[SLOPE_AT + ink] += per_area * (right - left)
                            sums[SLOPE_AT + INKS + ink] += per_area * (below - above)
                add_bells(recipe, alike, bells, shapes)
                sums[0] += count
                sums[1] += off
                sums[2] += bright
                sums[3] += scatter
                sums[4] += steep
                sums[5] += grain
        begin = end
