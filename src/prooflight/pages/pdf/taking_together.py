"""Pixels of a page drawn finer than its raster, taken together so that they show the light that they showed apart.

Half a pixel of solid ink beside half a pixel of paper reflects the mean of both. Half an ink reflects less, for printed
dots gain: what stands in the raster for both is the amount of ink that reflects their mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

InkLight = tuple[tuple[float, ...], ...]
"""Of C, M, Y and K: the light that an ink takes at even steps from none to all of it, where it is printed alone, as a
share of what all of it takes; rising from 0 to 1."""
FLAT: Final = np.uint32(0xF8F8F8F8)
"""assumed: pixels of which no ink differs by 8 of 255 from their mean are as light together as apart, within 0.02 %."""
STEPS: Final = 4096


def taken_together(fine: NDArray[np.uint8], out: NDArray[np.uint8], light: InkLight | None) -> None:
    """Write ``fine`` (n rows, n columns, 4) into ``out`` (rows, columns, 4). light: None, inks are averaged."""
    rows, columns = out.shape[:2]
    n = len(fine) // rows
    cv2.resize(fine, (columns, rows), dst=out, interpolation=cv2.INTER_AREA)
    if light is None:
        return
    apart = cv2.absdiff(out, np.ascontiguousarray(fine[::n, ::n])).view(np.uint32)[..., 0]
    at = np.flatnonzero(apart & FLAT)
    y, x = np.divmod(at, columns)
    pixels, first = fine.view(np.uint32).ravel(), n * (y * n * columns + x)
    inks = np.stack([pixels[first + row * n * columns + column] for row in range(n) for column in range(n)])
    inks = inks.view(np.uint8).reshape(n * n, -1, 4)
    together = np.empty((at.size, 4), np.uint8)
    for ink, curve in enumerate(light):
        takes, needs = _tables(curve)
        mean = takes[inks[..., ink]].mean(axis=0)
        together[:, ink] = needs[np.rint(mean * STEPS).astype(np.intp)]
    out[y, x] = together


def _tables(curve: Sequence[float]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """The light that each byte of an ink takes (256,), and the byte that takes each of ``STEPS`` + 1 shares of it."""
    given = np.linspace(0, 255, len(curve))
    takes = np.interp(np.arange(256), given, curve)
    needs = np.rint(np.interp(np.arange(STEPS + 1) / STEPS, takes, np.arange(256)))
    return takes.astype(np.float32), needs.astype(np.uint8)
