"""Compiled loops for residuals: block means, subtraction of fitted nuisances, sums of modes over tiles, their noise."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.residuals.fit import LEAST_AREA, LEVELS, SHAPES
from prooflight.kernels.residuals.moving import CELL, STRETCH, any_of
from prooflight.kernels.vectors import FLOAT, GROUP, INT, LONG, Group, Rows, filled, whole_groups

_SAME = np.float32(0.004)
"""Difference of ink areas below which recipes count as one."""
_FLOOR = np.float32(1e-12)
ROOT_OF_2: Final = 2**0.5


class FittedAmounts(NamedTuple):
    """Fitted amounts of every nuisance in one sensor's scan, in single precision."""

    shape: NDArray[np.float32]
    """Weights of bells, the relative change of light by colour, (SHAPES,)."""
    columns: NDArray[np.float32]
    """Relative change of light by column, (pixels,)."""
    gain: NDArray[np.float32]
    """Gain of each ink at the centre, and added at the right and lower edges, (4, 3)."""
    dot: NDArray[np.float32]
    """Dot gain of each ink, (4,)."""
    planes: NDArray[np.float32]
    """Displacement of each plane to the right and down, (4, 2). [pixels]"""


class VarianceShares(NamedTuple):
    """Coefficients of the variance of residuals; see ``variances``."""

    scale: np.float32
    edge: np.float32
    contrast: np.float32
    share: np.float32
    dark: np.float32
    white: np.float32
    """Light of bare paper. [DN]"""


