"""Compiled look-up of prediction: eight recipes at once, each a cell and one dot product of sixteen corners.

Written in the compiler's own vectors, because loops of plain numba fetch corners one by one
(docs/performance.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import binding, ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.compiled import inner_kernel, kernel

NODE_STEP = 8
NODES = 33
"""Number of nodes, at byte values 0, 8, ..., 256 of each ink: cell and fraction are a byte's upper 5 and
lower 3 bits."""
AT_ONCE = 8
_BYTE, _SHORT, _INT, _LONG, _FLOAT = (
    ir.IntType(8),
    ir.IntType(16),
    ir.IntType(32),
    ir.IntType(64),
    ir.FloatType(),
)
_EVENS, _ODDS = range(0, 16, 2), range(1, 16, 2)


def _vector(of: Any, count: int) -> Any:
    return ir.VectorType(of, count)


def _chosen(builder: Any, one: Any, other: Any, places: Any) -> Any:
    chosen = ir.Constant(_vector(_INT, len(places)), [ir.Constant(_INT, place) for place in places])
    return builder.shuffle_vector(one, other, chosen)


def _filled(builder: Any, value: Any, count: int) -> Any:
    none = ir.Constant(_vector(value.type, count), ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(_INT, 0))
    return _chosen(builder, first, none, [0] * count)


def _load(builder: Any, pointer: Any, index: Any, kind: Any) -> Any:
    """Load a ``kind`` that begins at element ``index``, of any alignment."""
    loaded = builder.load(builder.bitcast(builder.gep(pointer, [index], inbounds=True), kind.as_pointer()))
    loaded.align = 2 if pointer.type.pointee == _SHORT else 4
    return loaded


def has_extraction() -> bool:
    """Return whether this processor gathers a word's bits in one instruction (x86, BMI2)."""
    return bool(binding.get_host_cpu_features().get("bmi2"))


def _extracted(builder: Any, packed_inks: Any, widths: Any, *, upper: bool) -> Any:
    """Extract the upper ``widths`` bits of the word's four bytes, or the others, by shifts, for any processor."""
    eight, result = ir.Constant(_INT, 8), ir.Constant(_INT, 0)
    for ink in reversed(range(4)):
        byte = builder.and_(builder.lshr(packed_inks, ir.Constant(_INT, 8 * ink)), ir.Constant(_INT, 255))
        rest = builder.sub(eight, widths[ink])
        whole = builder.lshr(byte, rest)
        width = widths[ink] if upper else rest
        field = whole if upper else builder.sub(byte, builder.shl(whole, rest))
        result = builder.or_(builder.shl(result, width), field)
    return result


def _extracting(
    builder: Any, packed_inks: Any, widths: Any, masks: Any, *, upper: bool, one_instruction: bool
) -> Any:
    if not one_instruction:
        return _extracted(builder, packed_inks, widths, upper=upper)
    kind = ir.FunctionType(_INT, [_INT, _INT])
    pext = builder.module.declare_intrinsic("llvm.x86.bmi.pext.32", (), kind)
    return builder.call(pext, [packed_inks, masks[0] if upper else masks[1]])


def _eight_sums(
    builder: Any, tables: Any, packed: Any, first: Any, split: Any, *, one_instruction: bool
) -> Any:
    """Return 65536 times the interpolated codes of eight recipes from ``first`` on."""
    codes, inner, outer = tables
    widths, masks, inner_bits, inner_mask = split
    parts = []
    for n in range(AT_ONCE):
        packed_inks = _load(builder, packed, builder.add(first, ir.Constant(_LONG, n)), _INT)
        cell = _extracting(builder, packed_inks, widths, masks, upper=True, one_instruction=one_instruction)
        fraction = _extracting(
            builder, packed_inks, widths, masks, upper=False, one_instruction=one_instruction
        )
        places = [cell, builder.and_(fraction, inner_mask), builder.lshr(fraction, inner_bits)]
        starts = [
            builder.shl(builder.zext(place, _LONG), ir.Constant(_LONG, bits))
            for place, bits in zip(places, (4, 2, 3), strict=True)
        ]
        cell = _load(builder, codes, starts[0], _vector(_SHORT, 16))
        four = _load(builder, inner, starts[1], _LONG)
        weight = builder.bitcast(_filled(builder, four, 4), _vector(_SHORT, 16))
        # Compilers know this form as one instruction, multiply and add pairs.
        products = [
            builder.mul(
                *(builder.sext(_chosen(builder, of, of, half), _vector(_INT, 8)) for of in (cell, weight))
            )
            for half in (_EVENS, _ODDS)
        ]
        parts.append(builder.mul(builder.add(*products), _load(builder, outer, starts[2], _vector(_INT, 8))))
    while len(parts) > 2:
        parts = [_pairs(builder, parts[k], parts[k + 1]) for k in range(0, len(parts), 2)]
    low, high = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
    one, other = parts
    return builder.add(_chosen(builder, one, other, low), _chosen(builder, one, other, high))


