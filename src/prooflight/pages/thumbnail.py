"""A page as a small picture, for whoever wants to know which page it is; the press's own colours are not asked."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from numpy.typing import NDArray

LONGEST_PX: Final = 360


def thumbnail_png(cmyk: NDArray[np.uint8]) -> bytes:
    """A raster (rows, columns, 4) as a PNG of at most ``LONGEST_PX`` a side, never enlarged.

    Each ink takes its share of red, green or blue and black takes of all, as screens show CMYK without a profile.
    """
    rows, columns = cmyk.shape[:2]
    scale = min(LONGEST_PX / max(rows, columns), 1.0)
    size = max(round(columns * scale), 1), max(round(rows * scale), 1)
    left = 1 - cv2.resize(cmyk, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    file = io.BytesIO()
    Image.fromarray(np.rint(255 * left[..., :3] * left[..., 3:]).astype(np.uint8)).save(file, "PNG")
    return file.getvalue()
