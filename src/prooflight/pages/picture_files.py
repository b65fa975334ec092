"""PNG and JPEG files, opened with their size checked before they are decoded.

Not Pillow's Image.open: its guard against large images is below what an A3 page at 1200 dpi needs, and it
warns on stderr; and it would try some forty other formats.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile

from prooflight.errors import InputError
from prooflight.pages.memory import file_size, refuse_unaffordable

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

BAND_ROWS: Final = 64
JPEG_MAGIC: Final = b"\xff\xd8\xff"
PNG_MAGIC: Final = b"\x89PNG\r\n\x1a\n"
SCANS_MAX: Final = 100
"""Largest number of passes over the image: programs write ten or so, and each takes as long as decoding it
once."""
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_ALONE: Final = frozenset({0x01, 0xD8, *range(0xD0, 0xD8)})  # markers without a length
_END, _SCAN = 0xD9, 0xDA


@contextlib.contextmanager
def opened_picture(
    path: Path, refused: type[InputError], *, bytes_per_sample: float, remedy: str
) -> Iterator[ImageFile]:
    """Open a PNG or JPEG without decoding it; all errors inside the context are raised as ``refused``.

    ``bytes_per_sample`` is the peak memory of reading. OSError: the system cannot open the file.
    """
    size = file_size(path, refused)
    with path.open("rb") as file:
        head = file.read(len(PNG_MAGIC))
        if not head.startswith((JPEG_MAGIC, PNG_MAGIC)):
            raise refused(path, "is neither JPEG nor PNG", remedy=remedy)
        try:
            file.seek(0)
            if head != PNG_MAGIC:
                frame(file.read())
                file.seek(0)
            image = (PngImageFile if head == PNG_MAGIC else JpegImageFile)(file)
            shown = f"{image.width} x {image.height} pixels"
            channels = 3 if image.mode == "P" else len(image.getbands())
            needed = image.width * image.height * channels * bytes_per_sample
            refuse_unaffordable(refused, path, shown, needed_bytes=needed, file_bytes=size)
            yield image
        except InputError:
            raise
        except Exception as error:  # Pillow raises SyntaxError, OSError, struct.error, ...
            raise refused(path, f"the picture cannot be read ({error})", remedy=remedy) from None


def bands(image: ImageFile, *, mode: str | None = None) -> Iterator[tuple[slice, NDArray[Any]]]:
    """Yield rows of a picture from the top, some at a time, as (rows, columns, channels).

    ``mode`` is the mode of Pillow to convert to; None: its own.
    """
    image.load()
    for top in range(0, image.height, BAND_ROWS):
        bottom = min(top + BAND_ROWS, image.height)
        part = image.crop((0, top, image.width, bottom))
        samples = np.asarray(part if mode is None else part.convert(mode))
        yield slice(top, bottom), samples.reshape(bottom - top, image.width, -1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Size of a JPEG image."""

    rows: int
    columns: int
    components: int


def frame(data: bytes) -> Frame:
    """Return the frame of a JPEG stream (ITU-T T.81, annex B), read before it is decoded.

    ValueError: it has none, or more passes than ``SCANS_MAX``.
    """
    scans = data.count(b"\xff\xda")  # within a pass, FF is always followed by 00 or a restart
    if scans > SCANS_MAX:
        message = f"it is stored in {scans} passes"
        raise ValueError(message)
    place = 0
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            break
        marker = data[place + 1]
        if marker == 0xFF or marker in _ALONE:
            place += 1 if marker == 0xFF else 2
            continue
        if marker in (_END, _SCAN):
            break
        (length,) = struct.unpack_from(">H", data, place + 2)
        if marker in _FRAMES and place + 10 <= len(data):
            rows, columns, components = struct.unpack_from(">HHB", data, place + 5)
            return Frame(rows=rows, columns=columns, components=components)
        place += 2 + length
    message = "it does not state its size"
    raise ValueError(message)
