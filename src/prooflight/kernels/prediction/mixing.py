"""The compiled heart of the lens correction: seven lines mixed into four, sixteen pixels at a time, in registers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

AT_ONCE = 16
_INT, _LONG, _FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
_PIXELS = ir.VectorType(_FLOAT, AT_ONCE)
_FUSED = ("contract",)
_PAIRS = ((3, 3), (2, 4), (1, 5), (0, 6))
"""Lines of the seven that are equally far from the middle one."""


def _place(builder: Any, array: Any, index: Any) -> Any:
    return builder.bitcast(builder.gep(array, [index], inbounds=True), _PIXELS.as_pointer())


def _filled(builder: Any, value: Any) -> Any:
    none = ir.Constant(_PIXELS, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(_INT, AT_ONCE), [0] * AT_ONCE))


@intrinsic
def mix_rows(context, rows, starts, at, weights, out, width):  # type: ignore[no-untyped-def]
    """out[width x + at + i] = sum over y < 4 of weights[4 y + x] (line y above the middle + line y below), x < 4.

    i < 16. rows, weights, out (n,) float32; starts (7,) int64: where in rows the seven lines begin.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows, starts, weights, out = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 4)
        )
        at, width = args[2], args[5]

        def line(n: int) -> Any:
            start = builder.load(builder.gep(starts, [ir.Constant(_LONG, n)], inbounds=True))
            return builder.load(_place(builder, rows, builder.add(start, at)), align=4)

        sums = [
            line(above) if above == below else builder.fadd(line(above), line(below))
            for above, below in _PAIRS
        ]
        for x in range(4):
            total = None
            for y in range(4):
                place = builder.gep(weights, [ir.Constant(_LONG, 4 * y + x)], inbounds=True)
                part = builder.fmul(_filled(builder, builder.load(place)), sums[y], flags=_FUSED)
                total = part if total is None else builder.fadd(total, part, flags=_FUSED)
            target = builder.add(builder.mul(width, ir.Constant(_LONG, x)), at)
            builder.store(total, _place(builder, out, target), align=4)
        return context.get_dummy_value()

    return types.void(rows, starts, types.int64, weights, out, types.int64), generate
