"""PNG and JPEG files, opened with their size checked before they are decoded.

Not Pillow's Image.open: its guard against large images is below what an A3 page at 1200 dpi needs, and it
warns on stderr; and it would try some forty other formats.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile

from prooflight.errors import InputError
from prooflight.pages import jpeg_frames
from prooflight.pages.memory import file_size, refuse_unaffordable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from PIL.ImageFile import ImageFile

BAND_ROWS: Final = 64
JPEG_MAGIC: Final = b"\xff\xd8\xff"
PNG_MAGIC: Final = b"\x89PNG\r\n\x1a\n"


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
                jpeg_frames.frame(file.read())
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
