"""Faces, colours and styles of the report: Inter with figures of one width, as in the console."""

from __future__ import annotations

from functools import cache
from html import escape
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from reportlab.lib.colors import HexColor
from reportlab.lib.enums import TA_LEFT, TA_RIGHT
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import Paragraph, TableStyle

from prooflight.errors import visible

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

REGULAR, BOLD, FALLBACK = "Inter-Regular", "Inter-SemiBold", "DejaVuSans"
"""Faces; the last one, which comes with matplotlib, has letters that Inter's Latin subset lacks."""
INK, DIM, LINE, SOFT = HexColor("#14202b"), HexColor("#4d5b68"), HexColor("#d5dbe1"), HexColor("#f5f7f9")
STOP, LOOK, QUIET, ACCENT = (
    *(HexColor("#c2261d"), HexColor("#9a5b00")),
    *(HexColor("#8a9aa6"), HexColor("#14557f")),
)
SERIES: Final = (
    ("verdict.misprint", STOP),
    ("verdict.not-inspected", HexColor("#53636f")),
    ("verdict.late", HexColor("#f0a818")),
)
SMALL_PT: Final = 7.5

Name = Literal[
    "title",
    "lead",
    "heading",
    "subject",
    "label",
    "value",
    "number",
    "small",
    "figure",
    "column",
    "column.right",
]


def _style(
    name: str, size: float, *, bold: bool = False, colour: Any = INK, right: bool = False, **more: Any
) -> ParagraphStyle:
    return ParagraphStyle(
        name,
        fontName=BOLD if bold else REGULAR,
        fontSize=size,
        leading=more.pop("leading", size * 1.35),
        textColor=colour,
        alignment=TA_RIGHT if right else TA_LEFT,
        splitLongWords=1,
        **more,
    )


STYLES: Final[dict[str, ParagraphStyle]] = {
    "title": _style("title", 20, bold=True, leading=24),
    "lead": _style("lead", 9.5, colour=DIM, spaceBefore=1 * mm),
    "heading": _style("heading", 11, bold=True, spaceAfter=2 * mm),
    "subject": _style("subject", 10, bold=True, spaceBefore=0.6 * mm, spaceAfter=0.6 * mm),
    "label": _style("label", SMALL_PT, colour=DIM),
    "value": _style("value", 8.5),
    "number": _style("number", 8.5, right=True),
    "small": _style("small", SMALL_PT, colour=DIM),
    "figure": _style("figure", 19, bold=True, leading=22),
    "column": _style("column", SMALL_PT, bold=True, colour=DIM),
    "column.right": _style("column.right", SMALL_PT, bold=True, colour=DIM, right=True),
}
_PLAIN: Final = (
    ("LEFTPADDING", (0, 0), (-1, -1), 0),
    ("RIGHTPADDING", (0, 0), (-1, -1), 0),
    ("TOPPADDING", (0, 0), (-1, -1), 0),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 0),
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
)
BARE: Final = TableStyle([*_PLAIN])
FIGURES: Final = TableStyle(
    [
        *_PLAIN,
        ("LEFTPADDING", (0, 0), (-1, -1), 3 * mm),
        ("TOPPADDING", (0, 0), (-1, 0), 3 * mm),
        ("TOPPADDING", (0, 1), (-1, 1), 0.8 * mm),
        ("TOPPADDING", (0, 2), (-1, 2), 1.2 * mm),
        ("BOTTOMPADDING", (0, -1), (-1, -1), 3 * mm),
        ("BACKGROUND", (0, 0), (-1, -1), SOFT),
        ("LINEAFTER", (0, 0), (-2, -1), 0.5, LINE),
        ("ROUNDEDCORNERS", [2 * mm] * 4),
    ]
)
PAIRS: Final = TableStyle(
    [
        *_PLAIN,
        ("RIGHTPADDING", (0, 0), (0, -1), 3 * mm),
        ("TOPPADDING", (0, 0), (-1, -1), 0.7 * mm),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 0.7 * mm),
        ("LINEBELOW", (0, 0), (-1, -2), 0.4, LINE),
    ]
)
TABLE: Final = TableStyle(
    [
        *_PLAIN,
        ("RIGHTPADDING", (0, 0), (-2, -1), 3 * mm),
        ("TOPPADDING", (0, 0), (-1, -1), 0.8 * mm),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 0.8 * mm),
        ("LINEBELOW", (0, 0), (-1, 0), 0.8, DIM),
        ("LINEBELOW", (0, 1), (-1, -1), 0.4, LINE),
    ]
)
CARD: Final = TableStyle(
    [
        *_PLAIN,
        ("TOPPADDING", (0, 0), (-1, -1), 3 * mm),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 3 * mm),
        ("LINEABOVE", (0, 0), (-1, 0), 0.5, LINE),
    ]
)
SIGNATURE: Final = TableStyle(
    [
        *_PLAIN,
        ("RIGHTPADDING", (0, 0), (-1, -1), 6 * mm),
        ("TOPPADDING", (0, 1), (-1, 1), 1 * mm),
        *(("LINEBELOW", (column, 0), (column, 0), 0.6, INK) for column in range(3)),
    ]
)


