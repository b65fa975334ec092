"""PDF -> pages: what a digital press prints of a PDF, as CMYK rasters.

What is printed is the TrimBox where the page has one, else the CropBox, else the MediaBox, turned by /Rotate and
scaled by /UserUnit; annotations and layers as for printing. Its top-left corner is the corner of pixel (0, 0), and
the raster has round(size * dpi / 72) columns and rows. Nothing is anti-aliased: where a page is drawn at the raster's
own resolution, a pixel is ink or paper. Then letters and lines lie up to half a pixel from where a press of another,
finer resolution prints them. Drawn at a finer ``drawn_dpi`` and taken together, they lie up to half of one of those
pixels from it; drawn at the press's own, where it puts them.

Colour: DeviceCMYK and DeviceGray (to K alone) are printed as they stand; RGB, ICC-based and Lab colours are
converted to the given profile, else to the output intent of the page or document, else to MuPDF's built-in CMYK
(SWOP-like). Overprint (OPM 0 and 1) and spot colours: see ``drawing`` and ``tints``. An image that cannot be decoded
refuses its page; what else is printed otherwise than the file asks is a warning (``pages.warnings``).

Opening and ripping take place in a process of their own, within limits: ``rip_process``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from prooflight.errors import JobError, ProfileError, RequestError
from prooflight.pages.files import check_dpi, page_name
from prooflight.pages.memory import file_head, file_size, file_stamp
from prooflight.pages.pdf import process as rip_process
from prooflight.pages.pdf.facts import DocumentFacts, PageFacts
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH, Page
from prooflight.pages.warnings import PageWarning

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.pdf.engine import RipEngine
    from prooflight.pages.spots.spot_ink import SpotPrint

SWATCHES_A_PAGE: Final = 16
"""Spot colours that are drawn at once to measure their print: no engine draws any number on one page."""
SWATCH_DPI: Final = 72.0
PDF_HEAD_BYTES: Final = 1024
"""Leading bytes that must contain the signature of a PDF (ISO 32000-1, annex H.3.4.1)."""


Box = tuple[float, float, float, float]
"""A rectangle: x, y, width and height on the page as printed. [mm]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageMarks:
    """Marked places of a PDF page."""

    bleed: Box | None
    """BleedBox of the page; None: it has none."""
    layers: tuple[tuple[str, Box], ...]
    """Every layer that shows anything on the page, with its bounding box."""
    annotations: tuple[tuple[tuple[str, ...], Box], ...]
    """Every annotation that is printed, by all its names: its sort, its field's, its title, its subject."""


