"""One PDF read with MuPDF: its pages counted, measured and drawn.

Used in the process that rips (``rip_worker``) alone: MuPDF's state is global, and a PDF may be made to exhaust time and
memory. It needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
import math
import re
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np
import pymupdf
from pymupdf import mupdf

from prooflight.errors import InputError, JobError, ProfileError, RequestError
from prooflight.pages.memory import available_bytes, refuse_oversize
from prooflight.pages.pdf import separations as plates
from prooflight.pages.pdf.boxes import BoxError, printed_box
from prooflight.pages.pdf.marks import page_marks
from prooflight.pages.raster import POINTS_PER_INCH
from prooflight.pages.warnings import WHOLE_FILE, PageWarning

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.pdf.taking_together import InkLight

BYTES_PER_PIXEL: Final = 40
"""While drawing; measured: 8 for most pages, 36 with transparency groups five deep."""
BAND_PIXELS: Final = 2**24
"""Of a page that is drawn finer than its raster: so many at once, a page of A4 at 960 dpi in six bands."""
PIXELS_MAX: Final = 2**28 - 1  # four bytes each: beyond 2^30 bytes MuPDF leaves pictures out and only warns
ICC_HEADER_BYTES: Final = 128  # ICC.1:2022, 7.2
ICC_BYTES_MAX: Final = 64 * 2**20
_AGAIN: Final = "export or copy it again"
_NO_MEMORY: Final = re.compile(
    r"alloc \(.*\) failed|(?i:out of|insufficient|not enough) memory|memory allocation"
)


def read_profile(path: Path, shown: str) -> bytes:
    """An ICC profile of CMYK output as its bytes; ProfileError if it is broken or of other colours."""
    with path.open("rb") as file:
        data = file.read(ICC_BYTES_MAX)
    remedy = "give a CMYK output profile (.icc)"
    if len(data) < ICC_HEADER_BYTES or data[36:40] != b"acsp":
        raise ProfileError(shown, "not an ICC profile", remedy=remedy)
    if data[16:20] != b"CMYK":
        colours = data[16:20].decode("latin-1").strip()
        raise ProfileError(shown, f"the profile is for {colours}, not CMYK", remedy=remedy)
    size = int.from_bytes(data[:4], "big")
    if size != len(data):
        what = f"{len(data)} bytes where its header says {size}"
        raise ProfileError(shown, what, remedy="copy the profile again")
    try:
        plates.icc_space(data)
    except ValueError:
        raise ProfileError(shown, "the profile cannot convert colours to CMYK", remedy=remedy) from None
    return data


class PdfFile:
    """An open PDF."""

    def __init__(self, path: Path, shown: str, profile: bytes | None) -> None:
        """``shown``: how errors name it. JobError: encrypted, empty or damaged; MemoryError: beyond its limit."""
        self._shown, self._profile = shown, profile
        self._warnings = dict[PageWarning, None]()
        with self._listening("the PDF is damaged"):
            self._document = self._open(path)
            self.pages = int(self._document.page_count)
        if self.pages < 1:
            raise JobError(shown, "the PDF has no pages", remedy="give a job with at least one page")

    def _open(self, path: Path) -> Any:
        with path.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - 1024))
            tail = file.read()
            document = pymupdf.Document(_name_for_mupdf(path, file), filetype="pdf")
        if document.needs_pass:
            raise JobError(self._shown, "the PDF is encrypted", remedy="save it without a password")
        if document.is_repaired and b"%%EOF" not in tail:
            raise JobError(self._shown, "the PDF is truncated", remedy=_AGAIN)
        return document

    def close(self) -> None:
        """Let go of the file."""
        self._document.close()

    def warnings(self) -> list[PageWarning]:
        """Warnings since this was last called, each once, in their order."""
        found, self._warnings = list(self._warnings), {}
        return found

    def sizes_points(self) -> list[tuple[float, float]]:
        """Width and height of every page as printed. JobError: a page does not say."""
        with self._listening("the PDF is damaged"):
            boxes = [self._box(self._load(number), number) for number in range(1, self.pages + 1)]
        return [(box.x1 - box.x0, box.y1 - box.y0) for box in boxes]

    def marks(self, number: int) -> dict[str, Any]:
        """What page ``number`` says of its own places (``pages.pdf.marks``); errors as ``draw``."""
        with self._listening(f"page {number} is damaged", number):
            page = self._load(number)
            box = self._box(page, number)
            return page_marks(page, (box.x0, box.y0))

    def draw(
        self,
        number: int,
        dpi: float,
        raster: Callable[[tuple[int, int, int], int], NDArray[np.uint8]],
        *,
        drawn_dpi: float | None = None,
        light: InkLight | None = None,
    ) -> NDArray[np.uint8]:
        """Draw page ``number`` into the empty array that ``raster`` gives for its shape, (rows, columns, 4).

        raster: is also told how many pixels are drawn at once. drawn_dpi: drawn at another resolution than its
        raster's, and ``taken_together`` by ``light``. RequestError: there is no such page; JobError: it cannot be
        ripped; MemoryError: not within its limit.
        """
        with self._listening(f"page {number} is damaged", number):
            page = self._load(number)
            box, scale = self._box(page, number), dpi / POINTS_PER_INCH
            rows, columns = (max(1, round(side * scale)) for side in (box.y1 - box.y0, box.x1 - box.x0))
            step = 1.0 if drawn_dpi is None else drawn_dpi / dpi
            wide = columns if drawn_dpi is None else math.ceil(columns * step)
            band_rows = rows if drawn_dpi is None else max(min(int(BAND_PIXELS / step / wide), rows), 1)
            fine_rows = math.ceil(band_rows * step) + 1
            drawn = fine_rows * wide
            self._refuse_oversize(number, dpi, rows, columns, drawn=drawn)
            cmyk = raster((rows, columns, 4), drawn)
            troubles = dict[str, None]()
            drawn_on = None if drawn_dpi is None else np.empty((fine_rows, wide, 4), np.uint8)
            for top in range(0, rows, band_rows):
                band = cmyk[top : top + band_rows]
                above = math.floor(top * step)
                high = math.ceil((top + len(band)) * step) - above
                fine = band
                if drawn_on is not None:
                    fine = drawn_on[:high]
                    fine.fill(0)
                by = step * scale
                ctm = mupdf.FzMatrix(by, 0, 0, by, -box.x0 * by, -box.y0 * by - above)
                try:
                    troubles |= dict.fromkeys(plates.draw(page, ctm, fine, self._profile))
                except plates.PlateError as error:
                    what = f"page {number}: {error}"
                    raise JobError(self._shown, what, remedy="correct and export it again") from None
                if drawn_dpi is not None:
                    from prooflight.pages.pdf.taking_together import taken_together  # loads the compiler

                    taken_together(fine, band, light, step=step, first=top * step - above)
            self._warn(number - 1, troubles)
        return cmyk

    def _load(self, number: int) -> Any:
        if not 1 <= number <= self.pages:
            remedy = f"it has pages 1 to {self.pages}"
            raise RequestError(self._shown, f"there is no page {number}", remedy=remedy)
        return mupdf.pdf_load_page(mupdf.pdf_document_from_fz_document(self._document), number - 1)

    def _box(self, page: Any, number: int) -> Any:
        try:
            return printed_box(page)
        except BoxError as error:
            what = f"page {number} {error}"
            raise JobError(self._shown, what, remedy="correct and export it again") from None

    def _refuse_oversize(self, number: int, dpi: float, rows: int, columns: int, *, drawn: int) -> None:
        refuse_oversize(f"{self._shown}, page {number}", rows, columns)
        if rows * columns > PIXELS_MAX:
            what = f"page {number} at {dpi:g} dpi has {rows * columns / 1e6:.0f} megapixels"
            remedy = f"lower the resolution: at most {PIXELS_MAX / 1e6:.0f} can be ripped"
            raise JobError(self._shown, what, remedy=remedy)
        needed, free = max(rows * columns * 4, drawn * BYTES_PER_PIXEL), available_bytes()
        if needed > free:
            what = f"page {number}, {columns} x {rows} pixels, needs {needed / 1e9:.1f} GB"
            raise JobError(
                self._shown, what, remedy=f"{free / 1e9:.1f} GB of memory are free: lower the resolution"
            )

    @contextlib.contextmanager
    def _listening(self, damage: str, number: int = WHOLE_FILE + 1) -> Iterator[None]:
        """MuPDF's messages become warnings of page ``number``; what it raises is raised as a JobError.

        MemoryError: it lacked memory, even where it went on without what it could not draw.
        """
        tools = pymupdf.TOOLS
        tools.mupdf_display_errors(False)
        tools.mupdf_display_warnings(False)
        tools.reset_mupdf_warnings()
        try:
            yield
        except (InputError, MemoryError):
            raise
        except Exception as error:  # beside MuPDF's, what becomes of its errors if their text is not UTF-8
            self._take_in(number - 1, tools.mupdf_warnings(), str(error))
            raise JobError(self._shown, damage, remedy=_AGAIN) from None
        self._take_in(number - 1, tools.mupdf_warnings(), "")

    def _take_in(self, page: int, messages: str, raised: str) -> None:
        earlier = (warning.message for warning in self._warnings)
        if any(_NO_MEMORY.search(text) for text in (messages, raised, *earlier)):
            raise MemoryError
        self._warn(page, messages.splitlines())

    def _warn(self, page: int, messages: Iterable[str]) -> None:
        for message in messages:
            self._warnings[PageWarning(page=page, kind="renderer", message=message)] = None


def _name_for_mupdf(path: Path, file: BinaryIO) -> str:
    """MuPDF takes names as UTF-8, which files need not have."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return f"/dev/fd/{file.fileno()}"
    return str(path)
