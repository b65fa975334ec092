"""Building blocks of the intrinsics of compiled loops: vectors of single-precision numbers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]

INT, LONG, FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
FUSED = ("contract",)
"""Flag by which a product and a sum may be one instruction."""


def filled(builder: Any, value: Any, count: int) -> Any:
    """Return a vector of ``count`` times a number."""
    none = ir.Constant(ir.VectorType(FLOAT, count), ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(INT, 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(INT, count), [0] * count))


def number_at(builder: Any, array: Any, index: Any) -> Any:
    """Return the address of a number of an array."""
    return builder.gep(array, [index], inbounds=True)


def vector_at(builder: Any, array: Any, index: Any, count: int) -> Any:
    """Return the address of ``count`` numbers of an array from one on, aligned to numbers alone."""
    return builder.bitcast(number_at(builder, array, index), ir.VectorType(FLOAT, count).as_pointer())
