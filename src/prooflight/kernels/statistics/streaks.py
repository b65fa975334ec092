"""Compiled loops for columns without the light around them, and for sums of adjacent columns."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel()
def running(row, reach_before, reach_after, beyond, prefix, out):  # type: ignore[no-untyped-def]
    """Compute sums of a row (w,) from ``reach_before`` before to ``reach_after`` after each place.

    out (w,) float64 is written. beyond: 1: the first and the last value are repeated beyond the row, 0: zero
    beyond. prefix (w + 1,) float64 is working space.
    """
    size = row.size
    prefix[0] = 0.0
    for x in range(size):
        prefix[x + 1] = prefix[x] + row[x]
    for x in range(size):
        first, last = x - reach_before, x + reach_after + 1
        total = prefix[min(last, size)] - prefix[max(first, 0)]
        if beyond:
            total += max(-first, 0) * row[0] + max(last - size, 0) * row[size - 1]
        out[x] = total


@kernel(
    "columns (4, M, S, W), length, step, prior_power, wide, out (4, M, Q, W)",
    where="0 < length, 0 < step, (Q - 1) * step + length <= S",
)
def levelled_parts(columns, length, step, prior_power, wide, out):  # type: ignore[no-untyped-def]
    """Compute N', D', the edges' part of D' and the effect of uneven light on N', out (4, modes, parts, w).

    Each part is ``length`` segments of columns (4, modes, segments, w), one part every ``step`` of them. The
    effect of light as a whole, known: 1 / its prior variance, and the mean amount over ``wide`` columns about
    each are subtracted from N'. Light greater by a share s in one segment alone leaves s (C_s - D0_s C / D0):
    the squares of that, without s, are summed.
    """
    modes, parts, width = out.shape[1], out.shape[2], out.shape[3]
    sums, common = np.empty((4, width), np.float32), np.empty((2, width), np.float32)
    share = np.empty(width, np.float32)
    prefix, push, power = np.empty(width + 1), np.empty(width), np.empty(width)
    for part in range(parts):
        begin, end = part * step, part * step + length
        for mode in range(modes):
            for i in range(4):
                sums[i] = columns[i, mode, begin]
                for k in range(begin + 1, end):
                    sums[i] += columns[i, mode, k]
            own, rest = out[0, mode, part], out[1, mode, part]
            edges, uneven = out[2, mode, part], out[3, mode, part]
            own[:], rest[:], edges[:], uneven[:] = sums[0], sums[1], sums[3], np.float32(0)
            if mode == 0:
                common[0], common[1] = sums[0], sums[1]
            else:
                for x in range(width):
                    share[x] = sums[2, x] / (common[1, x] + prior_power)
                    own[x] -= share[x] * common[0, x]
                    rest[x] = max(sums[1, x] - share[x] * sums[2, x], np.float32(0))
                for k in range(begin, end):
                    light, shared = columns[1, 0, k], columns[2, mode, k]
                    for x in range(width):
                        difference = shared[x] - share[x] * light[x]
                        uneven[x] += difference * difference
            for x in range(width):
                edges[x] *= min(rest[x] / max(sums[1, x], np.float32(1e-9)), np.float32(1))
            running(own, wide // 2, wide - wide // 2 - 1, True, prefix, push)
            running(rest, wide // 2, wide - wide // 2 - 1, True, prefix, power)
            for x in range(width):
                own[x] -= push[x] / (power[x] + 1e-6 * wide) * rest[x]


@kernel("maps (N, W), count, out (N, W)")
def widened(maps, count, out):  # type: ignore[no-untyped-def]
    """Compute sums over ``count`` columns about each of maps (n, w), out (n, w); 0 beyond the ends."""
    prefix, sums = np.empty(maps.shape[1] + 1), np.empty(maps.shape[1])
    for n in range(maps.shape[0]):
        running(maps[n], count // 2, count - count // 2 - 1, False, prefix, sums)
        out[n] = sums
