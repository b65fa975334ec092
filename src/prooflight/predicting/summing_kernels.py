"""The compiled heart of filtering: weighted sums of some pixels, kept in registers until they are complete."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

FEW, MANY = 16, 64
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


sum_few, sum_many = summing(FEW), summing(MANY)