@intrinsic
def weighted_bells(context, bells, weights, levels, shares):  # type: ignore[no-untyped-def]
    """Return the weighted sum of bells; levels, shares: of each ink, the level below its area and what is above it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        factors, weights = (Rows(context, builder, signature.args[n], args[n], SHAPES) for n in (0, 1))
        none, one = ir.Constant(LONG, 0), ir.Constant(LONG, 1)
        product = weights.at(none, none)
        levels, shares = (cgutils.unpack_tuple(builder, args[n]) for n in (2, 3))
        for ink, (level, share) in enumerate(zip(levels, shares, strict=True)):
            place = builder.add(level, ir.Constant(LONG, ink * LEVELS))
            below = factors.at(place, none)
            step = factors.at(builder.add(place, one), none) - below
            product = product * (below + step * Group(builder, filled(builder, share, SHAPES)))
        return product.total()

    return types.float32(bells, weights, levels, shares), generate


@inner_kernel(fastmath=True, error_model="numpy")
def placed_level(area):  # type: ignore[no-untyped-def]
    """Return the tabulated level at or below an ink area, and the remainder above it."""
    at = min(max(area, np.float32(0)), np.float32(1)) * np.float32(LEVELS - 1)
    below = min(np.int32(at), np.int32(LEVELS - 2))
    return np.int64(below), at - np.float32(below)


@inner_kernel(fastmath=True, error_model="numpy")
def shape_of(c, m, y, k, bells, weights):  # type: ignore[no-untyped-def]
    """Return sum over j of weights_j bell_j at ink areas; bells: ``Colours``."""
    at_c, c_share = placed_level(c)
    at_m, m_share = placed_level(m)
    at_y, y_share = placed_level(y)
    at_k, k_share = placed_level(k)
    return weighted_bells(bells, weights, (at_c, at_m, at_y, at_k), (c_share, m_share, y_share, k_share))


@inner_kernel()
def new_recipes(cyan, magenta, yellow, black, inside, out):  # type: ignore[no-untyped-def]
    """Compute which pixels inside differ in any ink from the pixel before them, or have none inside, out (8 n,)."""
    out[0] = inside[0]
    for x in range(1, inside.size):
        same = (cyan[x] == cyan[x - 1]) & (magenta[x] == magenta[x - 1])
        same &= (yellow[x] == yellow[x - 1]) & (black[x] == black[x - 1]) & inside[x - 1]
        out[x] = inside[x] & ~same


@inner_kernel(fastmath=True, error_model="numpy")
def shape_run(cyan, magenta, yellow, black, inside, bells, weights, last, new, out):  # type: ignore[no-untyped-def]
    """Evaluate ``shape_of`` along part of a row of ink areas (pixels,), out (8 n,).

    last (5,): recipe evaluated last, which counts for all that differ by less than ``_SAME``, and its value. new (8 n,)
    is working space, 0 beyond the pixels.
    """
    new_recipes(cyan, magenta, yellow, black, inside, new)
    eights = new.view(np.int64)
    c, m, y, k, value = last[0], last[1], last[2], last[3], last[4]
    for eight in range(eights.size):
        first = 8 * eight
        if eights[eight] == 0:
            out[first : first + 8] = value
            continue
        for x in range(first, first + 8):
            if new[x]:
                by_c, by_m, by_y, by_k = cyan[x] - c, magenta[x] - m, yellow[x] - y, black[x] - k
                if max(max(abs(by_c), abs(by_m)), max(abs(by_y), abs(by_k))) >= _SAME:
                    c, m, y, k = cyan[x], magenta[x], yellow[x], black[x]
                    value = shape_of(c, m, y, k, bells, weights)
            out[x] = value
    last[0], last[1], last[2], last[3], last[4] = c, m, y, k, value


@inner_kernel(fastmath=True, error_model="numpy")
def single_shapes(bells, weights):  # type: ignore[no-untyped-def]
    """Return ``shape_of`` at every level of each ink where there is no other, (4, LEVELS)."""
    out, none = np.empty((INKS, LEVELS), np.float32), np.float32(0)
    for level in range(LEVELS):
        area = np.float32(level) / np.float32(LEVELS - 1)
        out[0, level] = shape_of(area, none, none, none, bells, weights)
        out[1, level] = shape_of(none, area, none, none, bells, weights)
        out[2, level] = shape_of(none, none, area, none, bells, weights)
        out[3, level] = shape_of(none, none, none, area, bells, weights)
    return out


@inner_kernel(fastmath=True, error_model="numpy")
def single_run(areas, inside, values, own, out):  # type: ignore[no-untyped-def]
    """Evaluate ``shape_of`` along part of a row of one ink's areas, out (pixels,), by its values (LEVELS,).

    own: the area evaluated last. Returned: the same after the last pixel.
    """
    for x in range(areas.size):
        own = areas[x] if inside[x] and abs(areas[x] - own) >= _SAME else own
        out[x] = own
    for x in range(areas.size):
        at, share = placed_level(out[x])
        out[x] = values[at] + share * (values[at + 1] - values[at])
    return own


@inner_kernel(error_model="numpy")
def shape_row(cover, line, shown, inside, bells, weights, singles, new, out):  # type: ignore[no-untyped-def]
    """Evaluate ``shape_of`` along a line, out (8 n,), as ``shape_run``, by table where cells show one ink or none.

    shown (4, cells): which cells show each ink; singles: ``single_shapes``.
    """
    end, pixels, cells = 0, inside.size, shown.shape[1]
    last = np.full(5, np.float32(-1))
    while end < cells:
        begin, kind = end, shown_kind(shown, end)
        while end < cells and shown_kind(shown, end) == kind:
            end += 1
        x0, x1 = begin * CELL, min(end * CELL, pixels)
        there, others, ink = inside[x0:x1], np.float32(0), max(kind, 0)
        for i in range(INKS):
            others = others if i == kind else max(others, abs(last[i]))
        if kind < 0:
            if others >= _SAME and any_of(there.view(np.uint8)):
                last[:INKS], last[INKS] = np.float32(0), singles[0, 0]
            out[x0:x1] = last[INKS]
        elif kind < INKS and (others == 0 or others >= _SAME):
            own = last[ink] if others == 0 else np.float32(-1)
            own = single_run(cover[ink, line, x0:x1], there, singles[ink], own, out[x0:x1])
            last[:INKS] = np.float32(0)
            last[ink], last[INKS] = own, out[x1 - 1]
        else:
            c, m, y, k = (
                cover[0, line, x0:x1],
                cover[1, line, x0:x1],
                cover[2, line, x0:x1],
                cover[3, line, x0:x1],
            )
            stop = (x1 + 7) // 8 * 8
            shape_run(c, m, y, k, there, bells, weights, last, new[x0:stop], out[x0:stop])


@inner_kernel()
def shown_kind(shown, cell):  # type: ignore[no-untyped-def]
    """Return which ink alone a cell shows; -1: none, ``INKS``: several."""
    kind = -1
    for ink in range(INKS):
        if shown[ink, cell]:
            kind = ink if kind < 0 else INKS
    return kind


@intrinsic
def take_light(context, measured, expected, columns, line, at, out):  # type: ignore[no-untyped-def]
    """Compute residuals of sixteen pixels without the part proportional to the light, into out (1, w).

    columns (4, w): offset, relative changes of light by column and by colour, and place, -1 left .. 1 right. The
    pixels of a line, from ``at`` on, may extend into the next one.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        scans, lights, columns, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 5)
        )
        line, at = args[3:5]
        offset, by_column, by_colour = (columns.at(ir.Constant(LONG, n), at) for n in range(3))
        light = lights.at(line, at)
        off = scans.converted(line, at) - light - (light - offset) * (by_column + by_colour)
        out.store(ir.Constant(LONG, 0), at, off)
        return context.get_dummy_value()

    return types.void(measured, expected, columns, types.int64, types.int64, out), generate


