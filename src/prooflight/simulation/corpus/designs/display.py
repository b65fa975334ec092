"""Display pages: photographs, posters, covers, slides, menus, invitations, certificates."""

from __future__ import annotations

import numpy as np

from prooflight.simulation.corpus.designs import charts, graphics
from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle, Frame
from prooflight.simulation.corpus.designs.inks import PAPER, is_dark, lighter
from prooflight.simulation.corpus.designs.setting import set_columns, set_paragraph
from prooflight.simulation.corpus.designs.sheet import Sheet, cells


def full_picture(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a photograph over the whole page, sometimes with a white edge or a few words."""
    edge = pick(rng, (0.0, 0.0, 0.0, some(rng, 5, 18)))
    wide, tall = sheet.width_mm - 2 * edge, sheet.height_mm - 2 * edge
    sheet.picture(edge, edge, wide, tall, design.photograph(rng, wide, tall))
    if often(rng, 0.4):
        y = sheet.height_mm * pick(rng, (0.08, 0.8))
        design.heading(
            sheet, edge + 14, y, wide - 28, design.voice.title(rng, 1, 3), some(rng, 24, 70), PAPER
        )


def poster(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a ground of one colour, a gradient, rays or a pattern, with huge words."""
    wide, tall, palette = sheet.width_mm, sheet.height_mm, design.palette
    kind = count(rng, 0, 4)
    ground = pick(rng, (palette.deep, palette.strong, palette.bright, palette.tint))
    if kind == 0:
        sheet.rect(0, 0, wide, tall, ground)
    elif kind == 1:
        second = pick(rng, (palette.bright, palette.third, palette.tint))
        sheet.blend(0, 0, wide, tall, ground, second, turn_deg=pick(rng, (90.0, 60.0, 120.0, 0.0)))
    elif kind == 2:
        graphics.rays(sheet, rng, ground, pick(rng, (lighter(ground, 0.75), palette.third, palette.bright)))
    elif kind == 3:
        sheet.rect(0, 0, wide, tall, ground)
        graphics.pattern(sheet, rng, 0, 0, wide, tall, lighter(ground, 0.7), palette.third)
        sheet.rect(0.1 * wide, 0.3 * tall, 0.8 * wide, 0.4 * tall, ground)
    else:
        high = tall * some(rng, 0.4, 0.65)
        sheet.rect(0, 0, wide, tall, ground)
        sheet.picture(0, 0, wide, high, design.photograph(rng, wide, high))
    over = PAPER if is_dark(ground) else palette.strong
    y = tall * some(rng, *{4: (0.66, 0.72), 3: (0.32, 0.42)}.get(kind, (0.06, 0.5)))
    align = pick(rng, ("left", "centre"))
    for _ in range(count(rng, 1, 3)):
        title, most_pt = design.voice.title(rng, 1, 2), some(rng, 40, 120)
        y = design.heading(sheet, 14, y, wide - 28, title, most_pt, over, align=align) + 4
    small = design.text(some(rng, 10, 16), over, align="left")
    set_paragraph(sheet, 14, y + 4, 0.6 * wide, design.voice.prose(rng, count(rng, 8, 40)), small)
    if often(rng, 0.6):
        side = some(rng, 18, 30)
        graphics.logo(sheet, rng, wide - side - 14, tall - side - 14, side, over, ground)


def cover(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a cover of bands and blocks of colour with a title and sometimes a picture in a frame or a circle."""
    wide, tall, palette = sheet.width_mm, sheet.height_mm, design.palette
    ground = pick(rng, (PAPER, palette.tint, palette.deep, palette.strong))
    sheet.rect(0, 0, wide, tall, ground)
    for _ in range(count(rng, 1, 4)):
        ink = pick(rng, (palette.strong, palette.bright, palette.third, lighter(palette.bright, 0.5)))
        if often(rng, 0.5):
            top, high = tall * some(rng, 0, 0.9), tall * some(rng, 0.02, 0.3)
            sheet.rect(0, top, wide, high, ink)
        else:
            corner = rng.uniform(-0.2, 1.2, (count(rng, 3, 4), 2)) * (wide, tall)
            sheet.polygon(corner[np.argsort(np.arctan2(*(corner - corner.mean(axis=0)).T))], ink)
    side, below = wide * some(rng, 0.35, 0.8), often(rng, 0.3)
    top, x = tall * (some(rng, 0.06, 0.16) if below else some(rng, 0.36, 0.46)), (wide - side) * rng.random()
    if often(rng, 0.7):
        round_ = often(rng, 0.3)
        high = side if round_ else min(side * some(rng, 0.6, 1.3), 0.5 * tall)
        sheet.picture(x, top, side, high, design.photograph(rng, side, high), round_=round_)
    else:
        graphics.logo(sheet, rng, x, top, min(side, 0.5 * tall), palette.bright, palette.third)
    box, head = pick(rng, (ground, palette.deep, PAPER)), tall * (0.66 if below else 0.08)
    sheet.rect(0.07 * wide, head, 0.86 * wide, 0.24 * tall, box)
    over = PAPER if is_dark(box) else palette.strong
    title = design.voice.title(rng, 1, 3)
    y = design.heading(sheet, 0.1 * wide, head + 0.02 * tall, 0.8 * wide, title, 60, over) + 5
    sheet.draw_text(0.1 * wide, y + 5, design.voice.title(rng, 2, 5)[:50], design.voice.italic, 14, over)
    sheet.draw_text(0.1 * wide, tall - 14, design.voice.title(rng, 2, 3), design.voice.face, 11, palette.text)


def slides(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a handout of two to six presentation slides."""
    (columns, rows), margin = pick(rng, ((1, 2), (1, 3), (2, 3), (2, 4))), some(rng, 8, 16)
    wide = (sheet.width_mm - margin * (columns + 1)) / columns
    tall = min((sheet.height_mm - margin * (rows + 1)) / rows, 0.75 * wide)
    ground = pick(rng, (PAPER, PAPER, design.palette.tint, design.palette.deep, design.palette.strong))
    over = PAPER if is_dark(ground) else design.palette.text
    size = float(np.clip(tall / 7, 5.5, 15))
    for x, y in cells(columns, rows, margin, margin, wide + margin, tall + margin):
        sheet.rect(x, y, wide, tall, ground)
        sheet.rect(x, y, wide, 0.16 * tall, design.palette.strong)
        design.heading(
            sheet, x + 3, y + 0.03 * tall, wide - 6, design.voice.title(rng, 2, 5), 0.26 * tall, PAPER
        )
        left, top, room = x + 4, y + 0.24 * tall, 0.5 * wide - 6
        style = design.text(size, over, align="left", indent_em=0.0)
        for _ in range(count(rng, 2, 4)):
            texts = design.voice.prose(rng, count(rng, 3, 9))
            top = set_paragraph(sheet, left + 3, top, room - 3, texts, style, bottom=y + tall - 3) + 1
        if often(rng, 0.6) and not is_dark(ground):
            charts.chart(Frame(sheet, rng, design, x + 0.5 * wide, y + 0.22 * tall, 0.48 * wide, 0.7 * tall))
        else:
            across, high = 0.44 * wide, 0.66 * tall
            sheet.picture(
                x + 0.52 * wide, y + 0.24 * tall, across, high, design.photograph(rng, across, high)
            )
        sheet.frame(x, y, wide, tall, design.palette.text, 0.5)


def menu(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw dishes and prices, light on dark or dark on a tint."""
    ground = pick(rng, (design.palette.deep, design.palette.deep, design.palette.tint))
    sheet.rect(0, 0, sheet.width_mm, sheet.height_mm, ground)
    over = PAPER if is_dark(ground) else design.palette.strong
    margin = some(rng, 18, 30)
    wide = sheet.width_mm - 2 * margin
    graphics.border(sheet, rng, some(rng, 5, 10), over)
    title = design.voice.title(rng, 1, 2)
    y = design.heading(sheet, margin, margin + 4, wide, title, 44, over, align="centre") + 12
    while y < sheet.height_mm - margin - 25:
        y = (
            design.heading(sheet, margin, y, wide, design.voice.title(rng, 1, 2), 18, over, align="centre")
            + 6
        )
        for _ in range(count(rng, 3, 7)):
            if y > sheet.height_mm - margin - 8:
                break
            sheet.draw_text(margin, y, design.voice.title(rng, 2, 4)[:38], design.voice.face, 11, over)
            price = f"{some(rng, 3, 60):.2f}"
            sheet.draw_text(margin + wide, y, price, design.voice.figures, 11, over, align="right")
            if often(rng, 0.6):
                note = " ".join(design.voice.vocabulary_sample(rng, count(rng, 4, 8)))[:60]
                sheet.draw_text(margin, y + 4, note, design.voice.italic, 7.5, over)
            y += 9
        y += 6


def certificate(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw an ornamental border, a ground of fine lines, a name, a seal and signatures."""
    wide, tall = sheet.width_mm, sheet.height_mm
    along = np.linspace(0, wide, 120)
    fine, waves, lift = lighter(design.palette.strong, 0.35), some(rng, 0.05, 0.25), some(rng, 3, 10)
    for line in range(count(rng, 20, 60)):
        wave = tall * (0.1 + 0.8 * line / 60) + lift * np.sin(waves * along + 0.3 * line)
        sheet.line(np.stack([along, wave], axis=1), fine, 0.25)
    graphics.border(sheet, rng, some(rng, 7, 13), design.palette.strong)
    y = (
        design.heading(sheet, 30, 0.16 * tall, wide - 60, design.voice.title(rng, 1, 2), 46, align="centre")
        + 14
    )
    for size in (12, 26, 12, 12):
        text = design.voice.title(rng, 2, 4)
        design.heading(sheet, 30, y, wide - 60, text, size, design.palette.text, align="centre")
        y += size * 0.35 + some(rng, 8, 18)
    sheet.disc(wide / 2, 0.72 * tall, 17, design.palette.bright)
    graphics.logo(sheet, rng, wide / 2 - 11, 0.72 * tall - 11, 22, design.palette.tint, design.palette.deep)
    for x in (0.18 * wide, 0.6 * wide):
        sheet.rule(x, 0.86 * tall, 0.24 * wide, design.palette.text, 0.5)
        graphics.signature(sheet, rng, x + 3, 0.855 * tall, 0.2 * wide, design.palette.text)


def invitation(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw a mostly white page with a few centred lines and an ornament."""
    wide, tall = sheet.width_mm, sheet.height_mm
    y = tall * some(rng, 0.12, 0.35)
    side = some(rng, 15, 45)
    graphics.logo(sheet, rng, (wide - side) / 2, y, side, design.palette.strong, design.palette.bright)
    y += side + 14
    for _ in range(count(rng, 3, 9)):
        size = pick(rng, (10, 12, 12, 16, 28))
        text, at = design.voice.title(rng, 2, 4), 0.15 * wide
        y = design.heading(sheet, at, y, 0.7 * wide, text, size, design.palette.text, align="centre")
        y += some(rng, 2, 7)
        if y > 0.9 * tall:
            break
    if often(rng, 0.4):
        graphics.border(sheet, rng, some(rng, 8, 16), design.palette.third)


def flyer(sheet: Sheet, rng: np.random.Generator, design: DesignStyle) -> None:
    """Draw offers: blocks of picture and colour in a grid that fills the page, prices in bursts."""
    columns, rows = count(rng, 2, 3), count(rng, 2, 4)
    wide, tall = sheet.width_mm / columns, sheet.height_mm / rows
    for x, y in cells(columns, rows, 0.0, 0.0, wide, tall):
        kind = count(rng, 0, 2)
        ground = pick(
            rng, (design.palette.strong, design.palette.bright, design.palette.deep, design.palette.tint)
        )
        if kind == 0:
            sheet.picture(x, y, wide, tall, design.photograph(rng, wide, tall))
        elif kind == 1:
            sheet.rect(x, y, wide, tall, ground)
        else:
            sheet.blend(x, y, wide, tall, ground, design.palette.third, turn_deg=some(rng, 0, 180))
        if kind:
            over = PAPER if is_dark(ground) else design.palette.text
            top = design.heading(sheet, x + 5, y + 6, wide - 10, design.voice.title(rng, 1, 2), 26, over) + 4
            style, texts = design.text(9.0, over, align="left"), design.paragraphs(rng, 60, 20)
            set_columns(sheet, x + 5, top, wide - 10, tall - (top - y) - 24, texts, style)
        if often(rng, 0.55):
            price, at = f"{some(rng, 1, 99):.2f}", (x + wide - 18, y + tall - 15)
            sheet.ellipse(*at, 14, 10, design.palette.bright, turn_deg=-10)
            over = PAPER if is_dark(design.palette.bright) else design.palette.text
            sheet.draw_text(at[0], at[1] + 2.6, price, design.voice.figures, 20, over, align="centre")
