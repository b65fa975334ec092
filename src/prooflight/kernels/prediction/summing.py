"""Compiled core of filtering: weighted sums of some pixels, kept in registers until they are complete."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.vectors import FLOAT, FUSED, INT, LONG, filled, number_at, vector_at

FEWEST, FEW, MANY = 8, 16, 64
EIGHT = FEWEST
GROUP = 16
"""Raster columns that are summed up along at once."""


def summing(count: int) -> Any:
    """Return the intrinsic for so many pixels at once."""
    pixels = ir.VectorType(FLOAT, count)

    @intrinsic
    def sum_pixels(context, source, starts, further, weights, first, last, out, at):  # type: ignore[no-untyped-def]
        """Set out[at + i] = sum over t of weights[t] source[starts[t] + further + i].

        i < count, t from first to last - 1; source, out (n,) float32; starts (taps,) int64; weights (taps,)
        float32. All contiguous.
        """

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            source, starts, weights, out = (
                make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 6)
            )
            further, first, last, at = (args[n] for n in (2, 4, 5, 7))
            total = cgutils.alloca_once_value(builder, ir.Constant(pixels, [ir.Constant(FLOAT, 0.0)] * count))
            with cgutils.for_range_slice(builder, first, last, ir.Constant(LONG, 1)) as (tap, _):
                weight = filled(builder, builder.load(number_at(builder, weights, tap)), count)
                place = builder.add(builder.load(number_at(builder, starts, tap)), further)
                seen = builder.load(vector_at(builder, source, place, count))
                seen.align = 4
                product = builder.fmul(weight, seen, flags=FUSED)
                builder.store(builder.fadd(product, builder.load(total), flags=FUSED), total)
            target = vector_at(builder, out, at, count)
            builder.store(builder.load(total), target, align=4)
            return context.get_dummy_value()

        whole = types.int64
        return types.void(source, starts, whole, weights, whole, whole, out, whole), generate

    return sum_pixels


sum_fewest, sum_few, sum_many = summing(FEWEST), summing(FEW), summing(MANY)


def _pairs(builder: Any, one: Any, other: Any) -> Any:
    """Return the sums of neighbours of two vectors of eight, half of each vector's by half."""
    evens, odds = [0, 2, 8, 10, 4, 6, 12, 14], [1, 3, 9, 11, 5, 7, 13, 15]
    return builder.fadd(_shuffled(builder, one, other, evens), _shuffled(builder, one, other, odds))


def _shuffled(builder: Any, one: Any, other: Any, places: list[int]) -> Any:
    chosen = ir.Constant(ir.VectorType(INT, len(places)), [ir.Constant(INT, place) for place in places])
    return builder.shuffle_vector(one, other, chosen)


@intrinsic
def dot_eight(context, source, starts, table, weights_at, taps, out, at):  # type: ignore[no-untyped-def]
    """Set out[at + i] = sum over t < taps of table[weights_at[at + i] + t] source[starts[at + i] + t], i < 8.

    source, table, out (n,) float32; starts, weights_at (n,) int32; taps: a whole multiple of 8. All
    contiguous.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source, starts, table, weights_at, out = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 2, 3, 5)
        )
        taps, at = args[4], args[6]
        none = ir.Constant(ir.VectorType(FLOAT, EIGHT), [ir.Constant(FLOAT, 0.0)] * EIGHT)
        sums = [cgutils.alloca_once_value(builder, none) for _ in range(EIGHT)]
        begins = []
        for n in range(EIGHT):
            place = builder.add(at, ir.Constant(LONG, n))
            begins.append(
                [
                    number_at(
                        builder, array, builder.sext(builder.load(number_at(builder, index, place)), LONG)
                    )
                    for array, index in ((source, starts), (table, weights_at))
                ]
            )
        with cgutils.for_range_slice(builder, ir.Constant(LONG, 0), taps, ir.Constant(LONG, EIGHT)) as (
            tap,
            _,
        ):
            for total, begin in zip(sums, begins, strict=True):
                seen, weight = (
                    builder.load(vector_at(builder, array, tap, EIGHT), align=4) for array in begin
                )
                product = builder.fmul(seen, weight, flags=FUSED)
                builder.store(builder.fadd(product, builder.load(total), flags=FUSED), total)
        parts = [builder.load(total) for total in sums]
        while len(parts) > 2:
            parts = [_pairs(builder, parts[k], parts[k + 1]) for k in range(0, len(parts), 2)]
        one, other = parts
        low, high = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        result = builder.fadd(_shuffled(builder, one, other, low), _shuffled(builder, one, other, high))
        builder.store(result, vector_at(builder, out, at, EIGHT), align=4)
        return context.get_dummy_value()

    whole = types.int64
    return types.void(source, starts, table, weights_at, whole, out, whole), generate


@intrinsic
def sum_tilted(context, source, starts, start, stride, table, slopes, weight, taps, rest, tilt, out, at):  # type: ignore[no-untyped-def]
    """Set out[at + i] = sum over t < taps of w[t, i] source[starts[start + stride t] + i], i < GROUP.

    w[t, i] = table[weight + t] + (rest + tilt (i - (GROUP - 1) / 2)) slopes[weight + t]. source, table, slopes,
    out (n,) float32; starts (n,) int32; rest, tilt float32. All contiguous.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        arrays = (0, 1, 4, 5, 10)
        source, starts, table, slopes, out = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in arrays
        )
        start, stride, weight, taps, rest, tilt, at = (args[n] for n in (2, 3, 6, 7, 8, 9, 11))
        pixels = ir.VectorType(FLOAT, GROUP)
        none = ir.Constant(pixels, [ir.Constant(FLOAT, 0.0)] * GROUP)
        total, change = (cgutils.alloca_once_value(builder, none) for _ in range(2))
        with cgutils.for_range_slice(builder, ir.Constant(LONG, 0), taps, ir.Constant(LONG, 1)) as (tap, _):
            row = builder.add(start, builder.mul(stride, tap))
            place = builder.sext(builder.load(number_at(builder, starts, row)), LONG)
            seen = builder.load(vector_at(builder, source, place, GROUP), align=4)
            for array, onto in ((table, total), (slopes, change)):
                by = filled(builder, builder.load(number_at(builder, array, builder.add(weight, tap))), GROUP)
                product = builder.fmul(by, seen, flags=FUSED)
                builder.store(builder.fadd(product, builder.load(onto), flags=FUSED), onto)
        middle = (GROUP - 1) / 2
        ramp = ir.Constant(pixels, [ir.Constant(FLOAT, i - middle) for i in range(GROUP)])
        tilts = builder.fadd(builder.fmul(ramp, filled(builder, tilt, GROUP)), filled(builder, rest, GROUP))
        product = builder.fmul(tilts, builder.load(change), flags=FUSED)
        result = builder.fadd(product, builder.load(total), flags=FUSED)
        builder.store(result, vector_at(builder, out, at, GROUP), align=4)
        return context.get_dummy_value()

    whole = types.int64
    signature = types.void(
        source, starts, whole, whole, table, slopes, whole, whole, types.float32, types.float32, out, whole
    )
    return signature, generate
