"""Book of the sample job: cover, title page, contents, three chapters with their figures, and a glossary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from reportlab.lib.units import mm
from reportlab.platypus import Paragraph

from prooflight.simulation.corpus.sample_job import copy_text, faces, inks
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
    from prooflight.simulation.corpus.sample_job.copy_text import Chapter
    from prooflight.simulation.corpus.sample_job.inks import Ink

MEASURE_MM = column(0, 4)[1]  # 112 mm: 64 characters a line at 11.8 pt
MARGIN_X_MM, MARGIN_MM = column(4, 2)
TEXT_TOP_MM, TEXT_BOTTOM_MM = 38.0, 268.0
DROP_LINES = 3
GLOSSARY_HEIGHT_MM = 136.0


def cover(sheet: Sheet) -> None:
    """Draw a full-bleed photograph with the title in light type."""
    sheet.begin("Cover")
    sky = develop(Shot(name="hubble", centre=(0.404, 0.5), black_point=24, soften=0.8), WIDTH_MM, HEIGHT_MM)
    sheet.picture(0, 0, sky)
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
        sheet.rect(LEFT_MM + 9 * place, 252, 8, 8, ink)
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
    in_margin(sheet, text, MARGIN_X_MM, TEXT_TOP_MM, MARGIN_MM)
    sheet.flow(LEFT_MM, TEXT_TOP_MM, MEASURE_MM, TEXT_BOTTOM_MM - TEXT_TOP_MM, story)
    below(sheet, text, LEFT_MM, TEXT_BOTTOM_MM, MEASURE_MM)
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


def in_margin(sheet: Sheet, chapter: Chapter, x: float, y: float, width: float) -> None:
    """Draw the figure that belongs to a chapter into the margin column at (x, y). [mm]"""
    draw = {
        copy_text.LIGHT.number: light_in_paper,
        copy_text.INKS.number: three_discs,
        copy_text.RUN.number: coins,
    }
    draw[chapter.number](sheet, x, y, width)


def below(sheet: Sheet, chapter: Chapter, x: float, bottom: float, width: float) -> None:
    """Fill the foot of a chapter's last page, where it has one to fill, down to ``bottom``. [mm]"""
    draw = {copy_text.INKS.number: screens, copy_text.RUN.number: photographer}
    if chapter.number in draw:
        draw[chapter.number](sheet, x, bottom, width)


def light_in_paper(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw a section through a sheet: a ray that enters near a dot of ink and leaves through it."""
    surface, depth = y + 24, 17.0
    sheet.rect(x, surface, width, depth, inks.SAND)
    for start in (9.0, 35.0):
        sheet.rect(x + start, surface - 1.6, 12, 1.6, inks.percent(100, 0, 0, 0))
    rays = (
        ((3.0, -20.0), (6.5, 0.0), (5.2, 6.0), (9.0, 11.0), (11.5, 7.0), (14.0, 0.0), (16.5, -18.0)),
        ((26.0, -20.0), (28.0, 0.0), (31.5, 8.0), (26.0, 12.5), (23.5, 6.0), (24.5, 0.0), (23.0, -18.0)),
        ((44.0, -20.0), (40.5, 0.0), (38.0, 6.5), (44.0, 10.5), (50.0, 5.5), (50.6, 0.0), (51.0, -18.0)),
    )
    for ray in rays:
        points = [(x + across, surface + down) for across, down in ray]
        sheet.canvas.setStrokeColor(inks.colour(inks.EMBER))
        sheet.canvas.setLineWidth(0.7)
        sheet.canvas.setLineJoin(1)
        sheet.canvas.drawPath(sheet.path(points, closed=False), stroke=1, fill=0)
        (tip_x, tip_y), (tail_x, _) = points[-1], points[-2]
        lean = (tip_x - tail_x) * 0.06
        sheet.polygon(
            [(tip_x + lean, tip_y - 1.2), (tip_x - 0.9, tip_y + 1), (tip_x + 0.9, tip_y + 1)], inks.EMBER
        )
    text = (
        "Three ways through the same sheet. The ray on the left goes in by clean paper and out through ink; the "
        "middle one meets no ink at all; the one on the right pays on the way in. Seen from above, the shadow of "
        "each dot is wider than the dot."
    )
    sheet.paragraph(x, surface + depth + 3, width, text, faces.caption())


def three_discs(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw cyan, magenta and yellow discs that overprint each other."""
    radius = 15.0
    middle, full = x + width / 2, inks.FULL
    discs = (
        (middle, y + radius, (full, 0, 0, 0)),
        (middle - 9, y + radius + 15, (0, full, 0, 0)),
        (middle + 9, y + radius + 15, (0, 0, full, 0)),
    )
    with sheet.overprinting():
        for across, down, ink in discs:
            sheet.circle(across, down, radius, ink)
    text = (
        "Cyan, magenta and yellow, each laid over the other two. Where two meet there is blue, red or green; in the "
        "middle, where all three do, the untidy brown that the key plate exists to replace."
    )
    sheet.paragraph(x, y + 49, width, text, faces.caption())


def coins(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw a photograph of coins."""
    shot = Shot(
        name="coins", centre=(0.25, 0.3), zoom=1.5, tone=(1.1, 1.0, 0.82), black_point=20, white_point=235
    )
    sheet.picture(x, y, develop(shot, width, 72))
    text = (
        "Greek coins found at Pompeii. Each was struck by hand, and no two are alike; yet anyone who had handled a "
        "thousand could tell a bad one at a glance, with no good one beside it."
    )
    sheet.paragraph(x, y + 75, width, text, faces.caption())


def screens(sheet: Sheet, x: float, bottom: float, width: float) -> None:
    """Draw the dots of each ink at its angle, enlarged, and the four of them combined."""
    gap = 3.0
    side = (width - 4 * gap) / 5
    top = bottom - 11 - side
    full = inks.FULL
    plates = ((15.0, (full, 0, 0, 0)), (75.0, (0, full, 0, 0)), (0.0, (0, 0, full, 0)), (45.0, inks.BLACK))
    for place, (angle, ink) in enumerate(plates):
        left = x + place * (side + gap)
        with sheet.overprinting():
            _dots(sheet, left, top, side, angle, ink)
            _dots(sheet, x + 4 * (side + gap), top, side, angle, ink)
        sheet.label(left, top - 2, f"{angle:g}°")
    sheet.label(x + 4 * (side + gap), top - 2, "together")
    text = "The four screens of a process tint, ten times enlarged, at their own angles."
    sheet.paragraph(x, bottom - 8, width, text, faces.caption())


def _dots(sheet: Sheet, left: float, top: float, side: float, angle_deg: float, ink: Ink) -> None:
    pitch, radius = 1.7, 0.56
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    reach = math.ceil(side / pitch)
    for row in range(-reach, reach + 1):
        for step in range(-reach, reach + 1):
            across = side / 2 + pitch * (step * cos - row * sin)
            down = side / 2 + pitch * (step * sin + row * cos)
            if radius <= across <= side - radius and radius <= down <= side - radius:
                sheet.circle(left + across, top + down, radius, ink)


def photographer(sheet: Sheet, x: float, bottom: float, width: float) -> None:
    """Draw a photograph across the measure."""
    height = 76.0
    shot = Shot(name="camera", centre=(0.5, 0.3), tone=(1.05, 1.0, 0.93), gamma=1.1, soften=0.7)
    sheet.picture(x, bottom - height - 8, develop(shot, width, height))
    sheet.paragraph(x, bottom - 6, width, "Somebody still has to look.", faces.caption())
