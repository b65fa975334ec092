"""Compiled loops for connected components of a raster's colours."""

from __future__ import annotations

from prooflight.kernels.compiled import inner_kernel, kernel

RUN = 4
"""Length of a run's record: row, first column, column after its last, colour; its piece replaces its colour
later."""
PIECE = 6
"""Length of a piece's record: first column, first row, columns, rows, area, colour."""


@inner_kernel()
def root(parents, at):  # type: ignore[no-untyped-def]
    """Return the first run of the piece that a run belongs to."""
    while parents[at] != at:
        parents[at] = parents[parents[at]]
        at = parents[at]
    return at


@kernel("packed (R, C), colours (K), runs (M, RUN), parents (M)")
def joined_runs(packed, colours, runs, parents):  # type: ignore[no-untyped-def]
    """Find runs of ``colours`` along rows, and join those that touch in adjacent rows; return their number.

    Runs that touch at corners are joined too. packed: one number a pixel. -1: there are more than ``runs``
    holds.
    """
    rows, columns = packed.shape
    count, before = 0, 0
    for y in range(rows):
        line, begin = packed[y], count
        near = before
        x = 0
        while x < columns:
            value, first = line[x], x
            x += 1
            while x < columns and line[x] == value:
                x += 1
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
