"""The images of a TIFF, checked before they are decoded, and decoded piece by piece into arrays of the caller.

tifffile is given only files whose directories have been followed to their end (``tiff_directories``): it
would follow a circle for ever.
"""

from __future__ import annotations

import contextlib
import logging
from contextvars import ContextVar
from math import prod
from typing import TYPE_CHECKING, Any, Final

import tifffile

from prooflight.errors import InputError
from prooflight.pages.memory import file_size, refuse_unaffordable
from prooflight.pages.picture_files import frame
from prooflight.pages.tiff_directories import DirectoryError, full_size_images

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

TIFF_SUFFIXES: Final = (".tif", ".tiff")
REMEDY: Final = "export or copy it again"
CHUNKS_MAX: Final = 1 << 17
"""Most strips or tiles of one image: A0 at 1200 dpi has 40,000 lines, and each takes some 20 microseconds
of overhead."""
CHUNK_SLACK_BYTES: Final = 64 * 2**20
"""Largest excess of a tile over its image."""
COMPRESSIONS: Final = {
    1: "none",
    5: "LZW",
    7: "JPEG",
    8: "deflate",
    32773: "PackBits",
    32946: "deflate",
    34925: "LZMA",
    50000: "ZSTD",
}
"""Decoders that write no more than requested, by number (TIFF 6.0 and its supplements)."""
_JPEG: Final = 7
_JPEG_SLACK: Final = 1 << 16  # samples; blocks are whole
BAND_ROWS: Final = 64
"""Rows that are converted at a time."""
_READ_BYTES: Final = 4 * 2**20  # read ahead of the decoder
_SEPARATE: Final = 2  # PlanarConfiguration

_hushed: ContextVar[bool] = ContextVar("_hushed", default=False)


def _speaks(_record: logging.LogRecord) -> bool:
    return not _hushed.get()


tifffile.logger().addFilter(_speaks)  # what it complains of is looked for here, and said in one line


@contextlib.contextmanager
def opened_tiff(path: Path, refused: type[InputError], *, remedy: str = REMEDY) -> Iterator[TiffImages]:
    """Open a TIFF's images, without thumbnails; all errors inside the context are raised as ``refused``.

    OSError: the system cannot open the file.
    """
    size = file_size(path, refused)
    with path.open("rb") as file:
        quiet = _hushed.set(True)
        try:
            places = full_size_images(file, size)
            file.seek(0)
            with tifffile.TiffFile(file, name=path.stem) as tiff:
                yield TiffImages(tiff.pages, places, file_bytes=size, refused=refused, remedy=remedy)
        except InputError:
            raise
        except Exception as error:  # the codecs raise errors of their own classes, none of them documented
            raise refused(path, f"the TIFF cannot be read ({error})", remedy=remedy) from None
        finally:
            _hushed.reset(quiet)


def image_count(path: Path, refused: type[InputError], *, remedy: str = REMEDY) -> int:
    """Return the number of images, without thumbnails, in a TIFF; ``refused``, OSError: as ``opened_tiff``."""
    size = file_size(path, refused)
    try:
        with path.open("rb") as file:
            return len(full_size_images(file, size))
    except DirectoryError as error:
        raise refused(path, f"the TIFF cannot be read ({error})", remedy=remedy) from None


class TiffImages:
    """The full-size images of an open TIFF, by their index from 0."""

    def __init__(
        self, pages: Any, places: Sequence[int], *, file_bytes: int, refused: type[InputError], remedy: str
    ) -> None:
        self._pages, self._places = pages, places
        self._file_bytes, self._refused, self._remedy = file_bytes, refused, remedy

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, place: int) -> Any:
        """Return the page as tifffile has it; nothing of it is decoded yet."""
        return self._pages[self._places[place]]

    def check(self, where: object, page: Any, *, result_bytes: float) -> None:
        """Raise if an image needs more memory than its file and the system allow, or too much time.

        ``result_bytes`` is the memory that the caller will hold of it.
        """
        what = _unreadable(page, self._file_bytes)
        if what:
            raise self._refused(where, what, remedy=self._remedy)
        size = f"{page.imagewidth} x {page.imagelength} pixels"
        decoding = _chunk_bytes(page) + max(page.databytecounts)
        refuse_unaffordable(
            self._refused, where, size, needed_bytes=result_bytes + decoding, file_bytes=self._file_bytes
        )