def _pairs(builder: Any, one: Any, other: Any) -> Any:
    """Return the sums of neighbours of two vectors, half of each vector's by half."""
    low, high = [0, 2, 8, 10, 4, 6, 12, 14], [1, 3, 9, 11, 5, 7, 13, 15]
    return builder.add(_chosen(builder, one, other, low), _chosen(builder, one, other, high))


def eight_at_once(*, one_instruction: bool) -> Any:
    """Return the look-up intrinsic; one_instruction: whether ``has_extraction``."""

    @intrinsic
    def lookup_eight(context, codes, inner, outer, packed, bits, first, masks, unit, level, out):  # type: ignore[no-untyped-def]
        """Set out[first:first + 8] = unit sum^2 - level of recipes there; bits: of cells (4) and inner fractions."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            def data(place: int) -> Any:
                return make_array(signature.args[place])(context, builder, args[place]).data

            widths = cgutils.unpack_tuple(builder, args[4], 5)
            inner_mask = builder.sub(builder.shl(ir.Constant(_INT, 1), widths[4]), ir.Constant(_INT, 1))
            split = (widths[:4], cgutils.unpack_tuple(builder, args[6], 2), widths[4], inner_mask)
            tables = [data(place) for place in range(3)]
            sums = _eight_sums(builder, tables, data(3), args[5], split, one_instruction=one_instruction)
            roots = builder.sitofp(sums, _vector(_FLOAT, AT_ONCE))
            square = builder.fmul(builder.fmul(roots, roots), _filled(builder, args[7], AT_ONCE))
            light = builder.fsub(square, _filled(builder, args[8], AT_ONCE))
            target = builder.gep(data(9), [args[5]], inbounds=True)
            builder.store(light, builder.bitcast(target, light.type.as_pointer()), align=4)
            return context.get_dummy_value()

        kinds = (codes, inner, outer, packed, bits, types.int64, masks, types.float32, types.float32, out)
        return types.void(*kinds), generate

    return lookup_eight


lookup_eight = eight_at_once(one_instruction=has_extraction())


@intrinsic
def eight_alike(context, packed, first, packed_inks):  # type: ignore[no-untyped-def]
    """Return whether eight recipes from ``first`` on are all ``packed_inks``."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = make_array(signature.args[0])(context, builder, args[0]).data
        seen = _load(builder, data, args[1], _vector(_INT, AT_ONCE))
        same = builder.bitcast(builder.icmp_unsigned("==", seen, _filled(builder, args[2], AT_ONCE)), _BYTE)
        return builder.icmp_unsigned("==", same, ir.Constant(_BYTE, 255))

    return types.boolean(packed, types.int64, types.uint32), generate


@inner_kernel()
def masks_of(bits):  # type: ignore[no-untyped-def]
    """Return the masks of a word's bits that are cells and that are fractions; bits as in ``QuantisedTable``."""
    cells = np.uint32(0)
    for ink in range(4):
        cells = np.uint32(cells | (((0xFF00 >> bits[ink]) & 255) << (8 * ink)))
    return cells, np.uint32(~cells)


@inner_kernel()
def bits_of(table):  # type: ignore[no-untyped-def]
    """Return the bits of a ``QuantisedTable``'s cells and of its inner fractions, as ``lookup_eight`` takes them."""
    b = table.bits
    return b[0], b[1], b[2], b[3], np.uint32(np.uint32(16) - b[0] - b[1])


@kernel(
    "packed (N), table.codes (65536, 16), table.inner (_, 4), table.outer (_, 8), table.bits (4), "
    "level, out (N)",
    where="N % 8 == 0",
)
def lookup_light(packed, table, level, out):  # type: ignore[no-untyped-def]
    """Look up recipes, packed (n,) uint32 with cyan lowest, in a ``QuantisedTable``, less ``level``; n a multiple of 8.

    Eight recipes equal to the one before, half of every page, are not looked up.
    """
    bits, masks = bits_of(table), masks_of(table.bits)
    before = level + table.offset
    last = np.uint32(~packed[0])
    value = np.float32(0)
    for first in range(0, packed.size - 7, 8):
        if eight_alike(packed, first, last):
            for i in range(first, first + 8):
                out[i] = value
        else:
            lookup_eight(
                table.codes, table.inner, table.outer, packed, bits, first, masks, table.unit, before, out
            )
            last = packed[first + 7]
            value = out[first + 7]
