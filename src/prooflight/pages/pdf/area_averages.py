"""Combination of the pixels of a page drawn finer than its raster, so that the reflected light stays the same.

Half a pixel of solid ink next to half a pixel of paper reflects the mean of both. Half an ink reflects less,
because printed dots gain: the raster holds for both the amount of ink that reflects their mean.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.area_averages import STEPS, average_areas

InkLight = tuple[tuple[float, ...], ...]
"""For C, M, Y and K: the light that an ink absorbs at even steps from none to all of it, printed alone, as
a share of white; rising from 0."""
FLAT: Final = 8
"""Largest ink difference within a pixel that is averaged. assumed: inks that differ by less than 8 of 255
reflect the same combined as separate, within 0.02 %."""
NEVER: Final = 256
_EVEN: Final = ((0.0, 1.0),) * 4


def area_averaged(
    fine: NDArray[np.uint8],
    out: NDArray[np.uint8],
    light: InkLight | None,
    *,
    step: float,
    first: float = 0.0,
    left: float = 0.0,
) -> None:
    """Write ``fine`` (n, m, 4) into ``out`` (rows, columns, 4); with ``light`` None, inks are averaged.

    ``step`` is the number of fine pixels that a pixel covers in either direction, weighted by area. ``first``
    is the row of ``fine`` at which ``out`` begins, ``left`` the column.
    """
    takes, needs, _ = light_tables(_EVEN if light is None else light)
    average_areas(fine, first, left, step, NEVER if light is None else FLAT, takes, needs, out)


@lru_cache(maxsize=4)
def light_tables(light: InkLight) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """Return how inks absorb light: each byte (4, 256), as a share of its solid, the byte for each share of that
    (4, STEPS + 1), and solids, as a share of white (4,).
    """
    steps, inks = np.arange(256), np.arange(STEPS + 1) / STEPS
    takes = np.stack([np.interp(steps, np.linspace(0, 255, len(curve)), curve) for curve in light])
    solids = takes[:, -1].astype(np.float32)
    takes /= takes[:, -1:]
    needs = np.stack([np.rint(np.interp(inks, of_ink, steps)) for of_ink in takes])
    return takes.astype(np.float32), needs.astype(np.uint8), solids