@cache
def register() -> None:
    """Register the faces with reportlab, once a process."""
    import matplotlib

    for name in (REGULAR, BOLD):
        with as_file(files("prooflight_line.run_package") / "fonts" / f"{name}.ttf") as path:
            pdfmetrics.registerFont(TTFont(name, path))
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    pdfmetrics.registerFont(TTFont(FALLBACK, folder / f"{FALLBACK}.ttf"))


def text(content: str, name: Name, *, colour: Any = None) -> Paragraph:
    """Return a paragraph of plain text; nothing of it is taken for markup."""
    style = STYLES[name]
    marked = "".join(
        escape(part) if inter else f'<font name="{FALLBACK}">{escape(part)}</font>'
        for part, inter in _runs(visible(content))
    )
    if colour is not None:
        marked = f'<font color="{colour.hexval().replace("0x", "#")}">{marked}</font>'
    return Paragraph(marked, style)


def draw(
    canvas: Canvas,
    x: float,
    y: float,
    content: str,
    *,
    bold: bool = False,
    colour: Any = DIM,
    align: Literal["left", "right", "centre"] = "left",
    size: float = SMALL_PT,
) -> None:
    """Draw a line of text onto the page."""
    face = BOLD if bold else REGULAR
    parts = [(part, face if inter else FALLBACK) for part, inter in _runs(visible(content))]
    width = sum(pdfmetrics.stringWidth(part, name, size) for part, name in parts)
    x -= {"left": 0.0, "right": width, "centre": width / 2}[align]
    canvas.setFillColor(colour)
    for part, name in parts:
        canvas.setFont(name, size)
        canvas.drawString(x, y, part)
        x += pdfmetrics.stringWidth(part, name, size)


def fitted(content: str, width: float, size: float = SMALL_PT) -> str:
    """Return a line of text, cut where it is wider than ``width``."""
    content = visible(content)
    if pdfmetrics.stringWidth(content, REGULAR, size) <= width:
        return content
    while content and pdfmetrics.stringWidth(content + "…", REGULAR, size) > width:
        content = content[:-1]
    return content + "…"


@cache
def _letters(face: str) -> frozenset[int]:
    return frozenset(pdfmetrics.getFont(face).face.charToGlyph)


def _runs(content: str) -> list[tuple[str, bool]]:
    """Return the text in parts, each with whether Inter has its letters; what no face has is shown as an escape."""
    runs: list[tuple[str, bool]] = []
    for letter in content:
        inter, fallback = (ord(letter) in _letters(face) for face in (REGULAR, FALLBACK))
        shown = letter if inter or fallback else letter.encode("unicode_escape").decode("ascii")
        inter = inter or not fallback
        if runs and runs[-1][1] == inter:
            runs[-1] = runs[-1][0] + shown, inter
        else:
            runs.append((shown, inter))
    return runs
