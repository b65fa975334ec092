"""Compiled loops that keep an image as runs of equal words, row by row, and write it again.

A row that equals the one above takes no room. Any other is kept as its runs, a word and a byte each, or as it is,
whichever is smaller.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.lines import same_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

LONGEST = 255
"""Greatest length of a run: it is kept in a byte. [words]"""


class Runs(NamedTuple):
    """An image of 32-bit words, (rows, columns), as runs."""

    value_at: NDArray[np.int64]
    """First of the row's words in ``values``, (rows,); rows that are equal to the one above have the same."""
    length_at: NDArray[np.int64]
    """First of the row's lengths in ``lengths``, (rows,); -1: the row is kept as it is."""
    values: NDArray[np.uint32]
    lengths: NDArray[np.uint8]


@kernel("words (R, C), runs (R)", where="0 < C")
def count_runs(words, runs):  # type: ignore[no-untyped-def]
    """Count the runs of every row (rows, columns) uint32 into runs (rows,); 0: it equals the row above."""
    for row in range(words.shape[0]):
        here = words[row]
        if row > 0 and same_row(here, words[row - 1]):
            runs[row] = 0
            continue
        count, length = 1, 1
        for x in range(1, here.size):
            if here[x] != here[x - 1] or length == LONGEST:
                count += 1
                length = 0
            length += 1
        runs[row] = count


@kernel("words (R, C), kept.value_at (R), kept.length_at (R), kept.values (V), kept.lengths (N)")
def keep_runs(words, kept):  # type: ignore[no-untyped-def]
    """Write rows (rows, columns) uint32 to ``Runs`` whose places are set."""
    for row in range(words.shape[0]):
        here, at, lengths_at = words[row], kept.value_at[row], kept.length_at[row]
        if row > 0 and at == kept.value_at[row - 1]:
            continue
        if lengths_at < 0:
            kept.values[at : at + here.size] = here
            continue
        kept.values[at], kept.lengths[lengths_at] = here[0], 1
        for x in range(1, here.size):
            if here[x] != here[x - 1] or kept.lengths[lengths_at] == LONGEST:
                at += 1
                lengths_at += 1
                kept.values[at], kept.lengths[lengths_at] = here[x], 0
            kept.lengths[lengths_at] += 1


@inner_kernel()
def write_row(kept, at, lengths_at, out):  # type: ignore[no-untyped-def]
    """Write one row (columns,); returns whether ``kept`` has all of it."""
    if lengths_at < 0:
        if at < 0 or at + out.size > kept.values.size:
            return False
        out[:] = kept.values[at : at + out.size]
        return True
    x = 0
    while x < out.size:
        if (
            at < 0
            or at >= kept.values.size
            or lengths_at >= kept.lengths.size
            or not kept.lengths[lengths_at]
        ):
            return False
        value, stop = kept.values[at], min(x + kept.lengths[lengths_at], out.size)
        while x < stop:
            out[x] = value
            x += 1
        at += 1
        lengths_at += 1
    return True


@kernel(
    "kept.value_at (R), kept.length_at (R), kept.values (V), kept.lengths (N), first, last, out (R, C)",
    where="0 <= first, last <= R",
)
def write_runs(kept, first, last, out):  # type: ignore[no-untyped-def]
    """Write rows first .. last - 1 of an image (rows, columns) uint32; returns whether ``Runs`` has all of them."""
    for row in range(first, last):
        at, lengths_at = kept.value_at[row], kept.length_at[row]
        if row > first and at == kept.value_at[row - 1] and lengths_at == kept.length_at[row - 1]:
            out[row] = out[row - 1]
        elif not write_row(kept, at, lengths_at, out[row]):
            return False
    return True
