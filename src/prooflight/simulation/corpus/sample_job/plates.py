"""Photographic pages of the sample job."""

from __future__ import annotations

from typing import Any

from reportlab.platypus import Paragraph

from prooflight.simulation.corpus.sample_job import copy_text as words
from prooflight.simulation.corpus.sample_job import faces, inks, quay
from prooflight.simulation.corpus.sample_job.pictures import Shot, develop
from prooflight.simulation.corpus.sample_job.sheet import (
    LEFT_MM,
    RIGHT_MM,
    TOP_MM,
    WIDTH_MM,
    Sheet,
    column,
    halves,
    refuse_overset,
)

BALANCED_MM = 110.0
BRICK_TONE = (1.12, 0.98, 0.9)

_CONTACTS: tuple[tuple[str, Shot], ...] = (
    ("Deep field", Shot(name="hubble", centre=(0.75, 0.55), zoom=2.2, black_point=18)),
    ("Commander", Shot(name="astronaut", centre=(0.43, 0.23), zoom=1.9)),
    ("The night before", Shot(name="rocket", centre=(0.5, 0.5), gamma=1.15)),
    ("Cup and spoon", Shot(name="coffee", centre=(0.45, 0.5))),
    ("Chelsea", Shot(name="chelsea", centre=(0.5, 0.4), zoom=1.2)),
    ("Half past, moving", Shot(name="clock", tone=(0.95, 1.0, 1.08))),
    ("On the common", Shot(name="camera", centre=(0.5, 0.35))),
    ("Left eye", Shot(name="retina", zoom=1.05)),
    ("Small change", Shot(name="coins", centre=(0.3, 0.65), zoom=1.4, tone=(1.1, 1.0, 0.82))),
    ("Wall", Shot(name="brick", tone=BRICK_TONE)),
    ("Drive", Shot(name="gravel", zoom=1.4)),
    ("Verge", Shot(name="grass", tone=(0.94, 1.06, 0.8), zoom=1.4)),
)


def single(sheet: Sheet) -> None:
    """Draw one large photograph on a white page."""
    sheet.begin("Plate: one large photograph")
    side = RIGHT_MM - LEFT_MM
    sheet.picture(LEFT_MM, 38, develop(Shot(name="retina", gamma=1.08, soften=0.6), side, side))
    sheet.label(LEFT_MM, 32, "Plate 1", ink=inks.EMBER)
    x, width = column(0, 4)
    sheet.text(x, 222, "The other end of the line", faces.SERIF, 22, ink=inks.NIGHT)
    sheet.paragraph(x, 227, width, words.RETINA, faces.style(size_pt=10.6, leading_pt=15))
    _folio(sheet)


