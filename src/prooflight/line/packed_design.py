"""Prepared designs in little memory: large arrays as runs of equal cells, written out for each inspection."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.detectors.matched_filter.detector import MatchedFilterPage
from prooflight.kernels.memory import unset
from prooflight.kernels.run_lengths import Runs, count_runs, keep_runs, write_runs
from prooflight.line.prefetch import size_bytes
from prooflight.pages.parallel import parts_of, shared_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inspection.inspector import Prepared
    from prooflight.line.sheets.thumbnails import Thumbnail

CELL_BYTES: Final = 4
RUN_BYTES: Final = 5
"""Room of one run: a cell and its length."""
NO_RASTER: Final = np.zeros((1, 1, 4), np.uint8)


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
        counts = np.empty(len(cells), np.int64)
        count_runs(cells, counts)
        whole = counts * RUN_BYTES > cells.shape[1] * CELL_BYTES
        sizes, lengths = np.where(whole, cells.shape[1], counts), np.where(whole, 0, counts)
        # A row that equals the one above begins where that one does.
        begins = np.maximum.accumulate(np.where(counts > 0, np.arange(len(cells)), 0))
        runs = Runs(
            value_at=(np.cumsum(sizes) - sizes)[begins],
            length_at=np.where(whole, -1, np.cumsum(lengths) - lengths)[begins],
            values=np.empty(sizes.sum(), np.uint32),
            lengths=np.empty(lengths.sum(), np.uint8),
        )
        keep_runs(cells, runs)
        return cls(shape=array.shape, dtype=array.dtype.str, runs=runs)

    @property
    def nbytes(self) -> int:
        """Memory that it takes. [bytes]"""
        return sum(one.nbytes for one in self.runs)

    def written(self, *, threads: int = 1) -> NDArray[Any]:
        """Return the array; ValueError: its runs do not fill it."""
        rows, row_bytes = _rows_of(self.shape, np.dtype(self.dtype))
        out = unset((rows, -(-row_bytes // CELL_BYTES))).view(np.uint32)
        if len(self.runs.value_at) != rows:
            raise ValueError("a packed array has another number of rows than its shape")
        parts = parts_of(rows, threads)
        tasks = [partial(write_runs, self.runs, first, last, out) for first, last in parts]
        if not all(shared_out(tasks, threads=threads)):
            raise ValueError("a packed array ends before its rows do")
        if row_bytes % CELL_BYTES:
            return (
                np.ascontiguousarray(out.view(np.uint8)[:, :row_bytes]).view(self.dtype).reshape(self.shape)
            )
        return out.view(self.dtype).reshape(self.shape)


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadyPage:
    """A design prepared for its sheets."""

    prepared: Prepared
    thumbnail: Thumbnail
    """Thumbnail by which its sheets are recognised."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PackedDesign:
    """A prepared design whose large arrays are packed; another detector's design is as it was prepared."""

    bare: ReadyPage
    """The design without the arrays that are packed."""
    arrays: dict[str, PackedArray] = field(default_factory=dict)

    @classmethod
    def of(cls, ready: ReadyPage) -> Self:
        """Pack a design; those of a graphics card stay as they are, since it keeps their images."""
        page = ready.prepared.prepared_page
        if not isinstance(page, MatchedFilterPage) or page.detector.press_context.device != "cpu":
            return cls(bare=ready)
        design = page.prepared_page
        large: dict[str, NDArray[Any] | None] = {
            "raster": design.page.cmyk,
            "levels": design.images.levels,
            "windows": design.landmarks.windows,
            "hidden": design.hidden,
            "unresolved": design.unresolved,
        }
        arrays = {name: PackedArray.of(one) for name, one in large.items() if one is not None}
        nothing = np.zeros(0, np.float32)
        bare = replace(
            design,
            page=replace(design.page, cmyk=NO_RASTER),
            images=replace(design.images, levels=np.zeros((0, 0, 0), np.uint16)),
            landmarks=replace(design.landmarks, windows=nothing),
            hidden=None,
            unresolved=None,
        )
        prepared = replace(ready.prepared, page=bare.page, prepared_page=replace(page, prepared_page=bare))
        return cls(bare=replace(ready, prepared=prepared), arrays=arrays)

    @property
    def thumbnail(self) -> Thumbnail:
        """Thumbnail by which its sheets are recognised."""
        return self.bare.thumbnail

    @property
    def nbytes(self) -> int:
        """Memory that it takes beside that of its press. [bytes]"""
        page = self.bare.prepared.prepared_page
        own = (
            (page.detector, page.prepared_page.binned_sensors)
            if isinstance(page, MatchedFilterPage)
            else None
        )
        return size_bytes((self.bare, list(self.arrays.values())), shared=own)

    def unpacked(self, *, threads: int = 1) -> ReadyPage:
        """Return the design as it was prepared."""
        if not self.arrays:
            return self.bare
        there = {name: one.written(threads=threads) for name, one in self.arrays.items()}
        page: Any = self.bare.prepared.prepared_page
        design = page.prepared_page
        raster = replace(design.page, cmyk=there["raster"])
        whole = replace(
            design,
            page=raster,
            images=replace(design.images, levels=there["levels"]),
            landmarks=replace(design.landmarks, windows=there["windows"]),
            hidden=there.get("hidden"),
            unresolved=there.get("unresolved"),
        )
        prepared = replace(self.bare.prepared, page=raster, prepared_page=replace(page, prepared_page=whole))
        return replace(self.bare, prepared=prepared)
