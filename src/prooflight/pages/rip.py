"""PDF -> pages: what a digital press prints of a PDF, as CMYK rasters.

What is printed is the TrimBox where the page has one, else the CropBox, else the MediaBox, turned by /Rotate and
scaled by /UserUnit; annotations and layers as for printing. Its top-left corner is the corner of pixel (0, 0), and
the raster has round(size * dpi / 72) columns and rows. A pixel is ink or paper: nothing is anti-aliased.

Colour: DeviceCMYK and DeviceGray (to K alone) are printed as they stand; RGB, ICC-based and Lab colours are
converted to the given profile, else to the output intent of the page or document, else to MuPDF's built-in CMYK
(SWOP-like). Overprint (OPM 0 and 1) and spot colours: see ``plates``.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from prooflight.errors import JobError, ProfileError, RequestError
from prooflight.pages.files import page_name, refuse_oversize
from prooflight.pages.raster import MM_PER_INCH, Page

if TYPE_CHECKING:
    from collections.abc import Iterator

POINTS_PER_INCH = 72
BYTES_PER_PIXEL = 40  # while drawing; measured: 8 for most pages, 36 with transparency groups five deep
PIXELS_MAX = 2**28 - 1  # four bytes each: beyond 2^30 bytes MuPDF leaves pictures out and only warns
ICC_HEADER_BYTES = 128  # ICC.1:2022, 7.2


def read_profile(path: Path) -> bytes:
    """An ICC profile of CMYK output as its bytes; ProfileError if it is broken or of other colours."""
    from prooflight.pages import plates

    data = path.read_bytes()
    remedy = "give a CMYK output profile (.icc)"
    if len(data) < ICC_HEADER_BYTES or data[36:40] != b"acsp":
        raise ProfileError(path, "not an ICC profile", remedy=remedy)
    if data[16:20] != b"CMYK":
        colours = data[16:20].decode("latin-1").strip()
        raise ProfileError(path, f"the profile is for {colours}, not CMYK", remedy=remedy)
    size = int.from_bytes(data[:4], "big")
    if size != len(data):
        raise ProfileError(
            path, f"{len(data)} bytes where its header says {size}", remedy="copy the profile again"
        )
    try:
        plates.icc_space(data)
    except ValueError:
        raise ProfileError(path, "the profile cannot convert colours to CMYK", remedy=remedy) from None
    return data


class PdfJob:
    """A PDF whose pages can be ripped one at a time. Not for several threads at once: MuPDF's state is global."""

    def __init__(self, path: Path, *, profile: Path | None = None) -> None:
        """JobError: not a PDF, encrypted, empty, damaged, or PyMuPDF is missing. ProfileError: not a CMYK profile."""
        self.path = Path(path)
        self.warnings: list[str] = []
        """What MuPDF had to say about the file so far, one line each."""
        self._mupdf = _pymupdf(self.path)
        self._errors = (RuntimeError, self._mupdf.mupdf.FzErrorBase)
        with self._listening():
            self._profile = None if profile is None else read_profile(Path(profile))
            self._document = self._open()
            self._count = self._pages()

    def _open(self) -> Any:
        with self.path.open("rb") as file:  # OSError for what the system cannot open
            head = file.read(1024)
            file.seek(max(0, file.seek(0, 2) - 1024))
            tail = file.read()
        if b"%PDF-" not in head:  # ISO 32000-1, annex H.3.4.1: within the first 1024 bytes
            raise JobError(self.path, "not a PDF", remedy="give a PDF file")
        try:
            document = self._mupdf.Document(str(self.path), filetype="pdf")
        except self._errors:
            raise JobError(self.path, "the PDF is damaged", remedy="export or copy it again") from None
        if document.needs_pass:
            raise JobError(self.path, "the PDF is encrypted", remedy="save it without a password")
        if document.is_repaired and b"%%EOF" not in tail:
            raise JobError(self.path, "the PDF is truncated", remedy="export or copy it again")
        return document

    def _pages(self) -> int:
        try:
            count = int(self._document.page_count)
        except self._errors:
            raise JobError(self.path, "the PDF is damaged", remedy="export or copy it again") from None
        if count < 1:
            raise JobError(self.path, "the PDF has no pages", remedy="give a job with at least one page")
        return count

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        """MuPDF's messages go to ``warnings``, not to stderr."""
        tools = self._mupdf.TOOLS
        shown = tools.mupdf_display_errors(), tools.mupdf_display_warnings()
        tools.mupdf_display_errors(False)
        tools.mupdf_display_warnings(False)
        tools.reset_mupdf_warnings()
        try:
            yield
        finally:
            self.warnings += [
                line for line in tools.mupdf_warnings().splitlines() if line not in self.warnings
            ]
            tools.mupdf_display_errors(shown[0])
            tools.mupdf_display_warnings(shown[1])

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._document.close()

    @property
    def page_sizes_mm(self) -> tuple[tuple[float, float], ...]:
        """Width and height of every page as printed. [mm]"""
        with self._listening():
            boxes = [self._printed_box(self._load(number)) for number in range(1, len(self) + 1)]
        scale = MM_PER_INCH / POINTS_PER_INCH
        return tuple(((box.x1 - box.x0) * scale, (box.y1 - box.y0) * scale) for box in boxes)

    def _load(self, number: int) -> Any:
        if not 1 <= number <= len(self):
            raise RequestError(
                self.path, f"there is no page {number}", remedy=f"it has pages 1 to {len(self)}"
            )
        mupdf = self._mupdf.mupdf
        try:
            return mupdf.pdf_load_page(mupdf.pdf_document_from_fz_document(self._document), number - 1)
        except self._errors:
            raise self._damaged(number) from None

    def _damaged(self, number: int) -> JobError:
        return JobError(self.path, f"page {number} is damaged", remedy="export or copy the PDF again")

    def _printed_box(self, page: Any) -> Any:
        mupdf = self._mupdf.mupdf
        return mupdf.pdf_bound_page(page, mupdf.FZ_TRIM_BOX)  # MuPDF falls back on CropBox, then MediaBox

    def page(self, number: int, dpi: float) -> Page:
        """Rip page ``number`` (from 1) at ``dpi``; RequestError if there is none, JobError if it cannot be ripped."""
        from prooflight.pages import plates

        if not dpi > 0:
            raise RequestError(self.path, f"a resolution of {dpi} dpi", remedy="give a dpi above 0")
        with self._listening():
            page = self._load(number)
            box, scale = self._printed_box(page), dpi / POINTS_PER_INCH
            shape = (max(1, round((box.y1 - box.y0) * scale)), max(1, round((box.x1 - box.x0) * scale)))
            refuse_oversize(f"{self.path}, page {number}", *shape)
            if shape[0] * shape[1] > PIXELS_MAX:
                what = f"page {number} at {dpi:g} dpi has {shape[0] * shape[1] / 1e6:.0f} megapixels"
                remedy = f"lower the resolution: at most {PIXELS_MAX / 1e6:.0f} can be ripped"
                raise JobError(self.path, what, remedy=remedy)
            ctm = self._mupdf.mupdf.FzMatrix(scale, 0, 0, scale, -box.x0 * scale, -box.y0 * scale)
            try:
                cmyk, troubles = plates.draw(page, ctm, shape, self._profile)
            except self._errors:
                raise self._damaged(number) from None
            except ValueError as error:
                raise JobError(
                    self.path, f"page {number}: {error}", remedy="correct and export it again"
                ) from None
        self.warnings += [f"page {number}: {trouble}" for trouble in troubles]
        return Page(cmyk=cmyk, dpi=float(dpi), name=page_name(number), number=number)


def _pymupdf(path: Path) -> Any:
    try:
        import pymupdf
    except ImportError:
        remedy = 'pip install "prooflight[pdf]", or give CMYK TIFF or JPEG files'
        raise JobError(path, "reading a PDF needs PyMuPDF", remedy=remedy) from None
    return pymupdf
