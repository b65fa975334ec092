"""One PDF read with MuPDF: its pages counted, measured and drawn.

Used only in the process that rips (``rip_worker``): MuPDF's state is global, and a PDF may be made to exhaust
time and memory. It needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pymupdf
from numpy.typing import NDArray
from pymupdf import mupdf

from prooflight.errors import InputError, JobError, ProfileError, RequestError, ScanError
from prooflight.pages.memory import available_bytes, refuse_oversize
from prooflight.pages.pdf import external
from prooflight.pages.pdf.boxes import BoxError, deciding_box, page_marks, printed_box
from prooflight.pages.pdf.colour_management import address
from prooflight.pages.pdf.corrections import AGAIN, PageContents, PrintedLayers, correct_page, open_document
from prooflight.pages.pdf.drawing import PageDrawing, PlateError, edges_of, icc_space, output_intent
from prooflight.pages.pdf.fonts import draw_colours_directly, substituted
from prooflight.pages.pdf.images import SHORT, ImageFault, lost
from prooflight.pages.pdf.resources import shown_name
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel, grown, growth_margin
from prooflight.pages.pdf.tints import TintSpaces
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH
from prooflight.pages.warnings import WHOLE_FILE, PageWarning

if TYPE_CHECKING:
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.pdf.engine import RipEngine
    from prooflight.pages.spots.spot_ink import SpotPrint

BYTES_PER_PIXEL: Final = 40
"""Memory while drawing; measured: 8 for most pages, 36 with transparency groups five deep."""
GROWN_ROWS: Final = 64
"""Rows of a raster whose device pixels grow at once."""
BAND_PIXELS: Final = 2**24
"""Pixels that are drawn at once of a page finer than its raster: a page of A4 at 960 dpi in six bands."""
PIXELS_MAX: Final = 2**28 - 1  # four bytes each: beyond 2^30 bytes MuPDF leaves pictures out and only warns
ICC_HEADER_BYTES: Final = 128  # ICC.1:2022, 7.2
ICC_BYTES_MAX: Final = 64 * 2**20
_OF_COLOURS: Final = re.compile(r"(?i)\bicc\b|colou?r ?space|color conversion")
"""Messages of MuPDF about colours that are not converted as the file requests."""
_NO_NEWS: Final = re.compile(r"^encountered syntax errors; page may not|^\.\.\. repeated|^dropping unclosed")
"""Messages of MuPDF that only accompany another message."""
_NO_MEMORY: Final = re.compile(
    r"alloc \(.*\) failed|(?i:out of|insufficient|not enough) memory|memory allocation"
)


def read_profile(path: Path, shown: str) -> bytes:
    """Return an ICC profile of CMYK output as its bytes; ProfileError if it is broken or of other colours."""
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
        what = f"{len(data)} bytes where its header states {size}"
        raise ProfileError(shown, what, remedy="copy the profile again")
    try:
        icc_space(data)
    except ValueError:
        raise ProfileError(shown, "the profile cannot convert colours to CMYK", remedy=remedy) from None
    return data


class PdfFile:
    """An open PDF."""

    def __init__(
        self, path: Path, shown: str, profile: bytes | None, spots: Sequence[SpotPrint] = ()
    ) -> None:
        """Open a PDF; ``shown`` is its name in errors, ``spots`` are the press's own spot inks.

        JobError: encrypted, empty or damaged; MemoryError: beyond its limit.
        """
        self._path, self._shown, self._profile = path, shown, profile
        self._warnings = dict[PageWarning, None]()
        self._tints, self._contents = TintSpaces(spots), dict[int, PageContents]()
        self._layers: PrintedLayers | None = None
        with self._listening("the PDF is damaged"):
            self._document = open_document(path, shown)
            self.pages = int(self._document.page_count)
        if self.pages < 1:
            raise JobError(shown, "the PDF has no pages", remedy="give a job with at least one page")

    def close(self) -> None:
        """Close the file."""
        self._document.close()

    def warnings(self) -> list[PageWarning]:
        """Return the warnings since the last call, each once, in their order."""
        found, self._warnings = list(self._warnings), {}
        return found

    def sizes_points(self) -> list[tuple[float, float]]:
        """Return width and height of every page as printed; JobError if a page does not state them."""
        with self._listening("the PDF is damaged"):
            boxes = [self._box(self._load(number), number) for number in range(1, self.pages + 1)]
        return [(box.x1 - box.x0, box.y1 - box.y0) for box in boxes]

    def extract(self, numbers: Sequence[int], out: Path) -> None:
        """Write a PDF of these pages, from 1, in this order, one as often as it is named; errors as ``draw``.

        The file must not have been drawn from, which changes it in memory, and is of no further use.
        """
        with self._listening("the PDF is damaged"):
            for number in numbers:
                self._refuse_number(number)
            self._document.select([number - 1 for number in numbers])
            self._document.save(str(out), garbage=3)

    def marks(self, number: int) -> dict[str, Any]:
        """Return the marked places of page ``number`` (``pages.pdf.boxes``); errors as ``draw``."""
        with self._listening(f"page {number} is damaged", number):
            page = self._load(number)
            box = self._box(page, number)
            return page_marks(page, (box.x0, box.y0))

    def picture(
        self, number: int, raster: Callable[[tuple[int, int, int], int], NDArray[np.uint8]]
    ) -> tuple[float, float]:
        """Draw the scan that page ``number`` consists of into ``raster((rows, columns, 1 or 3), pixels)``.

        Each of its pixels becomes one pixel, grey or sRGB; its profile has been applied. The result is the
        resolution across and along [pixels/inch]. Errors as ``draw``; ScanError: the page holds no picture.
        """
        with self._listening(f"page {number} is damaged", number):
            self._refuse_number(number)
            page = self._document[number - 1]
            images = [one for one in page.get_image_info() if not pymupdf.Rect(one["bbox"]).is_empty]
            if not images:
                what = f"page {number} contains no picture, so it is not a scan"
                raise ScanError(self._shown, what, remedy="give scans as PDF, JPEG, PNG or TIFF")
            # Devices cut a scan into strips, or add small pictures: the largest one states the resolution.
            largest = max(images, key=lambda one: one["width"] * one["height"])
            drawn = pymupdf.Matrix(largest["transform"])
            across = largest["width"] / math.hypot(drawn.a, drawn.b)
            along = largest["height"] / math.hypot(drawn.c, drawn.d)
            if abs(drawn.b) > abs(drawn.a):  # the page is turned by a quarter
                across, along = along, across
            rows, columns = round(page.rect.height * along), round(page.rect.width * across)
            if min(rows, columns) < 1:
                what = f"page {number} is {columns} x {rows} pixels"
                raise ScanError(self._shown, what, remedy="scan the page again")
            self._refuse_oversize(
                number, POINTS_PER_INCH * max(across, along), rows, columns, drawn=rows * columns
            )
            grey = all(one["colorspace"] <= 1 for one in images)
            out = raster((rows, columns, 1 if grey else 3), rows * columns)
            seen = page.get_pixmap(
                matrix=pymupdf.Matrix(columns / page.rect.width, rows / page.rect.height),
                colorspace=pymupdf.csGRAY if grey else pymupdf.csRGB,
                alpha=False,
                annots=False,
            )
            samples = np.frombuffer(seen.samples_mv, np.uint8).reshape(seen.h, seen.stride)
            high, wide = min(rows, seen.h), min(columns, seen.w)
            out[:] = 255
            out[:high, :wide] = samples[:high, : wide * seen.n].reshape(high, wide, seen.n)
        return POINTS_PER_INCH * across, POINTS_PER_INCH * along

    def facts(self, number: int, swatches: Path) -> dict[str, Any]:
        """Return facts of page ``number`` (``page_facts``), as long as nothing has been drawn; errors as ``draw``.

        A PDF of its spot colours is written to ``swatches``; "swatches" of the result names them.
        """
        from prooflight.pages.pdf.page_facts import page_facts, write_swatches

        with self._listening(f"page {number} is damaged", number):
            page = self._load(number)
            printed = deciding_box(page)
            self._box(page, number)
            named = write_swatches(page, swatches)
            return {"facts": page_facts(page, printed), "swatches": named}

    def document_facts(self) -> dict[str, Any]:
        """Return facts of the whole file (``document_facts``); JobError: it is damaged."""
        from prooflight.pages.pdf.page_facts import document_facts

        with self._listening("the PDF is damaged"):
            return document_facts(self._pdf())

    def draw(
        self,
        number: int,
        dpi: float,
        raster: Callable[[tuple[int, int, int], int], NDArray[np.uint8]],
        *,
        drawn_dpi: float | None = None,
        light: InkLight | None = None,
        rip: RipModel = UNSTATED,
    ) -> NDArray[np.uint8]:
        """Draw page ``number`` into the empty array that ``raster`` gives for its shape, (rows, columns, 4).

        The second argument of ``raster`` is the number of pixels drawn at once. With ``drawn_dpi``, the page
        is drawn at another resolution than its raster's, by the parameters of ``rip``, and ``area_averaged`` by
        ``light``. RequestError:
        there is no such page; JobError: it cannot be ripped; MemoryError: not within its limit.
        """
        with self._listening(f"page {number} is damaged", number):
            contents = self._corrected(number)
            page = self._load(number)
            box, scale = self._box(page, number), dpi / POINTS_PER_INCH
            rows, columns = (max(1, round(side * scale)) for side in (box.y1 - box.y0, box.x1 - box.x0))
            step = 1.0 if drawn_dpi is None else drawn_dpi / dpi
            # The first pixel of the device's grid covers the page's corner, and begins so far before it.
            by_grid = (0.0, 0.0) if drawn_dpi is None else rip.offset_pixels(drawn_dpi)
            left, lag = ((1.0 - pixels) % 1.0 for pixels in by_grid)
            growth = UNSTATED.growth_pixels(1.0) if drawn_dpi is None else rip.growth_pixels(drawn_dpi)
            margin = growth_margin(growth)
            edges = edges_of(UNSTATED if drawn_dpi is None else rip, step * dpi)
            wide = columns if drawn_dpi is None else math.ceil(columns * step + left)
            band_rows = rows if drawn_dpi is None else max(min(int(BAND_PIXELS / step / wide), rows), 1)
            fine_rows = math.ceil(band_rows * step + lag) + 1 + 2 * margin
            drawn = fine_rows * wide
            self._refuse_oversize(number, dpi, rows, columns, drawn=drawn)
            cmyk = raster((rows, columns, 4), drawn)
            drawing = self._drawing(page, number, contents)
            drawn_on = None if drawn_dpi is None else np.empty((fine_rows, wide, 4), np.uint8)
            for top in range(0, rows, band_rows):
                band = cmyk[top : top + band_rows]
                above = math.floor(top * step + lag) - margin
                high = math.ceil((top + len(band)) * step + lag) + margin - above
                fine = band
                if drawn_on is not None:
                    fine = drawn_on[:high]
                    fine.fill(0)
                by = step * scale
                draw_colours_directly(self._pdf(), contents.fonts)
                ctm = mupdf.FzMatrix(by, 0, 0, by, left - box.x0 * by, lag - box.y0 * by - above)
                drawing.draw(ctm, fine, edges, samples=rip.samples)
                self._refuse_faults(number, drawing.observed.faults, contents, (box.x0, box.y0))
                if drawn_dpi is not None:
                    from prooflight.pages.pdf.area_averages import area_averaged  # loads the compiler

                    fine = grown(fine, growth, light)
                    area_averaged(fine, band, light, step=step, first=top * step + lag - above, left=left)
            self._warn_of(number, drawing, contents)
        return cmyk

    def draw_by(
        self,
        engine: RipEngine,
        folder: Path,
        number: int,
        dpi: float,
        raster: Callable[[tuple[int, int, int], int], NDArray[np.uint8]],
        *,
        room_bytes: float,
        drawn_dpi: float | None = None,
        light: InkLight | None = None,
        rip: RipModel = UNSTATED,
    ) -> NDArray[np.uint8]:
        """Draw page ``number`` by another engine, at once and not in bands; otherwise as ``draw``.

        ``folder`` is where the engine writes. ``room_bytes`` is the memory that it may take in addition to
        its raster. Of ``rip`` only growth is applied: the engine fills pixels by its own rule.
        """
        with self._listening(f"page {number} is damaged", number):
            page = self._load(number)
            box, media = self._box(page, number), mupdf.pdf_bound_page(page, mupdf.FZ_MEDIA_BOX)
            rows, columns = external.pixels_of((box.x1 - box.x0, box.y1 - box.y0), dpi)
            step = 1.0 if drawn_dpi is None else drawn_dpi / dpi
            high, wide = math.ceil(rows * step), math.ceil(columns * step)
            intent = b"" if self._profile is not None else output_intent(page)
            profile = self._profile or (intent if intent[16:20] == b"CMYK" else b"")
            page_to_draw = external.PageToDraw(
                pdf=self._path,
                shown=self._shown,
                number=number,
                left_points=box.x0 - media.x0,
                below_points=media.y1 - box.y0,
                dpi=dpi * step,
                columns=wide,
                rows=high,
                profile=profile,
            )
        equivalent = (
            high * wide * 4 // BYTES_PER_PIXEL
        )  # as many pixels as take so much memory while MuPDF draws
        self._refuse_oversize(number, dpi, rows, columns, drawn=equivalent)
        cmyk = raster((rows, columns, 4), equivalent)
        drawn = external.draw(page_to_draw, engine, folder, room_bytes=room_bytes)
        if drawn_dpi is None:
            cmyk[:] = drawn.cmyk
        else:
            _grown_averages(drawn.cmyk, cmyk, light, step=step, growth=rip.growth_pixels(drawn_dpi))
        self._warnings |= dict.fromkeys(drawn.warnings)
        return cmyk

    def _corrected(self, number: int) -> PageContents:
        """Correct a page before it is loaded, and return what it uses."""
        self._refuse_number(number)
        if number not in self._contents:
            document = self._pdf()
            self._layers = self._layers or PrintedLayers(document)
            page = mupdf.pdf_lookup_page_obj(document, number - 1)
            self._contents[number] = correct_page(page, self._tints, self._layers)
        return self._contents[number]

    def _drawing(self, page: Any, number: int, contents: PageContents) -> PageDrawing:
        try:
            return PageDrawing(
                page, self._profile, self._tints, contents.tinted, text_knockout=contents.text_knockout
            )
        except PlateError as error:
            what = f"page {number}: {error}"
            raise JobError(self._shown, what, remedy="correct and export it again") from None

    def _refuse_faults(
        self, number: int, faults: list[ImageFault], contents: PageContents, corner: tuple[float, float]
    ) -> None:
        """Raise JobError if an image of the page, or any other stream that it is drawn with, cannot be decoded.

        ``corner`` is the corner of the printed part. [points]
        """
        messages = lost()
        if messages and not faults:
            mupdf.fz_empty_store()
            what = f"page {number}: its content, a form, a glyph or an image cannot be decoded ({messages})"
            raise JobError(self._shown, what, remedy="export the page again")
        if not faults:
            return
        places = [self._image_place(fault, contents, corner) for fault in faults]
        mupdf.fz_empty_store()  # MuPDF keeps what it drew, and would say nothing the next time
        undecodable = [
            (fault, place)
            for fault, place in zip(faults, places, strict=True)
            if messages or not fault.only_short
        ]
        if undecodable:
            fault, place = undecodable[0]
            more = f", and {len(undecodable) - 1} more" if len(undecodable) > 1 else ""
            reason = messages if fault.only_short else fault.reason
            what = f"page {number}: {place}{more}, cannot be decoded ({reason})"
            raise JobError(
                self._shown, what, remedy="replace it by an intact image, and export the page again"
            )
        for place in places:
            message = f"{place}, lacks its last samples, which print as 0: export it again"
            self._warn(number - 1, "image-short", [message])
        faults.clear()

    def _image_place(self, fault: ImageFault, contents: PageContents, corner: tuple[float, float]) -> str:
        """Describe an image and its position."""
        x0, y0, x1, y1 = (MM_PER_INCH / POINTS_PER_INCH * value for value in fault.box)
        x, y = (MM_PER_INCH / POINTS_PER_INCH * value for value in corner)
        name = self._image_name(fault.image, contents)
        return f"{name}, {x1 - x0:.0f} x {y1 - y0:.0f} mm at {x0 - x:.0f}, {y0 - y:.0f} mm from the top left"

    def _image_name(self, image: Any, contents: PageContents) -> str:
        for resource in contents.images:
            loaded = mupdf.pdf_load_image(self._pdf(), mupdf.pdf_dict_get(resource.holder, resource.key))
            mask = loaded.m_internal.mask
            if address(image.m_internal) in (address(loaded.m_internal), address(mask)):
                number = mupdf.pdf_to_num(mupdf.pdf_dict_get(resource.holder, resource.key))
                return f"image {shown_name(resource.name)} (object {number})"
        return "an inline image"

    def _warn_of(self, number: int, drawing: PageDrawing, contents: PageContents) -> None:
        """Add the warnings about the fonts, colours and images of a page, after it is drawn."""
        observed = drawing.observed
        self._warn(number - 1, "renderer", observed.troubles)
        self._warn(number - 1, "colour-space", drawing.inks.troubles)
        for name in substituted(self._pdf(), contents.fonts, observed.fonts):
            message = f"the font {name} is not embedded, and another is drawn in its place: embed it"
            self._warn(number - 1, "font-substituted", [message], name)
        for font, letter in observed.fonts.missing:
            message = f"the font {font} has no glyph for {letter}: embed a font that has"
            self._warn(number - 1, "glyph-missing", [message], font)
        for name in contents.transfers:
            message = f"the transfer function of graphics state {name} is ignored: apply it to the colours"
            self._warn(number - 1, "transfer-function", [message], name)
        if observed.separated:
            message = (
                "its transparency blends in other colours than the press's inks: CMYK is separated again"
            )
            self._warn(number - 1, "page-group", [message])

    def _pdf(self) -> Any:
        return mupdf.pdf_document_from_fz_document(self._document)

    def _refuse_number(self, number: int) -> None:
        if not 1 <= number <= self.pages:
            remedy = f"it has pages 1 to {self.pages}"
            raise RequestError(self._shown, f"there is no page {number}", remedy=remedy)

    def _load(self, number: int) -> Any:
        self._refuse_number(number)
        return mupdf.pdf_load_page(self._pdf(), number - 1)

    def _box(self, page: Any, number: int) -> Any:
        try:
            box, passed_over = printed_box(page)
        except BoxError as error:
            what = f"page {number} {error}"
            raise JobError(self._shown, what, remedy="correct and export it again") from None
        self._warn(number - 1, "box", passed_over)
        return box

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
        """Turn MuPDF's messages into warnings of page ``number``, and its errors into a JobError.

        MemoryError: it lacked memory, even if it went on without what it could not draw.
        """
        tools = pymupdf.TOOLS
        tools.mupdf_display_errors(False)
        tools.mupdf_display_warnings(False)
        mupdf.fz_flush_warnings()  # else one that was the last before is not repeated
        tools.reset_mupdf_warnings()
        try:
            yield
        except (InputError, MemoryError):
            raise
        except Exception as error:  # beside MuPDF's, what becomes of its errors if their text is not UTF-8
            self._take_in(number - 1, tools.mupdf_warnings(), str(error))
            raise JobError(self._shown, damage, remedy=AGAIN) from None
        self._take_in(number - 1, tools.mupdf_warnings(), "")

    def _take_in(self, page: int, messages: str, raised: str) -> None:
        earlier = (warning.message for warning in self._warnings)
        if any(_NO_MEMORY.search(text) for text in (messages, raised, *earlier)):
            raise MemoryError
        for message in messages.splitlines():
            if message == SHORT or _NO_NEWS.search(message):  # said better by the image's own warning
                continue
            of_colours = bool(_OF_COLOURS.search(message))
            what = (
                "a colour space cannot be used, and another is used instead"
                if of_colours
                else "parts may be missing"
            )
            kind = "colour-space" if of_colours else "renderer"
            self._warn(page, kind, [f"{what} (MuPDF: '{message}'): correct it, and export it again"])

    def _warn(self, page: int, kind: str, messages: Iterable[str], name: str = "") -> None:
        for message in messages:
            self._warnings[PageWarning(page=page, kind=kind, message=message, object_name=name)] = None


def _grown_averages(
    fine: NDArray[np.uint8],
    cmyk: NDArray[np.uint8],
    light: InkLight | None,
    *,
    step: float,
    growth: tuple[float, float, float, float],
) -> None:
    """Take a whole page's device pixels together after their growth, in bands: copies of all would not fit."""
    from prooflight.pages.pdf.area_averages import area_averaged  # loads the compiler

    if not any(growth):
        area_averaged(fine, cmyk, light, step=step)
        return
    margin = growth_margin(growth)
    for top in range(0, len(cmyk), GROWN_ROWS):
        band = cmyk[top : top + GROWN_ROWS]
        above = max(math.floor(top * step) - margin, 0)
        below = math.ceil((top + len(band)) * step) + margin
        wider = grown(fine[above:below], growth, light)
        area_averaged(wider, band, light, step=step, first=top * step - above)
