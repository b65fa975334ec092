"""Whole scan of a sheet up for review: passed on as numbers, stored as a JPEG.

The journal's own thread compresses it, so no verdict waits for it. It stores square roots of light, for which a
camera's noise is about as large in shadows as in paper, so that eight bits are enough for the eye.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from PIL.JpegImagePlugin import JpegImageFile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

NAME: Final = "whole"
TOP: Final = "whole_top"
MOST_PIXELS: Final = 12_000_000
"""Greatest number of pixels of a whole scan: an A3 page at the prototype's pitch. Larger scans are halved
before."""
MOST_BYTES: Final = 16_000_000
"""Greatest size of its JPEG; that of an A4 page takes half a million bytes."""
QUALITY: Final = 85


def packed(evidence: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    """Return evidence with its whole scan compressed.

    The scan, (lines, pixels) uint16 [DN], becomes the bytes of a JPEG, with "whole_top", the DN of its value 255.
    Evidence without a scan, or with one that cannot be compressed, is returned as it is.
    """
    raw = evidence.get(NAME)
    if raw is None or raw.dtype != np.uint16 or raw.ndim != 2 or not raw.size:
        return evidence
    top = max(int(raw.max()), 1)
    eight = np.rint(255 * np.sqrt(np.arange(top + 1) / top)).astype(np.uint8)[raw]
    done, code = cv2.imencode(".jpg", eight, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        return {name: array for name, array in evidence.items() if name != NAME}
    return {**evidence, NAME: code.ravel(), TOP: np.array(float(top))}


def unpacked(evidence: Mapping[str, NDArray[Any]]) -> NDArray[np.float32] | None:
    """Return the whole scan (lines, pixels) [DN] of a sheet's evidence; None: there is none that can be read."""
    code, top = evidence.get(NAME), evidence.get(TOP)
    if code is None or top is None or code.dtype != np.uint8 or code.size > MOST_BYTES or top.size != 1:
        return None
    scale = float(top.ravel()[0])
    if not 0 < scale <= np.iinfo(np.uint16).max:
        return None
    try:
        picture = JpegImageFile(io.BytesIO(code.tobytes()))
        if picture.mode != "L" or picture.width * picture.height > MOST_PIXELS:
            return None
        eight = np.asarray(picture)
    except Exception:  # Pillow raises SyntaxError, OSError, struct.error, ...
        return None
    return np.asarray((np.arange(256, dtype=np.float32) / 255) ** 2 * scale, np.float32)[eight]
