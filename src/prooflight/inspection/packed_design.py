"""Prepared designs in little memory: large arrays as runs of equal cells, written out for each inspection.

A process that inspects the same designs again and again may keep their arrays written out, if it has the memory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.optional import PacksArrays
from prooflight.kernels.memory import unset
from prooflight.kernels.run_lengths import Runs, keep_runs, mark_pieces, write_runs
from prooflight.pages.parallel import shared_out

if TYPE_CHECKING:
    from prooflight.inspection.inspector import Prepared

CELL_BYTES: Final = 4
RASTER: Final = "raster"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PackedArray:
    """An array as runs of equal cells along its rows."""

    shape: tuple[int, ...]
    dtype: str
    runs: Runs

    @classmethod
    def of(cls, array: NDArray[Any]) -> Self:
        """Pack an array (rows..., columns) or, of pixels of four bytes, (rows, columns, 4)."""
        cells = _cells(np.ascontiguousarray(array))
        room = np.empty((len(cells), 2), np.int64)
        marks = unset((len(cells), -(-cells.shape[1] // CELL_BYTES))).view(np.uint8)
        mark_pieces(cells, room, marks)
        sizes, lengths = room.T
        whole = sizes * CELL_BYTES + lengths > cells.shape[1] * CELL_BYTES
        sizes, lengths = np.where(whole, cells.shape[1], sizes), np.where(whole, 0, lengths)
        # A row that equals the one above begins where that one does.
        begins = np.maximum.accumulate(np.where(sizes > 0, np.arange(len(cells)), 0))
        runs = Runs(
            value_at=(np.cumsum(sizes) - sizes)[begins],
            length_at=np.where(whole, -1, np.cumsum(lengths) - lengths)[begins],
            values=np.empty(sizes.sum(), np.uint32),
            lengths=np.empty(lengths.sum(), np.uint8),
        )
        keep_runs(cells, marks, runs)
        return cls(shape=array.shape, dtype=array.dtype.str, runs=runs)

    @property
    def nbytes(self) -> int:
        """Memory that it takes. [bytes]"""
        return sum(one.nbytes for one in self.runs)

    def written(self) -> NDArray[Any]:
        """Return the array; ValueError: its runs do not fill it."""
        rows, row_bytes = _rows_of(self.shape, np.dtype(self.dtype))
        out = unset((rows, -(-row_bytes // CELL_BYTES))).view(np.uint32)
        if len(self.runs.value_at) != rows:
            raise ValueError("a packed array has another number of rows than its shape")
        if not write_runs(self.runs, out):
            raise ValueError("a packed array ends before its rows do")
        if row_bytes % CELL_BYTES:
            return (
                np.ascontiguousarray(out.view(np.uint8)[:, :row_bytes]).view(self.dtype).reshape(self.shape)
            )
        return out.view(self.dtype).reshape(self.shape)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrittenArray:
    """An array of a packed design that stays written out."""

    array: NDArray[Any]

    def written(self) -> NDArray[Any]:
        """See ``PackedArray``."""
        return self.array


def _rows_of(shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[int, int]:
    """Return the number of rows of an array, and the bytes of each; pixels of four bytes are one column."""
    columns = math.prod(shape[-2:]) if dtype.itemsize == 1 and shape[-1] == CELL_BYTES else shape[-1]
    return math.prod(shape) // columns, columns * dtype.itemsize


def _cells(array: NDArray[Any]) -> NDArray[np.uint32]:
    """Return an array's rows as cells, the last filled with 0."""
    rows, row_bytes = _rows_of(array.shape, array.dtype)
    each = array.reshape(-1).view(np.uint8).reshape(rows, row_bytes)
    if lacking := -row_bytes % CELL_BYTES:
        each = np.pad(each, ((0, 0), (0, lacking)))
    return each.view(np.uint32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class PackedDesign:
    """A prepared design whose large arrays are packed; another detector's design is as it was prepared."""

    bare: Prepared
    """The design without the arrays that are packed."""
    arrays: Mapping[str, PackedArray | WrittenArray] = field(default_factory=dict)
    additional: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Arrays that its user keeps with it, by name."""
    origin: PackedDesign | None = None
    """Design as it was prepared, of which this one is an adaptation to other light; None: it is as prepared."""

    @classmethod
    def of(cls, prepared: Prepared, additional: Mapping[str, NDArray[Any]]) -> Self:
        """Pack a design of a detector that ``PacksArrays``; any other is kept as it is."""
        page = prepared.prepared_page
        bare, large = page.without_arrays() if isinstance(page, PacksArrays) else (page, {})
        if not large:
            return cls(bare=prepared, additional=additional)
        raster = prepared.page
        arrays = {name: PackedArray.of(one) for name, one in (*large.items(), (RASTER, raster.cmyk))}
        nothing = replace(raster, cmyk=np.zeros((1, 1, INKS), np.uint8))
        return cls(
            bare=replace(prepared, page=nothing, prepared_page=bare), arrays=arrays, additional=additional
        )

    @property
    def nbytes(self) -> int:
        """Memory that it takes beside that of its press. [bytes]"""
        page = self.bare.prepared_page
        shared = page.of_press if isinstance(page, PacksArrays) else None
        return size_bytes(
            (self.bare, list(self.arrays.values()), list(self.additional.values())), shared=shared
        )

    @property
    def written_bytes(self) -> int:
        """Memory that its other arrays will take when they are written out. [bytes]"""
        return sum(
            math.prod(one.shape) * np.dtype(one.dtype).itemsize
            for one in self.arrays.values()
            if isinstance(one, PackedArray)
        )

    def written_out(self) -> Self:
        """Return the design with its arrays written out, so that ``unpacked`` takes no time."""
        arrays = {name: WrittenArray(array=one.written()) for name, one in self.arrays.items()}
        return replace(self, arrays=arrays)

    def unpacked(self, *, threads: int = 1) -> Prepared:
        """Return the design as it was prepared."""
        page = self.bare.prepared_page
        if not self.arrays or not isinstance(page, PacksArrays):
            return self.bare
        written = shared_out([one.written for one in self.arrays.values()], threads=threads)
        there = dict(zip(self.arrays, written, strict=True))
        raster = replace(self.bare.page, cmyk=there.pop(RASTER))
        return replace(self.bare, page=raster, prepared_page=page.with_arrays(raster, there))


def size_bytes(value: object, *, shared: object = None) -> int:
    """Return the memory of all arrays in nested dataclasses, tuples and lists, each counted once.

    Those that are in ``shared`` too do not count.
    """
    arrays: dict[int, int] = {}

    def walk(one: object) -> None:
        if isinstance(one, np.ndarray):
            arrays[id(one)] = one.nbytes
        elif isinstance(one, (tuple, list)):
            for part in one:
                walk(part)
        elif is_dataclass(one) and not isinstance(one, type):
            for part in fields(one):
                walk(getattr(one, part.name))

    walk(shared)
    others = set(arrays)
    walk(value)
    return sum(size for one, size in arrays.items() if one not in others)
