"""Compiled loops of the nuisance fit: means over blocks, and a page's smooth functions of colour by table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.residuals.moving import STRETCH

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
_LEAST_AREA = np.float32(0.02)
"""Ink area below which a plane's slope is not known."""


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
    shown: NDArray[np.bool_]
    """Whether ``STRETCH`` lines of each ink's gain, dot gain and area show anything, (3, 4, strips). Where gain or dot
    gain do not, their image may hold anything."""


@inner_kernel()
def shows(row):  # type: ignore[no-untyped-def]
    """Return whether anything in a row (pixels,) is not 0, tested in vectors; the sign of a 0 does not count."""
    bits, bits_set = row.view(np.int32), np.int32(0)
    for x in range(bits.size):
        bits_set |= np.int32(bits[x] << np.int32(1))
    return bits_set != 0


@inner_kernel(fastmath=True, error_model="numpy")
def sum_of(row):  # type: ignore[no-untyped-def]
    """Return the sum of a row (n,)."""
    total = np.float32(0)
    for x in range(row.size):
        total += row[x]
    return total


@inner_kernel(fastmath=True, error_model="numpy")
def add_levels(area, shift, recipe):  # type: ignore[no-untyped-def]
    """Add the nearest levels of a row of an ink's areas to packed recipes (pixels,), from bit ``shift`` on."""
    for x in range(area.size):
        level = min(max(area[x], np.float32(0)), np.float32(1)) * _MOST + _HALF
        recipe[x] |= np.int32(np.int32(level) << shift)


@inner_kernel(fastmath=True, error_model="numpy")
def add_bells(recipe, light, bells, shapes):  # type: ignore[no-untyped-def]
    """Add bells of one packed recipe times light to shapes (SHAPES,)."""
    c, m = bells[0, recipe & 255], bells[1, (recipe >> 8) & 255]
    y, k = bells[2, (recipe >> 16) & 255], bells[3, (recipe >> 24) & 255]
    for j in range(SHAPES):
        shapes[j] += c[j] * m[j] * y[j] * k[j] * light


@inner_kernel(fastmath=True, error_model="numpy")
def add_runs(recipes, light, bells, shapes):  # type: ignore[no-untyped-def]
    """Add bells of the recipes of a few pixels times their light to shapes, once for equal neighbours."""
    recipe, alike = np.int32(0), np.float32(0)
    for x in range(recipes.size):
        if recipes[x] != recipe:
            add_bells(recipe, alike, bells, shapes)
            recipe, alike = recipes[x], np.float32(0)
        alike += light[x]
    add_bells(recipe, alike, bells, shapes)


@inner_kernel(fastmath=True, error_model="numpy")
def add_product(row, share, sums):  # type: ignore[no-untyped-def]
    """Add a row times a share of each pixel to sums (pixels,)."""
    for x in range(sums.size):
        sums[x] += row[x] * share[x]


@inner_kernel(fastmath=True, error_model="numpy")
def add_light(measured, expected, offset, there, light, sums):  # type: ignore[no-untyped-def]
    """Add a line's number of pixels, residuals, light and squared slopes to sums, rows of ``block_sums``.

    expected: the line above, this one and the next; there (pixels,): 1 at pixels that count, else 0. Written: light
    (pixels,), 0 where it does not count. Factors instead of conditions, under which loops do not run in vectors.
    """
    above, here, below = expected
    count, off, bright, steep = sums[0], sums[1], sums[2], sums[4]
    for x in range(light.size):
        count[x] += there[x]
    for x in range(light.size):
        off[x] += (measured[x] - here[x]) * there[x]
    for x in range(light.size):
        light[x] = (here[x] - offset[x]) * there[x]
    for x in range(light.size):
        bright[x] += light[x]
    for x in range(1, light.size - 1):
        across, along = (here[x + 1] - here[x - 1]) * _HALF, (below[x] - above[x]) * _HALF
        steep[x] += (across * across + along * along) * there[x]