def decode_into(
    page: Any, out: NDArray[Any], convert: Callable[[NDArray[Any]], NDArray[Any]] | None = None
) -> None:
    """Decode a checked image piece by piece into (rows, columns, channels), with as many of its channels as
    there are.

    ``convert`` is applied to each piece's samples before they are stored.
    """
    if page.compression == _JPEG:
        _check_jpegs(page)
    channels = out.shape[2]
    for chunk, (plane, _, top, left, _), _ in page.segments(
        maxworkers=1, buffersize=_READ_BYTES, _fullsize=False
    ):
        if plane >= channels:
            continue
        bands = chunk[0, : out.shape[0] - top, : out.shape[1] - left, : channels - plane]
        height, width, deep = bands.shape
        for start in range(0, height, BAND_ROWS):
            band = bands[start : start + BAND_ROWS]
            rows = slice(top + start, top + start + len(band))
            out[rows, left : left + width, plane : plane + deep] = band if convert is None else convert(band)


def _unreadable(page: Any, file_bytes: int) -> str:
    """Return why an image is not decoded; empty: it may be."""
    if page.compression not in COMPRESSIONS:
        supported = ", ".join(dict.fromkeys(COMPRESSIONS.values()))
        return f"its compression {int(page.compression)} is not read, only {supported}"
    if min(page.imagewidth, page.imagelength, page.samplesperpixel) < 1 or page.dtype is None:
        return f"the image is {page.imagewidth} x {page.imagelength} pixels of {page.bitspersample} bits"
    subsampled = page.is_subsampled and page.compression != _JPEG
    if page.imagedepth != 1 or page.planarconfig not in (1, _SEPARATE) or subsampled:
        return "the TIFF stores its image in a way that is not read"
    offsets, sizes, chunks = page.dataoffsets, page.databytecounts, prod(page.chunked)
    if chunks > CHUNKS_MAX:
        return f"the image is in {chunks} pieces, at most {CHUNKS_MAX} are read"
    if not len(offsets) == len(sizes) == chunks:
        return "the TIFF is damaged: it does not state where all parts of its image are"
    if any(
        size < 1 or offset < 1 or offset + size > file_bytes
        for offset, size in zip(offsets, sizes, strict=True)
    ):
        return "the TIFF is truncated"
    if sum(sizes) > file_bytes:
        return "the TIFF is damaged: pieces of its image overlap"
    image_bytes = prod(page.shaped) * page.dtype.itemsize
    if _chunk_bytes(page) > image_bytes + CHUNK_SLACK_BYTES:
        return "the TIFF is damaged: its tiles are larger than its image"
    return ""


def _chunk_bytes(page: Any) -> int:
    """Return the size of a decoded strip or tile. [bytes]"""
    samples = page.samplesperpixel if page.planarconfig != _SEPARATE else 1
    wide, long = (page.tilewidth, page.tilelength) if page.is_tiled else (page.imagewidth, page.rowsperstrip)
    return wide * long * samples * page.dtype.itemsize


def _check_jpegs(page: Any) -> None:
    """Raise ValueError if a JPEG within a TIFF is larger than its strip or tile."""
    file = page.parent.filehandle
    allowed = 2 * _chunk_bytes(page) // page.dtype.itemsize + _JPEG_SLACK
    for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
        file.seek(offset)
        header = frame(file.read(size))
        if header.rows * header.columns * header.components > allowed:
            message = f"a JPEG of {header.columns} x {header.rows} pixels is in a smaller strip or tile"
            raise ValueError(message)
