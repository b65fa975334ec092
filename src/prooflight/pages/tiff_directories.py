"""Directories of a TIFF, checked before anything is decoded: they end, are within the file, and respect limits.

TIFF 6.0 chains directories by offsets, so that a damaged chain may lead back to an earlier directory.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
