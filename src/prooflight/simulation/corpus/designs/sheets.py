"""Pages of many similar items: labels, catalogues, calendars, albums, tickets, plans, puzzles and wrapping."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.simulation.corpus.designs import drawings, graphics, ledgers
from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle, Frame
from prooflight.simulation.corpus.designs.inks import BLACK, PAPER, grey, is_dark, lighter
from prooflight.simulation.corpus.designs.photographs import PIXEL_MM, clouds, ramp
from prooflight.simulation.corpus.designs.setting import cut, set_columns, set_paragraph
from prooflight.simulation.corpus.designs.sheet import Sheet, cells

if TYPE_CHECKING:
    import numpy as np


def labels(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw address or product labels, each with its own words and codes."""
    columns, rows = count(rng, 2, 4), count(rng, 4, 10)
    margin, gap = some(rng, 6, 14), some(rng, 0, 4)
    wide = (sheet.width_mm - 2 * margin + gap) / columns - gap
    tall = (sheet.height_mm - 2 * margin + gap) / rows - gap
    kind, framed, headed = count(rng, 0, 2), often(rng, 0.6), often(rng, 0.4)
    for x, y in cells(columns, rows, margin, margin, wide + gap, tall + gap):
        if framed:
            sheet.frame(x, y, wide, tall, design.palette.text, 0.4)
        if headed:
            sheet.rect(x, y, wide, 0.22 * tall, design.palette.strong)
        for row in range(min(count(rng, 2, 4), int(tall / 6))):
            text = f"{design.voice.title(rng, 1, 2)} {design.voice.number(rng)}"
            text = cut(text, design.voice.face, 8, wide - 6)
            ink = design.palette.text if row else design.palette.strong
            sheet.draw_text(x + 3, y + 0.22 * tall + 4 + 3.8 * row, text, design.voice.face, 8, ink)
        if kind == 0:
            graphics.bar_code(sheet, rng, x + 3, y + 0.66 * tall, wide - 6, 0.22 * tall)
        elif kind == 1:
            side = 0.6 * tall
            graphics.square_code(sheet, rng, x + wide - side - 2, y + 0.32 * tall, side)
        else:
            colours = design.palette.strong, design.palette.bright
            graphics.logo(sheet, rng, x + wide - 13, y + tall - 13, 10, *colours)


