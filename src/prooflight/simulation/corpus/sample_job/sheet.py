"""Page to draw on in millimetres."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from reportlab.lib.colors import CMYKColor
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfdoc
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Frame, Paragraph

from prooflight.simulation.corpus.sample_job import faces, inks
from prooflight.simulation.corpus.sample_job.pictures import PIXEL_MM

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.inks import Ink


WIDTH_MM, HEIGHT_MM = 210.0, 297.0  # A4, ISO 216
LEFT_MM, RIGHT_MM = 20.0, 190.0
TOP_MM, BOTTOM_MM = 22.0, 277.0
GUTTER_MM = 4.0
COLUMNS = 6
_NUDGE_MM = 0.0003
"""Distance of everything to the right of and below the 0.1 mm grid; pictures end as much before it.

A PDF states places to a ten-thousandth of a point, and a RIP that counts whole pixels must not see an edge
just short of one.
"""
COLUMN_MM = (RIGHT_MM - LEFT_MM - (COLUMNS - 1) * GUTTER_MM) / COLUMNS  # 25 mm


def column(first: int, count: int = 1) -> tuple[float, float]:
    """Return left edge and width of ``count`` grid columns from the ``first`` (0 to 5). [mm]"""
    pitch = COLUMN_MM + GUTTER_MM
    return LEFT_MM + first * pitch, count * pitch - GUTTER_MM


def halves() -> tuple[tuple[float, float], tuple[float, float]]:
    """Return left edge and width of two text columns, with twice the gutter between them. [mm]"""
    (left, width), (right, _) = column(0, 3), column(3, 3)
    inset = GUTTER_MM / 2
    return (left, width - inset), (right + inset, width - inset)


class Sheet:
    """Job being drawn, one A4 page after another.

    (0, 0) is the page's top-left corner, x to the right, y down. [mm]
    """

    def __init__(self, path: Path, title: str) -> None:
        faces.register()
        self.canvas = Canvas(
            str(path),
            pagesize=(WIDTH_MM * mm, HEIGHT_MM * mm),
            invariant=1,
            pageCompression=1,
            enforceColorSpace=_only_cmyk,
            initialFontName=faces.SERIF,
        )
        self.canvas.setTitle(title)
        self.titles: list[str] = []

    @property
    def number(self) -> int:
        """Return the number of the page being drawn, from 1."""
        return len(self.titles)

    def begin(self, title: str) -> None:
        """Start the next page; the one before is finished."""
        if self.titles:
            self.canvas.showPage()
        self.titles.append(title)
        self.canvas.bookmarkPage(f"p{self.number}")
        self.canvas.addOutlineEntry(title, f"p{self.number}", 0)
        self.canvas.translate(_NUDGE_MM * mm, -_NUDGE_MM * mm)
        self.canvas.setFillColor(inks.colour(inks.BLACK))
        self.canvas.setStrokeColor(inks.colour(inks.BLACK))

    def finish(self) -> None:
        """Write the file."""
        self.canvas.showPage()
        self.canvas.save()

    def rect(self, x: float, y: float, width: float, height: float, ink: Ink) -> None:
        """Draw a flat."""
        self.canvas.setFillColor(inks.colour(ink))
        self.canvas.rect(x * mm, _up(y + height), width * mm, height * mm, stroke=0, fill=1)

    def spot(self, x: float, y: float, width: float, height: float, fifths: int) -> None:
        """Draw a flat in the spot colour at ``fifths`` / 5 of its full tint."""
        self.canvas.setFillColor(inks.spot_colour(fifths))
        self.canvas.rect(x * mm, _up(y + height), width * mm, height * mm, stroke=0, fill=1)

    @contextmanager
    def overprinting(self) -> Iterator[None]:
        """Let inks of zero leave what lies below as it is (PDF overprint mode 1)."""
        self.canvas.saveState()
        self.canvas.setOverprintMask(1)
        self.canvas.setFillOverprint(True)
        yield
        self.canvas.restoreState()

    def outline(
        self, x: float, y: float, width: float, height: float, ink: Ink, width_pt: float = 0.5
    ) -> None:
        """Draw a frame, its line centred on the edge."""
        self.canvas.setStrokeColor(inks.colour(ink))
        self.canvas.setLineWidth(width_pt)
        self.canvas.rect(x * mm, _up(y + height), width * mm, height * mm, stroke=1, fill=0)

    def rule(
        self, x: float, y: float, to_x: float, to_y: float, ink: Ink = inks.BLACK, width_pt: float = 0.5
    ) -> None:
        """Draw a straight line."""
        self.canvas.setStrokeColor(inks.colour(ink))
        self.canvas.setLineWidth(width_pt)
        self.canvas.line(x * mm, _up(y), to_x * mm, _up(to_y))

    def circle(self, x: float, y: float, radius: float, ink: Ink) -> None:
        """Draw a filled disc around (x, y)."""
        self.canvas.setFillColor(inks.colour(ink))
        self.canvas.circle(x * mm, _up(y), radius * mm, stroke=0, fill=1)

    def path(self, points: Sequence[tuple[float, float]], *, closed: bool = True) -> Any:
        """Return a reportlab path through points, for ``canvas.drawPath``."""
        path = self.canvas.beginPath()
        path.moveTo(points[0][0] * mm, _up(points[0][1]))
        for x, y in points[1:]:
            path.lineTo(x * mm, _up(y))
        if closed:
            path.close()
        return path

    def polygon(self, points: Sequence[tuple[float, float]], ink: Ink) -> None:
        """Draw a filled polygon."""
        self.canvas.setFillColor(inks.colour(ink))
        self.canvas.drawPath(self.path(points), stroke=0, fill=1)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        face: str = faces.SERIF,
        size_pt: float = 10.6,
        *,
        ink: Ink = inks.BLACK,
        align: str = "left",
        spread_pt: float = 0.0,
    ) -> None:
        """Set one line with its baseline at y; ``spread_pt`` is added after each letter but the last."""
        width = faces.width_pt(text, face, size_pt) + spread_pt * (len(text) - 1)
        start = x * mm - {"left": 0.0, "centre": width / 2, "right": width}[align]
        line = self.canvas.beginText(start, _up(y))
        line.setFont(face, size_pt)
        line.setFillColor(inks.colour(ink))
        line.setCharSpace(spread_pt)
        line.textOut(text)
        line.setCharSpace(0)
        self.canvas.drawText(line)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the same point in PDF's coordinates, for direct use of ``canvas``. [pt]"""
        return float(x * mm), _up(y)

    def label(self, x: float, y: float, text: str, *, ink: Ink = inks.GREY, align: str = "left") -> None:
        """Set a small spaced line of capitals above the object that it names."""
        self.text(x, y, text.upper(), faces.SANS, 6.2, ink=ink, align=align, spread_pt=0.7)

    def paragraph(self, x: float, y: float, width: float, text: str, style: Any) -> float:
        """Set text from the top edge y down; return its lower edge. [mm]"""
        block = Paragraph(text, style)
        _, height = block.wrap(width * mm, HEIGHT_MM * mm)
        block.drawOn(self.canvas, x * mm, _up(y) - height)
        return float(y + height / mm)

    def folio(self) -> None:
        """Set the page's number at its foot."""
        self.text(RIGHT_MM, BOTTOM_MM + 3, str(self.number), faces.SERIF, 9.4, align="right")

    def flow(self, x: float, y: float, width: float, height: float, story: list[Any]) -> None:
        """Fill a column from ``story``, and remove the set part from it."""
        frame = Frame(x * mm, _up(y + height), width * mm, height * mm, 0, 0, 0, 0, showBoundary=0)
        frame.addFromList(story, self.canvas)
        if story:
            head, *tail = frame.split(story[0], self.canvas) or (None,)
            if head is not None:
                frame.add(head, self.canvas)
                story[:1] = tail

    def picture(self, x: float, y: float, cmyk: NDArray[np.uint8]) -> None:
        """Place a picture with its top-left corner at (x, y), a pixel every ``PIXEL_MM``."""
        rows, columns = cmyk.shape[:2]
        width, height = columns * PIXEL_MM, rows * PIXEL_MM
        self.canvas.saveState()
        self.canvas.translate(x * mm, _up(y + height - 2 * _NUDGE_MM))
        self.canvas.scale((width - 2 * _NUDGE_MM) * mm, (height - 2 * _NUDGE_MM) * mm)
        self.canvas.doForm(self._embed(cmyk))
        self.canvas.restoreState()

    def _embed(self, cmyk: NDArray[np.uint8]) -> str:
        """Put an image into the file, compressed as PNG does, and return its name.

        reportlab's own ``drawImage`` has no predictor, which costs a third more bytes.
        """
        name = "image-" + hashlib.sha256(cmyk.tobytes()).hexdigest()[:16]
        document = self.canvas._doc  # noqa: SLF001 - reportlab has no public way to add a stream
        if not self.canvas.hasForm(name):
            rows, columns = cmyk.shape[:2]
            entries = {
                "Type": pdfdoc.PDFName("XObject"),
                "Subtype": pdfdoc.PDFName("Image"),
                "Width": columns,
                "Height": rows,
                "ColorSpace": pdfdoc.PDFName("DeviceCMYK"),
                "BitsPerComponent": 8,
                "Filter": pdfdoc.PDFName("FlateDecode"),
                "DecodeParms": pdfdoc.PDFDictionary({"Predictor": 15, "Colors": 4, "Columns": columns}),
            }
            stream = pdfdoc.PDFStream(pdfdoc.PDFDictionary(entries), _png_rows(cmyk), filters=[])
            document.addForm(name, stream)
        return name


