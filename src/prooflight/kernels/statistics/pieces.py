"""Compiled loops that find the glyphs of a raster: whole inks at their edges, and pieces of one colour that touch."""

from __future__ import annotations

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel

RUN = 4
"""Length of a run's record: row, first column, column after its last, colour; its piece replaces its colour
later."""
PIECE = 6
"""Length of a piece's record: first column, first row, columns, rows, area, colour."""
LIKELY_BITS = 12
LIKELY = 1 << LIKELY_BITS
AT_ONCE = 16
"""Pixels of a run that are compared at once."""


@inner_kernel()
def extremes_of_three(above, here, below, most, least):  # type: ignore[no-untyped-def]
    """Compute the greatest and the least byte of each column of three rows (n,)."""
    for i in range(here.size):
        a, b, c = above[i], here[i], below[i]
        high, low = (a, b) if a > b else (b, a)
        most[i] = c if c > high else high
        least[i] = c if c < low else low


@inner_kernel()
def closest_extreme(here, most, least, out):  # type: ignore[no-untyped-def]
    """Set each byte (n,) to the closest of the extremes of its pixel's and of both neighbours' columns.

    most, least (n + 2 INKS,): of columns, from that to the left of the first pixel on.
    """
    for i in range(here.size):
        a, b, c = most[i], most[i + INKS], most[i + 2 * INKS]
        high = a if a > b else b
        high = c if c > high else high
        a, b, c = least[i], least[i + INKS], least[i + 2 * INKS]
        low = a if a < b else b
        low = c if c < low else low
        value = here[i]
        out[i] = low if np.uint8(high - value) > np.uint8(value - low) else high


@inner_kernel()
def harden_row(packed, row, most, least, out):  # type: ignore[no-untyped-def]
    """Run ``harden_rows`` on one row: out (columns x INKS,) uint8; most, least, two pixels longer: working space."""
    here = packed[row].view(np.uint8)
    above, below = (
        packed[max(row - 1, 0)].view(np.uint8),
        packed[min(row + 1, packed.shape[0] - 1)].view(np.uint8),
    )
    end = INKS + here.size
    extremes_of_three(above, here, below, most[INKS:end], least[INKS:end])
    for i in range(INKS):  # beyond the raster is what its border is
        most[i], least[i] = most[i + INKS], least[i + INKS]
        most[end + i], least[end + i] = most[end - INKS + i], least[end - INKS + i]
    closest_extreme(here, most, least, out)


@kernel("packed (H, W), every, out ((H + every - 1) // every, W)", where="1 <= W, 1 <= every")
def harden_rows(packed, every, out):  # type: ignore[no-untyped-def]
    """Set each byte of a raster's recipes to the closer of its extremes in the 3 x 3 pixels about it.

    packed: one uint32 a recipe; out: rows 0, ``every``, 2 ``every``, ... of the result. Halfway between, a byte becomes
    the greatest.
    """
    most, least = np.empty((2, (packed.shape[1] + 2) * INKS), np.uint8)
    for n in range(out.shape[0]):
        harden_row(packed, n * every, most, least, out[n].view(np.uint8))


@inner_kernel()
def bare_row(row):  # type: ignore[no-untyped-def]
    """Return whether a row (n,) has no ink."""
    inks = np.uint32(0)
    for i in range(row.size):
        inks |= row[i]
    return inks == 0


@inner_kernel()
def is_uniform(line, start, value):  # type: ignore[no-untyped-def]
    """Return whether ``AT_ONCE`` pixels of a line from ``start`` on have one value."""
    differs = np.uint32(0)
    for i in range(AT_ONCE):
        differs |= line[start + i] ^ value
    return differs == 0


@inner_kernel()
def hash_of(colour):  # type: ignore[no-untyped-def]
    """Return a colour's place in a table of ``LIKELY`` (multiplicative hashing, by the golden ratio of 2^32)."""
    return np.uint32(np.uint32(colour) * np.uint32(2654435769)) >> np.uint32(32 - LIKELY_BITS)


@inner_kernel()
def root(parents, at):  # type: ignore[no-untyped-def]
    """Return the first run of the piece that a run belongs to."""
    while parents[at] != at:
        parents[at] = parents[parents[at]]
        at = parents[at]
    return at


