"""Arithmetic of 16-bit words for compiled loops, thirty-two at once in a 512-bit register.

Numba widens integers to 64 bits by itself, and the compiler then keeps 32 of them; these stay words. A shift
to the left by a count that the compiler knows is moved into the product before it, which then needs 32 bits;
so take the count from outside the loop where a product is shifted.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

_WORD, _LONG = ir.IntType(16), ir.IntType(32)


def _high(_: Any, builder: ir.IRBuilder, __: Any, operands: Any) -> Any:
    product = builder.mul(builder.sext(operands[0], _LONG), builder.sext(operands[1], _LONG))
    return builder.trunc(builder.ashr(product, ir.Constant(_LONG, 16)), _WORD)


@intrinsic
def high(context, a, b):  # type: ignore[no-untyped-def]
    """Return the upper half of the product of two signed words, rounded down: a b / 2^16."""
    return types.int16(types.int16, types.int16), _high


@intrinsic
def add(context, a, b):  # type: ignore[no-untyped-def]
    """Return a + b of signed words, modulo 2^16."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.add(*operands)


@intrinsic
def sub(context, a, b):  # type: ignore[no-untyped-def]
    """Return a - b of signed words, modulo 2^16."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.sub(*operands)


@intrinsic
def left(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a 2^bits of a signed word, modulo 2^16; bits from 0 to 15."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.shl(*operands)


@intrinsic
def right(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a / 2^bits of a signed word, rounded down; bits from 0 to 15."""
    return types.int16(types.int16, types.int16), lambda _, builder, __, operands: builder.ashr(*operands)


@intrinsic
def left_unsigned(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a 2^bits of an unsigned word, modulo 2^16; bits from 0 to 15."""
    return types.uint16(types.uint16, types.uint16), lambda _, builder, __, operands: builder.shl(*operands)


@intrinsic
def right_unsigned(context, a, bits):  # type: ignore[no-untyped-def]
    """Return a / 2^bits of an unsigned word, rounded down; bits from 0 to 15."""
    return types.uint16(types.uint16, types.uint16), lambda _, builder, __, operands: builder.lshr(*operands)
