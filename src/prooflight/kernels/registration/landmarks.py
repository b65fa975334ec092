"""Compiled loops for landmarks: the information of a design's tiles, and their composition of inks."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.prediction.lookup import lookup_light

EVEN_EDGE = 0.01
"""Squared difference above which edges have equal weight: a tenth of white from pixel to pixel."""


@kernel(
    "packed (_, _), rows (N), columns (N), quantised.codes (65536, 16), quantised.inner (_, 4), "
    "quantised.outer (_, 8), quantised.bits (4), backing, signals (N, _, W)",
    where="W % 8 == 0",
)
def tile_signals(packed, rows, columns, quantised, backing, signals):  # type: ignore[no-untyped-def]
    """Compute the mean signal of raster windows (tiles, height, width) float32 with corners at rows, columns.

    packed (rows, columns) uint32 of the raster; quantised: ``QuantisedTable`` of the mean; width a multiple
    of 8. Off the page the signal is ``backing``.
    """
    height, width = signals.shape[1:]
    seen = np.zeros(width, np.uint32)
    for tile in range(rows.size):
        left = min(max(-columns[tile], 0), width)
        right = max(min(packed.shape[1] - columns[tile], width), left)
        seen[:] = 0
        for r in range(height):
            row = rows[tile] + r
            signal = signals[tile, r]
            if not 0 <= row < packed.shape[0]:
                signal[:] = backing
                continue
            copy_row(packed[row, columns[tile] + left : columns[tile] + right], seen[left:right])
            lookup_light(seen, quantised, np.float32(0), signal)
            signal[:left] = backing
            signal[right:] = backing


@kernel(
    "expected (L, P), variance (L, P), offset (P), per_gain (P), gradient_noise, signal_noise2, "
    "size, margin, information (L // size, P // size, 2)",
    fastmath=True,
    error_model="numpy",
)
def tile_information(  # type: ignore[no-untyped-def]
    expected, variance, offset, per_gain, gradient_noise, signal_noise2, size, margin, information
):
    """Add to information (tile rows, tile columns, 2) that of tiles about displacements across and along [1/pixel^2].

    expected, variance (lines, pixels) [DN, DN^2]; offset, per_gain (pixels,) convert to light signal. The
    information is the sum of squared slopes over twice the variance, a share of the slopes squared and of the
    signal squared; pixels nearer to a tile's border than ``margin`` are left out.
    """
    rows, columns = information.shape[:2]
    pixels = expected.shape[1]
    light = np.empty((3, pixels), np.float32)
    half = np.float32(0.5)
    two = np.float32(2)
    across = np.zeros(columns * size, np.float32)
    along = np.zeros(columns * size, np.float32)
    last = expected.shape[0] - 1
    for line in range(-1, rows * size):
        coming = min(line + 1, last)
        row = light[(line + 1) % 3]
        for i in range(pixels):
            row[i] = (expected[coming, i] - offset[i]) * per_gain[i]
        if line < 0:
            copy_row(row, light[2])
            continue
        before, here, after = light[(line - 1) % 3], light[line % 3], light[(line + 1) % 3]
        counts = margin <= line % size < size - margin
        for i in range(1, min(columns * size, pixels - 1) if counts else 1):
            gx = half * (here[i + 1] - here[i - 1])
            gy = half * (after[i] - before[i])
            gx, gy = gx * gx, gy * gy
            weight = two * variance[line, i] + gradient_noise * (gx + gy) + signal_noise2 * here[i] * here[i]
            across[i] += gx / weight
            along[i] += gy / weight
        if line % size == size - 1:
            for column in range(columns):
                for i in range(column * size + margin, (column + 1) * size - margin):
                    information[line // size, column, 0] += across[i]
                    information[line // size, column, 1] += along[i]
            across[:] = 0
            along[:] = 0


@inner_kernel()
def read_grid(packed, row, column, stride_x, stride_y, logs, roots, grid):  # type: ignore[no-untyped-def]
    """Read raster pixels at strides from a corner: grid (5, size, size) of planes' logs and the light's root.

    packed (rows, columns) uint32 of the raster; logs, roots (4, 256) by ink byte; off the page the root is
    -1. Returns whether any pixel is.
    """
    rows, columns = packed.shape
    beyond = False
    before, is_cached = np.uint32(0), False
    a, b, c, d, root = logs[0, 0], logs[0, 0], logs[0, 0], logs[0, 0], roots[0, 0]
    for line in range(grid.shape[1]):
        y = row + line * stride_y
        inside = 0 <= y < rows
        source = packed[y if inside else 0]
        for i in range(grid.shape[2]):
            x = column + i * stride_x
            if not inside or x < 0 or x >= columns:
                grid[:4, line, i] = 0
                grid[4, line, i] = -1
                beyond = True
                continue
            packed_inks = source[x]
            if packed_inks != before or not is_cached:
                inks = (
                    packed_inks & 255,
                    (packed_inks >> 8) & 255,
                    (packed_inks >> 16) & 255,
                    packed_inks >> 24,
                )
                a, b, c, d = logs[0, inks[0]], logs[1, inks[1]], logs[2, inks[2]], logs[3, inks[3]]
                root = roots[0, inks[0]] * roots[1, inks[1]] * roots[2, inks[2]] * roots[3, inks[3]]
                before, is_cached = packed_inks, True
            grid[0, line, i], grid[1, line, i], grid[2, line, i], grid[3, line, i] = a, b, c, d
            grid[4, line, i] = root
    return beyond


@inner_kernel(fastmath=True, error_model="numpy")
def add_edges(grid, line, down, right, shares):  # type: ignore[no-untyped-def]
    """Add the parts of squared differences of a line of ``read_grid``'s and neighbours at an offset, to shares (7,)."""
    s0, s1, s2, s3, opposed = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    even = np.float32(EVEN_EDGE)
    size, other_line = grid.shape[2] - 1, line + down
    a, b, c, d = grid[0, line, :size], grid[1, line, :size], grid[2, line, :size], grid[3, line, :size]
    e, f = grid[0, other_line, right : size + right], grid[1, other_line, right : size + right]
    g, h = grid[2, other_line, right : size + right], grid[3, other_line, right : size + right]
    root, other = grid[4, line, :size], grid[4, other_line, right : size + right]
    for i in range(root.size):
        light = root[i] * other[i]
        light = light if min(root[i], other[i]) >= 0 else np.float32(0)
        p0, p1, p2, p3 = e[i] - a[i], f[i] - b[i], g[i] - c[i], h[i] - d[i]
        edge = (p0 + p1 + p2 + p3) * light
        weight = edge * light / (even + edge * edge)
        opposed += abs(weight) * (abs(p0) + abs(p1) + abs(p2) + abs(p3) - abs(p0 + p1 + p2 + p3))
        s0 += weight * p0
        s1 += weight * p1
        s2 += weight * p2
        s3 += weight * p3
    for ink, s in enumerate((s0, s1, s2, s3)):
        shares[ink] += s
        shares[5] += s
    shares[6] += opposed


