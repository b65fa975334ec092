"""Book of the sample job: cover, title page, contents, three chapters and a glossary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reportlab.lib.units import mm
from reportlab.platypus import Paragraph

from prooflight.simulation.corpus.sample_job import copy_text, faces, figures, inks
from prooflight.simulation.corpus.sample_job.pictures import Shot, develop
from prooflight.simulation.corpus.sample_job.sheet import (
    HEIGHT_MM,
    LEFT_MM,
    RIGHT_MM,
    TOP_MM,
    WIDTH_MM,
    Sheet,
    column,
    halves,
    refuse_overset,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.simulation.corpus.sample_job.copy_text import Chapter

MEASURE_MM = column(0, 4)[1]  # 112 mm: 64 characters a line at 11.8 pt
MARGIN_X_MM, MARGIN_MM = column(4, 2)
TEXT_TOP_MM, TEXT_BOTTOM_MM = 38.0, 268.0
DROP_LINES = 3
GLOSSARY_HEIGHT_MM = 136.0


def cover(sheet: Sheet) -> None:
    """Draw a full-bleed photograph with the title in light type."""
    sheet.begin("Cover")
    covered = ((18.0, 116.0, 150.0, 76.0), (18.0, 268.0, 174.0, 12.0))
    sky = develop(Shot(name="hubble", centre=(0.404, 0.5), black_point=24, soften=0.8), WIDTH_MM, HEIGHT_MM)
    sheet.picture(0, 0, sky, covered=covered)
    sheet.rect(LEFT_MM, 118, 36, 1.2, inks.EMBER)
    for place, text in enumerate(("Ink, Light", "& Paper")):
        sheet.text(LEFT_MM - 1, 144 + 25 * place, text, faces.SERIF, 68, ink=inks.PAPER)
    sheet.text(LEFT_MM, 185, copy_text.SUBTITLE, faces.ITALIC, 22, ink=inks.SAND)
    sheet.label(LEFT_MM, 275, copy_text.SERIES, ink=inks.SAND)
    sheet.label(RIGHT_MM, 275, copy_text.IMPRINT, ink=inks.SAND, align="right")


def title_page(sheet: Sheet) -> None:
    """Draw the half-title in black on paper with the imprint's mark: one square of each ink."""
    sheet.begin("Title page")
    sheet.text(LEFT_MM, 84, "Ink, Light", faces.SERIF, 44, ink=inks.NIGHT)
    sheet.text(LEFT_MM, 101, "& Paper", faces.SERIF, 44, ink=inks.NIGHT)
    sheet.text(LEFT_MM, 114, copy_text.SUBTITLE, faces.ITALIC, 16)
    sheet.rule(LEFT_MM, 124, LEFT_MM + 36, 124, inks.EMBER, 1.2)
    lead = (
        "Three short chapters on white that nobody prints, on the quarrels of four inks, and on how to tell a good "
        "page from a bad one when there is nothing to compare it with. With plates, a glossary, and a working day’s "
        "jobs from the same press."
    )
    sheet.paragraph(LEFT_MM, 132, MEASURE_MM, lead, faces.style(size_pt=11.6, leading_pt=17))
    full = inks.FULL
    for place, ink in enumerate(((full, 0, 0, 0), (0, full, 0, 0), (0, 0, full, 0), inks.BLACK)):
        sheet.rect(LEFT_MM + 9 * place, 252, 8, 8, ink, reference=True)
    sheet.text(LEFT_MM, 269, copy_text.IMPRINT, faces.SERIF, 12)
    sheet.label(LEFT_MM, 274.5, "Harrowick")


def contents(sheet: Sheet, entries: Sequence[tuple[str, str, int]]) -> None:
    """Draw contents and colophon; ``entries`` are (title, description, page)."""
    sheet.begin("Contents and colophon")
    sheet.text(LEFT_MM, 48, "Contents", faces.SERIF, 30, ink=inks.NIGHT)
    sheet.rule(LEFT_MM, 55, RIGHT_MM, 55, inks.NIGHT, 0.8)
    y = 64.0
    for title, summary, page in entries:
        sheet.text(LEFT_MM, y, title, faces.SERIF, 12)
        sheet.text(column(2)[0], y, summary, faces.ITALIC, 10.4, ink=inks.GREY)
        sheet.text(RIGHT_MM, y, str(page), faces.SERIF, 12, align="right")
        sheet.rule(LEFT_MM, y + 3, RIGHT_MM, y + 3, inks.HAIRLINE, 0.3)
        y += 9.2
    y = 224.0
    sheet.label(LEFT_MM, y - 4, "Colophon")
    x, width = column(0, 2)
    for text in copy_text.COLOPHON:
        sheet.paragraph(x, y, width, text, faces.style(size_pt=8.2, leading_pt=11))
        x += width + 4
    sheet.folio()


