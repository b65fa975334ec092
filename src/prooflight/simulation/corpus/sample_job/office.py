"""Paperwork of the sample job: a dense price list, a form and a letter."""

from __future__ import annotations

from prooflight.simulation.corpus.sample_job import copy_text, faces, inks, quay
from prooflight.simulation.corpus.sample_job.sheet import BOTTOM_MM, LEFT_MM, RIGHT_MM, Sheet, column

_ROW_MM = 4.3
_PRICE_EDGES_MM = (LEFT_MM, 36.0, 86.0, 122.0, 134.0, 148.0, 162.0, 176.0, RIGHT_MM)


def price_list(sheet: Sheet, lots: tuple[quay.Lot, ...]) -> None:
    """Draw every lot in every bag, in 7 pt."""
    sheet.begin("Price list")
    quay.letterhead(sheet)
    sheet.text(LEFT_MM, 50, "Spring price list", faces.SERIF, 24, ink=quay.TEAL)
    lead = "in pounds, bag and label included, VAT extra"
    sheet.text(RIGHT_MM, 50, lead, faces.ITALIC, 10.6, ink=inks.GREY, align="right")
    y = 58.0
    heads = ("Code", "Lot", "Process", "Altitude m", "Score", "250 g", "1 kg", "5 kg", "15 kg")
    quay.row(sheet, y, _PRICE_EDGES_MM, heads, faces.SANS_BOLD, 6.4, quay.TEAL)
    sheet.rule(LEFT_MM, y + 1.6, RIGHT_MM, y + 1.6, quay.TEAL, 0.9)
    y += 1.6
    country = ""
    stripe = 0
    for lot in lots:
        if lot.country != country:
            country, stripe = lot.country, 0
            y += _ROW_MM + 1.0
            sheet.text(LEFT_MM, y - 1.3, country, faces.BOLD, 9.4, ink=quay.BEAN)
            sheet.rule(LEFT_MM, y, RIGHT_MM, y, quay.BEAN, 0.4)
        if stripe % 2:
            sheet.rect(LEFT_MM, y, RIGHT_MM - LEFT_MM, _ROW_MM, quay.FOAM)
        y += _ROW_MM
        stripe += 1
        prices = tuple(quay.money(lot.pence(grams)) for grams in quay.BAGS_G)
        cells = (lot.code, lot.name, lot.process, f"{lot.altitude_m:,}", f"{lot.cupping_score:.2f}", *prices)
        quay.row(sheet, y - 1.3, _PRICE_EDGES_MM, cells, faces.SANS, 6.8, inks.BLACK)
    sheet.rule(LEFT_MM, y + 0.4, RIGHT_MM, y + 0.4, quay.TEAL, 0.9)
    note = "Score: mean of three cuppings on the hundred-point scale. Prices hold while the lot lasts."
    sheet.text(LEFT_MM, y + 6, note, faces.ITALIC, 9, ink=inks.GREY)


def form(sheet: Sheet) -> None:
    """Draw an order form with boxes to fill in."""
    sheet.begin("Form to fill in")
    quay.letterhead(sheet)
    sheet.text(LEFT_MM, 50, "Standing order", faces.SERIF, 24, ink=quay.TEAL)
    lead = (
        "Fill in with a black pen, capital letters please, one to a box. We begin with the first roast after it "
        "arrives."
    )
    sheet.paragraph(LEFT_MM, 53, column(0, 4)[1], lead, faces.style(size_pt=10.6, leading_pt=14.4))
    _heading(sheet, 74, "1", "Who you are")
    _combs(sheet, 84, "Surname", 28)
    _combs(sheet, 96, "First name", 28)
    _combs(sheet, 108, "Street and number", 28)
    _combs(sheet, 120, "Town", 20)
    _combs(sheet, 120, "Postcode", 7, x=LEFT_MM + 21 * 6)
    _combs(sheet, 132, "Telephone", 14)
    _combs(sheet, 132, "Customer number, if any", 5, x=LEFT_MM + 21 * 6)
    _heading(sheet, 150, "2", "What you drink")
    choices = (
        ("Whole beans", "Ground for filter", "Ground for espresso"),
        ("One origin, our choice", "House blend only", "Surprise me"),
        ("250 g", "1 kg", "5 kg"),
    )
    for place, names in enumerate(choices):
        x, width = column(2 * place, 2)
        sheet.rect(x, 156, width, 28, quay.FOAM)
        for row, name in enumerate(names):
            _tick_box(sheet, x + 4, 160 + 7.6 * row, name)
    _heading(sheet, 195, "3", "How often")
    for place, name in enumerate(("every week", "every fortnight", "every month", "when I write")):
        _tick_box(sheet, LEFT_MM + 43.5 * place, 201, name)
    _heading(sheet, 217, "4", "Anything else")
    for row in range(3):
        sheet.rule(LEFT_MM, 228 + 8 * row, RIGHT_MM, 228 + 8 * row, inks.HAIRLINE, 0.4)
    for place, name in enumerate(("Place and date", "Signature")):
        x, width = column(3 * place, 3)
        sheet.rule(x, 264, x + width, 264, inks.BLACK, 0.5)
        sheet.label(x, 268, name)
    sheet.text(LEFT_MM, BOTTOM_MM, "Form 7, March 2025", faces.SANS, 6.2, ink=inks.GREY)