@intrinsic
def take_ink(context, gain, dot, cover, columns, holds, amounts, line, at, out):  # type: ignore[no-untyped-def]
    """Subtract the effects of one ink from sixteen residuals, in out (1, w).

    holds: whether gain and dot gain hold anything; amounts: gain at the centre of the line and to the right edge, dot
    gain, register right and down; columns, at: as ``take_light``.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        gains, dots, covers, columns, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 3, 8)
        )
        with_gain, with_dot = cgutils.unpack_tuple(builder, args[4])
        at_centre, to_right, by_dot, right, down = (
            Group(builder, filled(builder, amount, GROUP))
            for amount in cgutils.unpack_tuple(builder, args[5])
        )
        (line, at), none = args[6:8], ir.Constant(LONG, 0)
        with cgutils.if_likely(builder, cgutils.as_bool_bit(builder, with_gain)):
            area, (across, along) = covers.at(line, at), covers.slopes(line, at)
            slope = ((across * right + along * down) * 0.5 / area).chosen(area, ">", LEAST_AREA)
            change = columns.at(ir.Constant(LONG, 3), at) * to_right + at_centre - slope
            out.store(none, at, out.at(none, at) - gains.at(line, at) * change)
        with cgutils.if_likely(builder, cgutils.as_bool_bit(builder, with_dot)):
            out.store(none, at, out.at(none, at) - dots.at(line, at) * by_dot)
        return context.get_dummy_value()

    place = types.int64
    return types.void(gain, dot, cover, columns, holds, amounts, place, place, out), generate


@inner_kernel()
def padded(image, line):  # type: ignore[no-untyped-def]
    """Return a line of an image with those above and below it, (3, w): groups may extend beyond their ends."""
    pixels = image.shape[1]
    out = np.zeros((3, pixels + GROUP), np.float32)
    for row in range(3):
        copy_row(image[line - 1 + row], out[row, :pixels])
    return out


@inner_kernel()
def copy_inside(row, inside, margin, out):  # type: ignore[no-untyped-def]
    """Copy a row (pixels or more,) to out (pixels,) where it is inside; 0 elsewhere and in margins at its ends."""
    for x in range(out.size):
        out[x] = row[x] if inside[x] else np.float32(0)
    out[:margin] = out[out.size - margin :] = np.float32(0)


@kernel(
    "measured (L, P), expected (L, P), offset (P), inside (L, P), inks.gain (4, L, P), inks.dot (4, L, P), "
    "inks.cover (4, L, P), inks.shown (3, 4, (L + STRETCH - 1) // STRETCH, (P + CELL - 1) // CELL), "
    "bells (4, LEVELS, SHAPES), fitted.shape (SHAPES), fitted.columns (P), fitted.gain (4, 3), fitted.dot (4), "
    "fitted.planes (4, 2), first, last, out (L, P)",
    where="0 <= first, last <= L, 2 * P >= GROUP",
    fastmath=True,
    error_model="numpy",
)
def residuals(  # type: ignore[no-untyped-def]
    measured, expected, offset, inside, inks, bells, fitted, first, last, out
):
    """Compute residuals of one sensor's scan after the fitted nuisances, (lines, pixels) [DN]; 0 outside.

    inks: ``InkImages``; bells: as ``block_sums``; fitted: ``FittedAmounts``. Lines first .. last - 1 are
    written.
    """
    lines, pixels = measured.shape
    gain, dot, cover, shown = inks.gain, inks.dot, inks.cover, inks.shown
    weights, by_column, gains, dots, planes = fitted
    wide, cells = whole_groups(pixels), shown.shape[3]
    columns, row = np.zeros((4, wide), np.float32), np.empty((1, wide), np.float32)
    copy_row(offset, columns[0, :pixels])
    copy_row(by_column, columns[1, :pixels])
    for x in range(pixels):
        columns[3, x] = np.float32(2 * x + 1) / np.float32(pixels) - np.float32(1)
    singles = single_shapes(bells, weights)
    new = np.zeros((pixels + 7) // 8 * 8, np.bool_)
    for line in range(first, last):
        if line == 0 or line == lines - 1:
            out[line] = np.float32(0)
            continue
        here = shown[:, :, line // STRETCH]
        shape_row(cover, line, here[2], inside[line], bells, weights, singles, new, columns[2])
        for at in range(0, pixels, GROUP):
            take_light(measured, expected, columns, line, at, row)
        v = np.float32(2 * (line + 0.5) / lines - 1)
        for ink in range(INKS):
            # One ink after the other: the lines of all at once evict each other from the cache.
            own, at_line = (gain[ink], dot[ink], cover[ink]), line
            if line == lines - 2:
                own, at_line = (padded(own[0], line), padded(own[1], line), padded(own[2], line)), 1
            at_centre = gains[ink, 0] + gains[ink, 2] * v
            amounts = at_centre, gains[ink, 1], dots[ink], planes[ink, 0], planes[ink, 1]
            for cell in range(cells):
                holds = here[0, ink, cell], here[1, ink, cell]
                if holds[0] or holds[1]:
                    for at in range(cell * CELL, min((cell + 1) * CELL, pixels), GROUP):
                        take_ink(own[0], own[1], own[2], columns, holds, amounts, at_line, at, row)
        copy_inside(row[0], inside[line], 1, out[line])


_LOGARITHM = (
    7.0376836292e-2,
    -1.1514610310e-1,
    1.1676998740e-1,
    -1.2420140846e-1,
    1.4249322787e-1,
    -1.6668057665e-1,
    2.0000714765e-1,
    -2.4999993993e-1,
    3.3333331174e-1,
)
"""Coefficients of the third and higher powers of f in the logarithm of 1 + f, the highest first (Cephes, logf)."""


def logarithm(builder: Any, number: Group) -> Group:
    """Return natural logarithms of positive numbers, to one or two ulp.

    A number is 2^k (1 + f), f between -0.3 and 0.42, the logarithm of 1 + f a polynomial.
    """
    whole = ir.VectorType(INT, number.size)

    def constant(value: int) -> Any:
        return ir.Constant(whole, [value] * number.size)

    bits = builder.bitcast(number.value, whole)
    fraction = builder.or_(builder.and_(bits, constant(0x7FFFFF)), constant(0x3F800000))
    rest = Group(builder, builder.bitcast(fraction, number.value.type))
    exponent = builder.sub(builder.lshr(bits, constant(23)), constant(127))
    power = Group(builder, builder.sitofp(exponent, number.value.type)) + rest.above(ROOT_OF_2)
    f = (rest * 0.5).chosen(rest, ">", ROOT_OF_2, rest) - 1.0
    y = f * _LOGARITHM[0] + _LOGARITHM[1]
    for coefficient in _LOGARITHM[2:]:
        y = y * f + coefficient
    square = f * f
    return y * f * square - power * 2.12194440e-4 - square * 0.5 + f + power * 0.693359375


@intrinsic
def inverse_variance(context, light, variance, texture, squares, shares, line, at, out):  # type: ignore[no-untyped-def]
    """Compute the inverse variance of sixteen pixels from ``at`` on and the edges' share of it, into out (2, w).

    squares (3, w): squared slopes of the lines about this one, from ``GROUP`` pixels before them on; shares:
    ``VarianceShares``. The pixels may extend into the next line.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        lights, variances, textures, slopes, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 3, 7)
        )
        scale, edge, contrast, share, dark, white = (
            Group(builder, filled(builder, number, GROUP))
            for number in cgutils.unpack_tuple(builder, args[4])
        )
        (line, at), one = args[5:7], Group(builder, filled(builder, FLOAT(1.0), GROUP))
        columns = [
            slopes.at(ir.Constant(LONG, n), builder.add(at, ir.Constant(LONG, GROUP + by)))
            for n in range(3)
            for by in (-1, 0, 1)
        ]
        steep = edge * (sum(columns[1:], columns[0]) * (1 / 9))
        light = lights.at(line, at)
        depth = logarithm(builder, white / light.at_least(white * 0.01).at_most(white))
        rest = scale * variances.at(line, at) + steep + contrast * textures.at(line, at)
        level, at_white = (share + dark * depth * depth) * light, share * light
        # The additional variance of dark pixels must not make them count as flat.
        parts = one / (rest + level * level), steep / (rest + at_white * at_white)
        for n, part in enumerate(parts):
            out.store(ir.Constant(LONG, n), at, part)
        return context.get_dummy_value()

    place = types.int64
    return types.void(light, variance, texture, squares, shares, place, place, out), generate