def _up(y: float) -> float:
    """Return the height above the page's lower edge, the origin of PDF's coordinates. [pt]"""
    return float((HEIGHT_MM - y) * mm)


def refuse_overset(story: list[Any], what: str, *, parts: str = "paragraphs") -> None:
    """Raise ValueError if ``flow`` left anything of a story."""
    if story:
        message = f"{what}: {len(story)} {parts} are left"
        raise ValueError(message)


def _only_cmyk(wanted: object) -> object:
    """Let DeviceCMYK and the spot colour through.

    reportlab's own 'sep_cmyk' turns dark process colours into pure black, and the others drop the spot colour.
    """
    if not isinstance(wanted, CMYKColor):
        message = f"the sample job is CMYK throughout, got {wanted!r}"
        raise TypeError(message)
    return wanted


def _png_rows(cmyk: NDArray[np.uint8]) -> bytes:
    """Return predicted and deflated rows: the IDAT chunks of the image written as a four-channel PNG (RFC 2083)."""
    png = imagecodecs.png_encode(np.ascontiguousarray(cmyk), level=4)
    chunks: list[bytes] = []
    place = 8
    while place < len(png):
        length = int.from_bytes(png[place : place + 4], "big")
        if png[place + 4 : place + 8] == b"IDAT":
            chunks.append(bytes(png[place + 8 : place + 8 + length]))
        place += 12 + length
    return b"".join(chunks)
