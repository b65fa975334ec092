"""Compiled loops for sums of residuals over tiles and down columns, for every mode.

Row by row, one array written at a time, so that the loops run in vectors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.residuals.fit import shows

VOID, BLUR, WHOLE = 1 + 2 * INKS, 2 + 2 * INKS, 3 + 2 * INKS
"""Numbers of modes: light, each ink added (4), each ink's gain (4), void, blur and all inks' gain."""
_MOST_SQUARE = np.float32(25)
_FLOOR = np.float32(1e-12)


class ResidualImages(NamedTuple):
    """Residuals of one sensor's scan with the images for its modes; images (..., lines, pixels).

    With one more axis in front, those of all sensors.
    """

    residual: NDArray[np.float32]
    """Residual. [DN]"""
    weight: NDArray[np.float32]
    """Inverse variance. [1/DN^2]"""
    light: NDArray[np.float32]
    """Expected light. [DN]"""
    white: NDArray[np.float32]
    """Light of bare paper, (..., pixels). [DN]"""
    add: NDArray[np.float32]
    """``Modes.add``, (..., 4, lines, pixels). [DN]"""
    gain: NDArray[np.float32]
    """``Modes.gain``, (..., 4, lines, pixels). [DN]"""
    of_edges: NDArray[np.float32]
    """Share of the variance due to edges. [-]"""


@inner_kernel(fastmath=True, error_model="numpy")
def weighted_row(residual, weight, light, of_edges, most, most_edge, out):  # type: ignore[no-untyped-def]
    """Prepare a row (pixels,) for summing, out (4, pixels).

    Written: r / V with r limited to ``most`` sigma, 1 / V, light / V and the edges' part of 1 / V. Pixels
    whose variance is due to edges by more than ``most_edge`` are left out.
    """
    push, power, shared, edges = out[0], out[1], out[2], out[3]
    for x in range(residual.size):
        power[x] = weight[x] if of_edges[x] <= most_edge else np.float32(0)
    for x in range(residual.size):
        r, w = residual[x], power[x]
        push[x] = r * w * min(np.float32(1), most / np.sqrt(r * r * w + _FLOOR))
    for x in range(residual.size):
        shared[x] = light[x] * power[x]
    for x in range(residual.size):
        edges[x] = of_edges[x] * power[x]


@inner_kernel(fastmath=True, error_model="numpy")
def add_mode(mode, push, power, light, edge, pushes, powers, shared, edges):  # type: ignore[no-untyped-def]
    """Add a row's sums for one mode (pixels,) to its four sums; push .. edge: as from ``weighted_row``."""
    for x in range(mode.size):
        pushes[x] += mode[x] * push[x]
    for x in range(mode.size):
        powers[x] += mode[x] * mode[x] * power[x]
    for x in range(mode.size):
        shared[x] += mode[x] * light[x]
    for x in range(mode.size):
        edges[x] += mode[x] * mode[x] * edge[x]


@inner_kernel(fastmath=True, error_model="numpy")
def void_row(light, white, out):  # type: ignore[no-untyped-def]
    """Compute the difference to bare paper."""
    for x in range(out.size):
        out[x] = white[x] - light[x]


@inner_kernel(fastmath=True, error_model="numpy")
def blur_row(light, line, out):  # type: ignore[no-untyped-def]
    """Compute half the sum of four neighbours less twice the middle; 0 at both ends."""
    above, here, below = light[line - 1], light[line], light[line + 1]
    out[0], out[out.size - 1] = np.float32(0), np.float32(0)
    for x in range(1, out.size - 1):
        around = here[x + 1] + here[x - 1] + above[x] + below[x]
        out[x] = around * np.float32(0.5) - np.float32(2) * here[x]