@intrinsic
def square_slopes(context, light, line, at, row, out):  # type: ignore[no-untyped-def]
    """Compute squared slopes of the light of sixteen pixels from ``at`` on, into a row of out (3, w)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        lights, out = (Rows(context, builder, signature.args[n], args[n]) for n in (0, 4))
        across, along = (slope * 0.5 for slope in lights.slopes(args[1], args[2]))
        out.store(args[3], builder.add(args[2], ir.Constant(LONG, GROUP)), across * across + along * along)
        return context.get_dummy_value()

    place = types.int64
    return types.void(light, place, place, place, out), generate


@inner_kernel()
def square_row(light, line, squares):  # type: ignore[no-untyped-def]
    """Compute squared slopes of a line of light for ``inverse_variance``, into row ``line`` % 3; 0 at its ends."""
    pixels, row, at_line = light.shape[1], line % 3, line
    if line == light.shape[0] - 2:
        light, at_line = padded(light, line), 1
    for at in range(0, pixels, GROUP):
        square_slopes(light, at_line, at, row, squares)
    squares[row, GROUP] = squares[row, GROUP + pixels - 1] = np.float32(0)


@kernel(
    "light (L, P), variance (L, P), texture (L, P), inside (L, P), shares, first, last, out (L, P), of_edges (L, P)",
    where="0 <= first, last <= L, 2 * P >= GROUP",
    error_model="numpy",
)
def variances(  # type: ignore[no-untyped-def]
    light, variance, texture, inside, shares, first, last, out, of_edges
):
    """Compute the inverse variance of residuals of one sensor [1/DN^2], and the edges' share of variance; 0 outside.

    Written: (lines, pixels) each, lines first .. last - 1. The variance is scale x temporal variance + edge x
    mean squared slope over 3 x 3 pixels + contrast x texture + (s x light)^2, s = share + dark x log(white /
    light)^2; shares: ``VarianceShares``. The additional variance of dark pixels is left out of the edges'
    share.
    """
    lines, pixels = light.shape
    wide = whole_groups(pixels)
    squares, rows = np.zeros((3, GROUP + wide + GROUP), np.float32), np.empty((2, wide), np.float32)
    begin = max(first, 2)
    for line in range(first, last):
        if line < 2 or line >= lines - 2:
            out[line] = of_edges[line] = np.float32(0)
            continue
        for near in range(line - 1 if line == begin else line + 1, line + 2):
            square_row(light, near, squares)
        for at in range(0, pixels, GROUP):
            inverse_variance(light, variance, texture, squares, shares, line, at, rows)
        copy_inside(rows[0], inside[line], 2, out[line])
        copy_inside(rows[1], inside[line], 2, of_edges[line])


@kernel(
    "residual (L, P), weight (L, P), before (L, P), after (L, P), first, last",
    where="0 <= first, last <= L",
    error_model="numpy",
)
def predict_again(residual, weight, before, after, first, last):  # type: ignore[no-untyped-def]
    """Change residuals of one sensor from the expectation ``before`` to ``after``, in place, on some lines.

    Lines first .. last - 1 are written.
    """
    for line in range(first, last):
        for x in range(residual.shape[1]):
            change = after[line, x] - before[line, x]
            residual[line, x] -= change if weight[line, x] > 0 else np.float32(0)


@inner_kernel(fastmath=True, error_model="numpy")
def add_gains(residual, weight, light, push, power):  # type: ignore[no-untyped-def]
    """Add a row's evidence of its columns' gains to push and power (pixels,); residuals are limited to 3 sigma."""
    for x in range(push.size):
        r, w, bright = residual[x], weight[x], light[x]
        weighted = bright * w
        push[x] += weighted * r * min(np.float32(1), np.float32(3) / np.sqrt(r * r * w + _FLOOR))
        power[x] += weighted * bright


@kernel(
    "residual (L, P), weight (L, P), light (L, P), prior_power, first, last, out (P)",
    where="0 <= first, last <= P",
    fastmath=True,
    error_model="numpy",
)
def column_gains(residual, weight, light, prior_power, first, last, out):  # type: ignore[no-untyped-def]
    """Estimate the relative gain of each column of one sensor from its residuals, (pixels,) [-].

    prior_power: 1 / prior variance. Pixels first .. last - 1 are written.
    """
    gains = out[first:last]
    power = np.full(gains.size, prior_power)
    gains[:] = 0
    for line in range(2, residual.shape[0] - 2):
        add_gains(residual[line, first:last], weight[line, first:last], light[line, first:last], gains, power)
    for x in range(gains.size):
        gains[x] /= power[x]


@kernel(
    "residual (L, P), weight (L, P), light (L, P), gains (P), first, last",
    where="0 <= first, last <= L",
    fastmath=True,
    error_model="numpy",
)
def take_columns(residual, weight, light, gains, first, last):  # type: ignore[no-untyped-def]
    """Subtract column gains (pixels,) from one sensor's residuals, in place, in lines first .. last - 1."""
    pixels = residual.shape[1]
    for line in range(first, last):
        for x in range(pixels):
            if weight[line, x] > 0:
                residual[line, x] -= light[line, x] * gains[x]