def contact_sheet(sheet: Sheet) -> None:
    """Draw twelve small photographs with their names."""
    sheet.begin("Plate: contact sheet")
    sheet.label(LEFT_MM, 32, "Plate 2", ink=inks.EMBER)
    sheet.text(LEFT_MM, 46, "Contact sheet", faces.SERIF, 22, ink=inks.NIGHT)
    sheet.text(RIGHT_MM, 46, "Twelve frames, one roll", faces.ITALIC, 11, ink=inks.GREY, align="right")
    for place, (name, shot) in enumerate(_CONTACTS):
        x, width = column(2 * (place % 3), 2)
        y = 54 + 54.5 * (place // 3)
        sheet.picture(x, y, develop(shot, width, 43))
        sheet.text(x, y + 47.4, name, faces.ITALIC, 9, ink=inks.GREY)
        sheet.text(x + width, y + 47.2, f"{place + 1}A", faces.SANS, 6.2, ink=inks.EMBER, align="right")
    _folio(sheet)


def wrapped(sheet: Sheet) -> None:
    """Draw a photograph with text running round it in two columns."""
    sheet.begin("Plate: photograph with text around it")
    sheet.label(LEFT_MM, 32, "Plate 3", ink=inks.EMBER)
    sheet.text(LEFT_MM, 48, "A cat, for scale", faces.SERIF, 30, ink=inks.NIGHT)
    sheet.text(LEFT_MM, 57, "What a portrait asks of a press", faces.ITALIC, 13, ink=inks.GREY)
    top, tall = 68.0, 84.0
    x, width = column(2, 4)
    sheet.picture(x, top, develop(Shot(name="chelsea", centre=(0.5, 0.42), soften=0.6), width, tall))
    sheet.paragraph(x, top + tall + 2, width, words.CAT_CAPTION, faces.caption())
    plain = faces.style(size_pt=11.8, leading_pt=17, align="justified", indent_pt=17)
    story: list[Any] = [Paragraph(text, plain) for text in words.CAT]
    narrow, below = column(0, 2), top + tall + 11
    sheet.flow(narrow[0], top - 1.6, narrow[1] - 1, below - top, story)
    for half_x, half_width in halves():
        sheet.flow(half_x, below - 0.6, half_width, BALANCED_MM, story)
    refuse_overset(story, "text does not fit its columns")
    _folio(sheet)


def brochure(sheet: Sheet) -> None:
    """Draw a roastery's leaflet: full-bleed photograph above three columns on a tint."""
    sheet.begin("Brochure")
    sheet.rect(0, 0, 210, 297, quay.FOAM)
    shot = Shot(name="coffee", centre=(0.5, 0.5), gamma=0.96, soften=0.7)
    sheet.picture(0, 0, develop(shot, WIDTH_MM, 132))
    quay.mark(sheet, LEFT_MM, 20.0, 16.0, inks.PAPER, quay.TEAL)
    sheet.rect(0, 132, 210, 30, quay.TEAL)
    sheet.text(LEFT_MM, 148, "Slow beans, short walk.", faces.SERIF, 36, ink=inks.PAPER)
    sheet.text(LEFT_MM, 156, quay.NAME, faces.SERIF, 12, ink=quay.FOAM)
    hours = "Open from seven, shut when the tide turns"
    sheet.text(RIGHT_MM, 156, hours, faces.ITALIC, 12, ink=quay.FOAM, align="right")
    for place, (title, text) in enumerate(words.BROCHURE):
        x, width = column(2 * place, 2)
        sheet.rect(x, 174, 12, 1.0, quay.APRICOT)
        sheet.text(x, 184, title, faces.SERIF, 17, ink=quay.BEAN)
        sheet.paragraph(x, 188, width, text, faces.style(size_pt=10, leading_pt=14.2))
    coffees = (quay.BEAN, inks.percent(0, 58, 88, 4), quay.TEAL)
    for place, ((name, note, price), ink) in enumerate(zip(words.OFFERS, coffees, strict=True)):
        x, width = column(2 * place, 2)
        sheet.rect(x, 236, width, 40, ink)
        sheet.text(x + 5, 247, name, faces.SERIF, 15, ink=inks.PAPER)
        sheet.paragraph(x + 5, 250, width - 10, note, faces.style(faces.ITALIC, 9.4, 12.4, ink=inks.PAPER))
        sheet.text(x + width - 5, 268, price, faces.SERIF, 17, ink=inks.PAPER, align="right")
    sheet.text(LEFT_MM, 286, ", ".join(quay.ADDRESS), faces.SANS, 6.8, ink=quay.BEAN)
    sheet.text(RIGHT_MM, 286, quay.CONTACT[1], faces.SANS, 6.8, ink=quay.BEAN, align="right")


def night_launch(sheet: Sheet) -> None:
    """Draw light text on a dark flat, under a full-width photograph."""
    sheet.begin("Light text on a dark page")
    sheet.rect(0, 0, 210, 297, inks.NIGHT)
    sheet.picture(0, 0, develop(Shot(name="rocket", centre=(0.5, 0.46), soften=0.7), WIDTH_MM, 136))
    sheet.label(LEFT_MM, 154, "Evening lectures", ink=inks.EMBER)
    sheet.text(LEFT_MM, 170, "Eleven minutes to orbit", faces.SERIF, 34, ink=inks.PAPER)
    sheet.text(LEFT_MM, 180, "A talk with pictures, and one loud noise", faces.ITALIC, 14, ink=inks.STRAW)
    light = faces.style(size_pt=10.6, leading_pt=15.2, ink=inks.SAND, align="justified", indent_pt=14)
    story: list[Any] = [Paragraph(text, light) for text in words.LAUNCH]
    for x, width in halves():
        sheet.flow(x, 190, width, 52, story)
    refuse_overset(story, "text does not fit its columns")
    sheet.rule(LEFT_MM, 260, RIGHT_MM, 260, inks.STRAW, 0.5)
    for place, (when, what) in enumerate(words.LECTURES):
        x, width = column(2 * place, 2)
        sheet.text(x, 266, when, faces.SANS_BOLD, 6.6, ink=inks.STRAW)
        sheet.paragraph(x, 267.6, width, what, faces.style(size_pt=9.4, leading_pt=12, ink=inks.SAND))


def _folio(sheet: Sheet) -> None:
    sheet.folio()
    sheet.label(LEFT_MM, TOP_MM + 3, "Ink, Light & Paper")