class PdfJob:
    """A PDF whose pages can be ripped one at a time, by any thread; threads wait for one another."""

    def __init__(
        self,
        path: Path,
        *,
        profile: Path | None = None,
        engine: RipEngine | None = None,
        spots: Sequence[SpotPrint] = (),
    ) -> None:
        """Open a PDF; ``engine`` draws its pages, None: MuPDF; ``spots`` are the press's own spot inks.

        JobError: not a PDF, encrypted, empty, damaged, or PyMuPDF or the engine is missing. ProfileError: not
        a CMYK profile.
        """
        self.path = Path(path)
        self._warnings = dict[PageWarning, None]()
        if find_spec("pymupdf") is None:
            remedy = 'pip install "prooflight[pdf]", or give CMYK TIFF or JPEG files'
            raise JobError(path, "reading a PDF needs PyMuPDF", remedy=remedy)
        if engine is not None and engine.missing:
            raise JobError(path, f"its pages cannot be drawn: {engine.missing}", remedy=engine.remedy)
        self._engine, self._profile, self._spots = engine, profile, tuple(spots)
        self._limits = rip_process.RipLimits.of_environment()
        inks = [[spot.name, spot.mixture] for spot in spots]
        self._request = self._about_file() | self._about_profile(profile) | {"spots": inks}
        self._count = int(self._answer("opening it", do="open")["pages"])

    def _about_file(self) -> dict[str, Any]:
        if b"%PDF-" not in file_head(self.path, JobError, PDF_HEAD_BYTES):
            raise JobError(self.path, "not a PDF", remedy="give a PDF file")
        absolute = str(self.path.absolute())
        return {"path": absolute, "shown": str(self.path), "stamp": file_stamp(self.path)}

    @staticmethod
    def _about_profile(profile: Path | None) -> dict[str, Any]:
        if profile is None:
            return {"profile": None}
        file_size(Path(profile), ProfileError)
        return {"profile": str(Path(profile).absolute()), "shown_profile": str(profile)}

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        rip_process.forget(self._request)

    @property
    def page_sizes_mm(self) -> tuple[tuple[float, float], ...]:
        """Width and height of every page as printed. [mm]"""
        scale = MM_PER_INCH / POINTS_PER_INCH
        sizes = self._answer("measuring its pages", do="sizes")["sizes"]
        return tuple((width * scale, height * scale) for width, height in sizes)

    def page(
        self,
        number: int,
        dpi: float,
        *,
        drawn_dpi: float | None = None,
        light: InkLight | None = None,
        rip: RipModel = UNSTATED,
    ) -> Page:
        """Rip page ``number`` (from 1) at ``dpi``; RequestError if there is none, JobError if it cannot be ripped.

        For ``drawn_dpi`` see the top of this file; None: as ``dpi``. By ``light``, pixels are then
        combined, after shapes were drawn by the parameters of ``rip``.
        """
        check_dpi(self.path, dpi)
        if not 1 <= number <= len(self):
            remedy = f"it has pages 1 to {len(self)}"
            raise RequestError(self.path, f"there is no page {number}", remedy=remedy)
        engine = self._engine
        named = None if engine is None or engine.name == "mupdf" else (engine.name, engine.command)
        how = {"drawn_dpi": drawn_dpi, "light": light, "engine": named, "rip": asdict(rip)}
        cmyk = self._answer(f"page {number}", do="page", number=number, dpi=float(dpi), **how)["cmyk"]
        warnings = tuple(warning for warning in self._warnings if warning.page == number - 1)
        return Page(cmyk=cmyk, dpi=float(dpi), name=page_name(number), number=number, warnings=warnings)

    def picture(self, number: int) -> tuple[NDArray[np.uint8], tuple[float, float]]:
        """Return the scan that page ``number`` (from 1) consists of, and its resolution across and along.

        The scan is (rows, columns, 1 or 3), grey or sRGB, pixel by pixel as it is stored. [pixels/inch]
        JobError: the page cannot be drawn; ScanError: it holds no picture.
        """
        answer = self._answer(f"page {number}", do="picture", number=number)
        across, along = answer["dpi"]
        return answer["cmyk"], (across, along)

    @property
    def warnings(self) -> tuple[PageWarning, ...]:
        """Warnings of the file and of its pages that have been drawn or measured so far."""
        return tuple(self._warnings)

    def facts(self, number: int) -> tuple[PageFacts, dict[str, tuple[int, ...]]]:
        """Return facts of page ``number`` (from 1), and CMYK 0 to 255 of its spot colours as printed, by name.

        Errors as ``page``.
        """
        with tempfile.TemporaryDirectory(prefix="prooflight-") as folder:
            path = Path(folder) / "swatches.pdf"
            answer = self._answer(f"page {number}", do="facts", number=number, swatches=str(path))
            printed: dict[str, tuple[int, ...]] = {}
            if answer["swatches"]:
                with PdfJob(path, profile=self._profile, engine=self._engine, spots=self._spots) as swatches:
                    for first, colours in enumerate(_swatch_colours(swatches)):
                        names = answer["swatches"][first * SWATCHES_A_PAGE :]
                        printed |= dict(zip(names, colours, strict=False))
        return PageFacts.from_plain(answer["facts"]), printed

    def document_facts(self) -> DocumentFacts:
        """Return facts of the whole file; JobError: it is damaged."""
        return DocumentFacts.from_plain(self._answer("reading it", do="document")["facts"])

    def extract(self, numbers: Sequence[int], out: Path) -> None:
        """Write a PDF of these pages, from 1, in this order, one as often as it is named; errors as ``page``."""
        self._answer("taking pages of it", do="extract", numbers=list(numbers), out=str(out.absolute()))

    def marks(self, number: int) -> PageMarks:
        """Return the marked places of page ``number`` (from 1); errors as ``page``."""
        marks = self._answer(f"page {number}", do="marks", number=number)["marks"]
        scale = MM_PER_INCH / POINTS_PER_INCH

        def box(corners: list[float]) -> Box:
            x0, y0, x1, y1 = (scale * one for one in corners)
            return x0, y0, x1 - x0, y1 - y0

        return PageMarks(
            bleed=None if marks["bleed"] is None else box(marks["bleed"]),
            layers=tuple((name, box(corners)) for name, corners in marks["layers"]),
            annotations=tuple((tuple(names), box(corners)) for names, corners in marks["annotations"]),
        )

    def _answer(self, subject: str, **request: Any) -> dict[str, Any]:
        """Return the answer, after its warnings are recorded; JobError names what ``subject`` failed for."""
        try:
            answer = rip_process.ask(self._request | request, self._limits)
        except rip_process.RipFailure as failure:
            raise JobError(self.path, f"{subject} {failure.what}", remedy=failure.remedy) from None
        self._warnings |= dict.fromkeys(PageWarning(**warning) for warning in answer["warnings"])
        return answer


def _swatch_colours(swatches: PdfJob) -> Iterator[list[tuple[int, ...]]]:
    """Yield the CMYK values of the swatches of each page of a file of them."""
    for number in range(1, len(swatches) + 1):
        row = swatches.page(number, SWATCH_DPI).cmyk
        middle, wide = row[row.shape[0] // 2], row.shape[1] / SWATCHES_A_PAGE
        yield [tuple(middle[int((i + 0.5) * wide)].tolist()) for i in range(SWATCHES_A_PAGE)]
