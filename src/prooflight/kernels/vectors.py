"""Building blocks of the intrinsics of compiled loops: vectors of single-precision numbers."""

from __future__ import annotations

from typing import Any, Final

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.compiled import inner_kernel

INT, LONG, FLOAT = ir.IntType(32), ir.IntType(64), ir.FloatType()
FUSED = ("contract",)
"""Flag by which a product and a sum may be one instruction."""
LINE_BYTES: Final = 64
"""Bytes that a processor reads from memory at once."""
GROUP: Final = 16
"""Usual size of a ``Group``."""


@inner_kernel()
def whole_groups(pixels):  # type: ignore[no-untyped-def]
    """Return the number of pixels, rounded up to whole groups."""
    return (pixels + GROUP - 1) // GROUP * GROUP


class Group:
    """Adjacent numbers of a row, in a register: what the formulas of intrinsics are written with, and numbers.

    A number is one of Python's.
    """

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value
        self.size: int = value.type.count

    def _vector(self, other: Group | float) -> Any:
        if isinstance(other, Group):
            return other.value
        return ir.Constant(self.value.type, [ir.Constant(FLOAT, other)] * self.size)

    def __add__(self, other: Group | float) -> Group:
        return Group(self.builder, self.builder.fadd(self.value, self._vector(other), flags=FUSED))

    def __sub__(self, other: Group | float) -> Group:
        return Group(self.builder, self.builder.fsub(self.value, self._vector(other), flags=FUSED))

    def __mul__(self, other: Group | float) -> Group:
        return Group(self.builder, self.builder.fmul(self.value, self._vector(other), flags=FUSED))

    def __truediv__(self, other: Group | float) -> Group:
        return Group(self.builder, self.builder.fdiv(self.value, self._vector(other), flags=FUSED))

    def root(self) -> Group:
        """Return square roots."""
        kind = ir.FunctionType(self.value.type, [self.value.type])
        root = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.sqrt.v{self.size}f32")
        return Group(self.builder, self.builder.call(root, [self.value]))

    def total(self) -> Any:
        """Return their sum, a number of the compiled loop."""
        kind = ir.FunctionType(FLOAT, [FLOAT, self.value.type])
        add = cgutils.get_or_insert_function(
            self.builder.module, kind, f"llvm.vector.reduce.fadd.v{self.size}f32"
        )
        return self.builder.call(add, [ir.Constant(FLOAT, -0.0), self.value], fastmath=("reassoc",))

    def chosen(self, by: Group, relation: str, than: Group | float, otherwise: Group | float = 0.0) -> Group:
        """Return the numbers where those of ``by`` are in a relation to others, such as "<", and others elsewhere."""
        test = self.builder.fcmp_ordered(relation, by.value, self._vector(than))
        return Group(self.builder, self.builder.select(test, self.value, self._vector(otherwise)))

    def above(self, least: float) -> Group:
        """Return 1 where numbers are greater, 0 elsewhere."""
        test = self.builder.fcmp_ordered(">", self.value, self._vector(least))
        return Group(self.builder, self.builder.select(test, self._vector(1.0), self._vector(0.0)))

    def any_above(self, least: float) -> Any:
        """Return whether any of them is greater, a truth value of the compiled loop."""
        flags = self.builder.fcmp_ordered(">", self.value, self._vector(least))
        bits = ir.IntType(self.size)
        return self.builder.icmp_unsigned("!=", self.builder.bitcast(flags, bits), bits(0))

    def every_other(self, rest: Group) -> Group:
        """Return the first of these numbers and of as many that follow, the third and so on."""
        places = ir.Constant(ir.VectorType(INT, self.size), list(range(0, 2 * self.size, 2)))
        return Group(self.builder, self.builder.shuffle_vector(self.value, rest.value, places))

    def at_most(self, most: Group | float) -> Group:
        """Return the lesser of two numbers."""
        return self.chosen(self, "<", most, most)

    def at_least(self, least: Group | float) -> Group:
        """Return the greater of two numbers."""
        return self.chosen(self, ">", least, least)


class Rows:
    """Array (lines, pixels) of float32 whose numbers are taken by groups; a row is (1, pixels)."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any, size: int = GROUP) -> None:
        whole = make_array(kind)(context, builder, array)
        self.builder, self.data, self.size = builder, whole.data, size
        self.pixels = cgutils.unpack_tuple(builder, whole.shape)[-1]

    def _from(self, line: Any, x: Any) -> Any:
        place = self.builder.add(self.builder.mul(line, self.pixels), x)
        return vector_at(self.builder, self.data, place, self.size)

    def at(self, line: Any, x: Any) -> Group:
        """Return the numbers of a line from pixel ``x`` on; the next line's follow a line's last."""
        return Group(self.builder, self.builder.load(self._from(line, x), align=4))

    def converted(self, line: Any, x: Any) -> Group:
        """Return the numbers as ``at``, which may be whole numbers of at least 0."""
        kind = self.data.type.pointee
        if kind == FLOAT:
            return self.at(line, x)
        place = self.builder.bitcast(self._from(line, x), ir.VectorType(kind, self.size).as_pointer())
        whole = self.builder.load(place, align=kind.width // 8)
        return Group(self.builder, self.builder.uitofp(whole, ir.VectorType(FLOAT, self.size)))

    def slopes(self, line: Any, x: Any) -> tuple[Group, Group]:
        """Return the differences of the neighbours of each number, right less left and below less above."""
        one, of = ir.Constant(LONG, 1), self.builder
        across = self.at(line, of.add(x, one)) - self.at(line, of.sub(x, one))
        return across, self.at(of.add(line, one), x) - self.at(of.sub(line, one), x)

    def store(self, line: Any, x: Any, group: Group) -> None:
        """Write the numbers of a group."""
        self.builder.store(group.value, self._from(line, x), align=4)


def sums_of_lines(
    builder: Any, first: Any, last: Any, terms: Any, count: int, size: int = GROUP
) -> list[Group]:
    """Return sums over lines first .. last - 1 of ``count`` groups, which ``terms`` returns of a line."""
    none = filled(builder, ir.Constant(FLOAT, 0.0), size)
    totals = [cgutils.alloca_once_value(builder, none) for _ in range(count)]
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


def fetching(nearness: int) -> Any:
    """Return the intrinsic that fetches into the first cache (3) or into the second (2)."""

    @intrinsic
    def fetch_numbers(context, array, first, last):  # type: ignore[no-untyped-def]
        """Fetch an array's numbers first .. last - 1, counted from its start, without waiting for them."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            data = make_array(signature.args[0])(context, builder, args[0]).data
            whole, byte = ir.IntType(32), ir.IntType(8).as_pointer()
            kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
            prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
            step = ir.Constant(LONG, LINE_BYTES // (signature.args[0].dtype.bitwidth // 8))
            with cgutils.for_range_slice(builder, args[1], args[2], step) as (at, _):
                place = builder.bitcast(number_at(builder, data, at), byte)
                builder.call(prefetch, [place, whole(0), whole(nearness), whole(1)])
            return context.get_dummy_value()

        return types.void(array, types.int64, types.int64), generate

    return fetch_numbers


fetch, fetch_nearby = fetching(3), fetching(2)
