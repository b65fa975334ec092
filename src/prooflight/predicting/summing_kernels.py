"""The compiled heart of filtering: weighted sums of some pixels, kept in registers until they are complete."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

FEWEST, FEW, MANY = 8, 16, 64
_INT, _LONG, _FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
_FUSED = ("contract",)


def _filled(builder: Any, value: Any, count: int) -> Any:
    none = ir.Constant(ir.VectorType(_FLOAT, count), ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(_INT, count), [0] * count))


def _at(builder: Any, array: Any, index: Any) -> Any:
    return builder.gep(array, [index], inbounds=True)


def summing(count: int) -> Any:
    """The intrinsic for so many pixels at once."""
    pixels = ir.VectorType(_FLOAT, count)

    @intrinsic
    def sum_pixels(  # type: ignore[no-untyped-def]
        context, source, starts, further, weights, slopes, first, last, from_middle, drifts, out, at
    ):
        """out[at + i] = sum over t of (weights[t] + slopes[t] (from_middle + i)) source[starts[t] + further + i].

        i < count, t from first to last - 1; source, out (n,) float32; starts (taps,) int64; weights, slopes (taps,)
        float32; drifts: False where all slopes are 0. All contiguous.
        """

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            source, starts, weights, slopes, out = (
                make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 4, 9)
            )
            further, first, last, from_middle, drifts, at = (args[n] for n in (2, 5, 6, 7, 8, 10))
            ramp = ir.Constant(pixels, [ir.Constant(_FLOAT, float(i)) for i in range(count)])
            ramp = builder.fadd(ramp, _filled(builder, builder.sitofp(from_middle, _FLOAT), count))
            total = cgutils.alloca_once_value(
                builder, ir.Constant(pixels, [ir.Constant(_FLOAT, 0.0)] * count)
            )

            def add(*, drifting: bool) -> None:
                with cgutils.for_range_slice(builder, first, last, ir.Constant(_LONG, 1)) as (tap, _):
                    weight = _filled(builder, builder.load(_at(builder, weights, tap)), count)
                    if drifting:
                        slope = _filled(builder, builder.load(_at(builder, slopes, tap)), count)
                        weight = builder.fadd(builder.fmul(slope, ramp, flags=_FUSED), weight, flags=_FUSED)
                    place = builder.add(builder.load(_at(builder, starts, tap)), further)
                    seen = builder.load(builder.bitcast(_at(builder, source, place), pixels.as_pointer()))
                    seen.align = 4
                    product = builder.fmul(weight, seen, flags=_FUSED)
                    builder.store(builder.fadd(product, builder.load(total), flags=_FUSED), total)

            with builder.if_else(drifts) as (drifting, still):
                with drifting:
                    add(drifting=True)
                with still:
                    add(drifting=False)
            target = builder.bitcast(_at(builder, out, at), pixels.as_pointer())
            builder.store(builder.load(total), target, align=4)
            return context.get_dummy_value()

        whole = types.int64
        kinds = (source, starts, whole, weights, slopes, whole, whole, whole, types.boolean, out, whole)
        return types.void(*kinds), generate

    return sum_pixels


sum_fewest, sum_few, sum_many = summing(FEWEST), summing(FEW), summing(MANY)
SLACK = 2 * FEWEST
"""Numbers that ``lerp_eight`` may touch beyond the end of what is asked for."""


@intrinsic
def lerp_eight(context, table, slopes, place, taps, share, drift, out, slopes_out, at):  # type: ignore[no-untyped-def]
    """Eight numbers between two rows of tables (n,) float32, which have ``taps`` numbers each, from ``place`` on.

    out[at:at + 8] = table + share (the table's next row - table), slopes_out of drift x slopes; (n,) float32. Eight are
    read and written, whether that many are left or not: whoever goes on to the next row overwrites them.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        eight = ir.VectorType(_FLOAT, FEWEST)

        def at_place(n: int, index: Any) -> Any:
            data = make_array(signature.args[n])(context, builder, args[n]).data
            return builder.bitcast(_at(builder, data, index), eight.as_pointer())

        low = builder.load(at_place(0, args[2]), align=4)
        high = builder.load(at_place(0, builder.add(args[2], args[3])), align=4)
        slope = builder.load(at_place(1, args[2]), align=4)
        rise = builder.fmul(_filled(builder, args[4], FEWEST), builder.fsub(high, low), flags=_FUSED)
        builder.store(builder.fadd(low, rise, flags=_FUSED), at_place(6, args[8]), align=4)
        builder.store(builder.fmul(slope, _filled(builder, args[5], FEWEST)), at_place(7, args[8]), align=4)
        return context.get_dummy_value()

    whole, number = types.int64, types.float32
    kinds = (table, slopes, whole, whole, number, number, out, slopes_out, whole)
    return types.void(*kinds), generate