@inner_kernel()
def all_inside(inside, line, out):  # type: ignore[no-untyped-def]
    """Compute whether each pixel of a line and all its neighbours are inside (lines, pixels), out (pixels,); 1 or 0."""
    bits = inside.view(np.uint8)
    above, here, below = bits[max(line - 1, 0)], bits[line], bits[min(line + 1, bits.shape[0] - 1)]
    last = out.size - 1
    for x in range(out.size):
        out[x] = above[x] & here[x] & below[x]
    before = out[0]
    for x in range(out.size):
        own = out[x]
        out[x] = before & own & out[min(x + 1, last)]
        before = own


@kernel(
    "left (L, P), variance (L, P), light (L, P), texture (L, P), inside (L, P), steepest, "
    "squares (2, (L // 2) * (P // 2))",
    error_model="numpy",
)
def flat_squares(left, variance, light, texture, inside, steepest, squares):  # type: ignore[no-untyped-def]
    """Compute second differences of residuals in flat squares of 2 x 2 pixels; return the number of squares.

    Written to squares (2, squares): squared second difference over four times the stated variance, and texture
    over that variance. r[i, j] - r[i + 1, j] - r[i, j + 1] + r[i + 1, j + 1] is free of columns' gains and
    lines' flicker. A square is flat if its first pixel and all neighbours of that are inside, and light
    changes over the diagonal by less than ``steepest`` standard deviations.
    """
    lines, pixels = left.shape
    there = np.empty(pixels, np.uint8)
    most, count = np.float32(steepest * steepest), 0
    for line in range(0, lines - 1, 2):
        all_inside(inside, line, there)
        for x in range(0, pixels - 1, 2):
            stated, step = variance[line, x], light[line + 1, x + 1] - light[line, x]
            if there[x] and step * step < most * stated:
                crossed = left[line, x] - left[line, x + 1] - left[line + 1, x] + left[line + 1, x + 1]
                squares[0, count] = crossed * crossed / (np.float32(4) * stated)
                squares[1, count] = texture[line, x] / stated
                count += 1
    return count
