"""Typefaces and text styles of the sample job.

Faces: STIX General (SIL Open Font License 1.1) for reading, DejaVu Sans and DejaVu Sans Mono (Bitstream Vera
licence) for tables and labels. All three come with matplotlib and may be embedded.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reportlab.lib.enums import TA_CENTER, TA_JUSTIFY, TA_LEFT, TA_RIGHT
from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont

from prooflight.simulation.corpus.sample_job import inks

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.inks import Ink

SERIF, BOLD, ITALIC, BOLD_ITALIC = "Book", "Book-Bold", "Book-Italic", "Book-BoldItalic"
SANS, SANS_BOLD = "Plain", "Plain-Bold"
MONO = "Mono"

_FILES = {
    SERIF: "STIXGeneral",
    BOLD: "STIXGeneralBol",
    ITALIC: "STIXGeneralItalic",
    BOLD_ITALIC: "STIXGeneralBolIta",
    SANS: "DejaVuSans",
    SANS_BOLD: "DejaVuSans-Bold",
    "Plain-Italic": "DejaVuSans-Oblique",
    MONO: "DejaVuSansMono",
}
_ALIGNMENTS = {"left": TA_LEFT, "right": TA_RIGHT, "centre": TA_CENTER, "justified": TA_JUSTIFY}


@cache
def register() -> None:
    """Register the faces with reportlab, once a process."""
    import matplotlib

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for name, stem in _FILES.items():
        pdfmetrics.registerFont(TTFont(name, folder / f"{stem}.ttf"))
    pdfmetrics.registerFontFamily(SERIF, SERIF, BOLD, ITALIC, BOLD_ITALIC)
    pdfmetrics.registerFontFamily(SANS, SANS, SANS_BOLD, "Plain-Italic", SANS_BOLD)


def width_pt(text: str, face: str, size_pt: float) -> float:
    """Return the length of a line of text. [pt]"""
    return float(pdfmetrics.stringWidth(text, face, size_pt))


def style(
    face: str = SERIF,
    size_pt: float = 10.6,
    leading_pt: float = 15.0,
    *,
    ink: Ink = inks.BLACK,
    align: str = "left",
    indent_pt: float = 0.0,
    after_pt: float = 0.0,
) -> Any:
    """Return a reportlab paragraph style in CMYK; ``align`` is left, right, centre or justified."""
    return ParagraphStyle(
        f"{face}-{size_pt}-{align}",
        fontName=face,
        fontSize=size_pt,
        leading=leading_pt,
        textColor=inks.colour(ink),
        alignment=_ALIGNMENTS[align],
        firstLineIndent=indent_pt,
        spaceAfter=after_pt,
        allowWidows=0,
        allowOrphans=0,
        splitLongWords=0,
    )


def body(*, indent: bool = True) -> Any:
    """Return the style of running text: justified, indented except after a heading."""
    return style(size_pt=11.8, leading_pt=17.0, align="justified", indent_pt=17.0 if indent else 0.0)


def caption(ink: Ink = inks.GREY) -> Any:
    """Return the style of notes next to a picture."""
    return style(ITALIC, 8.6, 11.0, ink=ink)


def raised(text: str, style: Any) -> str:
    """Return markup with note marks (``<super>``) in a size that does not push the lines apart."""
    size, rise = 0.64 * style.fontSize, 0.3 * style.fontSize
    return text.replace("<super>", f'<super size="{size:.1f}" rise="{rise:.1f}">')
