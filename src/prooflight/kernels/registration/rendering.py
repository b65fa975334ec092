"""Compiled core of tile rendering: sums across a tile for eight columns of four lines, kept in registers.

A camera pixel's phase among raster pixels changes from column to column, so columns have weights of their
own: a small table of the weights of each raster pixel in each of eight columns. Nothing then needs to be
transposed or gathered. Four lines share the weights that are read, and their sums do not wait for each other.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.vectors import FLOAT, FUSED, LONG, filled, number_at, vector_at

EIGHT, FOUR = 8, 4
_PIXELS = ir.VectorType(FLOAT, EIGHT)


@intrinsic
def sum_eight(  # type: ignore[no-untyped-def]
    context, values, tilts, begin, width, weights, slopes, first, count, out, by_x, by_y, at, columns
):
    """Compute eight columns of four lines: sums over k < count, k from ``begin`` on in values, tilts (n,) float32.

    out[at:at + 8] of weights x values, by_x of slopes x values, by_y of weights x tilts; weights, slopes (n,)
    float32 hold eight numbers for each k, from 8 x first on. out, by_x, by_y (n,) float32. Lines are ``width``
    apart in values and tilts, ``columns`` in out, by_x and by_y.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values, tilts, weights, slopes, *targets = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 4, 5, 8, 9, 10)
        )
        begin, width, first, count, at, columns = (args[n] for n in (2, 3, 6, 7, 11, 12))
        none = ir.Constant(_PIXELS, [ir.Constant(FLOAT, 0.0)] * EIGHT)
        totals = [[cgutils.alloca_once_value(builder, none) for _ in targets] for _ in range(FOUR)]

        def of_line(start: Any, pitch: Any, line: int) -> Any:
            return builder.add(start, builder.mul(pitch, ir.Constant(LONG, line)))

        def add(total: Any, one: Any, other: Any) -> None:
            product = builder.fmul(one, other, flags=FUSED)
            builder.store(builder.fadd(product, builder.load(total), flags=FUSED), total)

        with cgutils.for_range(builder, count) as loop:
            row = builder.mul(builder.add(first, loop.index), ir.Constant(LONG, EIGHT))
            weight, slope = (
                builder.load(vector_at(builder, table, row, EIGHT), align=4) for table in (weights, slopes)
            )
            for line, (total, total_x, total_y) in enumerate(totals):
                place = of_line(builder.add(begin, loop.index), width, line)
                value, tilt = (
                    filled(builder, builder.load(number_at(builder, array, place)), EIGHT)
                    for array in (values, tilts)
                )
                add(total, weight, value)
                add(total_x, slope, value)
                add(total_y, weight, tilt)
        for line, of_targets in enumerate(totals):
            for target, total in zip(targets, of_targets, strict=True):
                place = vector_at(builder, target, of_line(at, columns, line), EIGHT)
                builder.store(builder.load(total), place, align=4)
        return context.get_dummy_value()

    whole = types.int64
    kinds = (values, tilts, whole, whole, weights, slopes, whole, whole, out, by_x, by_y, whole, whole)
    return types.void(*kinds), generate
