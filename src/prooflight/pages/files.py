"""Input and output of CMYK TIFF and JPEG files.

A CMYK JPEG by Adobe stores 255 - ink. Pillow handles that, for reading and for writing; the JPEG codec behind
tifffile does not, and must not: inside a TIFF the values are stored as they are (TIFF 6.0, separated images).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from prooflight.errors import JobError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.pages.memory import file_head, refuse_oversize
from prooflight.pages.picture_files import JPEG_MAGIC, bands, opened_picture
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.pages.tiff_images import TIFF_SUFFIXES, decode_into, image_count, opened_tiff

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

PAGE_BYTES_PER_PIXEL = 4
DPI_MAX = 100_000.0
"""Largest plausible resolution; the smallest is 1. At this limit a pixel is a quarter of a micrometre, and
a hair some 60."""
ANISOTROPY_MAX = 0.01  # x against y resolution; above, the file is not a page raster but a fax
SUFFIXES = (*TIFF_SUFFIXES, ".jpg", ".jpeg")
_TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # classic and BigTIFF
_XRESOLUTION, _YRESOLUTION, _RESOLUTION_UNIT, _ORIENTATION = 282, 283, 296, 274  # TIFF 6.0; EXIF has the same
NO_UNIT, _INCH, _CENTIMETRE = 1, 2, 3  # TIFF 6.0, ResolutionUnit
_UNITS_PER_INCH = {_INCH: 1.0, _CENTIMETRE: MM_PER_INCH / 10}
_PHOTOSHOP_RESOLUTION = 0x03ED  # Adobe Photoshop file formats: ResolutionInfo, in pixels per inch
_JPEG_BYTES_PER_SAMPLE = 2.1  # measured: Pillow's own, the page's, and a band of rows
_REMEDY = "give CMYK TIFF or JPEG, 8 or 16 bits a channel"
_COPY = "export or copy it again"


def page_name(number: int) -> str:
    """Return the file-name stem of page ``number`` of a job, from 1.

    >>> page_name(7)
    'p0007'
    """
    return f"p{number:04d}"


def check_dpi(where: object, dpi: float) -> None:
    """Raise RequestError if a requested resolution is not plausible. [pixels/inch]"""
    if not 1 <= dpi <= DPI_MAX:
        remedy = f"give a dpi above 0: from 1 to {DPI_MAX:.0f}"
        raise RequestError(where, f"a resolution of {dpi:g} dpi", remedy=remedy)


def read_image(path: Path, *, dpi: float | None = None) -> list[Page]:
    """Return all pages of a CMYK TIFF or JPEG; ``dpi`` [pixels/inch] replaces the file's own resolution.

    JobError: not CMYK, truncated, empty, without a resolution, or larger than memory allows.
    """
    return [read_page(path, number, dpi=dpi) for number in range(1, page_count(path) + 1)]


def page_count(path: Path) -> int:
    """Return the number of pages in a TIFF (without thumbnails) or JPEG; JobError if it is neither."""
    path = Path(path)
    if _is_jpeg(path):
        return 1
    count = image_count(path, JobError)
    if not count:
        raise JobError(path, "the TIFF has no pages", remedy="export or copy it again")
    return count


def page_size_mm(path: Path, number: int) -> tuple[float, float]:
    """Return width and height of page ``number`` (from 1) without decoding it; errors as ``read_page``."""
    path = Path(path)
    with (_jpeg if _is_jpeg(path) else _tiff_page)(path, number) as stored:
        dpi = _one_resolution(stored.where, *stored.dpi)
    return stored.columns * MM_PER_INCH / dpi, stored.rows * MM_PER_INCH / dpi


def read_page(path: Path, number: int = 1, *, dpi: float | None = None) -> Page:
    """Return page ``number`` (from 1) of a CMYK TIFF or JPEG.

    RequestError: there is no such page. Other errors as ``read_image``.
    """
    path = Path(path)
    if dpi is not None:
        check_dpi(path, dpi)
    with (_jpeg if _is_jpeg(path) else _tiff_page)(path, number) as stored:
        resolution = dpi or _one_resolution(stored.where, *stored.dpi)
        cmyk = np.empty((stored.rows, stored.columns, 4), np.uint8)
        stored.decode(cmyk)
    return Page(cmyk=cmyk, dpi=resolution, name=page_name(number), number=number)


def flaws(path: Path) -> dict[int, JobError]:
    """Return the pages, from 1, that are known without decoding to be unusable, and why."""
    flawed = {}
    for number in range(1, page_count(path) + 1):
        try:
            page_size_mm(path, number)
        except JobError as error:
            flawed[number] = error
    return flawed


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stored:
    """A page in an open file that has been checked, and is not decoded yet."""

    where: object
    rows: int
    columns: int
    dpi: tuple[float, float]
    """Resolution across and along, as the file states it; 0 if it does not. [pixels/inch]"""
    decode: Callable[[NDArray[np.uint8]], None]
    """Function that decodes the page into an array of (rows, columns, 4)."""


def _is_jpeg(path: Path) -> bool:
    head = file_head(path, JobError, 4)
    if not head:
        raise JobError(path, "the file is empty", remedy=_REMEDY)
    if not head.startswith((JPEG_MAGIC, *_TIFF_MAGICS)):
        raise JobError(path, "neither TIFF nor JPEG", remedy=_REMEDY)
    return head.startswith(JPEG_MAGIC)


@contextlib.contextmanager
def _tiff_page(path: Path, number: int) -> Iterator[_Stored]:
    with opened_tiff(path, JobError) as images:
        if not 1 <= number <= len(images):
            raise RequestError(path, f"there is no page {number}", remedy=f"it has pages 1 to {len(images)}")
        page = images[number - 1]
        where = path if len(images) == 1 else f"{path}, page {number}"
        _check_tiff(where, page)
        refuse_oversize(where, page.imagelength, page.imagewidth)
        images.check(where, page, result_bytes=PAGE_BYTES_PER_PIXEL * page.imagelength * page.imagewidth)
        yield _Stored(
            where=where,
            rows=page.imagelength,
            columns=page.imagewidth,
            dpi=tag_dpi(resolution_tags(page)),
            decode=partial(decode_into, page, convert=_eight_bits if page.dtype == np.uint16 else None),
        )


def _eight_bits(samples: NDArray[np.uint16]) -> NDArray[np.uint32]:
    """Return the nearest values of 8 bits: 65535 / 255 = 257."""
    return (samples.astype(np.uint32) + 128) // 257


def _check_tiff(where: object, page: Any) -> None:
    if page.photometric != 5 or page.tags.valueof(332, 1) != 1:  # 5 separated; 332 InkSet, 1 CMYK
        colours = getattr(page.photometric, "name", "other colours").lower()
        raise JobError(where, f"the image is {colours}, not CMYK", remedy=_REMEDY)
    if page.samplesperpixel != 4:
        raise JobError(where, f"{page.samplesperpixel} channels where CMYK has 4", remedy=_REMEDY)
    if page.dtype not in (np.uint8, np.uint16) or page.bitspersample not in (8, 16):
        raise JobError(where, f"{page.bitspersample} bits a channel ({page.dtype})", remedy=_REMEDY)
    if page.tags.valueof(_ORIENTATION, 1) != 1:
        raise JobError(where, "the image is stored rotated", remedy="export it with its first row on top")


@contextlib.contextmanager
def _jpeg(path: Path, number: int) -> Iterator[_Stored]:
    if number != 1:
        raise RequestError(path, f"there is no page {number}", remedy="a JPEG has one page")
    with opened_picture(path, JobError, bytes_per_sample=_JPEG_BYTES_PER_SAMPLE, remedy=_COPY) as image:
        if image.mode != "CMYK":
            raise JobError(path, f"the image is {image.mode}, not CMYK", remedy=_REMEDY)
        if image.getexif().get(_ORIENTATION, 1) != 1:
            raise JobError(path, "the image is stored rotated", remedy="export it with its first row on top")
        refuse_oversize(path, image.height, image.width)

        def decode(cmyk: NDArray[np.uint8]) -> None:
            for rows, samples in bands(image):
                cmyk[rows] = samples

        yield _Stored(where=path, rows=image.height, columns=image.width, dpi=_jpeg_dpi(image), decode=decode)


def _jpeg_dpi(image: ImageFile) -> tuple[float, float]:
    """Return the resolution by JFIF, else EXIF, else Photoshop's own record; 0 if there is none. [pixels/inch]"""
    # Not info["dpi"]: Pillow makes it 72 when the EXIF record is broken.
    unit = image.info.get("jfif_unit", 0)
    if unit in (1, 2):  # JFIF 1.02: 1 inch, 2 centimetre
        x, y = image.info["jfif_density"]
        return x * _UNITS_PER_INCH[unit + 1], y * _UNITS_PER_INCH[unit + 1]
    by_exif = tag_dpi(dict(image.getexif()))
    if by_exif[0] > 0:
        return by_exif
    record = image.info.get("photoshop", {}).get(_PHOTOSHOP_RESOLUTION, {})
    return float(record.get("XResolution", 0)), float(record.get("YResolution", 0))


