"""Compiled loops: what an ink plane, printed elsewhere, would explain of a residual."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel(fastmath=True, error_model="numpy")
def row_explained(push, weight, here, there):  # type: ignore[no-untyped-def]
    """N and D of a row (n,) of cells if ``there`` lay on them instead of ``here``."""
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
    """N and D of a plane at every ``wanted`` shift, added to explained, power (2 reach + 1, 2 reach + 1) float64.

    pushes, weights (h, w): r / V and 1 / V of cells. plane (h + 2 reach, w + 2 reach): its effect, bordered by 0.
    wanted: of shifts down and right, none in the middle.
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
