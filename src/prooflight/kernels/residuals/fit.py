"""Compiled loops of the nuisance fit: means over blocks, and a page's smooth functions of colour by table."""

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
from prooflight.kernels.residuals.moving import CELL, STRETCH
from prooflight.kernels.vectors import FLOAT, INT, LONG, Group, Rows, filled, number_at, sums_of_lines

SHAPES = 16
"""Greatest number of features of colour; those that a page does not have are 0."""
LEVELS = 256
"""Levels of ink area, by which bells are tabulated."""
GAIN_AT, DOT_AT, SHAPE_AT = 6, 6 + INKS, 6 + 2 * INKS
"""First columns of ``block_sums``: inks' gains and dot gains, bells; before these, single numbers."""
SLOPE_AT = SHAPE_AT + SHAPES
"""First column of planes' slopes across, then along."""
SUMS = SLOPE_AT + 2 * INKS
EIGHT = 8
"""Side of a block. [pixels]"""
LEAST_AREA: Final = 0.02
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
    """Whether ``CELL`` pixels of ``STRETCH`` lines of each ink's gain, dot gain and area show anything, (3, 4, ., .).
    Where gain or dot gain do not, their image may hold anything."""


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


@intrinsic
def sum_bells(context, recipes, light, bells, shapes):  # type: ignore[no-untyped-def]
    """Compute the sums of the bells of packed recipes (n,) times their light (n,), into shapes (SHAPES,)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        recipes, lights, factors, out = (
            Rows(context, builder, signature.args[n], args[n], SHAPES) for n in range(4)
        )

        def terms(pixel: Any) -> list[Group]:
            recipe = builder.zext(builder.load(number_at(builder, recipes.data, pixel)), LONG)
            light = builder.load(number_at(builder, lights.data, pixel))
            product = Group(builder, filled(builder, light, SHAPES))
            for ink in range(INKS):
                level = builder.and_(builder.lshr(recipe, ir.Constant(LONG, 8 * ink)), ir.Constant(LONG, 255))
                place = builder.add(level, ir.Constant(LONG, ink * LEVELS))
                product = product * factors.at(place, ir.Constant(LONG, 0))
            return [product]

        none = ir.Constant(LONG, 0)
        (total,) = sums_of_lines(builder, none, recipes.pixels, terms, 1, SHAPES)
        out.store(none, none, total)
        return context.get_dummy_value()

    return types.void(recipes, light, bells, shapes), generate


@inner_kernel()
def any_ink(recipes):  # type: ignore[no-untyped-def]
    """Return whether any of packed recipes (n,) has ink."""
    bits = np.int32(0)
    for x in range(recipes.size):
        bits |= recipes[x]
    return bits != 0


@intrinsic
def sum_light(  # type: ignore[no-untyped-def]
    context, measured, inside, columns, expected, variance, texture, top, first, last, at, light, sums
):
    """Sum up what does not depend on inks over a block, lines first .. last - 1, into the first of ``block_sums``.

    columns (2, w): 1 at columns that count, else 0, and their offset; light (lines, 8) is written from ``top`` on, 0
    where it does not count.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        scans, counts, columns, lights, variances, textures, bright = (
            Rows(context, builder, signature.args[n], args[n], EIGHT) for n in (0, 1, 2, 3, 4, 5, 10)
        )
        (top, first, last, at), none = args[6:10], ir.Constant(LONG, 0)
        within, offset = columns.at(none, at), columns.at(ir.Constant(LONG, 1), at)

        def terms(line: Any) -> list[Group]:
            count, expected = counts.converted(line, at) * within, lights.at(line, at)
            light = (expected - offset) * count
            bright.store(builder.sub(line, top), none, light)
            across, along = lights.slopes(line, at)
            steep = (across * across + along * along) * 0.25
            off = scans.converted(line, at) - expected
            others = off, variances.at(line, at), steep, textures.at(line, at)
            off, variance, steep, texture = (other * count for other in others)
            return [count, off, light, variance, steep, texture]

        out = Rows(context, builder, signature.args[11], args[11])
        for n, total in enumerate(sums_of_lines(builder, first, last, terms, GAIN_AT, EIGHT)):
            builder.store(total.total(), number_at(builder, out.data, ir.Constant(LONG, n)))
        return context.get_dummy_value()

    place = types.int64
    taken = measured, inside, columns, expected, variance, texture, place, place, place, place
    return types.void(*taken, light, sums), generate


