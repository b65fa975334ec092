"""What the intrinsics of compiled loops are built of: vectors of single-precision numbers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]

INT, LONG, FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
FUSED = ("contract",)
"""A product and a sum may be one instruction."""


def filled(builder: Any, value: Any, count: int) -> Any:
    """A vector of ``count`` times a number."""
    none = ir.Constant(ir.VectorType(FLOAT, count), ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(INT, 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(INT, count), [0] * count))


def number_at(builder: Any, array: Any, index: Any) -> Any:
    """Where a number of an array lies."""
    return builder.gep(array, [index], inbounds=True)


def vector_at(builder: Any, array: Any, index: Any, count: int) -> Any:
    """Where ``count`` numbers of an array lie, from one on; aligned to numbers alone."""
    return builder.bitcast(number_at(builder, array, index), ir.VectorType(FLOAT, count).as_pointer())