def _heading(sheet: Sheet, y: float, number: str, text: str) -> None:
    sheet.rect(LEFT_MM, y - 5, 7, 7, quay.TEAL)
    sheet.text(LEFT_MM + 3.5, y, number, faces.SANS_BOLD, 10, ink=inks.PAPER, align="centre")
    sheet.text(LEFT_MM + 10, y, text, faces.SERIF, 14, ink=quay.TEAL)


def _combs(sheet: Sheet, y: float, name: str, count: int, *, x: float = LEFT_MM) -> None:
    sheet.label(x, y - 1.2, name)
    for place in range(count):
        sheet.outline(x + 6 * place, y, 6, 6.6, quay.TEAL, 0.5)


def _tick_box(sheet: Sheet, x: float, y: float, name: str) -> None:
    sheet.rect(x, y, 4, 4, inks.PAPER)
    sheet.outline(x, y, 4, 4, quay.TEAL, 0.6)
    sheet.text(x + 6.4, y + 3.2, name, faces.SERIF, 11)


def letter(sheet: Sheet) -> None:
    """Draw a short letter: mostly white paper."""
    sheet.begin("Letter")
    quay.letterhead(sheet)
    quay.address(sheet, quay.CUSTOMERS[0])
    sheet.text(RIGHT_MM, 100, "Harrowick, 14 March 2025", faces.SERIF, 11.4, align="right")
    y = 112.0
    text = faces.style(size_pt=11.4, leading_pt=16)
    for words in copy_text.LETTER:
        y = sheet.paragraph(LEFT_MM, y, column(0, 5)[1], words, text) + 4.2
    _signature(sheet, LEFT_MM + 2, y + 10)
    sheet.text(LEFT_MM, y + 24, "Jonah Tansley", faces.SERIF, 11.4)
    sheet.text(LEFT_MM, y + 29.4, "Dispatch", faces.ITALIC, 10.4, ink=inks.GREY)


def _signature(sheet: Sheet, x: float, y: float) -> None:
    """Draw a pen stroke in blue ink."""
    strokes = (
        ((0, -2), (4, -12), (9, -9), (3, 4), (1, 7), (-3, 5), (6, 0)),
        ((6, 0), (10, -4), (9, 2), (12, 0), (15, -3), (14, 2), (18, 0)),
        ((18, 0), (24, -14), (20, 4), (24, 0), (28, -4), (27, 3), (32, -1)),
        ((2, 3), (18, 5), (30, 2), (46, -2), (46, -2), (46, -2), (46, -2)),
    )
    path = sheet.canvas.beginPath()
    for stroke in strokes:
        points = [sheet.at(x + across, y + down) for across, down in stroke]
        path.moveTo(*points[0])
        path.curveTo(*points[1], *points[2], *points[3])
        path.curveTo(*points[4], *points[5], *points[6])
    sheet.canvas.setStrokeColor(inks.colour(inks.percent(96, 80, 0, 0)))
    sheet.canvas.setLineWidth(1.1)
    sheet.canvas.setLineCap(1)
    sheet.canvas.drawPath(path, stroke=1, fill=0)
    sheet.canvas.setLineCap(0)
