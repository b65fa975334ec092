"""CMYK TIFF and JPEG files in and out.

A CMYK JPEG by Adobe stores 255 - ink. Pillow knows that, for reading and for writing; the JPEG codec behind
tifffile does not, and must not: inside a TIFF the values stand as they are (TIFF 6.0, separated images).
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tifffile
from PIL.JpegImagePlugin import JpegImageFile

from prooflight.atomic import whole_file
from prooflight.errors import JobError, RequestError
from prooflight.pages.raster import MM_PER_INCH, Page

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

MEGAPIXELS_MAX = 400  # assumed: A0 at 482 dpi has 360
BYTES_PER_PIXEL = (
    12  # 4 of the page, as many again while it is decoded or drawn, and as many for a copy by the caller
)
ANISOTROPY_MAX = 0.01  # x against y resolution; above, the file is not a page raster but a fax
SUFFIXES = (".tif", ".tiff", ".jpg", ".jpeg")
_TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # classic and BigTIFF
_JPEG_MAGIC = b"\xff\xd8\xff"
_XRESOLUTION, _YRESOLUTION, _RESOLUTION_UNIT, _ORIENTATION = (
    282,
    283,
    296,
    274,
)  # TIFF 6.0; EXIF uses the same
_UNITS_PER_INCH = {2: 1.0, 3: MM_PER_INCH / 10}  # TIFF 6.0: 2 inch, 3 centimetre
_PHOTOSHOP_RESOLUTION = 0x03ED  # Adobe Photoshop file formats: ResolutionInfo, in pixels per inch
_REMEDY = "give CMYK TIFF or JPEG, 8 or 16 bits a channel"


def page_name(number: int) -> str:
    """File-name stem of page ``number`` of a job, from 1.

    >>> page_name(7)
    'p0007'
    """
    return f"p{number:04d}"


def refuse_oversize(
    where: object, rows: int, columns: int, *, bytes_per_pixel: int = BYTES_PER_PIXEL
) -> None:
    """JobError, before anything is allocated, if a page is larger than memory or 400 megapixels allow."""
    megapixels = rows * columns / 1e6
    if megapixels > MEGAPIXELS_MAX:
        what = f"{columns} x {rows} pixels are {megapixels:.0f} megapixels"
        raise JobError(where, what, remedy=f"at most {MEGAPIXELS_MAX}: lower the resolution or cut the page")
    needed, free = rows * columns * bytes_per_pixel, available_bytes()
    if needed > free:
        what = f"{columns} x {rows} pixels need {needed / 1e9:.1f} GB"
        raise JobError(where, what, remedy=f"{free / 1e9:.1f} GB of memory are free: lower the resolution")


def available_bytes() -> float:
    """Memory that can still be taken without swapping; infinite where the system does not say."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024
    return float("inf")


def read_image(path: Path, *, dpi: float | None = None) -> list[Page]:
    """All pages of a CMYK TIFF or JPEG; ``dpi`` [pixels/inch] takes the place of the file's own resolution.

    JobError: not CMYK, truncated, empty, without a resolution, or larger than memory allows.
    """
    return [read_page(path, number, dpi=dpi) for number in range(1, page_count(path) + 1)]


def page_count(path: Path) -> int:
    """Number of pages in a TIFF (thumbnails left out) or JPEG; JobError if it is neither."""
    path = Path(path)
    if _is_jpeg(path):
        return 1
    with _opened_tiff(path) as pages:
        count = len(pages)
    if not count:
        raise JobError(path, "the TIFF has no pages", remedy="export or copy it again")
    return count


def read_page(path: Path, number: int = 1, *, dpi: float | None = None) -> Page:
    """Page ``number`` (from 1) of a CMYK TIFF or JPEG; RequestError if there is none, else as ``read_image``."""
    path = Path(path)
    if dpi is not None and not dpi > 0:
        raise RequestError(path, f"a resolution of {dpi} dpi", remedy="give a dpi above 0")
    read = _read_jpeg if _is_jpeg(path) else _read_tiff
    cmyk, resolution = read(path, number, dpi)
    return Page(cmyk=cmyk, dpi=resolution, name=page_name(number), number=number)


def flaws(path: Path) -> dict[int, JobError]:
    """Pages of a TIFF, from 1, of which it can be told undecoded that they cannot be used; of a JPEG none."""
    if _is_jpeg(path):
        return {}
    found = {}
    with _opened_tiff(path) as pages:
        for number, page in enumerate(pages, start=1):
            try:
                _check_tiff(path if len(pages) == 1 else f"{path}, page {number}", page, path.stat().st_size)
            except JobError as error:
                found[number] = error
    return found


def _is_jpeg(path: Path) -> bool:
    with path.open("rb") as file:  # OSError for what the system cannot open
        head = file.read(4)
    if not head:
        raise JobError(path, "the file is empty", remedy=_REMEDY)
    if not head.startswith((_JPEG_MAGIC, *_TIFF_MAGICS)):
        raise JobError(path, "neither TIFF nor JPEG", remedy=_REMEDY)
    return head.startswith(_JPEG_MAGIC)


@contextlib.contextmanager
def _opened_tiff(path: Path) -> Iterator[list[Any]]:
    """The full-size pages of a TIFF."""
    try:
        with tifffile.TiffFile(path) as tiff:
            pages = [page for page in tiff.pages if not page.is_reduced]
            yield pages
    except (JobError, RequestError):
        raise
    except Exception as error:  # the codecs raise errors of their own classes, none of them documented
        raise JobError(path, f"the TIFF cannot be read ({error})", remedy="export or copy it again") from None


