"""Compiled loops of registration: tiles rendered at an assumed placement, and sums of their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.registration.field import backward, cholesky, forward
from prooflight.kernels.registration.rendering import render_tile
from prooflight.kernels.vectors import fetch

if TYPE_CHECKING:
    from numpy.typing import NDArray

HUBER = 3.0
"""Residual above which a pixel's weight decreases: specks, dust, defects. [standard deviations]"""
SUMS = 15
NO_ESTIMATE = (np.float32(0),) * 4
"""Estimate for ``weighted_sums`` of a tile without an estimate yet."""


class SensorTaps(NamedTuple):
    """A footprint as weights of raster pixels, by the phase at which it begins; (phases, taps) each."""

    across: NDArray[np.float32]
    across_slope: NDArray[np.float32]
    """Derivative by the page's displacement. [1/pixel]"""
    along: NDArray[np.float32]
    along_slope: NDArray[np.float32]
    across_ratio: float
    """Raster pixels per camera pixel."""
    along_ratio: float


class SensorLight(NamedTuple):
    """Conversion of one sensor's scan to light, with its noise."""

    offset: NDArray[np.float32]
    """Offset of each column, (pixels,). [DN]"""
    per_gain: NDArray[np.floating]
    """Inverse of each column's gain, (pixels,)."""
    noise: NDArray[np.float32]
    """Variance without light, by signal, by signal squared, by gradient squared, (4,)."""


class TileWindows(NamedTuple):
    """Raster windows of all tiles of a page for one sensor, with their positions."""

    signals: NDArray[np.float32]
    """Signals as from ``tile_signals``, (tiles, height, width)."""
    origins: NDArray[np.float64]
    """Start of a tile's first footprint in the window, x and y, (tiles, 2). [raster pixels]"""
    lines: NDArray[np.int64]
    """Line of a tile's first pixel in the scan of a page at its nominal place, (tiles,)."""
    columns: NDArray[np.int64]


@inner_kernel(fastmath=True, error_model="numpy", forceinline=True)
def subtract(seen, light, left, part, image, error, base):  # type: ignore[no-untyped-def]
    """Subtract a tile's image from the scan's light, and compute base = 1 / variance; return the image's sum.

    seen (lines, columns): the scan's tile [DN]; light: ``SensorLight``; left: of the tile in the scan; part: its
    lines l0 .. l1 - 1 and columns i0 .. i1 - 1 inside the scan. image (3, lines, columns): value, derivatives;
    error, base (lines, columns).
    """
    l0, l1, i0, i1 = part
    total = np.float32(0)
    noise = light.noise
    dark, by_light, by_square, by_slope = noise[0], noise[1], noise[2], noise[3]
    level, gain = light.offset[left + i0 : left + i1], light.per_gain[left + i0 : left + i1]
    for line in range(l0, l1):
        numbers = seen[line, i0:i1]
        value, by_x, by_y = image[0, line, i0:i1], image[1, line, i0:i1], image[2, line, i0:i1]
        errors, weights = error[line, i0:i1], base[line, i0:i1]
        # Two loops run in vectors; one uses more arrays than the compiler checks for overlaps.
        for i in range(errors.size):
            errors[i] = (np.float32(numbers[i]) - level[i]) * gain[i] - value[i]
            total += value[i]
        for i in range(weights.size):
            m = value[i]
            flat = max(dark + by_light * m + by_square * m * m, dark)
            weights[i] = np.float32(1) / (flat + by_slope * (by_x[i] * by_x[i] + by_y[i] * by_y[i]))
    return total


@inner_kernel(fastmath=True, error_model="numpy", forceinline=True)
def weighted_sums(error, value, by_x, by_y, base, estimate, robust, mean, sums):  # type: ignore[no-untyped-def]
    """Sum up normal equations of offset, gain and displacement of one tile; all (pixels,), in any order.

    error: scan minus image; value, by_x, by_y: of the image; base: 1 / variance, 0 where nothing is seen.
    With ``robust`` the weight of pixels with large residuals about the estimate, as of ``solved``, is
    lowered.
    """
    level, gain, move_x, move_y = estimate
    # Scalars, not an array: the loop then runs in vectors.
    none = np.float32(0)
    s0, s1, s2, s3, s4, s5, s6, s7 = none, none, none, none, none, none, none, none
    s8, s9, s10, s11, s12, s13, s14 = none, none, none, none, none, none, none
    limit = np.float32(HUBER)
    tiny = np.float32(1e-6)
    one = np.float32(1)
    for i in range(error.size):
        r = value[i] - mean
        gx = by_x[i]
        gy = by_y[i]
        e = error[i]
        w = base[i]
        if robust:
            left = e - level - gain * r - move_x * gx - move_y * gy
            w *= min(one, limit / np.sqrt(left * left * w + tiny))
        wr = w * r
        wx = w * gx
        wy = w * gy
        we = w * e
        s0 += w
        s1 += wr
        s2 += wx
        s3 += wy
        s4 += wr * r
        s5 += wr * gx
        s6 += wr * gy
        s7 += wx * gx
        s8 += wx * gy
        s9 += wy * gy
        s10 += we
        s11 += we * r
        s12 += we * gx
        s13 += we * gy
        s14 += we * e
    for k, s in enumerate((s0, s1, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13, s14)):
        sums[k] = s


