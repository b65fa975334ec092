"""Office and transactional pages: letters, invoices, statements, forms, reports, tables, slides."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.simulation.corpus.designs import charts, graphics, ledgers
from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle, Frame
from prooflight.simulation.corpus.designs.inks import PAPER, grey, is_dark, lighter
from prooflight.simulation.corpus.designs.setting import set_columns, set_paragraph
from prooflight.simulation.corpus.designs.sheet import Sheet, cells

if TYPE_CHECKING:
    import numpy as np


def _letterhead(sheet: Sheet, rng: np.random.Generator, design: DesignStyle, margin: float) -> float:
    """Draw the sender at the top and return its lower edge."""
    wide, side = sheet.width_mm - 2 * margin, some(rng, 9, 20)
    kind = count(rng, 0, 3)
    name = design.voice.title(rng, 1, 3)
    if kind == 0 and often(rng, 0.6):
        sheet.rect(0, 0, sheet.width_mm, 10 + side, design.palette.deep)
        graphics.logo(sheet, rng, margin, 5, side, lighter(design.palette.bright, 0.6), PAPER)
        design.heading(sheet, margin + side + 5, 6, 0.6 * wide, name, 22, PAPER)
        return 16 + side
    at, start = (margin, margin + side + 4) if kind == 1 else (margin + wide - side, margin)
    graphics.logo(sheet, rng, at, 10, side, design.palette.strong, design.palette.bright)
    design.heading(sheet, start, 10, wide - side - 6, name, some(rng, 12, 24))
    for row in range(count(rng, 1, 3)):
        text = " ".join(design.voice.vocabulary_sample(rng, count(rng, 3, 6)))
        sheet.draw_text(start, 21 + 3.4 * row, text[:60], design.voice.face, 7, grey(0.75))
    if kind == 3:
        sheet.rule(margin, 14 + side, wide, design.palette.strong, some(rng, 0.5, 2.5))
    return 18 + side


def _address(sheet: Sheet, rng: np.random.Generator, design: DesignStyle, x: float, y: float) -> None:
    for row in range(count(rng, 3, 5)):
        text = design.voice.title(rng, 1, 3) + (f" {design.voice.number(rng)}" if row else "")
        sheet.draw_text(
            x, y + 4.8 * row, text[:36], design.voice.face, design.body.size_pt, design.palette.text
        )


def _foot(sheet: Sheet, rng: np.random.Generator, design: DesignStyle, margin: float) -> None:
    y, parts = sheet.height_mm - 16, count(rng, 2, 4)
    sheet.rule(margin, y - 4, sheet.width_mm - 2 * margin, design.palette.strong, 0.4)
    for part in range(parts):
        left = margin + part * (sheet.width_mm - 2 * margin) / parts
        for row in range(count(rng, 1, 3)):
            text = f"{design.voice.title(rng, 1, 2)} {design.voice.number(rng)}"
            sheet.draw_text(left, y + 3 * row, text[:24], design.voice.face, 6, grey(0.7))


def letter(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a business letter: head, address, running text, signature, foot."""
    margin = some(rng, 17, 28)
    wide = sheet.width_mm - 2 * margin
    y = _letterhead(sheet, rng, design, margin) + some(rng, 4, 16)
    _address(sheet, rng, design, margin, y)
    sheet.draw_text(margin + wide, y + 12, design.voice.number(rng), design.voice.figures, 9, align="right")
    y = design.heading(sheet, margin, y + 32, wide, design.voice.title(rng, 3, 6), 12) + 4
    end = sheet.height_mm - 60
    for texts in design.paragraphs(rng, count(rng, 30, 300), 60):
        y = set_paragraph(sheet, margin, y, wide, texts, design.body, bottom=end) + 3
    length, ink = some(rng, 30, 55), pick(rng, (design.palette.text, design.palette.strong))
    graphics.signature(sheet, rng, margin, y + 16, length, ink)
    signed = design.voice.title(rng, 2, 3)
    sheet.draw_text(margin, y + 24, signed, design.voice.face, design.body.size_pt, design.palette.text)
    if often(rng, 0.15):
        graphics.stamp(sheet, rng, margin + 0.75 * wide, y + 12, 15, design.palette.bright, design.voice)
    _foot(sheet, rng, design, margin)


