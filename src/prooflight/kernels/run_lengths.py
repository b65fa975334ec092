"""Compiled loops that keep an image as runs of equal cells, row by row, and write it again.

A row that equals the one above takes no room. Any other is stored as pieces or as it is, whichever is smaller. A
piece is a run of equal cells, which takes a cell and a byte; cells that equal those of the row above, which take two
bytes; or cells that differ from their neighbours, which take themselves and two bytes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.prediction.lines import same_row

LONGEST = 254
"""Greatest length of a piece: it is stored in a byte. [cells]"""
DIFFERENT, AS_ABOVE = 0, 255
"""Marks of pieces other than runs, before their lengths. The mark of a run is its length."""
AT_ONCE = 16
"""Cells that are compared at once where many are equal."""


class Runs(NamedTuple):
    """An image of cells of 32 bits, (rows, columns), as pieces."""

    value_at: NDArray[np.int64]
    """First of the row's cells in ``values``, (rows,); rows that are equal to the one above have the same."""
    length_at: NDArray[np.int64]
    """First of the row's marks and lengths in ``lengths``, (rows,); -1: the row is stored as it is."""
    values: NDArray[np.uint32]
    lengths: NDArray[np.uint8]


@inner_kernel()
def equal_until(cells, others, start, last):  # type: ignore[no-untyped-def]
    """Return the first place from ``start`` on, at most ``last``, where cells (n,) differ from others (m,)."""
    for _ in range(2):  # most cells of a picture differ soon
        if start >= last or cells[start] != others[start]:
            return start
        start += 1
    while start + AT_ONCE <= last:
        differs = np.uint32(0)
        for i in range(start, start + AT_ONCE):
            differs |= cells[i] ^ others[i]
        if differs:
            break
        start += AT_ONCE
    while start < last and cells[start] == others[start]:
        start += 1
    return start


@inner_kernel()
def piece_at(cells, above, start):  # type: ignore[no-untyped-def]
    """Return the end and the mark of the piece that begins at ``start`` of a row (columns,).

    above: the row above (columns,), or nothing (0,).
    """
    last = min(start + LONGEST, cells.size)
    same = equal_until(cells, above, start, min(last, above.size))
    if same == last and same > start + 1:
        return same, AS_ABOVE
    run = equal_until(cells[1:], cells, start, last - 1) + 1
    if same >= run and same > start + 1:
        return same, AS_ABOVE
    if run > start + 1:
        return run, run - start
    end = run
    while end < last:
        if end + 1 < cells.size:
            as_above = above.size > 0 and cells[end] == above[end] and cells[end + 1] == above[end + 1]
            if as_above or cells[end] == cells[end + 1]:
                break
        end += 1
    return end, 1 if end == run else DIFFERENT


@inner_kernel()
def room_of(mark, size):  # type: ignore[no-untyped-def]
    """Return the cells and the bytes that a piece of ``size`` cells takes."""
    if mark == AS_ABOVE:
        return 0, 2
    return (size, 2) if mark == DIFFERENT else (1, 1)


@kernel("cells (R, C), room (R, 2), marks (R, M)", where="0 < C <= M")
def mark_pieces(cells, room, marks):  # type: ignore[no-untyped-def]
    """Divide rows (rows, columns) uint32 into pieces; count the cells and bytes that each row takes, room (rows, 2).

    The bytes, marks and lengths, are written to the beginning of each row of marks (rows, columns or more) uint8. A
    row that equals the row above takes neither.
    """
    for row in range(cells.shape[0]):
        here, above = cells[row], cells[row - 1] if row > 0 else cells[row, :0]
        x, values, lengths = 0, 0, 0
        while x < here.size and not (x == 0 and row > 0 and same_row(here, above)):
            end, mark = piece_at(here, above, x)
            cell_count, byte_count = room_of(mark, end - x)
            marks[row, lengths] = mark
            values += cell_count
            lengths += byte_count
            marks[row, lengths - 1] = end - x
            x = end
        room[row, 0], room[row, 1] = values, lengths


@kernel(
    "cells (R, C), marks (R, M), stored.value_at (R), stored.length_at (R), stored.values (V), stored.lengths (N)",
    where="C <= M",
)
def keep_runs(cells, marks, stored):  # type: ignore[no-untyped-def]
    """Write rows (rows, columns) uint32 and their ``marks`` to ``Runs`` whose places are set."""
    for row in range(cells.shape[0]):
        here, at, lengths_at = cells[row], stored.value_at[row], stored.length_at[row]
        if row > 0 and at == stored.value_at[row - 1]:
            continue
        if lengths_at < 0:
            copy_row(here, stored.values[at : at + here.size])
            continue
        x, first = 0, lengths_at
        while x < here.size:
            mark = marks[row, lengths_at - first]
            bytes_of_piece = room_of(mark, 0)[1]
            length = int(marks[row, lengths_at - first + bytes_of_piece - 1])
            stored.lengths[lengths_at] = mark
            stored.lengths[lengths_at + bytes_of_piece - 1] = length
            values = room_of(mark, length)[0]
            copy_row(here[x : x + values], stored.values[at : at + values])
            x += length
            at += values
            lengths_at += bytes_of_piece


@inner_kernel()
def write_row(stored, at, lengths_at, above, out):  # type: ignore[no-untyped-def]
    """Write one row (columns,) below ``above``; returns whether ``stored`` has all of it."""
    if at < 0:
        return False
    if lengths_at < 0:
        if at + out.size > stored.values.size:
            return False
        copy_row(stored.values[at : at + out.size], out)
        return True
    x = 0
    while x < out.size:
        if lengths_at >= stored.lengths.size:
            return False
        mark = stored.lengths[lengths_at]
        lengths_at += room_of(mark, 0)[1]
        length = min(int(stored.lengths[min(lengths_at, stored.lengths.size) - 1]), out.size - x)
        values = room_of(mark, length)[0]
        if length == 0 or at + values > stored.values.size or (mark == AS_ABOVE and above.size == 0):
            return False
        if mark == AS_ABOVE:
            copy_row(above[x : x + length], out[x : x + length])
        elif mark == DIFFERENT:
            copy_row(stored.values[at : at + length], out[x : x + length])
        else:
            value, stop = stored.values[at], x + length
            for place in range(x, stop):
                out[place] = value
        x += length
        at += values
    return True


@kernel("stored.value_at (R), stored.length_at (R), stored.values (V), stored.lengths (N), out (R, C)")
def write_runs(stored, out):  # type: ignore[no-untyped-def]
    """Write an image (rows, columns) uint32; returns whether ``Runs`` has all of it."""
    for row in range(out.shape[0]):
        at, lengths_at = stored.value_at[row], stored.length_at[row]
        above = out[row - 1] if row > 0 else out[row, :0]
        if row > 0 and at == stored.value_at[row - 1] and lengths_at == stored.length_at[row - 1]:
            copy_row(above, out[row])
        elif not write_row(stored, at, lengths_at, above, out[row]):
            return False
    return True
