"""Compiled core of tile rendering: sums across a tile for eight columns at once, kept in registers.

A camera pixel's phase among raster pixels changes from column to column, so columns have weights of their
own: a small table of the weights of each raster pixel in each of eight columns. Nothing then needs to be
transposed or gathered.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.vectors import FLOAT, FUSED, LONG, filled, number_at, vector_at

EIGHT = 8
_PIXELS = ir.VectorType(FLOAT, EIGHT)


@intrinsic
def sum_eight(context, values, tilts, begin, weights, slopes, first, count, out, by_x, by_y, at):  # type: ignore[no-untyped-def]
    """Compute eight columns of a line: sums over k < count, k from ``begin`` on in values, tilts (n,) float32.

    out[at:at + 8] of weights x values, by_x of slopes x values, by_y of weights x tilts; weights, slopes (n,)
    float32 hold eight numbers for each k, from 8 x first on. out, by_x, by_y (n,) float32.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values, tilts, weights, slopes, *targets = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 4, 7, 8, 9)
        )
        begin, first, count, at = (args[n] for n in (2, 5, 6, 10))
        none = ir.Constant(_PIXELS, [ir.Constant(FLOAT, 0.0)] * EIGHT)
        totals = [cgutils.alloca_once_value(builder, none) for _ in targets]

        def add(total: Any, one: Any, other: Any) -> None:
            product = builder.fmul(one, other, flags=FUSED)
            builder.store(builder.fadd(product, builder.load(total), flags=FUSED), total)

        with cgutils.for_range(builder, count) as loop:
            place = builder.add(begin, loop.index)
            value = filled(builder, builder.load(number_at(builder, values, place)), EIGHT)
            tilt = filled(builder, builder.load(number_at(builder, tilts, place)), EIGHT)
            row = builder.mul(builder.add(first, loop.index), ir.Constant(LONG, EIGHT))
            weight, slope = (
                builder.load(vector_at(builder, table, row, EIGHT), align=4) for table in (weights, slopes)
            )
            add(totals[0], weight, value)
            add(totals[1], slope, value)
            add(totals[2], weight, tilt)
        for target, total in zip(targets, totals, strict=True):
            builder.store(builder.load(total), vector_at(builder, target, at, EIGHT), align=4)
        return context.get_dummy_value()

    whole = types.int64
    kinds = (values, tilts, whole, weights, slopes, whole, whole, out, by_x, by_y, whole)
    return types.void(*kinds), generate