@kernel(
    "images.residual (L, P), images.weight (L, P), images.light (L, P), images.white (P), "
    "images.add (4, L, P), images.gain (4, L, P), images.of_edges (L, P), most_edges (N), shift (L), "
    "segment_lines, which (M), first, last, out (N, 4, M, G, P)",
    where="0 <= first, last <= G",
    fastmath=True,
    error_model="numpy",
)
def line_sums(images, most_edges, shift, segment_lines, which, first, last, out):  # type: ignore[no-untyped-def]
    """Add sums down the columns of a page, in segments of its height, to out (n, 4, modes, segments, pixels).

    Segments first .. last - 1 are processed. which (modes,): numbers of modes, none beyond ``VOID``. Of each:
    sum P r / V; P^2 / V; P light / V; the edges' part of P^2 / V. r is limited to 4 sigma. most_edges (n,):
    greatest share of variance due to edges of pixels that count. shift (lines,): whole pixels by which a line
    is moved left, so that columns of a turned page coincide.
    """
    residual, weight, light, white, add, gain, of_edges = images
    lines, pixels = residual.shape
    rows = np.empty((most_edges.size, 4, pixels), np.float32)
    void = np.empty(pixels, np.float32)
    end = lines if last == out.shape[3] else last * segment_lines
    for line in range(max(first * segment_lines, 2), min(end, lines - 2)):
        segment = min(line // segment_lines, out.shape[3] - 1)
        by = shift[line]
        left, right = max(by, 0), min(pixels + by, pixels)
        if left >= right:
            continue
        for n in range(most_edges.size):
            weighted_row(
                residual[line],
                weight[line],
                light[line],
                of_edges[line],
                np.float32(4),
                most_edges[n],
                rows[n],
            )
        void_row(light[line], white, void)
        to = slice(left - by, right - by)
        for place in range(which.size):
            m = which[place]
            if m == 0:
                mode = light[line, left:right]
            elif m < 1 + INKS:
                mode = add[m - 1, line, left:right]
            elif m < 1 + 2 * INKS:
                mode = gain[m - 1 - INKS, line, left:right]
                if not shows(mode):
                    continue
            else:
                mode = void[left:right]
            for n in range(most_edges.size):
                row = rows[n]
                # Every row by itself is contiguous, as loops in vectors need it; a slice of all rows is not.
                add_mode(
                    mode,
                    row[0, left:right],
                    row[1, left:right],
                    row[2, left:right],
                    row[3, left:right],
                    out[n, 0, place, segment, to],
                    out[n, 1, place, segment, to],
                    out[n, 2, place, segment, to],
                    out[n, 3, place, segment, to],
                )


@inner_kernel(fastmath=True, error_model="numpy")
def add_tile_row(images, first, last, side, which, rows, scratch, sums, out):  # type: ignore[no-untyped-def]
    """Add sums over one row of tiles, lines first .. last - 1 of one sensor, to out (4, modes + 1, tile columns).

    rows (side, 4, pixels), made (3, side, pixels), sums (4, pixels) are working space; the rest as in
    ``tile_sums``.
    """
    residual, weight, light, white, add, gain, of_edges = images
    for line in range(first, last):
        k = line - first
        weighted_row(
            residual[line], weight[line], light[line], of_edges[line], np.float32(10), np.float32(1), rows[k]
        )
        for place in range(which.size):
            m = which[place]
            if m == VOID:
                void_row(light[line], white, scratch[0, k])
            elif m == BLUR:
                blur_row(light, line, scratch[1, k])
            elif m == WHOLE:
                whole_row(gain[0, line], gain[1, line], gain[2, line], gain[3, line], scratch[2, k])
    for place in range(which.size):
        m = which[place]
        sums[:] = np.float32(0)
        for k in range(last - first):
            if m == 0:
                mode = light[first + k]
            elif m < 1 + INKS:
                mode = add[m - 1, first + k]
            elif m < 1 + 2 * INKS:
                mode = gain[m - 1 - INKS, first + k]
                if not shows(mode):
                    continue
            else:
                mode = scratch[m - VOID, k]
            row = rows[k]
            add_mode(mode, row[0], row[1], row[2], row[3], sums[0], sums[1], sums[2], sums[3])
        for part in range(4):
            gather(sums[part], side, out[part, place])
    sums[:2] = np.float32(0)
    for line in range(first, last):
        add_energy(residual[line], weight[line], sums[0], sums[1])
    gather(sums[0], side, out[0, which.size])
    gather(sums[1], side, out[1, which.size])


@kernel(
    "images.residual (S, L, P), images.weight (S, L, P), images.light (S, L, P), images.white (S, P), "
    "images.add (S, 4, L, P), images.gain (S, 4, L, P), images.of_edges (S, L, P), side, "
    "which (M), first, last, out (4, M + 1, L // side, P // side)",
    where="0 <= first, last <= L // side",
)
def tile_sums(images, side, which, first, last, out):  # type: ignore[no-untyped-def]
    """Compute sums over tiles of all sensors: out (4, modes + 1, tile rows, tile columns), rows first .. last - 1.

    images: ``ResidualImages`` of all sensors; which (modes,): numbers of modes. As ``line_sums``, r limited
    to 10 sigma; the last mode is the energy: sum of r^2 / V, each at most 25, and pixels. Sensors alternate
    at each row of tiles, whose sums stay in the cache: all tiles together are as large as all images.
    """
    residual, weight, light, white, add, gain, of_edges = images
    lines, pixels = residual.shape[1:]
    rows = np.empty((side, 4, pixels), np.float32)
    scratch = np.empty((3, side, pixels), np.float32)
    sums = np.empty((4, pixels), np.float32)
    here = np.empty((4, which.size + 1, out.shape[3]), np.float32)
    for tile in range(first, last):
        here[:] = np.float32(0)
        begin, end = max(tile * side, 2), min((tile + 1) * side, lines - 2)
        for s in range(residual.shape[0]):
            own = ResidualImages(residual[s], weight[s], light[s], white[s], add[s], gain[s], of_edges[s])
            add_tile_row(own, begin, end, side, which, rows, scratch, sums, here)
        for i in range(4):
            for mode in range(which.size + 1):
                copy_row(here[i, mode], out[i, mode, tile])


@inner_kernel(fastmath=True, error_model="numpy")
def whole_row(cyan, magenta, yellow, black, out):  # type: ignore[no-untyped-def]
    """Compute the sum of all inks' gain."""
    for x in range(out.size):
        out[x] = cyan[x] + magenta[x] + yellow[x] + black[x]


@inner_kernel(fastmath=True, error_model="numpy")
def add_energy(residual, weight, energy, count):  # type: ignore[no-untyped-def]
    """Add a row's squared residuals over their variance, and the number of pixels that have any."""
    for x in range(residual.size):
        energy[x] += min(residual[x] * residual[x] * weight[x], _MOST_SQUARE)
    for x in range(residual.size):
        count[x] += np.float32(weight[x] > 0)


@inner_kernel(fastmath=True, error_model="numpy")
def gather(sums, side, out):  # type: ignore[no-untyped-def]
    """Add sums (pixels,) in tiles of ``side`` to out (tile columns,)."""
    if side == 2:
        for column in range(out.size):
            out[column] += sums[2 * column] + sums[2 * column + 1]
        return
    for column in range(out.size):
        total = np.float32(0)
        for x in range(column * side, (column + 1) * side):
            total += sums[x]
        out[column] += total