def catalogue(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw goods: picture, name, a few words, a price, in rows and columns."""
    columns, rows, margin = count(rng, 2, 4), count(rng, 2, 5), some(rng, 9, 15)
    y0 = (
        design.heading(sheet, margin, margin, sheet.width_mm - 2 * margin, design.voice.title(rng, 1, 3), 28)
        + 5
    )
    wide = (sheet.width_mm - 2 * margin + 5) / columns - 5
    tall = (sheet.height_mm - y0 - margin + 5) / rows - 5
    high = tall * some(rng, 0.5, 0.66)
    for x, y in cells(columns, rows, margin, y0, wide + 5, tall + 5):
        sheet.picture(x, y, wide, high, design.photograph(rng, wide, high))
        name = design.voice.title(rng, 1, 2)
        down = design.heading(sheet, x, y + high + 1.5, wide, name, 10, design.palette.strong) + 1
        texts = design.voice.prose(rng, count(rng, 6, 20))
        set_paragraph(sheet, x, down, wide - 14, texts, design.text(7.0, align="left"), bottom=y + tall)
        price = f"{rng.lognormal(3, 1):.2f}"
        sheet.draw_text(
            x + wide, y + tall - 2, price, design.voice.figures, 10, design.palette.bright, align="right"
        )


def album(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw photographs on white, black or colour, in unequal rows."""
    ground = pick(rng, (PAPER, PAPER, design.palette.deep, design.palette.tint))
    sheet.rect(0, 0, sheet.width_mm, sheet.height_mm, ground)
    margin, gap = some(rng, 0, 14), some(rng, 1, 6)
    rows = count(rng, 2, 4)
    tall = (sheet.height_mm - 2 * margin - gap * (rows - 1)) / rows
    for row in range(rows):
        shares = rng.dirichlet([6.0] * count(rng, 1, 3))
        x, room = margin, sheet.width_mm - 2 * margin - gap * (len(shares) - 1)
        for share in shares:
            wide = float(share) * room
            sheet.picture(x, margin + row * (tall + gap), wide, tall, design.photograph(rng, wide, tall))
            x += wide + gap


def calendar(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a month below a picture or a band, with entries."""
    high = sheet.height_mm * some(rng, 0.15, 0.5)
    wide, tall = sheet.width_mm, sheet.height_mm
    if often(rng, 0.6):
        sheet.picture(0, 0, wide, high, design.photograph(rng, wide, high))
        y = design.heading(sheet, 12, high + 6, 0.7 * wide, design.voice.title(rng, 1, 1), 40) + 6
    else:
        high = 0.15 * tall
        sheet.rect(0, 0, wide, high, design.palette.strong)
        design.heading(sheet, 12, high / 2 - 8, 0.7 * wide, design.voice.title(rng, 1, 1), 50, PAPER)
        y = high + 8
    margin = some(rng, 7, 14)
    step_x, step_y = (wide - 2 * margin) / 7, (tall - y - margin) / 6
    first, days = count(rng, 0, 6), count(rng, 28, 31)
    for day in range(days):
        column, row = (first + day) % 7, (first + day) // 7
        x, top = margin + column * step_x, y + row * step_y
        if column > 4:
            sheet.rect(x, top, step_x, step_y, design.palette.tint)
        sheet.frame(x, top, step_x, step_y, grey(0.6), 0.4)
        ink = design.palette.bright if column == 6 else design.palette.text
        sheet.draw_text(x + 1.5, top + 6, str(day + 1), design.voice.figures, 13, ink)
        if often(rng, 0.3):
            sheet.draw_text(
                x + 1.5, top + 0.8 * step_y, design.voice.title(rng, 1, 1)[:9], design.voice.face, 6.5
            )


def tickets(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw tickets, vouchers or cards, each numbered, with a stub."""
    columns, rows, margin = count(rng, 1, 2), count(rng, 3, 6), some(rng, 8, 14)
    wide, tall = (sheet.width_mm - 2 * margin) / columns, (sheet.height_mm - 2 * margin) / rows
    ground = pick(
        rng, (design.palette.strong, design.palette.deep, design.palette.tint, design.palette.bright)
    )
    blended, over = often(rng, 0.5), PAPER if is_dark(ground) else design.palette.text
    for x, y in cells(columns, rows, margin, margin, wide, tall):
        main = 0.74 * wide
        if blended:
            sheet.blend(x, y, main, tall - 2, ground, lighter(ground, some(rng, 0.4, 0.9)), turn_deg=0)
        else:
            sheet.rect(x, y, main, tall - 2, ground)
        sheet.frame(x, y, wide - 2, tall - 2, design.palette.text, 0.6)
        down = design.heading(sheet, x + 5, y + 5, main - 10, design.voice.title(rng, 1, 3), 26, over) + 4
        texts, style = design.voice.prose(rng, 12), design.text(8.0, over)
        set_paragraph(sheet, x + 5, down, main - 30, texts, style, bottom=y + tall - 6)
        side = min(0.2 * wide, 0.45 * tall)
        graphics.square_code(sheet, rng, x + main + 3, y + 4, side)
        sheet.turned_text(x + wide - 5, y + tall - 6, design.voice.number(rng), design.voice.figures, 10)
        for notch in range(int((tall - 4) / 2.4)):
            sheet.upright(x + main, y + 1 + 2.4 * notch, 1.3, grey(0.8), 0.5)


def map_page(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a map over most of the page with its title and scale."""
    margin = some(rng, 0, 14)
    head = some(rng, 14, 30)
    draw = pick(rng, (drawings.contour_map, drawings.street_map))
    draw(
        Frame(
            sheet,
            rng,
            design,
            margin,
            head,
            sheet.width_mm - 2 * margin,
            sheet.height_mm - head - margin - 12,
        )
    )
    design.heading(sheet, max(margin, 8), 5, 0.7 * sheet.width_mm, design.voice.title(rng, 1, 3), 20)
    for step in range(5):
        x = max(margin, 8) + 12 * step
        sheet.rect(x, sheet.height_mm - 8, 12, 2, BLACK if step % 2 else grey(0.2))


def plan(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a drawing with its title block."""
    margin, block = some(rng, 8, 14), some(rng, 25, 45)
    wide, tall = sheet.width_mm - 2 * margin, sheet.height_mm - 2 * margin
    sheet.frame(margin, margin, wide, tall, BLACK, 1.4)
    draw = pick(rng, (drawings.floor_plan, drawings.circuit, drawings.wire_frame))
    draw(Frame(sheet, rng, design, margin + 10, margin + 10, wide - 20, tall - block - 30))
    ledgers.table(Frame(sheet, rng, design, margin, margin + tall - block, wide, block), columns=4, size_pt=7)


def puzzles(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw crosswords with their clues."""
    margin = some(rng, 13, 22)
    wide = sheet.width_mm - 2 * margin
    y = design.heading(sheet, margin, margin, wide, design.voice.title(rng, 1, 3), 26) + 5
    side = wide * some(rng, 0.55, 1.0)
    drawings.crossword(sheet, rng, design, margin, y, side)
    clues, columns = design.paragraphs(rng, 400, 7), count(rng, 2, 4)
    down = y + side + 6
    room = sheet.height_mm - margin - down
    set_columns(sheet, margin, down, wide, room, clues, design.text(8.0), columns=columns)


def wrapping(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a pattern over the whole page."""
    ground = pick(rng, (PAPER, design.palette.tint, design.palette.strong, design.palette.deep))
    sheet.rect(0, 0, sheet.width_mm, sheet.height_mm, ground)
    colours = (design.palette.bright, PAPER if is_dark(ground) else design.palette.third)
    graphics.pattern(sheet, rng, 0, 0, sheet.width_mm, sheet.height_mm, *colours)


def scan(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a scanned document: grey-brown paper with stains, dark edges, type and a stamp."""
    wide, tall = sheet.width_mm, sheet.height_mm
    paper = clouds(rng, round(tall / PIXEL_MM / 2), round(wide / PIXEL_MM / 2), falling=0.9, coarse=4) * 0.05
    dark, light = some(rng, 0.35, 0.6), some(rng, 0.8, 0.95)
    rgb = ramp(paper + 0.75, (dark, 0.94 * dark, 0.85 * dark), (light, 0.97 * light, 0.91 * light))
    sheet.picture(0, 0, wide, tall, design.separation.inks(rgb))
    edge = some(rng, 1, 7)
    sheet.rect(0, 0, edge, tall, grey(0.85))
    sheet.rect(0, 0, wide, 0.6 * edge, grey(0.9))
    margin, style = some(rng, 20, 30), design.text(some(rng, 9, 12), grey(some(rng, 0.75, 0.95)))
    y = (
        design.heading(sheet, margin, margin, wide - 2 * margin, design.voice.title(rng, 2, 5), 16, style.ink)
        + 6
    )
    texts = design.paragraphs(rng, count(rng, 150, 600))
    set_columns(sheet, margin, y, wide - 2 * margin, tall - y - 40, texts, style)
    graphics.stamp(sheet, rng, 0.7 * wide, tall - 45, 14, design.palette.strong, design.voice)


def coupons(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a page of square codes and bar codes with captions, as for stock-taking."""
    columns, rows, margin = count(rng, 2, 5), count(rng, 3, 7), some(rng, 10, 18)
    wide, tall = (sheet.width_mm - 2 * margin) / columns, (sheet.height_mm - 2 * margin) / rows
    square = often(rng, 0.6)
    side = 0.72 * min(wide, tall)
    for x, y in cells(columns, rows, margin, margin, wide, tall):
        if square:
            graphics.square_code(sheet, rng, x + (wide - side) / 2, y, side)
        else:
            graphics.bar_code(sheet, rng, x + 3, y, wide - 6, 0.55 * tall, design.voice)
        name = cut(design.voice.title(rng, 1, 2), design.voice.face, 8, wide - 4)
        at = x + wide / 2, y + 0.9 * tall
        sheet.draw_text(*at, name, design.voice.face, 8, design.palette.strong, align="centre")
