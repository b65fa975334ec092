"""Compiled core of the lens correction: seven lines mixed into four, sixteen pixels at a time, in registers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.vectors import FUSED, LONG, filled, number_at, vector_at

AT_ONCE = 16
_PAIRS = ((3, 3), (2, 4), (1, 5), (0, 6))
"""Lines of the seven that are equally far from the middle one."""


@intrinsic
def mix_rows(context, rows, starts, at, weights, out, width):  # type: ignore[no-untyped-def]
    """Mix seven lines into four, sixteen pixels of each.

    out[width x + at + i] = sum over y < 4 of weights[4 y + x] (line y above the middle + line y below), x <
    4, i < 16. rows, weights, out (n,) float32; starts (7,) int64: where in rows the seven lines begin.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        rows, starts, weights, out = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3, 4)
        )
        at, width = args[2], args[5]

        def line(n: int) -> Any:
            start = builder.load(number_at(builder, starts, ir.Constant(LONG, n)))
            return builder.load(vector_at(builder, rows, builder.add(start, at), AT_ONCE), align=4)

        sums = [
            line(above) if above == below else builder.fadd(line(above), line(below))
            for above, below in _PAIRS
        ]
        for x in range(4):
            total = None
            for y in range(4):
                place = number_at(builder, weights, ir.Constant(LONG, 4 * y + x))
                part = builder.fmul(filled(builder, builder.load(place), AT_ONCE), sums[y], flags=FUSED)
                total = part if total is None else builder.fadd(total, part, flags=FUSED)
            target = builder.add(builder.mul(width, ir.Constant(LONG, x)), at)
            builder.store(total, vector_at(builder, out, target, AT_ONCE), align=4)
        return context.get_dummy_value()

    return types.void(rows, starts, types.int64, weights, out, types.int64), generate
