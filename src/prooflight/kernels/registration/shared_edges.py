"""Compiled loops for the register of planes by fringes: edges that planes share, and renderings of patches there."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.lookup import bits_of, lookup_eight, lookup_light, masks_of
from prooflight.kernels.registration.measuring import NO_ESTIMATE, weighted_sums
from prooflight.kernels.registration.rendering import EIGHT, displace_eight, render_tile

if TYPE_CHECKING:
    from numpy.typing import NDArray

PAIRS = 6
"""Number of pairs of four planes: CM, CY, CK, MY, MK, YK."""
EDGES = 10
"""Number of kinds of edges: shared by a pair of planes, or of any one plane, CMYK."""
ROUNDS = 5
LAST_PHASE = 1 - 2.0**-20
"""Greatest phase within a raster pixel, before the next begins."""


class SensorPatches(NamedTuple):
    """Patches of one scan for one sensor, with the raster under them."""

    light: NDArray[np.float32]
    """Light of the scan, (patches, size, size). [DN]"""
    base: NDArray[np.float32]
    """Inverse variance, (patches, size, size)."""
    packed: NDArray[np.uint32]
    """Raster around the patches, for ``displace_planes``, (patches, height + 2 margin, width + 2 margin)."""
    margin: int
    origins: NDArray[np.float64]
    """Start of the first footprint in the window, (patches, 2). [raster pixels]"""
    moves: NDArray[np.float64]
    """Displacement of the page, (patches, 2). [raster pixels]"""
    seen: NDArray[np.uint32]
    """Recipes of the set of displacements that was rendered last, (patches, height, width)."""
    window: NDArray[np.float32]
    """Light of these, in the same shape. [DN]"""


@kernel(
    "packed (H, W), cell, stride_x, stride_y, light (4, 256), scores (R, C, 2, EDGES)",
    where="(R * cell - 1) * stride_y < H, (C * cell - 1) * stride_x < W",
    error_model="numpy",
)
def shared_edges(packed, cell, stride_x, stride_y, light, scores):  # type: ignore[no-untyped-def]
    """Add the strength of edges that planes share, and of all edges of a plane, to scores (rows, columns, 2, EDGES).

    packed (rows, columns) uint32 of the raster, sampled in steps of stride_x, stride_y raster pixels; a cell
    is ``cell`` such steps wide and high. light (4, 256): share of the light that an ink of that byte leaves;
    inks multiply (close enough for a choice). A plane off the others shows a strip of itself on the lighter
    side of an edge, across or along; the strip of the weaker of two counts, squared, in shares of white.
    """
    for row in range(scores.shape[0]):
        for line in range(row * cell, (row + 1) * cell):
            y = line * stride_y
            for i in range(scores.shape[1] * cell):
                x = i * stride_x
                here = packed[y, x]
                if x + stride_x < packed.shape[1] and packed[y, x + stride_x] != here:
                    add_strips(here, packed[y, x + stride_x], light, scores[row, i // cell, 0])
                if y + stride_y < packed.shape[0] and packed[y + stride_y, x] != here:
                    add_strips(here, packed[y + stride_y, x], light, scores[row, i // cell, 1])


@inner_kernel(error_model="numpy")
def add_strips(here, there, light, scores):  # type: ignore[no-untyped-def]
    """Add the contribution of two neighbouring raster pixels to ``shared_edges``, scores (EDGES,)."""
    one, other = np.float32(1), np.float32(1)
    change = (
        np.float32(0),
        np.float32(0),
        np.float32(0),
        np.float32(0),
    )  # an array would be allocated each time
    for ink in range(4):
        a, b = light[ink, (here >> (8 * ink)) & 255], light[ink, (there >> (8 * ink)) & 255]
        one, other = one * a, other * b
        change = (change[1], change[2], change[3], np.float32(1) - min(a, b) / max(a, b))
    most = max(one, other) ** 2
    pair = 0
    for first in range(4):
        scores[PAIRS + first] += most * change[first] ** 2
        for second in range(first + 1, 4):
            scores[pair] += most * min(change[first], change[second]) ** 2
            pair += 1


@inner_kernel(forceinline=True)
def render_light(packed, part, right, down, table, bits, masks, seen, window, changed):  # type: ignore[no-untyped-def]
    """Displace a packed raster's planes by right, down (4,), and look up those groups of eight recipes that change.

    packed: around the patch, with the same margin on all sides; part: its rows and columns that are seen, first and
    last each, without the margin. seen, window (height, width): recipes and their light, which go together before and
    after; table: ``QuantisedTable``, with its bits and masks; changed: room for as many numbers as there are groups.
    """
    first_row, last_row, first_column, last_column = part
    width, across = seen.shape[1], packed.shape[1]
    margin = (across - width) // 2
    c, m = down[0] * across + right[0], down[1] * across + right[1]
    y, k = down[2] * across + right[2], down[3] * across + right[3]
    count = 0
    for row in range(first_row, last_row):
        for column in range(first_column // EIGHT * EIGHT, last_column, EIGHT):
            place, at = (row + margin) * across + margin + column, row * width + column
            changed[count] = at  # a list: the processor could not foresee which groups are to be looked up
            count += displace_eight(packed, place - c, place - m, place - y, place - k, seen, at)
    for n in range(count):
        lookup_eight(
            table.codes,
            table.inner,
            table.outer,
            seen,
            bits,
            changed[n],
            masks,
            table.unit,
            table.offset,
            window,
        )


@inner_kernel(error_model="numpy")
def footprint_pixels(taps, ratio, size):  # type: ignore[no-untyped-def]
    """Return the raster pixels along one axis that ``size`` camera pixels see; taps (phases, taps) of one of them."""
    return int(np.ceil((size - 1) * ratio)) + taps.shape[1] + 1


@inner_kernel(error_model="numpy")
def within(place, pixels, whole):  # type: ignore[no-untyped-def]
    """Return a place in a window of ``whole`` raster pixels, moved to its end if ``pixels`` from it on are not within.

    Of a window with room for displacements only the part that a patch sees is rendered.
    """
    return min(max(place, 0.0), whole - pixels + LAST_PHASE)


@inner_kernel(fastmath=True, forceinline=True)
def difference(light, image, error):  # type: ignore[no-untyped-def]
    """Compute the light (pixels,) less its image; return the image's sum."""
    total = np.float32(0)
    for i in range(error.size):
        error[i] = light[i] - image[i]
        total += image[i]
    return total


