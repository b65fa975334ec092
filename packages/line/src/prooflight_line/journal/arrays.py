"""Arrays of one page in a NumPy archive: their limits, and reading that trusts nothing the file states.

Sizes precede the data they describe, and a few damaged bytes can claim all memory: every size is checked against
the limits of a page's evidence before anything is unpacked. Nothing in a file is evaluated.
"""

from __future__ import annotations

import io
import math
import os
import re
import struct
import zipfile
import zlib
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from PIL.JpegImagePlugin import JpegImageFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from typing import IO

    from numpy.typing import NDArray

MOST_PAGE_BYTES: Final = 64_000_000
"""Limit of the size of one page's arrays; those of an A4 page take a quarter of a megabyte."""
MOST_MEMBERS: Final = 20_000
MOST_LIST_BYTES: Final = 4_000_000
"""Limit of the size of an archive's list of members."""
KINDS: Final = "biuf"
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
_HEADER: Final = re.compile(
    r"\{'descr': '([<>|](?:b1|[iu][1248]|f[248]))', 'fortran_order': (True|False), "
    r"'shape': \((|[0-9]+,|[0-9]+(?:, [0-9]+)+)\), \} *\n"
)
"""Header of an array as NumPy writes it."""
_MAGIC: Final = b"\x93NUMPY\x01\x00"
_END: Final = struct.Struct("<4s4H2LH")
DAMAGED: Final = (
    *(zipfile.BadZipFile, zlib.error, EOFError, struct.error),
    *(NotImplementedError, RuntimeError, OverflowError, ValueError, OSError),
)
"""Errors by which ``zipfile`` fails on a damaged archive."""


