"""Compiled loops for glyphs: the energy of residuals, given a hypothesis of the letter."""

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
def row_between(image, first, v, out):  # type: ignore[no-untyped-def]
    """Interpolate between two rows of an image's cells, out (columns,); the upper one begins at ``first``."""
    upper, lower = image[first : first + out.size], image[first + out.size : first + 2 * out.size]
    for x in range(out.size):
        out[x] = upper[x] + v * (lower[x] - upper[x])


@inner_kernel(fastmath=True, error_model="numpy")
def pixels_of(row, first, u, out):  # type: ignore[no-untyped-def]
    """Interpolate a row of cells at pixels, out (n,); the first lies by u behind the middle of cell ``first``."""
    cells = row[first:]  # so that the compiler knows that no index is negative
    for k in range(out.size):
        out[k] = cells[SHARE * k] + u * (cells[SHARE * k + 1] - cells[SHARE * k])


@inner_kernel(fastmath=True, error_model="numpy")
def nuisances_of(above, here, below, at, basis):  # type: ignore[no-untyped-def]
    """Write the effects of a glyph's nuisances on a row of pixels, at a slice of basis (nuisances, pixels).

    above, here, below: images of the letter a pixel apart, each from a pixel before the row to one behind it.
    """
    ink, across, along, level = basis[0, at], basis[1, at], basis[2, at], basis[3, at]
    broad, tall = basis[4, at], basis[5, at]
    for k in range(ink.size):
        ink[k] = here[k + 1]
        level[k] = 1.0
    for k in range(ink.size):
        across[k] = np.float32(0.5) * (here[k + 2] - here[k])
        broad[k] = here[k] + here[k + 2] - np.float32(2) * here[k + 1]
    for k in range(ink.size):
        along[k] = np.float32(0.5) * (below[k + 1] - above[k + 1])
        tall[k] = above[k + 1] + below[k + 1] - np.float32(2) * here[k + 1]


@inner_kernel(fastmath=True, error_model="numpy")
def add_evidence(left, weight, contrast, push, power, energy):  # type: ignore[no-untyped-def]
    """Add a row's c r / V, c^2 / V and r^2 / V of one sensor, (n,) each."""
    for x in range(push.size):
        weighted = weight[x] * left[x]
        push[x] += contrast * weighted
        power[x] += contrast * contrast * weight[x]
        energy[x] += weighted * left[x]


@inner_kernel(fastmath=True, error_model="numpy")
def product_sum(one, other):  # type: ignore[no-untyped-def]
    """Return the sum of products of two rows."""
    total = 0.0
    for x in range(one.size):
        total += one[x] * other[x]
    return total


@inner_kernel(error_model="numpy")
def normal_equations(basis, push, power, weighted, whole, right):  # type: ignore[no-untyped-def]
    """Add a glyph's products to the lower half of whole (n, n), and write right (n,); basis (n, pixels)."""
    for i in range(basis.shape[0]):
        one = basis[i]
        for x in range(one.size):
            weighted[x] = power[x] * one[x]
        for j in range(i + 1):
            whole[i, j] += product_sum(weighted, basis[j])
        right[i] = product_sum(push, one)


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
    lines, pixels = left.shape[1:]
    most_rows, most_columns = patches.size[:, 0].max(), patches.size[:, 1].max()  # of cells
    most_lines, most_pixels = most_rows // SHARE + 1, most_columns // SHARE + 1
    most = most_lines * most_pixels
    bases, weighed = np.empty(NUISANCES * most), np.empty((4, most))
    cells, seen = np.empty(most_columns, np.float32), np.empty((most_lines + 2, most_pixels + 2), np.float32)
    whole, right = np.empty((NUISANCES, NUISANCES)), np.empty(NUISANCES)
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
        # A margin of two cells, so that slopes are known everywhere.
        first_line, first_pixel = max(int(np.ceil(y + 1)), 0), max(int(np.ceil(x + 1)), 0)
        past_line = min(int(np.floor(y + np.float32(rows - 1) * _HALF - _MARGIN)) + 1, lines)
        past_pixel = min(int(np.floor(x + np.float32(columns - 1) * _HALF - _MARGIN)) + 1, pixels)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = 0.0, 0.0, -by_x, -by_y
        wide, high = past_pixel - first_pixel, past_line - first_line
        if wide <= 0 or high <= 0:
            continue
        basis = bases[: NUISANCES * wide * high].reshape(NUISANCES, wide * high)
        push, power = weighed[0, : wide * high], weighed[1, : wide * high]
        energy, weighted = weighed[2, : wide * high], weighed[3, : wide * high]
        push[:], power[:], energy[:] = 0.0, 0.0, 0.0
        for s in range(left.shape[0]):
            for line in range(first_line, past_line):  # first all of them, so that memory is read ahead
                here = slice((line - first_line) * wide, (line - first_line + 1) * wide)
                add_evidence(
                    left[s, line, first_pixel:past_pixel],
                    weight[s, line, first_pixel:past_pixel],
                    placed.contrast[n, s],
                    push[here],
                    power[here],
                    energy[here],
                )
        u = (np.float32(first_pixel) - x) * np.float32(SHARE)
        column = min(max(np.int64(u), SHARE), columns - SHARE * (wide + 1))
        u -= np.float32(column)
        v = (np.float32(first_line) - y) * np.float32(SHARE)
        row = min(max(np.int64(v), SHARE), rows - SHARE * (high + 1))
        v -= np.float32(row)
        for k in range(high + 2):
            row_between(own, first + (row + SHARE * (k - 1)) * columns, v, cells[:columns])
            pixels_of(cells, column - SHARE, u, seen[k, : wide + 2])
        for k in range(high):
            nuisances_of(seen[k], seen[k + 1], seen[k + 2], slice(k * wide, (k + 1) * wide), basis)
        whole[:] = 0.0
        for i in range(NUISANCES):
            whole[i, i] = prior_power[i]
        normal_equations(basis, push, power, weighted, whole, right)
        count, total = 0, 0.0
        for k in range(power.size):
            if power[k] > 0:
                count += 1
                total += energy[k]
        out[n, 0], out[n, 1] = total - explained(whole, right), count