def resolution_tags(page: Any) -> dict[int, Any]:
    """Return the tags that ``tag_dpi`` needs, of a page of tifffile."""
    return {code: page.tags.valueof(code) for code in (_XRESOLUTION, _YRESOLUTION, _RESOLUTION_UNIT)}


def tag_dpi(tags: dict[int, Any], *, unit_unstated: int = _INCH) -> tuple[float, float]:
    """Return the resolution across and along by TIFF or EXIF tags; 0 if there is none. [pixels/inch]

    ``unit_unstated`` is the unit if no tag states it; TIFF 6.0 defines the inch.
    """
    unit = tags.get(_RESOLUTION_UNIT)
    # Not "unit or": tifffile's RESUNIT.NONE is false.
    scale = _UNITS_PER_INCH.get(unit_unstated if unit is None else unit, 0.0)
    x, y = (_ratio(tags.get(code)) for code in (_XRESOLUTION, _YRESOLUTION))
    return x * scale, y * scale


def _ratio(value: Any) -> float:
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError):
        return float(value[0] / value[1] if isinstance(value, tuple) else value)
    return 0.0


def _one_resolution(where: object, x_dpi: float, y_dpi: float) -> float:
    if not (0 < x_dpi < np.inf and 0 < y_dpi < np.inf):
        raise JobError(where, "the image states no resolution", remedy="save it with its resolution")
    if not (1 <= x_dpi <= DPI_MAX and 1 <= y_dpi <= DPI_MAX):
        what = f"the image states a resolution of {x_dpi:g} x {y_dpi:g} dpi"
        raise JobError(where, what, remedy="save it with its resolution")
    if abs(x_dpi / y_dpi - 1) > ANISOTROPY_MAX:
        what = f"{x_dpi:g} dpi across and {y_dpi:g} along"
        raise JobError(where, what, remedy="give an image of the same resolution both ways")
    return x_dpi


def write_tiff(page: Page, path: Path) -> None:
    """Write a page as a CMYK TIFF, deflated, with its resolution; whole or not at all."""
    with whole_file(Path(path)) as unfinished:
        tifffile.imwrite(
            unfinished,
            page.cmyk,
            photometric="separated",
            planarconfig="contig",
            compression="adobe_deflate",
            compressionargs={"level": 6},
            predictor=True,
            rowsperstrip=256,
            resolution=(page.dpi, page.dpi),
            resolutionunit="inch",
            bigtiff=page.cmyk.nbytes > 2**31,
            metadata=None,
            maxworkers=1,
        )