def invoice(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a head, address, items, totals, payment slip."""
    margin = some(rng, 14, 24)
    wide = sheet.width_mm - 2 * margin
    y = _letterhead(sheet, rng, design, margin) + 6
    _address(sheet, rng, design, margin, y)
    design.heading(
        sheet, margin + 0.55 * wide, y, 0.45 * wide, design.voice.title(rng, 1, 1), some(rng, 16, 32)
    )
    for row in range(3):
        at = y + 16 + 4.6 * row
        fact = design.voice.title(rng, 1, 1)
        sheet.draw_text(margin + 0.6 * wide, at, fact, design.voice.face, 8, design.palette.text)
        sheet.draw_text(margin + wide, at, design.voice.number(rng), design.voice.figures, 8, align="right")
    y += 38
    y = ledgers.table(Frame(sheet, rng, design, margin, y, wide, some(rng, 15, sheet.height_mm - y - 85)))
    for row in range(count(rng, 2, 4)):
        at = y + 6 + 5 * row
        name = design.voice.title(rng, 1, 2)[:18]
        sheet.draw_text(margin + 0.62 * wide, at, name, design.voice.face, 9, design.palette.text)
        figure = f"{rng.lognormal(6, 1):,.2f}"
        sheet.draw_text(
            margin + wide, at, figure, design.voice.figures, 9, design.palette.text, align="right"
        )
    foot = sheet.height_mm - 42
    if often(rng, 0.6):
        graphics.bar_code(sheet, rng, margin, foot, some(rng, 45, 75), some(rng, 8, 14), design.voice)
    if often(rng, 0.4):
        graphics.square_code(sheet, rng, margin + wide - 24, foot - 4, some(rng, 16, 24))
    _foot(sheet, rng, design, margin)


def form_page(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a form from edge to edge of the type area."""
    margin = some(rng, 9, 17)
    wide = sheet.width_mm - 2 * margin
    y = design.heading(sheet, margin, margin, 0.7 * wide, design.voice.title(rng, 3, 6), some(rng, 13, 22))
    if often(rng, 0.5):
        graphics.bar_code(sheet, rng, margin + wide - 45, margin, 45, 9)
    texts = design.voice.prose(rng, count(rng, 15, 60))
    y = set_paragraph(sheet, margin, y + 3, wide, texts, design.text(7.0)) + 3
    ledgers.form(
        Frame(sheet, rng, design, margin, y, wide, (sheet.height_mm - margin - y) * some(rng, 0.5, 1.0))
    )


def statement(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a bill or statement: key figures in boxes, a chart, a table, small print."""
    margin = some(rng, 13, 20)
    wide = sheet.width_mm - 2 * margin
    y = _letterhead(sheet, rng, design, margin) + 2
    boxes = count(rng, 2, 4)
    each = (wide - 3 * (boxes - 1)) / boxes
    ground = pick(rng, (design.palette.tint, design.palette.third, PAPER, design.palette.strong))
    over = PAPER if is_dark(ground) else design.palette.text
    for box in range(boxes):
        left = margin + box * (each + 3)
        sheet.rect(left, y, each, 22, ground)
        sheet.frame(left, y, each, 22, design.palette.strong, 0.6)
        sheet.draw_text(left + 3, y + 6, design.voice.title(rng, 1, 2)[:16], design.voice.face, 7.5, over)
        figure, size = f"{rng.lognormal(5, 1):,.2f}", some(rng, 13, 18)
        sheet.draw_text(left + 3, y + 17, figure, design.voice.figures, size, over)
    y += 28
    if often(rng, 0.7):
        tall = some(rng, 40, 65)
        charts.chart(Frame(sheet, rng, design, margin, y, wide, tall))
        y += tall + 5
    room = sheet.height_mm - some(rng, 40, 70) - y
    y = ledgers.table(Frame(sheet, rng, design, margin, y, wide, max(some(rng, 0.3, 1.0) * room, 25))) + 5
    if often(rng, 0.5):
        small, texts = design.text(6.0), design.paragraphs(rng, 300)
        set_columns(sheet, margin, y, wide, sheet.height_mm - 8 - y, texts, small, columns=count(rng, 1, 3))
    elif often(rng, 0.6):
        graphics.bar_code(sheet, rng, margin, y + 3, some(rng, 50, 90), some(rng, 8, 16), design.voice)


def report(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw numbered sections of text with charts, tables and bullet lists."""
    margin = some(rng, 18, 28)
    wide, end = sheet.width_mm - 2 * margin, sheet.height_mm - 22
    y, plain = some(rng, 18, 26), design.text(indent_em=0.0)
    if often(rng, 0.4):  # the last page of a section
        end *= some(rng, 0.3, 0.9)
    sheet.draw_text(margin, y - 8, design.voice.title(rng, 2, 4), design.voice.italic, 7.5, grey(0.7))
    while y < end - 25:
        title = f"{count(rng, 1, 9)}.{count(rng, 1, 9)}  {design.voice.title(rng, 2, 5)}"
        y = design.heading(sheet, margin, y, wide, title, some(rng, 11, 16)) + 3
        for texts in design.paragraphs(rng, count(rng, 40, 150)):
            y = set_paragraph(sheet, margin, y, wide, texts, design.body, bottom=end) + 2
        tall, kind = some(rng, 35, 70), count(rng, 0, 3)
        if kind == 0 and y + tall < end:
            charts.chart(Frame(sheet, rng, design, margin, y, wide, tall))
            y += tall + 5
        elif kind == 1 and y + tall < end:
            y = ledgers.table(Frame(sheet, rng, design, margin, y + 2, wide, tall)) + 6
        elif kind == 2:
            for _ in range(count(rng, 3, 6)):
                if y < end - 10:
                    sheet.disc(margin + 2, y + 2.4, 0.8, design.palette.bright)
                    point = design.voice.prose(rng, count(rng, 5, 24))
                    y = set_paragraph(sheet, margin + 6, y, wide - 6, point, plain, bottom=end) + 1
            y += 3
    at = sheet.width_mm / 2, sheet.height_mm - 12
    sheet.draw_text(*at, design.voice.number(rng), design.voice.figures, 8, align="centre")


def table_page(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a page of tables: price lists, timetables, results."""
    margin = some(rng, 10, 20)
    wide = sheet.width_mm - 2 * margin
    y = design.heading(sheet, margin, margin, wide, design.voice.title(rng, 2, 5), some(rng, 12, 26)) + 4
    size, end = some(rng, 5.5, 8.5), sheet.height_mm * some(rng, 0.6, 1.0) - margin
    while y < end - 20:
        tall, columns = min(some(rng, 40, 240), end - y), count(rng, 4, 11)
        y = ledgers.table(Frame(sheet, rng, design, margin, y, wide, tall), columns=columns, size_pt=size) + 6


def dashboard(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a sheet of charts in a grid, with a coloured head."""
    margin, head = some(rng, 8, 15), some(rng, 18, 36)
    ground = pick(rng, (design.palette.deep, design.palette.strong))
    sheet.rect(0, 0, sheet.width_mm, head, ground)
    design.heading(
        sheet, margin, head / 2 - 4, 0.8 * sheet.width_mm, design.voice.title(rng, 2, 4), 26, PAPER
    )
    columns, rows = count(rng, 1, 2), count(rng, 2, 4)
    wide = (sheet.width_mm - margin * (columns + 1)) / columns
    tall = (sheet.height_mm - head - margin * (rows + 1)) / rows
    for x, y in cells(columns, rows, margin, head + margin, wide + margin, tall + margin):
        if often(rng, 0.15):
            set_columns(sheet, x, y, wide, tall, design.paragraphs(rng, 140), design.body)
        else:
            charts.chart(Frame(sheet, rng, design, x, y, wide, tall))
