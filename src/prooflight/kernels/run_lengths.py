"""Compiled loops that keep an image as runs of equal cells, row by row, and write it again.

A row that equals the one above takes no room. Any other is stored as its runs, a cell and a byte each, or as it is,
whichever is smaller.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.prediction.lines import same_row

LONGEST = 255
"""Greatest length of a run: it is stored in a byte. [cells]"""


class Runs(NamedTuple):
    """An image of cells of 32 bits, (rows, columns), as runs."""

    value_at: NDArray[np.int64]
    """First of the row's cells in ``values``, (rows,); rows that are equal to the one above have the same."""
    length_at: NDArray[np.int64]
    """First of the row's lengths in ``lengths``, (rows,); -1: the row is stored as it is."""
    values: NDArray[np.uint32]
    lengths: NDArray[np.uint8]


@kernel("cells (R, C), runs (R)", where="0 < C")
def count_runs(cells, runs):  # type: ignore[no-untyped-def]
    """Count the runs of every row (rows, columns) uint32 into runs (rows,); 0: it equals the row above."""
    for row in range(cells.shape[0]):
        here = cells[row]
        if row > 0 and same_row(here, cells[row - 1]):
            runs[row] = 0
            continue
        count, length = 1, 1
        for x in range(1, here.size):
            if here[x] != here[x - 1] or length == LONGEST:
                count += 1
                length = 0
            length += 1
        runs[row] = count


@kernel("cells (R, C), stored.value_at (R), stored.length_at (R), stored.values (V), stored.lengths (N)")
def keep_runs(cells, stored):  # type: ignore[no-untyped-def]
    """Write rows (rows, columns) uint32 to ``Runs`` whose places are set."""
    for row in range(cells.shape[0]):
        here, at, lengths_at = cells[row], stored.value_at[row], stored.length_at[row]
        if row > 0 and at == stored.value_at[row - 1]:
            continue
        if lengths_at < 0:
            copy_row(here, stored.values[at : at + here.size])
            continue
        stored.values[at], stored.lengths[lengths_at] = here[0], 1
        for x in range(1, here.size):
            if here[x] != here[x - 1] or stored.lengths[lengths_at] == LONGEST:
                at += 1
                lengths_at += 1
                stored.values[at], stored.lengths[lengths_at] = here[x], 0
            stored.lengths[lengths_at] += 1


@inner_kernel()
def write_row(stored, at, lengths_at, out):  # type: ignore[no-untyped-def]
    """Write one row (columns,); returns whether ``stored`` has all of it."""
    if lengths_at < 0:
        if at < 0 or at + out.size > stored.values.size:
            return False
        copy_row(stored.values[at : at + out.size], out)
        return True
    x = 0
    while x < out.size:
        if (
            at < 0
            or at >= stored.values.size
            or lengths_at >= stored.lengths.size
            or not stored.lengths[lengths_at]
        ):
            return False
        value, stop = stored.values[at], min(x + stored.lengths[lengths_at], out.size)
        while x < stop:
            out[x] = value
            x += 1
        at += 1
        lengths_at += 1
    return True


@kernel(
    "stored.value_at (R), stored.length_at (R), stored.values (V), stored.lengths (N), first, last, out (R, C)",
    where="0 <= first, last <= R",
)
def write_runs(stored, first, last, out):  # type: ignore[no-untyped-def]
    """Write rows first .. last - 1 of an image (rows, columns) uint32; returns whether ``Runs`` has all of them."""
    for row in range(first, last):
        at, lengths_at = stored.value_at[row], stored.length_at[row]
        if row > first and at == stored.value_at[row - 1] and lengths_at == stored.length_at[row - 1]:
            copy_row(out[row - 1], out[row])
        elif not write_row(stored, at, lengths_at, out[row]):
            return False
    return True
