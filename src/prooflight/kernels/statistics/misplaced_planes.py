"""Compiled loops for ink planes printed elsewhere, or as another ink: the part of a residual that they explain."""

from __future__ import annotations

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel(fastmath=True, error_model="numpy")
def row_explained(push, weight, here, there):  # type: ignore[no-untyped-def]
    """Return N and D of a row (n,) of cells if ``there`` lay on them instead of ``here``."""
    explained, power = np.float32(0), np.float32(0)
    for x in range(push.size):
        step = there[x] - here[x]
        explained += push[x] * step
        power += weight[x] * step * step
    return explained, power


@kernel(
    "pushes (H, W), weights (H, W), plane (H + N - 1, W + N - 1), wanted (N, N), "
    "explained (N, N), power (N, N)",
    where="N % 2 == 1",
)
def shift_sums(pushes, weights, plane, wanted, explained, power):  # type: ignore[no-untyped-def]
    """Add N and D of a plane at every ``wanted`` shift to explained, power (2 reach + 1, 2 reach + 1) float64.

    pushes, weights (h, w): r / V and 1 / V of cells. plane (h + 2 reach, w + 2 reach): its effect, bordered
    by 0. wanted: of shifts down and right, none in the middle.
    """
    height, width = pushes.shape
    reach = wanted.shape[0] // 2
    printed = np.empty(plane.shape[0], np.bool_)
    for y in range(printed.size):
        printed[y] = plane[y].any()
    for y in range(height):
        here = plane[y + reach, reach : reach + width]
        for i in range(wanted.shape[0]):
            above = y + 2 * reach - i
            if not (printed[above] or printed[y + reach]):
                continue
            for j in range(wanted.shape[1]):
                if wanted[i, j]:
                    first = 2 * reach - j
                    there = plane[above, first : first + width]
                    n, d = row_explained(pushes[y], weights[y], here, there)
                    explained[i, j] += n
                    power[i, j] += d


@inner_kernel(fastmath=True, error_model="numpy")
def without_light(tiles, mode, y, prior, push, power):  # type: ignore[no-untyped-def]
    """Add N' and D' of one mode along a row of tiles to push and power (w,)."""
    own, whole, shared = tiles[0, mode, y], tiles[1, mode, y], tiles[2, mode, y]
    push0, power0 = tiles[0, 0, y], tiles[1, 0, y]
    for x in range(push.size):
        push[x] += own[x] - shared[x] * push0[x] / (power0[x] + prior)
    for x in range(push.size):
        power[x] += max(whole[x] - shared[x] * shared[x] / (power0[x] + prior), np.float32(0))


@kernel(
    "tiles (4, M, H, W), cover (4, H, W), pairs (N, 2), prior_power, side, out (2, N, H // side, W // side)",
    where="M > 2 * INKS",
    fastmath=True,
    error_model="numpy",
)
def swap_sums(tiles, cover, pairs, prior_power, side, out):  # type: ignore[no-untyped-def]
    """Compute pushes and powers of exchanging pairs (n, 2) of inks, by blocks of tiles: out (2, n, rows, columns).

    tiles (4, 9 modes or more, h, w): N, D, C of light, each ink added, each ink's gain; cover (4, h, w);
    prior_power: 1 / the prior variance of light.
    """
    width = out.shape[3] * side
    push, power = np.empty((2, INKS, tiles.shape[3]), np.float32)
    out[:] = 0
    for y in range(out.shape[2] * side):
        push[:] = 0
        power[:] = 0
        for ink in range(INKS):
            without_light(tiles, 1 + ink, y, prior_power, push[ink], power[ink])
            without_light(tiles, 1 + INKS + ink, y, prior_power, push[ink], power[ink])
        for n in range(pairs.shape[0]):
            a, b = pairs[n]
            pushes, powers = out[0, n, y // side], out[1, n, y // side]
            for x in range(width):
                step = cover[b, y, x] - cover[a, y, x]
                pushes[x // side] += step * (push[a, x] - push[b, x])
                powers[x // side] += step * step * (power[a, x] + power[b, x])