@intrinsic
def sum_ink(  # type: ignore[no-untyped-def]
    context, gain, dot, cover, inside, columns, shown, ink, first, last, at, sums
):
    """Sum up one ink's effects and the slopes of its plane over a block, lines first .. last - 1, into ``block_sums``.

    shown: whether gain and dot gain hold anything, 1 or 0; columns: as ``sum_light``.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        gains, dots, covers, counts, columns, out = (
            Rows(context, builder, signature.args[n], args[n], EIGHT) for n in (0, 1, 2, 3, 4, 10)
        )
        with_gain, with_dot = (
            Group(builder, filled(builder, one, EIGHT)) for one in cgutils.unpack_tuple(builder, args[5])
        )
        ink, first, last, at = args[6:10]
        within = columns.at(ir.Constant(LONG, 0), at)

        def terms(line: Any) -> list[Group]:
            count, area = counts.converted(line, at) * within, covers.at(line, at)
            gain = (gains.at(line, at) * count).chosen(with_gain, ">", 0.0)
            dot = (dots.at(line, at) * count).chosen(with_dot, ">", 0.0)
            per_area = (gain * 0.5 / area).chosen(area, ">", LEAST_AREA)
            across, along = covers.slopes(line, at)
            return [gain, dot, per_area * across, per_area * along]

        parts = GAIN_AT, DOT_AT, SLOPE_AT, SLOPE_AT + INKS
        for part, total in zip(parts, sums_of_lines(builder, first, last, terms, 4, EIGHT), strict=True):
            place = builder.add(ink, ir.Constant(LONG, part))
            builder.store(total.total(), number_at(builder, out.data, place))
        return context.get_dummy_value()

    place = types.int64
    taken = gain, dot, cover, inside, columns, shown, place, place, place, place
    return types.void(*taken, sums), generate


@intrinsic
def add_levels(context, cover, shift, top, first, last, at, recipes):  # type: ignore[no-untyped-def]
    """Add the nearest levels of an ink's areas in a block to packed recipes (lines, 8), from bit ``shift`` on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        (shift, top, first, last, at), none = args[1:6], ir.Constant(LONG, 0)
        covers = Rows(context, builder, signature.args[0], args[0], EIGHT)
        packed = Rows(context, builder, signature.args[6], args[6], EIGHT)
        whole = ir.VectorType(INT, EIGHT)
        spread = ir.Constant(whole, [0] * EIGHT)
        by = builder.insert_element(spread, builder.trunc(shift, INT), ir.Constant(INT, 0))
        by = builder.shuffle_vector(by, by, spread)
        with cgutils.for_range_slice(builder, first, last, ir.Constant(LONG, 1)) as (line, _):
            level = covers.at(line, at).at_least(0.0).at_most(1.0) * (LEVELS - 1.0) + 0.5
            place = builder.sub(line, top)
            before = builder.bitcast(packed.at(place, none).value, whole)
            recipe = builder.or_(before, builder.shl(builder.fptosi(level.value, whole), by))
            packed.store(place, none, Group(builder, builder.bitcast(recipe, ir.VectorType(FLOAT, EIGHT))))
        return context.get_dummy_value()

    place = types.int64
    return types.void(cover, place, place, place, place, place, recipes), generate


@kernel(
    "measured (L, P), expected (L, P), offset (P), variance (L, P), inks.gain (4, L, P), inks.dot (4, L, P), "
    "inks.texture (L, P), inks.cover (4, L, P), "
    "inks.shown (3, 4, (L + STRETCH - 1) // STRETCH, (P + CELL - 1) // CELL), inside (L, P), "
    "bells (4, LEVELS, SHAPES), corners (N, 2), out (N, SUMS)",
    fastmath=True,
    error_model="numpy",
)
def block_sums(  # type: ignore[no-untyped-def]
    measured, expected, offset, variance, inks, inside, bells, corners, out
):
    """Compute sums over some blocks of ``EIGHT`` x ``EIGHT`` pixels of one sensor, into out (blocks, SUMS).

    inks: ``InkImages``. corners (blocks, 2): first line and column of whole blocks, in order, multiples of ``EIGHT``.
    bells (4, LEVELS, SHAPES): factors of each bell by ink, whose product is exp(-|a - centre|^2 / length^2). Columns
    of out: pixels inside, residual, light, variance, squared slope of light, texture, ink gains (4), dot gains (4),
    bells times light, plane slopes across (4) and along (4).
    """
    lines, pixels = measured.shape
    gain, dot, texture, cover, shown = inks
    columns = np.ones((2, pixels), np.float32)
    columns[0, 0] = columns[0, pixels - 1] = np.float32(0)
    copy_row(offset, columns[1])
    bare = bells[0, 0] * bells[1, 0] * bells[2, 0] * bells[3, 0]
    light, recipes = np.empty((EIGHT, EIGHT), np.float32), np.empty((EIGHT, EIGHT), np.int32)
    out[:] = np.float32(0)
    row = np.int64(-1)
    for block in range(corners.shape[0]):
        top, at = corners[block]
        strip, cell, sums = top // STRETCH, at // CELL, out[block]
        first, last = max(top, 1), min(top + EIGHT, lines - 1)
        if top != row:
            row = top
            light[:] = np.float32(0)
        sum_light(measured, inside, columns, expected, variance, texture, top, first, last, at, light, sums)
        printed = False
        for ink in range(INKS):
            if shown[2, ink, strip, cell]:
                if not printed:
                    recipes[:] = np.int32(0)
                    printed = True
                add_levels(cover[ink], 8 * ink, top, first, last, at, recipes)
            of_gain, of_dot = shown[0, ink, strip, cell], shown[1, ink, strip, cell]
            if of_gain or of_dot:
                sum_ink(
                    gain[ink],
                    dot[ink],
                    cover[ink],
                    inside,
                    columns,
                    (np.float32(of_gain), np.float32(of_dot)),
                    ink,
                    first,
                    last,
                    at,
                    sums,
                )
        if printed and any_ink(recipes.reshape(-1)):
            sum_bells(recipes.reshape(-1), light.reshape(-1), bells, sums[SHAPE_AT:SLOPE_AT])
        else:
            for j in range(SHAPES):
                sums[SHAPE_AT + j] = bare[j] * sums[2]