@inner_kernel(fastmath=True, error_model="numpy")
def add_ink(gain, dot, areas, there, per_area, ink, sums):  # type: ignore[no-untyped-def]
    """Add a line's effects of one ink and the slopes of its plane to sums, rows of ``block_sums``.

    areas: of the ink in the line above, this one and the next; per_area (pixels,) is working space.
    """
    above, here, below = areas
    add_product(gain, there, sums[GAIN_AT + ink])
    add_product(dot, there, sums[DOT_AT + ink])
    across, along = sums[SLOPE_AT + ink], sums[SLOPE_AT + INKS + ink]
    for x in range(per_area.size):
        share = gain[x] / max(here[x], _LEAST_AREA) * _HALF
        per_area[x] = share * there[x] * np.float32(here[x] > _LEAST_AREA)
    for x in range(1, per_area.size - 1):
        across[x] += per_area[x] * (here[x + 1] - here[x - 1])
    for x in range(per_area.size):
        along[x] += per_area[x] * (below[x] - above[x])


@kernel(
    "measured (L, P), expected (L, P), offset (P), variance (L, P), inks.gain (4, L, P), inks.dot (4, L, P), "
    "inks.texture (L, P), inks.cover (4, L, P), inks.shown (3, 4, (L + STRETCH - 1) // STRETCH), inside (L, P), "
    "bells (4, LEVELS, SHAPES), corners (N, 2), side, out (N, SUMS)",
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

    Lines are summed up whole, in vectors, although not all of their blocks are used.
    """
    lines, pixels = measured.shape
    gain, dot, texture, cover, shown = inks
    sums, bare = np.empty((SUMS, pixels), np.float32), np.empty(pixels, np.float32)
    recipe, light, room = (
        np.empty(pixels, np.int32),
        np.empty(pixels, np.float32),
        np.empty(pixels, np.float32),
    )
    there, blank, used = np.zeros(pixels, np.float32), np.zeros(pixels, np.float32), np.empty(SUMS, np.bool_)
    out[:] = np.float32(0)
    begin = 0
    while begin < corners.shape[0]:
        top, end = corners[begin, 0], begin
        while end < corners.shape[0] and corners[end, 0] == top:
            end += 1
        used[:] = False
        used[:GAIN_AT] = True
        sums[:GAIN_AT] = np.float32(0)
        bare[:] = np.float32(0)
        for line in range(max(top, 1), min(top + side, lines - 1)):
            strip = line // STRETCH
            for x in range(1, pixels - 1):
                there[x] = inside[line, x]
            near = expected[line - 1], expected[line], expected[line + 1]
            add_light(measured[line], near, offset, there, light, sums)
            add_product(variance[line], there, sums[3])
            add_product(texture[line], there, sums[5])
            recipe[:] = np.int32(0)
            printed = False
            for ink in range(INKS):
                if shown[2, ink, strip] and shows(cover[ink, line]):
                    printed = True
                    add_levels(cover[ink, line], np.int32(8 * ink), recipe)
                if not (shown[0, ink, strip] or shown[1, ink, strip]):
                    continue
                for part in (GAIN_AT, DOT_AT, SLOPE_AT, SLOPE_AT + INKS):
                    if not used[part + ink]:
                        used[part + ink] = True
                        sums[part + ink] = np.float32(0)
                own_gain = gain[ink, line] if shown[0, ink, strip] else blank
                own_dot = dot[ink, line] if shown[1, ink, strip] else blank
                areas = cover[ink, line - 1], cover[ink, line], cover[ink, line + 1]
                add_ink(own_gain, own_dot, areas, there, room, ink, sums)
            if not printed:
                for x in range(pixels):
                    bare[x] += light[x]
                continue
            for block in range(begin, end):
                across = slice(corners[block, 1], corners[block, 1] + side)
                add_runs(recipe[across], light[across], bells, out[block, SHAPE_AT:SLOPE_AT])
        for block in range(begin, end):
            across = slice(corners[block, 1], corners[block, 1] + side)
            add_bells(np.int32(0), sum_of(bare[across]), bells, out[block, SHAPE_AT:SLOPE_AT])
            for part in range(SUMS):
                if used[part]:
                    out[block, part] = sum_of(sums[part, across])
        begin = end