@inner_kernel(fastmath=True, error_model="numpy")
def inverse_variance(image, noise, base):  # type: ignore[no-untyped-def]
    """Compute 1 / variance of a patch's pixels, base (pixels,), from its image (3, pixels): value and derivatives."""
    dark, by_light, by_square, by_slope = noise[0], noise[1], noise[2], noise[3]
    for i in range(base.size):
        m, gx, gy = image[0, i], image[1, i], image[2, i]
        flat = max(dark + by_light * m + by_square * m * m, dark)
        base[i] = np.float32(1) / (flat + by_slope * (gx * gx + gy * gy))


@kernel(
    "patches.light (N, S, S), patches.base (N, S, S), patches.packed (N, H, W), patches.margin, "
    "patches.origins (N, 2), patches.moves (N, 2), patches.seen (N, H - 2 * patches.margin, W - 2 * patches.margin), "
    "patches.window (N, H - 2 * patches.margin, W - 2 * patches.margin), right (K, 4), down (K, 4), shifts (K, 2), "
    "quantised.codes (65536, 16), quantised.inner (_, 4), quantised.outer (_, 8), quantised.bits (4), "
    "taps.across (_, X), taps.across_slope (_, X), taps.along (_, Y), taps.along_slope (_, Y), noise (4), "
    "workspace.value (V), workspace.tilt (V), workspace.lines (2, S), workspace.columns (2, S), "
    "first, sums (K, N, SUMS)",
    where="0 <= patches.margin, EIGHT * (W - 2 * patches.margin) <= V, (W - 2 * patches.margin) % 16 == 0, "
    "S % EIGHT == 0",
    error_model="numpy",
)
def fringe_sums(  # type: ignore[no-untyped-def]
    patches, right, down, shifts, quantised, taps, noise, workspace, first, sums
):
    """Compute ``weighted_sums``'s sums of every patch of one sensor, for each of k sets of displacements of its planes.

    patches: ``SensorPatches``, whose inverse variance is computed for the first set if ``first``; right, down
    (k, 4) of planes, shifts (k, 2) of the page beyond its ``moves``: raster pixels; taps: ``SensorTaps``;
    noise: as in ``SensorLight``; workspace: ``Workspace``. sums (k, patches, SUMS) is written.
    """
    light, packed, margin = patches.light, patches.packed, patches.margin
    origins, moves = patches.origins, patches.moves
    size = light.shape[1]
    height, width = packed.shape[1] - 2 * margin, packed.shape[2] - 2 * margin
    rows = min(footprint_pixels(taps.along, taps.along_ratio, size), height)
    columns = min(footprint_pixels(taps.across, taps.across_ratio, size), width)
    image = np.empty((3, size, size), np.float32)
    flat = image.reshape(3, -1)
    error = np.empty(size * size, np.float32)
    of_scan, weights = light.reshape(-1, size * size), patches.base.reshape(-1, size * size)
    bits, masks = bits_of(quantised), masks_of(quantised.bits)
    changed = np.empty(height * width // EIGHT + 1, np.int64)
    for n in range(light.shape[0]):
        seen, window = patches.seen[n], patches.window[n]
        if first:
            seen[:] = 0
            lookup_light(seen.reshape(-1), quantised, np.float32(0), window.reshape(-1))
        for k in range(right.shape[0]):
            x = within(origins[n, 0] - (moves[n, 0] + shifts[k, 0]), columns, width)
            y = within(origins[n, 1] - (moves[n, 1] + shifts[k, 1]), rows, height)
            part = (int(y), int(y) + rows, int(x), int(x) + columns)
            render_light(packed[n], part, right[k], down[k], quantised, bits, masks, seen, window, changed)
            render_tile(window, x, y, taps, workspace, image)
            if first and k == 0:
                inverse_variance(flat, noise, weights[n])
            mean = difference(of_scan[n], flat[0], error) / np.float32(error.size)
            weighted_sums(error, flat[0], flat[1], flat[2], weights[n], NO_ESTIMATE, False, mean, sums[k, n])


@kernel("gathered (S, N, SUMS), level_sd (S), gain_sd, left (N, 6)", error_model="numpy")
def without_light(gathered, level_sd, gain_sd, left):  # type: ignore[no-untyped-def]
    """Eliminate each sensor's level and contrast from sums (sensors, patches, SUMS): left (patches, 6).

    level_sd (sensors,) [DN], gain_sd: prior standard deviations of these. The six numbers are the squared
    error at no displacement, its gradient across and along, and the information (xx, xy, yy).
    """
    for n in range(gathered.shape[1]):
        left[n] = 0
        for sensor in range(gathered.shape[0]):
            s = gathered[sensor, n]
            a, b, d = s[0] + 1 / level_sd[sensor] ** 2, s[1] + 0.0, s[4] + 1 / gain_sd**2
            whole = a * d - b * b
            a, b, d = d / whole, -b / whole, a / whole
            level, gain = a * s[10] + b * s[11], b * s[10] + d * s[11]
            level_x, gain_x = a * s[2] + b * s[5], b * s[2] + d * s[5]
            level_y, gain_y = a * s[3] + b * s[6], b * s[3] + d * s[6]
            left[n, 0] += s[14] - s[10] * level - s[11] * gain
            left[n, 1] += s[12] - s[2] * level - s[5] * gain
            left[n, 2] += s[13] - s[3] * level - s[6] * gain
            left[n, 3] += s[7] - s[2] * level_x - s[5] * gain_x
            left[n, 4] += s[8] - s[2] * level_y - s[5] * gain_y
            left[n, 5] += s[9] - s[3] * level_y - s[6] * gain_y


@inner_kernel(error_model="numpy")
def shared_cost(left, own_sd, common_sd, most, costs):  # type: ignore[no-untyped-def]
    """Return the cost of patches (n, 6) of ``without_light``, and their common displacement (x, y). [-, pixels]

    own_sd, common_sd: of each patch's own displacement and of the common one [pixels]. A patch counts u / (1
    + u / most), so that one that shows something else has no influence. costs (n,): u of each, is written.
    """
    quadratics = np.empty(left.shape)
    prior = 1 / own_sd**2
    for n in range(left.shape[0]):
        c, x, y, xx, xy, yy = left[n]
        whole = (xx + prior) * (yy + prior) - xy * xy
        a, b, d = (yy + prior) / whole, -xy / whole, (xx + prior) / whole
        step_x, step_y = a * x + b * y, b * x + d * y
        quadratics[n, 0] = c - x * step_x - y * step_y
        # What a displacement of its own explains of a patch is no evidence of the common one.
        quadratics[n, 1], quadratics[n, 2] = step_x * prior, step_y * prior
        quadratics[n, 3] = prior * (1 - a * prior)
        quadratics[n, 4] = -prior * b * prior
        quadratics[n, 5] = prior * (1 - d * prior)
    move_x, move_y, total = 0.0, 0.0, 0.0
    for _ in range(ROUNDS):
        push_x, push_y, total = 0.0, 0.0, 0.0
        xx, xy, yy = 1 / common_sd**2, 0.0, 1 / common_sd**2
        for n in range(left.shape[0]):
            c, gx, gy, hxx, hxy, hyy = quadratics[n]
            u = c - 2 * (gx * move_x + gy * move_y)
            u += hxx * move_x**2 + 2 * hxy * move_x * move_y + hyy * move_y**2
            u = max(u, 0.0)
            costs[n] = u
            total += u / (1 + u / most)
            w = 1 / (1 + u / most) ** 2
            push_x, push_y = push_x + w * gx, push_y + w * gy
            xx, xy, yy = xx + w * hxx, xy + w * hxy, yy + w * hyy
        total += (move_x**2 + move_y**2) / common_sd**2
        whole = xx * yy - xy * xy
        move_x, move_y = (yy * push_x - xy * push_y) / whole, (xx * push_y - xy * push_x) / whole
    return total, move_x, move_y


@kernel("left (K, N, 6), own_sd, common_sd, most, estimates (K, 3), costs (K, N)", error_model="numpy")
def shared_costs(left, own_sd, common_sd, most, estimates, costs):  # type: ignore[no-untyped-def]
    """Run ``shared_cost`` on each of k sets of displacements: estimates (k, 3), costs (k, patches) are written."""
    for k in range(left.shape[0]):
        estimates[k] = shared_cost(left[k], own_sd, common_sd, most, costs[k])
