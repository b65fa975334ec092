"""The images of a TIFF, checked before they are decoded, and decoded piece by piece into arrays of the caller.

tifffile is given only files whose directories have been followed to their end: they end, are within the file, and
respect limits. TIFF 6.0 chains them by offsets, so that a damaged chain may lead back to an earlier directory, and
tifffile would follow a circle for ever.
"""

from __future__ import annotations

import contextlib
import logging
import struct
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import tifffile
from numpy.typing import NDArray

from prooflight.errors import InputError
from prooflight.pages.memory import file_size, refuse_unaffordable
from prooflight.pages.picture_files import frame

IMAGES_MAX: Final = 10_000
"""Most images in one file: a run of a thousand sheets seen by ten sensors."""
TAGS_MAX: Final = 4096
"""Most tags in one directory; tifffile takes no more."""
VALUES_MAX: Final = 1 << 18
"""Most values of one tag that holds numbers: two such tags, offsets and sizes, suffice for as many strips
as are decoded in seconds."""
ALL_TAGS_MAX: Final = 1 << 20
"""Most tags in one file: directories may overlap, so that a small file could hold very many."""

_SIZES: Final = np.array([0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8, 0])
"""Bytes of a value, by the number of its type (TIFF 6.0 and BigTIFF); 0: there is no such type."""
_ROOM: Final = np.where(np.isin(np.arange(len(_SIZES)), (1, 2, 6, 7)), np.inf, VALUES_MAX)
"""Most values of a tag, by its type: bytes are read in one piece, without a limit."""
_UNKNOWN: Final = len(_SIZES) - 1
_BASELINE_END: Final = 600  # below, tags say how the image is stored; above, programs keep what is theirs
_SINGLE: Final = np.zeros(1 << 16, bool)
_SINGLE[[256, 257, 259, 262, 266, 274, 277, 284, 296, 317, 322, 323]] = (
    True  # sizes and forms of an image, one each
)
_SUBFILE, _OLD_SUBFILE = 254, 255


class DirectoryError(ValueError):
    """The directories of a TIFF cannot be followed; the message states why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Form:
    """Storage of numbers: classic TIFF or BigTIFF, least or most significant byte first."""

    order: str
    big: bool

    @property
    def offset(self) -> struct.Struct:
        return struct.Struct(self.order + ("Q" if self.big else "I"))

    @property
    def count(self) -> struct.Struct:
        return struct.Struct(self.order + ("Q" if self.big else "H"))

    @property
    def tag(self) -> np.dtype[Any]:
        wide = "u8" if self.big else "u4"
        names = ("code", "u2"), ("type", "u2"), ("count", wide), ("value", wide)
        return np.dtype([(name, self.order + kind) for name, kind in names])


def full_size_images(file: BinaryIO, size: int) -> list[int]:
    """Return the indices, from 0, of a TIFF's images that are not thumbnails; ``size`` is that of the file [bytes].

    DirectoryError: the file is no TIFF, is truncated, or its directories form a circle or exceed the limits.
    """
    form = _form(file.read(16))
    file.seek(8 if form.big else 4)
    (offset,) = form.offset.unpack(file.read(form.offset.size))
    seen: set[int] = set()
    found, tags = [], 0
    while offset:
        if offset in seen:
            raise DirectoryError("its directories form a loop")
        if len(seen) == IMAGES_MAX:
            raise DirectoryError(f"it holds more than {IMAGES_MAX} images")
        directory, following = _directory(file, form, offset, size)
        tags += len(directory)
        if tags > ALL_TAGS_MAX:
            raise DirectoryError(f"it holds more than {ALL_TAGS_MAX} tags")
        if not _is_reduced(directory, form):
            found.append(len(seen))
        seen.add(offset)
        offset = following
    return found


def _form(head: bytes) -> _Form:
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 8:
        raise DirectoryError("it is not a TIFF")
    (version,) = struct.unpack(order + "H", head[2:4])
    if version not in (42, 43) or (version == 43 and head[4:8] != struct.pack(order + "HH", 8, 0)):
        raise DirectoryError("it is not a TIFF")
    if version == 43 and len(head) < 16:
        raise DirectoryError("it is truncated")
    return _Form(order=order, big=version == 43)


def _directory(file: BinaryIO, form: _Form, offset: int, size: int) -> tuple[NDArray[Any], int]:
    """Return the tags of the directory at ``offset``, and the offset of the next one."""
    file.seek(min(offset, size))
    head = file.read(form.count.size)
    count = form.count.unpack(head)[0] if len(head) == form.count.size else 0
    if not count:
        raise DirectoryError("it is truncated")
    if count > TAGS_MAX:
        raise DirectoryError(f"a directory holds {count} tags")
    table, tail = file.read(count * form.tag.itemsize), file.read(form.offset.size)
    if len(tail) < form.offset.size:
        raise DirectoryError("it is truncated")
    tags = np.frombuffer(table, form.tag)
    _check_values(tags, form, size)
    return tags, form.offset.unpack(tail)[0]


def _check_values(tags: NDArray[Any], form: _Form, size: int) -> None:
    kinds, counts = np.minimum(tags["type"], _UNKNOWN), tags["count"]
    each = _SIZES[kinds]
    unknown = (each == 0) & (tags["code"] < _BASELINE_END)
    if unknown.any():
        raise DirectoryError(f"tag {tags['code'][unknown][0]} is of an unknown type")
    long = (counts > _ROOM[kinds]) | (_SINGLE[tags["code"]] & (counts != 1))
    if long.any():
        raise DirectoryError(f"tag {tags['code'][long][0]} holds {counts[long][0]} values")
    needed = np.minimum(counts, size + 1).astype(np.int64) * each
    ends = tags["value"].astype(np.float64) + needed  # exact to 2^53
    beyond = (needed > form.offset.size) & (ends > size)
    if beyond.any():
        raise DirectoryError(f"it is truncated: tag {tags['code'][beyond][0]} is beyond its end")


def _is_reduced(tags: NDArray[Any], form: _Form) -> bool:
    """Return whether a directory declares its image a smaller copy of another."""
    for code in (_SUBFILE, _OLD_SUBFILE):
        for tag in tags[tags["code"] == code]:
            narrow = np.dtype(form.order + ("u2" if tag["type"] == 3 else "u4"))
            value = int(np.frombuffer(tag["value"].tobytes(), narrow)[0])
            if code == _SUBFILE:
                if value:
                    return bool(value & 1)
            else:
                return value == 2
    return False


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
