"""The statistics that a decision needs, gathered in one pass over a scan."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from prooflight.comparing.kernels import PHI_REACH, PHI_STEPS_PER_SIGMA, compare_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

INTERVALS = 32
"""Equally likely intervals of the error's distribution (31 degrees of freedom a sensor)."""
BLOCK_PIXELS = 8
TILE_PIXELS = 64
"""Side of the tiles that are tested by themselves: 6.7 mm, about a word, and 128 pixels expected an interval."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What one scan says against its prediction."""

    tile_histogram: NDArray[np.int64]
    """(sensors, tile rows, tile columns, intervals) pixels in each equally likely interval, rounding to integers
    allowed for; tiles of 64 x 64 pixels, the last of each row and column larger by what is left over."""
    naive_histogram: NDArray[np.int64]
    """(sensors, intervals) of the whole page, as if digital numbers were not integers: it rejects every good page."""
    block_z: NDArray[np.float32]
    """(sensors, block rows, block columns) mean of z over 8 x 8 pixels times 8: N(0, 1) on a good page. [-]"""

    @property
    def histogram(self) -> NDArray[np.int64]:
        """(sensors, intervals) of the whole page."""
        return self.tile_histogram.sum(axis=(1, 2))


@cache
def _phi_table() -> NDArray[np.float64]:
    return np.asarray(special.ndtr(np.arange(-PHI_REACH, PHI_REACH + 1e-9, 1 / PHI_STEPS_PER_SIGMA)))


def gather(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
    *,
    top_codes_dn: Sequence[int],
    seed: int,
    threads: int | None = None,
) -> Evidence:
    """One pass over (sensors, lines, pixels) arrays of the page's area.

    seed: of the uniform numbers that the randomised probability integral transform needs; same seed, same result,
    whatever the number of threads.
    """
    sensors, lines, pixels = measured_dn.shape
    tile_rows, tile_columns = max(lines // TILE_PIXELS, 1), max(pixels // TILE_PIXELS, 1)
    histogram = np.zeros((sensors, tile_rows, tile_columns, INTERVALS), np.int64)
    naive = np.zeros((sensors, tile_rows, INTERVALS), np.int64)
    block_z = np.zeros((sensors, lines // BLOCK_PIXELS, pixels // BLOCK_PIXELS), np.float32)

    def band(task: tuple[int, int]) -> None:
        sensor, tile_row = task
        compare_lines(
            measured_dn[sensor],
            expected_dn[sensor],
            variance_dn2[sensor],
            top_codes_dn[sensor],
            np.uint64(seed * sensors + sensor),
            _phi_table(),
            tile_row * TILE_PIXELS,
            lines if tile_row == tile_rows - 1 else (tile_row + 1) * TILE_PIXELS,
            TILE_PIXELS,
            BLOCK_PIXELS,
            histogram[sensor, tile_row],
            naive[sensor, tile_row],
            block_z[sensor],
        )

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        list(pool.map(band, [(s, n) for s in range(sensors) for n in range(tile_rows)]))
    return Evidence(
        tile_histogram=histogram,
        naive_histogram=naive.sum(axis=1),
        block_z=(block_z / BLOCK_PIXELS).astype(np.float32),
    )