@inner_kernel(forceinline=True)
def fetch_pixels(scan, windows, tile, move, size):  # type: ignore[no-untyped-def]
    """Fetch a tile's pixels of a scan displaced by move (2,) from memory, while another is measured."""
    left, top = windows.columns[tile] + int(np.rint(move[0])), windows.lines[tile] + int(np.rint(move[1]))
    for line in range(max(top, 0), min(top + size, scan.shape[0])):
        fetch(scan[line], left, left + 2 * size - 1)


@kernel(
    "scan (L, P), lost (L), light.offset (P), light.per_gain (P), light.noise (4), windows.signals (A, _, W), "
    "windows.origins (A, 2), windows.lines (A), windows.columns (A), taps.across (_, X), "
    "taps.across_slope (_, X), taps.along (_, Y), taps.along_slope (_, Y), tiles (N), moves (N, 2), size, "
    "workspace.value (V), workspace.tilt (V), workspace.lines (2, size), workspace.columns (2, size), "
    "sums (N, SUMS + 1)",
    where="8 * W <= V, W % 16 == 0, size % 8 == 0",
    error_model="numpy",
)
def measure_tiles(scan, lost, light, windows, taps, tiles, moves, size, workspace, sums):  # type: ignore[no-untyped-def]
    """Run ``weighted_sums`` on chosen tiles of one sensor, with the page displaced by ``moves`` (tiles, 2).

    scan (lines, pixels) uint16; lost (lines,) bool: missing lines of it; moves: pixels x, y; light:
    ``SensorLight``; windows: ``TileWindows``; taps: ``SensorTaps``; tiles (n,): indices of the tiles to
    measure, of size x size pixels; workspace: ``Workspace``. sums (n, SUMS + 1): the last is the number of
    pixels, 0 where the tile is outside the scan, or less than a quarter of its lines was seen.
    """
    image, seen = np.empty((3, size, size), np.float32), np.empty((size, size), scan.dtype)
    error = np.empty((size, size), np.float32)
    base = np.empty((size, size), np.float32)
    value, by_x, by_y = image[0].reshape(-1), image[1].reshape(-1), image[2].reshape(-1)
    errors, weights = error.reshape(-1), base.reshape(-1)
    for n in range(tiles.size):
        tile = tiles[n]
        following = min(n + 1, tiles.size - 1)
        fetch_pixels(scan, windows, tiles[following], moves[following], size)
        whole_x, whole_y = int(np.rint(moves[n, 0])), int(np.rint(moves[n, 1]))
        left, top = windows.columns[tile] + whole_x, windows.lines[tile] + whole_y
        i0, i1 = max(-left, 0), min(size, scan.shape[1] - left)
        l0, l1 = max(-top, 0), min(size, scan.shape[0] - top)
        sums[n] = 0
        if i1 - i0 < size // 2 or l1 - l0 < size // 2:
            continue
        missing = 0
        for line in range(l0, l1):
            missing += lost[top + line]
        if l1 - l0 - missing < size // 4:
            continue
        x = windows.origins[tile, 0] - (moves[n, 0] - whole_x) * taps.across_ratio
        y = windows.origins[tile, 1] - (moves[n, 1] - whole_y) * taps.along_ratio
        # Read before any arithmetic, so that the processor waits for all lines of the memory at once.
        for line in range(l0, l1):
            copy_row(scan[top + line, left + i0 : left + i1], seen[line, i0:i1])
        ahead = windows.signals[tiles[following]]
        render_tile(windows.signals[tile], x, y, taps, workspace, image, ahead)
        count = (l1 - l0) * (i1 - i0)
        if count < size * size:
            errors[:] = 0
            weights[:] = 0
        part = (l0, l1, i0, i1)
        total = subtract(seen, light, left, part, image, error, base)
        mean = total / np.float32(count)
        if missing:
            for line in range(l0, l1):
                if lost[top + line]:
                    error[line] = 0
                    base[line] = 0
            count -= missing * (i1 - i0)
        weighted_sums(errors, value, by_x, by_y, weights, NO_ESTIMATE, False, mean, sums[n])
        weighted_sums(errors, value, by_x, by_y, weights, solved(sums[n]), True, mean, sums[n])
        sums[n, SUMS] = count


@inner_kernel(error_model="numpy")
def solved(s):  # type: ignore[no-untyped-def]
    """Return offset, gain and displacement x, y that solve one tile's normal equations."""
    a = np.empty((4, 4))
    right_side = np.empty((1, 4))
    b = right_side[0]
    k = 0
    for i in range(4):
        for j in range(i, 4):
            a[i, j] = s[k]
            a[j, i] = s[k]
            k += 1
        b[i] = s[10 + i]
    for i in range(4):  # slight damping, since a tile may have edges of one direction only
        a[i, i] = a[i, i] * (1 + 1e-4) + 1e-9
    cholesky(a, 0)
    forward(a, right_side)
    backward(a, b)
    return np.float32(b[0]), np.float32(b[1]), np.float32(b[2]), np.float32(b[3])