@kernel("packed (R, C), colours (K), runs (M, RUN), parents (M)", where="1 <= C")
def joined_runs(packed, colours, runs, parents):  # type: ignore[no-untyped-def]
    """Find runs of ``colours`` along rows, and join those that touch in adjacent rows; return their number.

    Rows pass through ``harden_rows`` first, while they are in the processor's cache. Runs that touch at corners are
    joined too. packed: one uint32 a pixel. -1: there are more than ``runs`` holds.
    """
    rows, columns = packed.shape
    likely = np.zeros(LIKELY, np.bool_)
    for k in range(colours.size):
        likely[hash_of(colours[k])] = True
    line = np.empty(columns, np.uint32)
    sharp = line.view(np.uint8)
    most, least = np.empty((2, (columns + 2) * INKS), np.uint8)
    likely_bare = likely[hash_of(np.uint32(0))]
    count, before = 0, 0
    bare_above, bare_here, bare_below = True, True, rows == 0 or bare_row(packed[0])
    for y in range(rows):
        begin = count
        bare_above, bare_here = bare_here, bare_below
        bare_below = y + 1 == rows or bare_row(packed[y + 1])
        if bare_above and bare_here and bare_below and not likely_bare:  # as most of a page of type
            before = begin
            continue
        harden_row(packed, y, most, least, sharp)
        near = before
        x = 0
        while x < columns:
            value, first = line[x], x
            x += 1
            if x < columns and line[x] == value:
                while x + AT_ONCE <= columns and is_uniform(line, x, value):
                    x += AT_ONCE
            while x < columns and line[x] == value:
                x += 1
            if not likely[hash_of(value)]:  # one look, since photographs have millions of colours
                continue
            which = -1
            for k in range(colours.size):
                if colours[k] == value:
                    which = k
            if which < 0:
                continue
            if count == runs.shape[0]:
                return -1
            runs[count, 0], runs[count, 1], runs[count, 2], runs[count, 3] = y, first, x, which
            parents[count] = count
            while near < begin and runs[near, 2] < first:
                near += 1
            other = near
            while other < begin and runs[other, 1] <= x:
                if runs[other, 3] == which and runs[other, 0] == y - 1:
                    a, b = root(parents, other), root(parents, count)
                    parents[max(a, b)] = min(a, b)
                other += 1
            count += 1
        before = begin
    return count


@kernel("runs (M, RUN), parents (M), pieces (M, PIECE)")
def piece_boxes(runs, parents, pieces):  # type: ignore[no-untyped-def]
    """Compute box, area and colour of every piece of joined runs; return the number of pieces, and label each run."""
    count = 0
    for at in range(runs.shape[0]):
        first = root(parents, at)
        y, left, right, colour = runs[at, 0], runs[at, 1], runs[at, 2], runs[at, 3]
        if first == at:
            piece = count
            count += 1
            pieces[piece, 0], pieces[piece, 1], pieces[piece, 2] = left, y, right
            pieces[piece, 4], pieces[piece, 5] = 0, colour
        else:
            piece = runs[first, 3]
        runs[at, 3] = piece
        pieces[piece, 0] = min(pieces[piece, 0], left)
        pieces[piece, 2] = max(pieces[piece, 2], right)
        pieces[piece, 3] = y + 1
        pieces[piece, 4] += right - left
    for piece in range(count):
        pieces[piece, 2] -= pieces[piece, 0]
        pieces[piece, 3] -= pieces[piece, 1]
    return count


@kernel("runs (M, RUN), pieces (N, PIECE), wanted (N), out (_)", where="M >= 0")
def filled_pieces(runs, pieces, wanted, out):  # type: ignore[no-untyped-def]
    """Draw masks of pieces, row by row, each from ``wanted`` on in out; -1: not of this piece. out: 0 before."""
    for at in range(runs.shape[0]):
        piece = runs[at, 3]
        if wanted[piece] < 0:
            continue
        width = pieces[piece, 2]
        begin = wanted[piece] + (runs[at, 0] - pieces[piece, 1]) * width - pieces[piece, 0]
        for x in range(runs[at, 1], runs[at, 2]):
            out[begin + x] = 1
