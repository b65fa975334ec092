"""Pages for reading: books, newspapers, magazines, newsletters, dictionaries, music."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.simulation.corpus.designs import charts, drawings, ledgers
from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle, Frame
from prooflight.simulation.corpus.designs.inks import BLACK, PAPER, grey, is_dark
from prooflight.simulation.corpus.designs.setting import Style, set_columns, set_paragraph

if TYPE_CHECKING:
    import numpy as np

    from prooflight.simulation.corpus.designs.sheet import Sheet


def book(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a page of prose: running head, sometimes a chapter opening with a large initial, folio."""
    wide = sheet.width_mm * some(rng, 0.58, 0.74)
    x = (sheet.width_mm - wide) * some(rng, 0.4, 0.6)
    y, end = sheet.height_mm * some(rng, 0.08, 0.12), sheet.height_mm * some(rng, 0.86, 0.92)
    running = design.voice.title(rng, 2, 4)
    sheet.draw_text(
        sheet.width_mm / 2, y - 6, running, design.voice.italic, 8, design.palette.strong, align="centre"
    )
    style = design.text(some(rng, 9.5, 12.5), align="justified", indent_em=1.5)
    if often(rng, 0.3):
        y += sheet.height_mm * some(rng, 0.08, 0.22)
        title, align = design.voice.title(rng, 1, 4), pick(rng, ("left", "centre"))
        y = design.heading(sheet, x, y, wide, title, 26, align=align) + 12
    if often(rng, 0.25):
        wall = some(rng, 35, 80)
        picture = design.photograph(rng, wide, wall)
        sheet.picture(x, y, wide, wall, picture)
        caption = design.voice.prose(rng, count(rng, 8, 30))
        y = set_paragraph(sheet, x, y + wall + 2, wide, caption, design.text(7.5)) + 5
    if often(rng, 0.3):  # the last page of a chapter
        end = y + (end - y) * some(rng, 0.15, 0.8)
    set_columns(sheet, x, y, wide, end - y, design.paragraphs(rng, 900, 110), style)
    folio = design.voice.number(rng)[:3]
    sheet.draw_text(x + wide / 2, sheet.height_mm * 0.94, folio, design.voice.figures, 9, align="centre")


