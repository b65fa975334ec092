"""Compiled loops for glyphs: connected components, and the energy of residuals, given a hypothesis of the letter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.residuals.moving import STRETCH

NUISANCES = 6
"""Number of nuisances of one glyph: its ink as a whole, its place across and along, the level around it, the
breadth of its strokes across and along."""
SHARE = 2
"""Cells of a patch per camera pixel, each way."""
_HALF = np.float32(0.5)
_MARGIN = np.float32(1.5)
RUN = 4
"""Length of a run's record: row, first column, column after its last, colour; its piece replaces its colour
later."""
PIECE = 6
"""Length of a piece's record: first column, first row, columns, rows, area, colour."""


class Patches(NamedTuple):
    """Images of letters, in cells of half a camera pixel, one after the other."""

    own: NDArray[np.float32]
    """Share of a letter's ink that a pixel in the middle of each cell sees, (cells,)."""
    size: NDArray[np.int64]
    """Rows and columns of each letter, (letters, 2)."""
    first: NDArray[np.int64]
    """Index of the first cell of each letter, (letters,)."""


class PlacedGlyphs(NamedTuple):
    """Glyphs in the scan of a page at its nominal place."""

    letter: NDArray[np.int64]
    """Letter of each glyph, (glyphs,)."""
    at: NDArray[np.float32]
    """Middle of a patch's first cell, right and down, (glyphs, 2). [pixels]"""
    contrast: NDArray[np.float32]
    """Light of the ink minus that of its surroundings, (glyphs, sensors). [DN]"""


@inner_kernel(error_model="numpy")
def displaced(nodes, x, y):  # type: ignore[no-untyped-def]
    """Interpolate a field at nodes (R, C), ``STRETCH`` pixels apart, at a place; bilinear."""
    u, v = x / np.float32(STRETCH), y / np.float32(STRETCH)
    column = min(max(np.int64(u), 0), nodes.shape[1] - 2)
    row = min(max(np.int64(v), 0), nodes.shape[0] - 2)
    u, v = u - np.float32(column), v - np.float32(row)
    above = nodes[row, column] + u * (nodes[row, column + 1] - nodes[row, column])
    below = nodes[row + 1, column] + u * (nodes[row + 1, column + 1] - nodes[row + 1, column])
    return above + v * (below - above)


@inner_kernel(fastmath=True, error_model="numpy")
def cell(image, first, columns, row, column, u, v):  # type: ignore[no-untyped-def]
    """Interpolate an image between the middles of four cells."""
    at = first + row * columns + column
    p = image[at] + u * (image[at + 1] - image[at])
    below = at + columns
    q = image[below] + u * (image[below + 1] - image[below])
    return p + v * (q - p)


@inner_kernel(error_model="numpy")
def explained(whole, right):  # type: ignore[no-untyped-def]
    """Return right' whole^-1 right of a small symmetric positive system; overwrites both (Cholesky)."""
    n = right.size
    total = 0.0
    for i in range(n):
        for j in range(i + 1):
            left = whole[i, j]
            for k in range(j):
                left -= whole[i, k] * whole[j, k]
            whole[i, j] = np.sqrt(max(left, 1e-12)) if i == j else left / whole[j, j]
        for k in range(i):
            right[i] -= whole[i, k] * right[k]
        right[i] /= whole[i, i]
        total += right[i] * right[i]
    return total


@kernel(
    "left (S, L, P), weight (S, L, P), across (R, C), along (R, C), patches.own (_), patches.size (U, 2), "
    "patches.first (U), placed.letter (N), placed.at (N, 2), placed.contrast (N, S), prior_power (NUISANCES), start, "
    "stop, out (N, 4)",
    where="R >= 2, C >= 2, 0 <= start, start <= stop, stop <= N",
    error_model="numpy",
)
def glyph_energies(  # type: ignore[no-untyped-def]
    left, weight, across, along, patches, placed, prior_power, start, stop, out
):
    """Compute the residual energy of glyphs start .. stop after a fit of their nuisances, into out (n, 4).

    Columns of out: energy of the residuals that the nuisances leave, number of pixels, and displacement of
    the glyph in the scan, right and down [pixels]. left, weight: residuals and their inverse variance;
    across, along: ``PixelMap``; known: inverse variances of a glyph's nuisances, in units of its contrast and
    pixels.
    """
    own = patches.own
    sensors, lines, pixels = left.shape
    basis = np.empty(NUISANCES, np.float64)
    whole = np.empty((NUISANCES, NUISANCES), np.float64)
    right = np.empty(NUISANCES, np.float64)
    for n in range(start, stop):
        letter = placed.letter[n]
        rows, columns = patches.size[letter, 0], patches.size[letter, 1]
        first = patches.first[letter]
        x, y = placed.at[n, 0], placed.at[n, 1]
        middle_x = x + np.float32(columns - 1) / np.float32(2 * SHARE)
        middle_y = y + np.float32(rows - 1) / np.float32(2 * SHARE)
        by_x, by_y = displaced(across, middle_x, middle_y), displaced(along, middle_x, middle_y)
        seen_x, seen_y = middle_x - by_x, middle_y - by_y
        by_x, by_y = displaced(across, seen_x, seen_y), displaced(along, seen_x, seen_y)
        x, y = x - by_x, y - by_y
        whole[:] = 0.0
        right[:] = 0.0
        for i in range(NUISANCES):
            whole[i, i] = prior_power[i]
        energy, count = 0.0, 0
        # A margin of two cells, so that slopes are known everywhere.
        first_line, first_pixel = max(int(np.ceil(y + 1)), 0), max(int(np.ceil(x + 1)), 0)
        past_line = min(int(np.floor(y + np.float32(rows - 1) * _HALF - _MARGIN)) + 1, lines)
        past_pixel = min(int(np.floor(x + np.float32(columns - 1) * _HALF - _MARGIN)) + 1, pixels)
        for line in range(first_line, past_line):
            v = (np.float32(line) - y) * np.float32(SHARE)
            row = min(max(np.int64(v), SHARE), rows - SHARE - 2)
            v -= np.float32(row)
            for pixel in range(first_pixel, past_pixel):
                r, w, e = 0.0, 0.0, 0.0
                for s in range(sensors):
                    c, sure, rest = placed.contrast[n, s], weight[s, line, pixel], left[s, line, pixel]
                    r += c * sure * rest
                    w += c * c * sure
                    e += sure * rest * rest
                if w <= 0:
                    continue
                u = (np.float32(pixel) - x) * np.float32(SHARE)
                column = min(max(np.int64(u), SHARE), columns - SHARE - 2)
                u -= np.float32(column)
                here = cell(own, first, columns, row, column, u, v)
                left_of = cell(own, first, columns, row, column - SHARE, u, v)
                right_of = cell(own, first, columns, row, column + SHARE, u, v)
                above = cell(own, first, columns, row - SHARE, column, u, v)
                below = cell(own, first, columns, row + SHARE, column, u, v)
                basis[0] = here
                basis[1] = 0.5 * (right_of - left_of)
                basis[2] = 0.5 * (below - above)
                basis[3] = 1.0
                basis[4] = left_of + right_of - 2 * here
                basis[5] = above + below - 2 * here
                for i in range(NUISANCES):
                    for j in range(i + 1):
                        whole[i, j] += w * basis[i] * basis[j]
                    right[i] += r * basis[i]
                energy += e
                count += 1
        out[n, 0] = energy - explained(whole, right)
        out[n, 1], out[n, 2], out[n, 3] = count, -by_x, -by_y


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
