"""Compiled loops of comparison: one pass over a scan and its prediction."""

from __future__ import annotations

import numpy as np
from numba import njit

PHI_REACH = 8.0
PHI_STEPS_PER_SIGMA = 512


@njit(cache=True, nogil=True, inline="always")
def _phi(x, table):  # type: ignore[no-untyped-def]
    """Standard normal distribution function by linear interpolation of its table; error below 4e-7."""
    place = (x + PHI_REACH) * PHI_STEPS_PER_SIGMA
    if place <= 0:
        return 0.0
    if place >= table.size - 1:
        return 1.0
    cell = int(place)
    return table[cell] + (place - cell) * (table[cell + 1] - table[cell])


@njit(cache=True, nogil=True, inline="always")
def _uniform(seed, index):  # type: ignore[no-untyped-def]
    """Uniform number in [0, 1) of a pixel: splitmix64 of its index (Steele, Lea, Flood 2014), the same in any order."""
    z = seed + np.uint64(index) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
def compare_lines(  # type: ignore[no-untyped-def]
    measured,
    expected,
    variance,
    top_code,
    seed,
    phi_table,
    line_from,
    line_to,
    tile,
    block,
    histogram,
    naive,
    block_z,
):
    """Histograms and block sums of z over lines line_from .. line_to - 1; all images are (lines, pixels).

    histogram (tiles across, intervals) counts the randomised probability integral transform of each digital number:
    uniform if the rounded, clipped Gaussian that was predicted is true; the last tile takes what is left over. naive
    (intervals,) counts Phi(z) as if digital numbers were not integers. block_z (lines / block, pixels / block) adds z
    over blocks. line_from is a multiple of block.
    """
    tiles, intervals = histogram.shape
    for line in range(line_from, line_to):
        for i in range(measured.shape[1]):
            dn = float(measured[line, i])
            error = dn - expected[line, i]
            sigma = np.sqrt(variance[line, i])
            z = error / sigma
            unrounded = 1.0 / np.sqrt(max(variance[line, i] - 1.0 / 12.0, 1e-6))
            low = 0.0 if dn <= 0 else _phi((error - 0.5) * unrounded, phi_table)
            high = 1.0 if dn >= top_code else _phi((error + 0.5) * unrounded, phi_table)
            u = low + (high - low) * _uniform(seed, line * measured.shape[1] + i)
            histogram[min(i // tile, tiles - 1), min(int(u * intervals), intervals - 1)] += 1
            naive[min(int(_phi(z, phi_table) * intervals), intervals - 1)] += 1
            row, column = line // block, i // block
            if row < block_z.shape[0] and column < block_z.shape[1]:
                block_z[row, column] += z