def dictionary(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw small type in narrow columns: dictionaries, directories, small print, contents."""
    margin = some(rng, 10, 17)
    wide, tall, columns = sheet.width_mm - 2 * margin, sheet.height_mm - 2 * margin - 8, count(rng, 2, 5)
    sheet.draw_text(
        margin, margin + 2, design.voice.title(rng, 1, 1), design.voice.bold, 11, design.palette.strong
    )
    style = design.text(some(rng, 5.5, 8.0), leading=1.15)
    entries = design.paragraphs(rng, 2600, count(rng, 7, 40))
    rules = grey(0.6) if often(rng, 0.5) else None
    gap = some(rng, 3, 6)
    set_columns(sheet, margin, margin + 6, wide, tall, entries, style, columns=columns, gap=gap, rules=rules)


def newspaper(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a masthead and articles in columns under headlines, some with pictures."""
    margin, columns = some(rng, 8, 13), count(rng, 4, 6)
    wide, gap = sheet.width_mm - 2 * margin, some(rng, 3, 4.5)
    y = design.heading(sheet, margin, margin, wide, design.voice.title(rng, 1, 2), 54, align="centre") + 2
    sheet.rule(margin, y, wide, BLACK, 1.5)
    sheet.draw_text(margin, y + 4, design.voice.title(rng, 2, 3), design.voice.face, 7)
    sheet.rule(margin, y + 6, wide, BLACK, 0.4)
    y += 9
    style = design.text(some(rng, 6.5, 8.0), align="justified", leading=1.15)
    end = sheet.height_mm - margin
    while y < end - 30:
        block = min(some(rng, 55, 130), end - y)
        if end - y - block < 30:
            block = end - y
        split = count(rng, 2, columns - 1)
        for first, last in ((0, split), (split, columns)):
            x = margin + first * (wide + gap) / columns
            across = (last - first) * (wide + gap) / columns - gap
            _article(Frame(sheet, rng, design, x, y, across, block - 4), last - first, style)
        sheet.rule(margin, y + block - 2, wide, BLACK, 0.5)
        y += block


def _article(frame: Frame, columns: int, style: Style) -> None:
    sheet, rng, design, x, y, wide, tall = frame
    head = design.text(some(rng, 14, 26), face=design.voice.bold, align="left", leading=1.1, indent_em=0.0)
    title = design.voice.title(rng, 2, 5).split()
    top = set_paragraph(sheet, x, y, wide, title, head, bottom=y + 0.4 * tall) + 2
    if often(rng, 0.45) and tall > 60:
        high = tall * some(rng, 0.3, 0.5)
        sheet.picture(x, top, wide, high, design.photograph(rng, wide, high))
        caption, small = (
            design.voice.prose(rng, count(rng, 6, 16)),
            design.text(6.5, face=design.voice.italic),
        )
        top = set_paragraph(sheet, x, top + high + 1, wide, caption, small) + 2
    texts = design.paragraphs(rng, round(columns * 260), 45)
    set_columns(sheet, x, top, wide, y + tall - top, texts, style, columns=columns, gap=3.5)


def magazine(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a large picture, a title on or below it, text in two or three columns, a tinted box."""
    high = sheet.height_mm * some(rng, 0.3, 0.62)
    margin = some(rng, 12, 20)
    wide = sheet.width_mm - 2 * margin
    if often(rng, 0.35):
        sheet.rect(0, 0, sheet.width_mm, sheet.height_mm, design.palette.tint)
    bleed = often(rng, 0.7)
    left, top, across = (0.0, 0.0, sheet.width_mm) if bleed else (margin, margin, wide)
    sheet.picture(left, top, across, high, design.photograph(rng, across, high))
    if often(rng, 0.5):
        y = top + high - 20
        design.heading(sheet, margin + 3, y, wide - 6, design.voice.title(rng, 1, 3), 52, PAPER)
        y = top + high + 6
    else:
        y = design.heading(sheet, margin, top + high + 5, wide, design.voice.title(rng, 2, 5), 38) + 3
    intro = design.text(13.0, ink=design.palette.strong, face=design.voice.italic, align="left")
    y = set_paragraph(sheet, margin, y, wide, design.voice.prose(rng, count(rng, 15, 35)), intro) + 4
    end = sheet.height_mm - margin
    boxed = often(rng, 0.4) and end - y > 50
    columns = count(rng, 2, 3)
    each = (wide - 5 * (columns - 1)) / columns
    room, left = (wide - (each + 5), columns - 1) if boxed else (wide, columns)
    text = design.paragraphs(rng, 900, 80)
    set_columns(sheet, margin, y, room, end - y, text, design.body, columns=left, gap=5)
    if boxed:
        x = margin + wide - each
        ground = pick(rng, (design.palette.strong, design.palette.bright, design.palette.deep))
        sheet.rect(x, y, each, end - y, ground)
        over = PAPER if is_dark(ground) else BLACK
        down = design.heading(sheet, x + 4, y + 4, each - 8, design.voice.title(rng, 1, 3), 16, over) + 3
        text = design.paragraphs(rng, 200, 30)
        set_columns(sheet, x + 4, down, each - 8, end - down - 4, text, design.text(8.5, over))


def newsletter(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a head in colour, stories with small pictures, charts and tables in a side column."""
    margin, head = some(rng, 10, 16), some(rng, 24, 48)
    ground = pick(
        rng, (design.palette.strong, design.palette.bright, design.palette.deep, design.palette.tint)
    )
    sheet.rect(0, 0, sheet.width_mm, head, ground)
    over = PAPER if is_dark(ground) else design.palette.strong
    wide = sheet.width_mm - 2 * margin
    design.heading(sheet, margin, head / 2 - 7, wide, design.voice.title(rng, 1, 3), 44, over)
    y, end = head + 6, sheet.height_mm - margin
    main = wide * some(rng, 0.6, 0.7)
    side = wide - main - 6
    x, aside = (margin, margin + main + 6) if often(rng, 0.5) else (margin + side + 6, margin)
    down = y
    while down < end - 30:
        down = design.heading(sheet, x, down, main, design.voice.title(rng, 2, 5), 18) + 2
        tall = min(some(rng, 40, 95), end - down)
        if often(rng, 0.55):
            across = main * some(rng, 0.35, 0.5)
            high = min(across * some(rng, 0.6, 1.1), tall)
            sheet.picture(x, down, across, high, design.photograph(rng, across, high))
            text, beside = design.paragraphs(rng, 400, 60), main - across - 4
            set_columns(sheet, x + across + 4, down, beside, tall - 4, text, design.body)
        else:
            text = design.paragraphs(rng, 500, 60)
            set_columns(sheet, x, down, main, tall - 4, text, design.body, columns=2, gap=5)
        down += tall
    sheet.rect(aside, y, side, end - y, design.palette.tint)
    down = y + 4
    while down < end - 45:
        tall, kind = some(rng, 35, 60), count(rng, 0, 2)
        if kind == 0:
            charts.chart(Frame(sheet, rng, design, aside + 2, down, side - 4, tall))
        elif kind == 1:
            ledgers.table(
                Frame(sheet, rng, design, aside + 3, down, side - 6, tall - 5), columns=2, size_pt=7
            )
        else:
            text = design.paragraphs(rng, 150, 25)
            set_columns(sheet, aside + 4, down, side - 8, tall - 3, text, design.text(8.0))
        down += tall + 3


def score(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw music: systems of one to three staves with a title."""
    margin, space = some(rng, 12, 18), some(rng, 1.3, 2.0)
    wide, staves = sheet.width_mm - 2 * margin, count(rng, 1, 3)
    y = design.heading(sheet, margin, margin, wide, design.voice.title(rng, 1, 4), 22, align="centre") + 14
    end = sheet.height_mm * pick(rng, (1.0, 1.0, some(rng, 0.4, 1.0))) - margin
    while y + staves * 11 * space < end:
        top = y
        for _ in range(staves):
            bottom = drawings.music(sheet, rng, design, margin + 4, y, wide - 4, space)
            y = bottom + some(rng, 6.5, 7.5) * space
        sheet.upright(margin + 4, top, bottom - top, BLACK, 1.2)
        y += 2 * space


def manual(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw technical text with drawings: circuits, wire frames, plans, and a table."""
    margin = some(rng, 15, 22)
    wide, end = sheet.width_mm - 2 * margin, sheet.height_mm - 20
    y = design.heading(sheet, margin, margin, wide, design.voice.title(rng, 2, 4), 20) + 4
    while y < end - 70:
        tall = min(some(rng, 55, 110), end - y - 20)
        draw = pick(rng, (drawings.circuit, drawings.wire_frame, drawings.floor_plan))
        draw(Frame(sheet, rng, design, margin, y, wide, tall))
        y += tall + 8
        text = design.voice.prose(rng, count(rng, 30, 110))
        y = set_paragraph(sheet, margin, y, wide, text, design.body, bottom=end) + 4