@inner_kernel()
def add_page_edge(here, there, backing, shares):  # type: ignore[no-untyped-def]
    """Add the same for neighbours of which one is off the page: roots (pixels,) as from ``read_grid``."""
    for i in range(here.size):
        if (here[i] < 0) != (there[i] < 0):
            edge = max(here[i], there[i]) ** 2 - backing
            part = edge * edge / (EVEN_EDGE + edge * edge)
            shares[4] += part
            shares[5] += part


@kernel(
    "packed (_, _), rows (N), columns (N), size, stride_x, stride_y, logs (4, 256), backing, shares (N, 2, 7)"
)
def edge_shares(packed, rows, columns, size, stride_x, stride_y, logs, backing, shares):  # type: ignore[no-untyped-def]
    """Add the share of each plane in each tile's edges, across and along, to shares (tiles, 2, 7).

    rows, columns: raster pixel of each tile's corner, size: its camera pixels, stride_x, stride_y raster
    pixels apart. logs (4, 256) float32: logarithm of the light that an ink of that byte leaves; inks multiply
    (close enough for a share). Light is in shares of white. Of the seven sums four are an ink's part of squared
    differences, the fifth the part of the page's own edge, the sixth all of it; strong edges have less weight,
    as they do where tiles are measured. The last is the sum over edges of sum |s| - |sum s|, s the inks' parts: 0 where
    all begin or end together, and more than the edges themselves where one ends as others begin, and the light
    hardly changes.
    """
    grid = np.empty((5, size + 1, size + 1), np.float32)
    roots = np.exp(logs * np.float32(0.5))
    for tile in range(rows.size):
        beyond = read_grid(packed, rows[tile], columns[tile], stride_x, stride_y, logs, roots, grid)
        for line in range(size):
            add_edges(grid, line, 0, 1, shares[tile, 0])
            add_edges(grid, line, 1, 0, shares[tile, 1])
            if beyond:
                here, right, below = grid[4, line, :size], grid[4, line, 1:], grid[4, line + 1, :size]
                add_page_edge(here, right, backing, shares[tile, 0])
                add_page_edge(here, below, backing, shares[tile, 1])
