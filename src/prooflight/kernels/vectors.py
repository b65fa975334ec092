"""Building blocks of the intrinsics of compiled loops: vectors of single-precision numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils
from numba.np.arrayobj import make_array

INT, LONG, FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
FUSED = ("contract",)
"""Flag by which a product and a sum may be one instruction."""
GROUP: Final = 16
"""Numbers of a ``Group``."""
_GROUP: Final = ir.VectorType(FLOAT, GROUP)


class Group:
    """Sixteen adjacent numbers of a row, in registers: what the formulas of intrinsics are written with."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    @classmethod
    def of(cls, builder: Any, number: Any) -> Group:
        """Return sixteen times a number of Python's or of the compiled loop."""
        if isinstance(number, float):
            return cls(builder, ir.Constant(_GROUP, [ir.Constant(FLOAT, number)] * GROUP))
        return cls(builder, filled(builder, number, GROUP))

    def __add__(self, other: Group) -> Group:
        return Group(self.builder, self.builder.fadd(self.value, other.value, flags=FUSED))

    def __sub__(self, other: Group) -> Group:
        return Group(self.builder, self.builder.fsub(self.value, other.value, flags=FUSED))

    def __mul__(self, other: Group) -> Group:
        return Group(self.builder, self.builder.fmul(self.value, other.value, flags=FUSED))

    def root(self) -> Group:
        """Return square roots."""
        kind = ir.FunctionType(_GROUP, [_GROUP])
        root = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.sqrt.v{GROUP}f32")
        return Group(self.builder, self.builder.call(root, [self.value]))

    def where(self, relation: str, other: Group, otherwise: Group | None = None) -> Group:
        """Return the numbers that are in a relation to others, such as "<", and others or 0 elsewhere."""
        return self.chosen(self, relation, other, otherwise)

    def chosen(self, by: Group, relation: str, than: Group, otherwise: Group | None = None) -> Group:
        """Return the numbers where those of ``by`` are in a relation to ``than``, and others or 0 elsewhere."""
        rest = otherwise or Group.of(self.builder, 0.0)
        test = self.builder.fcmp_ordered(relation, by.value, than.value)
        return Group(self.builder, self.builder.select(test, self.value, rest.value))

    def limited(self, most: Group) -> Group:
        """Return numbers of which none is beyond ``most``, of either sign."""
        least = Group.of(self.builder, 0.0) - most
        return self.where("<", most, most).where(">", least, least)


class Rows:
    """Array (lines, pixels) of float32 whose numbers are taken by groups; a row is (1, pixels)."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        whole = make_array(kind)(context, builder, array)
        self.builder, self.data = builder, whole.data
        self.pixels = cgutils.unpack_tuple(builder, whole.shape)[-1]

    def _from(self, line: Any, x: Any) -> Any:
        place = self.builder.add(self.builder.mul(line, self.pixels), x)
        return vector_at(self.builder, self.data, place, GROUP)

    def at(self, line: Any, x: Any) -> Group:
        """Return sixteen numbers of a line from pixel ``x`` on; the next line's follow a line's last."""
        return Group(self.builder, self.builder.load(self._from(line, x), align=4))

    def store(self, line: Any, x: Any, group: Group) -> None:
        """Write sixteen numbers."""
        self.builder.store(group.value, self._from(line, x), align=4)


def sums_of_lines(builder: Any, first: Any, last: Any, terms: Any, count: int) -> Sequence[Group]:
    """Return sums over lines first .. last - 1 of ``count`` groups, which ``terms`` returns of a line."""
    totals = [cgutils.alloca_once_value(builder, Group.of(builder, 0.0).value) for _ in range(count)]
    with cgutils.for_range_slice(builder, first, last, ir.Constant(LONG, 1)) as (line, _):
        for total, term in zip(totals, terms(line), strict=True):
            builder.store((Group(builder, builder.load(total)) + term).value, total)
    return [Group(builder, builder.load(total)) for total in totals]


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
