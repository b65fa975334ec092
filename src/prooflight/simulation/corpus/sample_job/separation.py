"""RGB photographs to CMYK by a plain grey-component replacement.

The model is multiplicative: a page under ink reflects (1 - ink)(1 - black) of each primary, so for any black
``k <= min(1 - R, 1 - G, 1 - B)`` the chromatic ink ``(1 - R - k) / (1 - k)`` gives the same colour (the textbook
identity of under-colour removal). What is left to choose is ``k``: it follows the square of the grey component, so
that highlights and skin carry no black and shadows much of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

BLACK_MAXIMUM = 0.95
"""Black where the grey component is 1. [-] assumed: leaves the other inks to deepen it, as printers do"""
TOTAL_INK_LIMIT = 3.2
"""Largest sum of the four area coverages. [-] assumed: 320 %, an ordinary limit for coated sheets"""


def separate(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Separate sRGB code values (rows, columns, 3) into C M Y K bytes (rows, columns, 4).

    Where the sum passes ``TOTAL_INK_LIMIT`` cyan, magenta and yellow are scaled down together, which keeps the hue.
    """
    # Planes, not pixels, are the outer axis: reducing over a last axis of three is several times slower.
    cmy = 1.0 - np.moveaxis(rgb, -1, 0).astype(np.float32, order="C") / np.float32(255.0)
    grey = np.minimum(np.minimum(cmy[0], cmy[1]), cmy[2])
    black = np.rint(255.0 * BLACK_MAXIMUM * grey * grey) / np.float32(255.0)
    cmy = np.maximum(cmy - black, 0.0) / (1.0 - black)
    room = (TOTAL_INK_LIMIT - black) / np.maximum(cmy[0] + cmy[1] + cmy[2], np.float32(1e-6))
    cmy *= np.minimum(room, 1.0)
    inks = np.empty((*rgb.shape[:-1], 4), dtype=np.uint8)
    for place, plane in enumerate(cmy):
        # Rounded down: rounding to nearest could pass the limit by a byte.
        inks[..., place] = np.floor(plane * 255.0 + 1e-3)
    inks[..., 3] = np.rint(black * 255.0)
    return inks
