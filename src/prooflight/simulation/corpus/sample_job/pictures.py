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
from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.simulation.corpus.sample_job.separation import separate

if TYPE_CHECKING:
    from numpy.typing import NDArray

PIXEL_MM = 0.1
"""Side of a picture pixel on paper: 254 dpi. [mm]"""
_SOURCES = {"hubble": "hubble_deep_field"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """How one photograph is used: its crop centre and tone."""

    name: str
    centre: tuple[float, float] = (0.5, 0.5)
    """Where the crop sits in the original, (across, down), 0 to 1. [-]"""
    zoom: float = 1.0
    """1 = the largest crop of the wanted shape. [-]"""
    black_point: int = 0
    """Code value that becomes black. [0..255]"""
    white_point: int = 255
    """Code value that becomes paper. [0..255]"""
    gamma: float = 1.0
    """Above 1 lightens the middle tones. [-]"""
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