def _read_tiff(path: Path, number: int, dpi: float | None) -> tuple[NDArray[np.uint8], float]:
    with _opened_tiff(path) as pages:
        if not 1 <= number <= len(pages):
            raise RequestError(path, f"there is no page {number}", remedy=f"it has pages 1 to {len(pages)}")
        page = pages[number - 1]
        where = path if len(pages) == 1 else f"{path}, page {number}"
        _check_tiff(where, page, path.stat().st_size)
        tags = {code: page.tags.valueof(code) for code in (_XRESOLUTION, _YRESOLUTION, _RESOLUTION_UNIT)}
        resolution = dpi or _one_resolution(where, *_tag_dpi(tags))
        pixels = np.asarray(page.asarray(maxworkers=1))
    if page.planarconfig == 2:
        pixels = np.moveaxis(pixels, 0, -1)
    if pixels.dtype == np.uint16:
        pixels = ((pixels.astype(np.uint32) + 128) // 257).astype(np.uint8)  # 65535 / 255 = 257
    return np.ascontiguousarray(pixels.reshape(page.imagelength, page.imagewidth, 4)), resolution


def _check_tiff(where: object, page: Any, file_bytes: int) -> None:
    if page.photometric != 5 or page.tags.valueof(332, 1) != 1:  # 5 separated; 332 InkSet, 1 CMYK
        colours = getattr(page.photometric, "name", "other colours").lower()
        raise JobError(where, f"the image is {colours}, not CMYK", remedy=_REMEDY)
    if page.samplesperpixel != 4:
        raise JobError(where, f"{page.samplesperpixel} channels where CMYK has 4", remedy=_REMEDY)
    if page.dtype not in (np.uint8, np.uint16):
        raise JobError(where, f"{page.bitspersample} bits a channel ({page.dtype})", remedy=_REMEDY)
    if page.tags.valueof(_ORIENTATION, 1) != 1:
        raise JobError(where, "the image is stored turned", remedy="export it with its first row on top")
    refuse_oversize(where, page.imagelength, page.imagewidth)
    for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
        if not size or offset + size > file_bytes:
            raise JobError(where, "the TIFF is truncated", remedy="export or copy it again")


def _read_jpeg(path: Path, number: int, dpi: float | None) -> tuple[NDArray[np.uint8], float]:
    if number != 1:
        raise RequestError(path, f"there is no page {number}", remedy="a JPEG has one page")
    # Not Image.open: its guard against large images is below what an A3 page at 1200 dpi needs; ours follows.
    with path.open("rb") as file:
        try:
            image = JpegImageFile(file)
            mode, size = image.mode, image.size
        except Exception as error:  # Pillow raises SyntaxError, OSError, struct.error, ...
            raise JobError(
                path, f"the JPEG cannot be read ({error})", remedy="export or copy it again"
            ) from None
        if mode != "CMYK":
            raise JobError(path, f"the image is {mode}, not CMYK", remedy=_REMEDY)
        if image.getexif().get(_ORIENTATION, 1) != 1:
            raise JobError(path, "the image is stored turned", remedy="export it with its first row on top")
        refuse_oversize(path, size[1], size[0])
        resolution = dpi or _one_resolution(path, *_jpeg_dpi(image))
        try:
            pixels = np.array(image)
        except Exception:
            raise JobError(
                path, "the JPEG is truncated or damaged", remedy="export or copy it again"
            ) from None
    return pixels, resolution


def _jpeg_dpi(image: JpegImageFile) -> tuple[float, float]:
    """Resolution by JFIF, else EXIF, else Photoshop's own record; 0 where there is none [pixels/inch]."""
    # Not info["dpi"]: Pillow makes it 72 when the EXIF record is broken.
    unit = image.info.get("jfif_unit", 0)
    if unit in (1, 2):  # JFIF 1.02: 1 inch, 2 centimetre
        x, y = image.info["jfif_density"]
        return x * _UNITS_PER_INCH[unit + 1], y * _UNITS_PER_INCH[unit + 1]
    by_exif = _tag_dpi(dict(image.getexif()))
    if by_exif[0] > 0:
        return by_exif
    record = image.info.get("photoshop", {}).get(_PHOTOSHOP_RESOLUTION, {})
    return float(record.get("XResolution", 0)), float(record.get("YResolution", 0))


def _tag_dpi(tags: dict[int, Any]) -> tuple[float, float]:
    """Resolution by TIFF or EXIF tags; 0 where there is none [pixels/inch]."""
    unit = tags.get(_RESOLUTION_UNIT)
    scale = _UNITS_PER_INCH.get(
        2 if unit is None else unit, 0.0
    )  # "unit or 2": tifffile's RESUNIT.NONE is false
    x, y = (_ratio(tags.get(code)) for code in (_XRESOLUTION, _YRESOLUTION))
    return x * scale, y * scale


def _ratio(value: Any) -> float:
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError):
        return float(value[0] / value[1] if isinstance(value, tuple) else value)
    return 0.0


def _one_resolution(where: object, x_dpi: float, y_dpi: float) -> float:
    if not (0 < x_dpi < np.inf and 0 < y_dpi < np.inf):
        raise JobError(where, "the image states no resolution", remedy="save it with its resolution")
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


def write_jpeg(page: Page, path: Path, *, quality: int = 95) -> None:
    """Write a page as a CMYK JPEG as Adobe stores it (inverted), not subsampled; whole or not at all.

    quality: 1 to 100, the IJG scale. JPEG holds whole pixels per inch: the resolution is rounded.
    """
    from PIL import Image

    with whole_file(Path(path)) as unfinished:
        Image.fromarray(page.cmyk, mode="CMYK").save(
            unfinished, format="JPEG", quality=quality, subsampling=0, dpi=(round(page.dpi), round(page.dpi))
        )
