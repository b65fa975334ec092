"""The photographs of the sample job: scikit-image's own, cropped, enlarged smoothly and separated.

All of them are in the scikit-image wheel and free to use (statements in ``skimage.data``'s documentation):

============== ==========================================================================================
coffee         Rachel Michetti, CC0
chelsea        Stefan van der Walt, CC0
clock          Stefan van der Walt, public domain
camera         Lav Varshney, CC0
brick, gravel  CC0Textures, CC0
grass          linolafett, CC0
retina         Mikael Haeggstroem, CC0
hubble         NASA, ESA (eXtreme Deep Field), public domain
astronaut      NASA, public domain
rocket         SpaceX, public domain
coins          Brooklyn Museum, no known copyright restrictions
============== ==========================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

PIXEL_MM = 0.1
"""Side of a picture pixel on paper: 254 dpi. [mm]"""
_SOURCES = {"hubble": "hubble_deep_field"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """Use of one photograph: its crop centre and tone."""

    name: str
    centre: tuple[float, float] = (0.5, 0.5)
    """Centre of the crop in the original, (across, down), 0 to 1. [-]"""
    zoom: float = 1.0
    """Zoom; 1 = the largest crop of the wanted shape. [-]"""
    black_point: int = 0
    """Code value that becomes black. [0..255]"""
    white_point: int = 255
    """Code value that becomes paper. [0..255]"""
    gamma: float = 1.0
    """Gamma; above 1 lightens the middle tones. [-]"""
    soften: float = 0.5
    """Gaussian blur before enlarging, against noise and compression blocks. [original pixels]"""
    tone: tuple[float, float, float] | None = None
    """Colour of a grey original's middle tone relative to neutral (R, G, B); none for colour originals. [-]"""


def develop(shot: Shot, width_mm: float, height_mm: float) -> NDArray[np.uint8]:
    """Crop, tone, enlarge and separate a photograph to a placed size -> (rows, columns, 4) CMYK bytes.

    width_mm and height_mm must be multiples of ``PIXEL_MM``.
    """
    columns, rows = round(width_mm / PIXEL_MM), round(height_mm / PIXEL_MM)
    crop = _crop(_original(shot.name), columns / rows, shot)
    if shot.soften:
        crop = cv2.GaussianBlur(crop, (0, 0), shot.soften)
    shrinks = columns < crop.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    placed = cv2.resize(_tone(crop, shot), (columns, rows), interpolation=method)
    return separate(np.clip(np.rint(placed), 0, 255).astype(np.uint8))


def _original(name: str) -> NDArray[np.float32]:
    import skimage.data  # imported late: only the sample job needs it

    image = np.asarray(getattr(skimage.data, _SOURCES.get(name, name))(), dtype=np.float32)
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def _crop(image: NDArray[np.float32], aspect: float, shot: Shot) -> NDArray[np.float32]:
    rows, columns = image.shape[:2]
    width = min(columns, rows * aspect) / shot.zoom
    height = width / aspect
    left = min(max(shot.centre[0] * columns - width / 2, 0), columns - width)
    top = min(max(shot.centre[1] * rows - height / 2, 0), rows - height)
    return image[round(top) : round(top + height), round(left) : round(left + width)]


def _tone(image: NDArray[np.float32], shot: Shot) -> NDArray[np.float32]:
    span = shot.white_point - shot.black_point
    level = np.clip((image - shot.black_point) / span, 0.0, 1.0) ** (1.0 / shot.gamma)
    if shot.tone is not None:
        # A duotone's mid-tone cast that fades towards black and paper.
        level = level ** (1.0 / np.array(shot.tone, dtype=np.float32))
    return np.asarray(level * 255.0, dtype=np.float32)


BLACK_MAXIMUM = 0.95
"""Greatest black, where the grey component is 1. [-]

assumed: leaves the other inks to deepen it, as printers do.
"""
TOTAL_INK_LIMIT = 3.2
"""Largest sum of the four area coverages. [-] assumed: 320 %, an ordinary limit for coated sheets"""


def separate(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Separate sRGB code values (rows, columns, 3) into C M Y K bytes (rows, columns, 4).

    A plain grey-component replacement. The model is multiplicative: a page under ink reflects (1 - ink)(1 - black) of
    each primary, so for any black ``k <= min(1 - R, 1 - G, 1 - B)`` the chromatic ink ``(1 - R - k) / (1 - k)`` gives
    the same colour (the textbook identity of under-colour removal). What is left to choose is ``k``: it follows the
    square of the grey component, so that highlights and skin carry no black and shadows much of it.
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