def check_arrays(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Raise ValueError if these arrays cannot be stored as the evidence of one page."""
    for name, array in arrays.items():
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a name of an array")
        dtype = np.asarray(array).dtype
        if dtype.kind not in KINDS or dtype.itemsize > 8:
            raise ValueError(f"{name} contains {dtype}, not numbers")
        if np.ndim(array) > 8:
            raise ValueError(f"{name} has {np.ndim(array)} axes")
    if (size := sum(np.asarray(array).nbytes for array in arrays.values())) > MOST_PAGE_BYTES:
        raise ValueError(f"it takes {size / 1e6:,.0f} MB, a page's may take {MOST_PAGE_BYTES / 1e6:.0f}")


def write_arrays(archive: zipfile.ZipFile, sheet: int, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write one page's arrays, named SHEET/NAME."""
    for name, array in arrays.items():
        with archive.open(f"{sheet}/{name}.npy", "w") as member:
            np.lib.format.write_array(member, np.asarray(array), version=(1, 0), allow_pickle=False)


def read_arrays(file: IO[bytes], sheet: int) -> dict[str, NDArray[Any]]:
    """Read one page's arrays; ValueError: they are damaged, or larger than a page's may be."""
    begin = f"{sheet}/"
    with checked_archive(file) as archive:
        members = [each for each in archive.infolist() if each.filename.startswith(begin)]
        left, arrays = MOST_PAGE_BYTES, {}
        for member in members:
            name = member.filename.removeprefix(begin).removesuffix(".npy")
            if not _NAME.fullmatch(name) or name in arrays:
                raise ValueError(f"{member.filename[:80]!r} is not a name of an array, or appears twice")
            arrays[name] = _read_array(archive, member, most_bytes=left)
            left -= arrays[name].nbytes
    return arrays


@contextmanager
def checked_archive(file: IO[bytes]) -> Iterator[zipfile.ZipFile]:
    """Open an archive of arrays whose list of members is of valid size; ValueError, also later: it is damaged."""
    try:
        _check_end(file)
        with zipfile.ZipFile(file) as archive:
            yield archive
    except DAMAGED as error:
        raise ValueError(str(error) or type(error).__name__) from error


def _check_end(file: IO[bytes]) -> None:
    """Raise ValueError unless the archive's last bytes are an end record with a list of valid size."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _END.size, 0))
    magic, _, _, _, members, list_bytes, begin, _ = _END.unpack(file.read(_END.size))
    if magic != b"PK\x05\x06" or begin + list_bytes + _END.size != size:
        raise ValueError("its end is missing")
    if members > MOST_MEMBERS or list_bytes > MOST_LIST_BYTES:
        raise ValueError(f"it lists {members:,} arrays in {list_bytes:,} bytes")


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, *, most_bytes: int) -> NDArray[Any]:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
        raise ValueError(f"{member.filename} is compressed in another way")
    with archive.open(member) as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise ValueError(f"{member.filename} is not an array")
        (length,) = struct.unpack("<H", stream.read(2))
        header = _HEADER.fullmatch(stream.read(length).decode("latin-1"))
        if header is None:
            raise ValueError(f"{member.filename} is not an array of numbers")
        dtype = np.dtype(header[1])
        shape = tuple(int(part) for part in header[3].replace(",", " ").split())
        count = math.prod(shape)
        if (size := count * dtype.itemsize) > most_bytes:
            raise ValueError(f"{member.filename} would take {size:,} bytes")
        content = stream.read(size)
        if len(content) != size or stream.read(1):  # the last read compares the check sum
            raise ValueError(f"{member.filename} does not have the length that it states")
    return (
        np.frombuffer(content, dtype)
        .reshape(shape, order="F" if header[2] == "True" else "C")
        .copy(order="K")
    )


# --- the whole scan of a sheet up for review: numbers that are stored as a JPEG ---
#
# The journal's own thread compresses it, so no verdict waits for it. It stores square roots of light, for which a
# camera's noise is about as large in shadows as in paper, so that eight bits are enough for the eye.

NAME: Final = "whole"
TOP: Final = "whole_top"
MOST_PIXELS: Final = 12_000_000
"""Greatest number of pixels of a whole scan: an A3 page at the prototype's pitch. Larger scans are halved
before."""
MOST_BYTES: Final = 16_000_000
"""Greatest size of its JPEG; that of an A4 page takes half a million bytes."""
QUALITY: Final = 85


def packed(evidence: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    """Return evidence with its whole scan compressed.

    The scan, (lines, pixels) uint16 [DN], becomes the bytes of a JPEG, with "whole_top", the DN of its value 255.
    Evidence without a scan, or with one that cannot be compressed, is returned as it is.
    """
    raw = evidence.get(NAME)
    if raw is None or raw.dtype != np.uint16 or raw.ndim != 2 or not raw.size:
        return evidence
    top = max(int(raw.max()), 1)
    eight = np.rint(255 * np.sqrt(np.arange(top + 1) / top)).astype(np.uint8)[raw]
    done, code = cv2.imencode(".jpg", eight, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        return {name: array for name, array in evidence.items() if name != NAME}
    return {**evidence, NAME: code.ravel(), TOP: np.array(float(top))}


def unpacked(evidence: Mapping[str, NDArray[Any]]) -> NDArray[np.float32] | None:
    """Return the whole scan (lines, pixels) [DN] of a sheet's evidence; None: there is none that can be read."""
    code, top = evidence.get(NAME), evidence.get(TOP)
    if code is None or top is None or code.dtype != np.uint8 or code.size > MOST_BYTES or top.size != 1:
        return None
    scale = float(top.ravel()[0])
    if not 0 < scale <= np.iinfo(np.uint16).max:
        return None
    try:
        picture = JpegImageFile(io.BytesIO(code.tobytes()))
        if picture.mode != "L" or picture.width * picture.height > MOST_PIXELS:
            return None
        eight = np.asarray(picture)
    except Exception:  # Pillow raises SyntaxError, OSError, struct.error, ...
        return None
    return np.asarray((np.arange(256, dtype=np.float32) / 255) ** 2 * scale, np.float32)[eight]
