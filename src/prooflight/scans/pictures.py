"""Scans from any camera or scanner: TIFF of any depth, JPEG, PNG; grey, RGB, or one image for each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import ScanError
from prooflight.pages.files import DPI_MAX, NO_UNIT, resolution_tags, tag_dpi
from prooflight.pages.job import files_in
from prooflight.pages.picture_files import bands, opened_picture
from prooflight.pages.tiff_images import TIFF_SUFFIXES, decode_into, image_count, opened_tiff

SUFFIXES: Final = (*TIFF_SUFFIXES, ".jpg", ".jpeg", ".png")
PLAIN: Final = {"P": "RGB", "RGBA": "RGB", "1": "L", "LA": "L"}
"""Pillow's modes, and those as which they are read."""
REMEDY: Final = "give grey or RGB, as TIFF of any depth, JPEG or PNG"
BYTES_PER_SAMPLE: Final = 8.0
"""Memory while a picture is read: 4 of the light, and of Pillow's own picture 1, or 4 where it has 16
bits."""
_AGAIN: Final = "scan the page again"
_ICC: Final = 34675
"""TIFF tag of the ICC profile (ICC.1:2022, B.4)."""
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2  # TIFF 6.0, PhotometricInterpretation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """Contents of one picture file."""

    light: NDArray[np.float32]
    """Light in the file's own numbers, more is lighter, (channels, lines, pixels)."""
    dpi: tuple[float, float] | None
    """Resolution across and along, if the file states one. [pixels/inch]"""
    full: float = 1.0
    """Greatest number that a sample of the file can have; 1 for floating point."""
    profile: bytes | None = None
    """Its ICC profile; None: the file has none."""

    @property
    def grey(self) -> NDArray[np.float32]:
        """Mean of its channels, (1, lines, pixels)."""
        return self.light.mean(axis=0, keepdims=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """Location of one stored picture, which is read later."""

    path: Path
    first_image: int
    images: int
    """Number of the file's images that make up the picture: one for each channel, or one of RGB."""

    @property
    def name(self) -> str:
        """The file's stem, with the picture's place in the file if there are several."""
        return (
            self.path.stem
            if not self.first_image
            else f"{self.path.stem}-{self.first_image // self.images + 1}"
        )

    def read(self) -> Picture:
        """Read the picture; ScanError if it is damaged, turned, or neither grey nor RGB."""
        if self.path.suffix.lower() in TIFF_SUFFIXES:
            return _read_tiff(self)
        return _read_other(self.path)


def picture_files(path: Path, *, images: int | None = None) -> list[PictureFile]:
    """Return pictures in order: of a folder, by natural order of names; of a multi-page TIFF, by ``images`` of them.

    images None: a file is one picture. A file of a folder whose images cannot be counted is one picture,
    whose error is raised when it is read. ScanError if there is nothing to read.
    """
    if path.is_dir():
        inside = files_in(path, SUFFIXES)
        if not inside:
            raise ScanError(path, "holds no scans", remedy=REMEDY)
        return [picture for file in inside for picture in _pictures_of(file, images, one_of_many=True)]
    if not path.is_file():
        raise ScanError(path, "there is no such file or folder", remedy="give a scan or a folder of scans")
    return _pictures_of(path, images)


def _pictures_of(path: Path, images: int | None, *, one_of_many: bool = False) -> list[PictureFile]:
    if path.suffix.lower() not in TIFF_SUFFIXES:
        return [PictureFile(path=path, first_image=0, images=1)]
    try:
        count = image_count(path, ScanError, remedy=_AGAIN)
    except ScanError:
        if one_of_many:
            return [PictureFile(path=path, first_image=0, images=images or 1)]
        raise
    each = images or count
    if not count or count % each:
        raise ScanError(path, f"holds {count} images", remedy=f"give {each} images for each page")
    return [PictureFile(path=path, first_image=first, images=each) for first in range(0, count, each)]


def _read_tiff(file: PictureFile) -> Picture:
    path = file.path
    with opened_tiff(path, ScanError, remedy=_AGAIN) as images:
        pages = [images[place] for place in range(file.first_image, file.first_image + file.images)]
        for page in pages:
            _check_colours(path, page)
        if pages[0].tags.valueof(274) not in (None, 1):
            raise ScanError(path, "is stored rotated", remedy="save it with its first line on top")
        if len({(page.imagelength, page.imagewidth) for page in pages}) > 1:
            what = "holds images of different sizes"
            raise ScanError(path, what, remedy="give images of one size for each page")
        shape = (sum(map(_channels, pages)), pages[0].imagelength, pages[0].imagewidth)
        for page in pages:
            images.check(path, page, result_bytes=BYTES_PER_SAMPLE * prod(shape))
        light = np.empty(shape, np.float32)
        start = 0
        for page in pages:
            part = light[start : start + _channels(page)]
            decode_into(page, np.moveaxis(part, 0, -1))
            if page.photometric == _MIN_IS_WHITE:
                np.subtract(part.max(initial=0), part, out=part)
            start += len(part)
        dpi = _sane(tag_dpi(resolution_tags(pages[0]), unit_unstated=NO_UNIT))
        full = 1.0 if pages[0].dtype.kind == "f" else float(2 ** pages[0].bitspersample - 1)
        profile = pages[0].tags.valueof(_ICC)
    return Picture(light=_checked(path, light), dpi=dpi, full=full, profile=profile or None)


def _channels(page: Any) -> int:
    """Return the channels of light of one image; those after red, green and blue are none."""
    return int(min(page.samplesperpixel, 3))


def _check_colours(path: Path, page: Any) -> None:
    if page.photometric not in (_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB, 6):  # 6: YCbCr, decoded to RGB
        what = f"is {getattr(page.photometric, 'name', 'of unknown colours').lower()}"
        raise ScanError(path, what, remedy=REMEDY)


def _sane(dpi: Sequence[float]) -> tuple[float, float] | None:
    """Return a plausible resolution, or None; programs write 0 or 1 where they know none."""
    return (dpi[0], dpi[1]) if all(1 < value <= DPI_MAX for value in dpi) else None


def _read_other(path: Path) -> Picture:
    with opened_picture(path, ScanError, bytes_per_sample=BYTES_PER_SAMPLE, remedy=REMEDY) as image:
        if image.mode not in (*PLAIN, *PLAIN.values()) and not image.mode.startswith("I"):
            raise ScanError(path, f"is {image.mode}", remedy=REMEDY)
        plain = PLAIN.get(image.mode)
        light = np.empty((3 if (plain or image.mode) == "RGB" else 1, image.height, image.width), np.float32)
        for rows, samples in bands(image, mode=plain):
            light[:, rows] = np.moveaxis(samples, -1, 0)
        dpi, profile = image.info.get("dpi"), image.info.get("icc_profile")
        full = 65535.0 if image.mode.startswith("I") else 255.0
    return Picture(
        light=_checked(path, light),
        dpi=None if not dpi else _sane([float(value) for value in dpi]),
        full=full,
        profile=profile or None,
    )


def _checked(path: Path, light: NDArray[np.float32]) -> NDArray[np.float32]:
    if not all(np.isfinite(rows).all() for rows in light.reshape(-1, light.shape[-1])):
        raise ScanError(path, "holds values that are not finite", remedy=_AGAIN)
    return light
