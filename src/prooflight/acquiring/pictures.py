"""Scans from any camera or scanner: TIFF of any depth, JPEG, PNG; grey, RGB, or one image for each sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import tifffile

from prooflight.errors import ScanError
from prooflight.pages.job import natural_order

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

TIFF_SUFFIXES: Final = (".tif", ".tiff")
SUFFIXES: Final = (*TIFF_SUFFIXES, ".jpg", ".jpeg", ".png")
PLAIN: Final = {"P": "RGB", "RGBA": "RGB", "1": "L", "LA": "L"}
"""Pillow's modes and what they are read as."""
REMEDY: Final = "give grey or RGB, as TIFF of any depth, JPEG or PNG"
INCHES: Final = {2: 1.0, 3: 2.54}
"""TIFF 6.0, ResolutionUnit: 2 inch, 3 centimetre; what one of them multiplies to inches."""
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2  # TIFF 6.0, PhotometricInterpretation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """What one picture file shows."""

    light: NDArray[np.float32]
    """(channels, lines, pixels) in the file's own numbers, more is lighter."""
    dpi: tuple[float, float] | None
    """Resolution across and along, if the file states one. [pixels/inch]"""

    @property
    def grey(self) -> NDArray[np.float32]:
        """(1, lines, pixels) mean of its channels."""
        return self.light.mean(axis=0, keepdims=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """Where one picture is stored; read only when its turn comes."""

    path: Path
    first_image: int
    images: int
    """How many of the file's images make up the picture: one for each channel, or one of RGB."""

    @property
    def name(self) -> str:
        """The file's stem; with the picture's place in the file if there are several."""
        return (
            self.path.stem
            if not self.first_image
            else f"{self.path.stem}-{self.first_image // self.images + 1}"
        )

    def read(self) -> Picture:
        """The picture; ScanError if it is damaged, turned, or neither grey nor RGB."""
        if self.path.suffix.lower() in TIFF_SUFFIXES:
            return _read_tiff(self)
        return _read_other(self.path)


def picture_files(path: Path, *, images: int | None = None) -> list[PictureFile]:
    """Pictures in order: of a folder, by natural order of names; of a multi-page TIFF, ``images`` make up each.

    images None: a file is one picture. A file of a folder that cannot even be counted is one picture, which says so
    when it is read. ScanError if there is nothing to read.
    """
    if path.is_dir():
        inside = [file for file in path.iterdir() if file.suffix.lower() in SUFFIXES and file.name[0] != "."]
        if not inside:
            raise ScanError(path, "holds no scans", remedy=REMEDY)
        ordered = sorted(inside, key=lambda file: natural_order(file.name))
        return [picture for file in ordered for picture in _pictures_of(file, images, one_of_many=True)]
    if not path.is_file():
        raise ScanError(path, "there is no such file or folder", remedy="give a scan or a folder of scans")
    return _pictures_of(path, images)


def _pictures_of(path: Path, images: int | None, *, one_of_many: bool = False) -> list[PictureFile]:
    if path.suffix.lower() not in TIFF_SUFFIXES:
        return [PictureFile(path=path, first_image=0, images=1)]
    try:
        with tifffile.TiffFile(path) as file:
            count = len(file.pages)
    except Exception as error:  # decoders raise whatever damage leads them to
        if one_of_many:
            return [PictureFile(path=path, first_image=0, images=images or 1)]
        raise ScanError(path, "is damaged or not a TIFF", remedy="scan the page again") from error
    each = images or count
    if not count or count % each:
        raise ScanError(path, f"holds {count} images", remedy=f"give {each} images for each page")
    return [PictureFile(path=path, first_image=first, images=each) for first in range(0, count, each)]


def _read_tiff(file: PictureFile) -> Picture:
    path = file.path
    try:
        with tifffile.TiffFile(path) as tiff:
            pages = [tiff.pages[index] for index in range(file.first_image, file.first_image + file.images)]
            sheets = [_channels(path, page, page.asarray(maxworkers=1)) for page in pages]
            tags = {code: pages[0].tags.valueof(code) for code in (282, 283, 296, 274)}  # TIFF 6.0
    except ScanError:
        raise
    except Exception as error:  # as above
        raise ScanError(path, "is damaged or not a TIFF", remedy="scan the page again") from error
    if tags[274] not in (None, 1):
        raise ScanError(path, "is stored turned", remedy="save it with its first line on top")
    if len({sheet.shape[1:] for sheet in sheets}) > 1:
        raise ScanError(
            path, "holds images of different sizes", remedy="give images of one size for each page"
        )
    unit = INCHES.get(tags[296] or 0)
    x, y = (_ratio(tags[code]) for code in (282, 283))
    dpi = None if unit is None or min(x, y) <= 0 else (x * unit, y * unit)
    return Picture(light=_checked(path, np.concatenate(sheets)), dpi=dpi)


def _channels(path: Path, page: Any, pixels: NDArray[Any]) -> NDArray[np.float32]:
    """(channels, lines, pixels) of one TIFF image."""
    if page.photometric not in (_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB, 6):  # 6: YCbCr, decoded to RGB
        what = f"is {getattr(page.photometric, 'name', 'of unknown colours').lower()}"
        raise ScanError(path, what, remedy=REMEDY)
    if pixels.ndim == 3 and page.planarconfig == 1:
        pixels = np.moveaxis(pixels, -1, 0)
    pixels = pixels[None] if pixels.ndim == 2 else pixels[:3]
    light = pixels.astype(np.float32)
    if page.photometric == _MIN_IS_WHITE:
        light = np.float32(light.max(initial=0)) - light
    return light


def _read_other(path: Path) -> Picture:
    from PIL import Image

    try:
        with Image.open(path) as image:
            plain = PLAIN.get(image.mode)
            mode, dpi = image.mode, image.info.get("dpi")
            pixels = np.asarray(image.convert(plain) if plain else image, np.float32)
    except Exception as error:  # Pillow raises OSError, SyntaxError, struct.error, ...
        raise ScanError(path, "is damaged or not a picture", remedy=REMEDY) from error
    if mode == "CMYK" or pixels.ndim not in (2, 3):
        raise ScanError(path, f"is {mode}", remedy=REMEDY)
    light = pixels[None] if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)
    return Picture(
        light=_checked(path, np.ascontiguousarray(light)),
        dpi=None if not dpi or min(dpi) <= 1 else (float(dpi[0]), float(dpi[1])),
    )


def _checked(path: Path, light: NDArray[np.float32]) -> NDArray[np.float32]:
    if not light.size or not np.isfinite(light).all():
        what = "is empty" if not light.size else "holds values that are not finite"
        raise ScanError(path, what, remedy="scan the page again")
    return np.ascontiguousarray(light)


def _ratio(value: Any) -> float:
    if isinstance(value, tuple) and len(value) == 2 and value[1]:
        return float(value[0] / value[1])
    return 0.0