def chapter(sheet: Sheet, text: Chapter) -> None:
    """Draw two pages: the opening with a drop cap and a footnote, then the rest next to a figure."""
    story: list[Any] = [
        Paragraph(faces.raised(words, faces.body()), faces.body()) for words in text.paragraphs[1:]
    ]
    sheet.begin(f"Chapter {text.number.lower()}: {text.title}")
    sheet.label(LEFT_MM, 52, f"Chapter {text.number.lower()}", ink=inks.EMBER)
    sheet.text(LEFT_MM, 66, text.title, faces.SERIF, 30, ink=inks.NIGHT)
    sheet.text(LEFT_MM, 75, text.summary, faces.ITALIC, 13, ink=inks.GREY)
    foot = _footnote(sheet, text.note)
    top = _drop_cap(sheet, 92, text.paragraphs[0])
    sheet.flow(LEFT_MM, top, MEASURE_MM, foot - 5.5 - top, story)
    sheet.folio()

    sheet.begin(f"Chapter {text.number.lower()}, continued")
    _running_head(sheet, text.title)
    figures.in_margin(sheet, text, MARGIN_X_MM, TEXT_TOP_MM, MARGIN_MM)
    sheet.flow(LEFT_MM, TEXT_TOP_MM, MEASURE_MM, TEXT_BOTTOM_MM - TEXT_TOP_MM, story)
    figures.below(sheet, text, LEFT_MM, TEXT_BOTTOM_MM, MEASURE_MM)
    refuse_overset(story, f"chapter {text.number} does not fit its two pages")
    sheet.folio()


def glossary(sheet: Sheet) -> None:
    """Draw two columns of small type below a band of three textures."""
    sheet.begin("Glossary in two columns")
    _running_head(sheet, "Glossary")
    for place, name in enumerate(("brick", "gravel", "grass")):
        x, width = column(2 * place, 2)
        tone = ((1.12, 0.98, 0.9), (1.0, 1.0, 1.0), (0.94, 1.06, 0.8))[place]
        sheet.picture(x, TEXT_TOP_MM, develop(Shot(name=name, tone=tone, zoom=1.6), width, 40))
    sheet.text(LEFT_MM, 98, "Words of the trade", faces.SERIF, 24, ink=inks.NIGHT)
    lead = "Surfaces first: three that no printer has ever matched. Then the words in which printers explain why."
    sheet.paragraph(LEFT_MM, 102, column(0, 5)[1], lead, faces.style(faces.ITALIC, 11, 15, ink=inks.GREY))
    small = faces.style(size_pt=8.0, leading_pt=10.4, align="justified", after_pt=2.6)
    story: list[Any] = [Paragraph(f"<b>{term}.</b> {meaning}", small) for term, meaning in copy_text.GLOSSARY]
    for x, width in halves():
        sheet.flow(x, 122, width, GLOSSARY_HEIGHT_MM, story)
    refuse_overset(story, "the glossary does not fit its columns", parts="terms")
    sheet.folio()


def _drop_cap(sheet: Sheet, y: float, text: str) -> float:
    """Set a paragraph whose first letter is three lines tall; return the lower edge. [mm]"""
    plain = faces.body(indent=False)
    # STIX capitals are 0.66 of the size tall.
    size_pt = (DROP_LINES - 1) * plain.leading / 0.66 + plain.fontSize
    gap_mm = faces.width_pt(text[0], faces.SERIF, size_pt) / mm + 1.6
    baseline = y + ((DROP_LINES - 1) * plain.leading + plain.fontSize) / mm
    sheet.text(LEFT_MM, baseline, text[0], faces.SERIF, size_pt, ink=inks.EMBER)
    block = Paragraph(text[1:], plain)
    narrow = (MEASURE_MM - gap_mm) * mm
    block.wrap(narrow, HEIGHT_MM * mm)
    beside, below = block.split(narrow, DROP_LINES * plain.leading)
    for part, x, width in ((beside, LEFT_MM + gap_mm, MEASURE_MM - gap_mm), (below, LEFT_MM, MEASURE_MM)):
        _, height = part.wrap(width * mm, HEIGHT_MM * mm)
        y += height / mm
        part.drawOn(sheet.canvas, *sheet.at(x, y))
    return y


def _footnote(sheet: Sheet, text: str) -> float:
    """Set a note at the foot of the text; return the height of its rule. [mm]"""
    small = faces.style(size_pt=8.6, leading_pt=11.4, align="justified")
    block = Paragraph(faces.raised(text, small), small)
    _, height = block.wrap(MEASURE_MM * mm, HEIGHT_MM * mm)
    top = TEXT_BOTTOM_MM - height / mm
    block.drawOn(sheet.canvas, *sheet.at(LEFT_MM, TEXT_BOTTOM_MM))
    sheet.rule(LEFT_MM, top - 2, LEFT_MM + 25, top - 2, inks.GREY, 0.4)
    return top - 2


def _running_head(sheet: Sheet, text: str) -> None:
    sheet.label(LEFT_MM, TOP_MM + 3, copy_text.TITLE)
    sheet.text(RIGHT_MM, TOP_MM + 3, text, faces.ITALIC, 9.4, ink=inks.GREY, align="right")
    sheet.rule(LEFT_MM, TOP_MM + 5.6, RIGHT_MM, TOP_MM + 5.6, inks.HAIRLINE, 0.3)
