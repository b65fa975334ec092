"""Tables and forms."""

from __future__ import annotations

from itertools import pairwise

from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import Frame
from prooflight.simulation.corpus.designs.graphics import signature
from prooflight.simulation.corpus.designs.inks import BLACK, PAPER, grey, is_dark, lighter
from prooflight.simulation.corpus.designs.setting import cut


def table(frame: Frame, *, columns: int | None = None, size_pt: float | None = None) -> float:
    """Draw a table down to y + height: a head, rows of words and figures; return its lower edge. [mm]"""
    sheet, rng, design, x, y, width, height = frame
    columns = count(rng, 3, 8) if columns is None else columns
    size = some(rng, 6.5, 9.5) if size_pt is None else size_pt
    step = size * some(rng, 0.5, 0.85)
    shares = rng.dirichlet([14.0, *[7.0] * (columns - 1)]) if columns > 1 else [1.0]
    edges = [x]
    for share in shares:
        edges.append(edges[-1] + float(share) * width)
    head, banded, ruled, boxed = (often(rng, share) for share in (0.6, 0.35, 0.7, 0.3))
    ground = pick(rng, (design.palette.strong, design.palette.deep, design.palette.tint))
    if head:
        sheet.rect(x, y, width, step, ground)
    over = PAPER if head and is_dark(ground) else design.palette.text
    rows = max(int(height / step), 2)
    number_from = count(rng, 1, 2)
    money = often(rng, 0.5)
    for row in range(rows):
        top = y + row * step
        if row and banded and row % 2 == 0:
            sheet.rect(x, top, width, step, lighter(design.palette.tint, 0.8))
        for column, (left, right) in enumerate(pairwise(edges)):
            base = top + 0.5 * step + 0.13 * size
            if row == 0:
                text = cut(design.voice.title(rng, 1, 2), design.voice.bold, size, right - left - 2)
                at, align = (left + 1, "left") if column < number_from else (right - 1, "right")
                sheet.draw_text(at, base, text, design.voice.bold, size, over, align=align)
            elif column < number_from:
                text = cut(design.voice.title(rng, 1, 3), design.voice.face, size, right - left - 2)
                sheet.draw_text(left + 1, base, text, design.voice.face, size, design.palette.text)
            elif rng.random() < 0.92:
                value = rng.lognormal(4, 1.8)
                figure = f"{value:,.2f}" if money else f"{value:.0f}"
                figures = cut(figure[::-1], design.voice.figures, size, right - left - 2)[::-1]
                face, ink = design.voice.figures, design.palette.text
                sheet.draw_text(right - 1, base, figures, face, size, ink, align="right")
        if ruled:
            sheet.rule(x, top + step, width, grey(0.5) if row else design.palette.strong, 0.3 if row else 0.8)
    bottom = y + rows * step
    if boxed:
        for edge in edges:
            sheet.upright(edge, y, bottom - y, grey(0.6), 0.35)
        sheet.frame(x, y, width, bottom - y, design.palette.strong, 0.7)
    return bottom


def form(frame: Frame) -> None:
    """Draw boxes with captions, some filled in by hand or machine, tick boxes, rows of single-letter boxes."""
    sheet, rng, design, x, y, width, height = frame
    line, tinted, bottom = some(rng, 0.3, 0.9), often(rng, 0.5), y + height
    tall = some(rng, 7.5, 13)
    section = 0
    while y + tall < bottom:
        if section % count(rng, 4, 7) == 0 and y + 2 * tall < bottom:
            sheet.rect(x, y, width, 5.2, design.palette.deep)
            title = f"{section + 1}. {design.voice.title(rng, 2, 5)}"[:60]
            sheet.draw_text(x + 1.5, y + 3.7, title, design.voice.bold, 8, PAPER)
            y += 5.2
        section += 1
        kind = count(rng, 0, 5)
        if kind == 0:
            _ticks(Frame(sheet, rng, design, x, y, width, tall))
        elif kind == 1:
            _letters(Frame(sheet, rng, design, x, y, width, tall), line)
        else:
            _fields(Frame(sheet, rng, design, x, y, width, tall), line, tinted=tinted)
        y += tall
    sheet.frame(x, y, width, 0.01, design.palette.text, line)


def _fields(frame: Frame, line: float, *, tinted: bool) -> None:
    sheet, rng, design, x, y, width, tall = frame
    left = x
    for share in rng.dirichlet([4.0] * count(rng, 1, 4)):
        wide = float(share) * width
        if tinted:
            sheet.rect(left, y, wide, tall, lighter(design.palette.tint, 0.7))
        sheet.frame(left, y, wide, tall, design.palette.text, line)
        caption = cut(design.voice.title(rng, 1, 4), design.voice.face, 5.2, wide - 2)
        sheet.draw_text(left + 1, y + 2.3, caption, design.voice.face, 5.2, design.palette.text)
        if often(rng, 0.3):
            text = cut(design.voice.number(rng), design.voice.figures, 9, wide - 4)
            sheet.draw_text(left + 2, y + tall - 1.6, text, design.voice.figures, 9, BLACK)
        elif often(rng, 0.06) and wide > 30:
            signature(sheet, rng, left + 4, y + tall - 1.5, min(wide - 8, 38), design.palette.strong)
        left += wide


def _ticks(frame: Frame) -> None:
    sheet, rng, design, x, y, width, tall = frame
    boxes = count(rng, 3, 6)
    step = width / boxes
    for box in range(boxes):
        left, top = x + box * step + 1, y + tall / 2 - 1.6
        sheet.frame(left, top, 3.2, 3.2, design.palette.text, 0.6)
        if often(rng, 0.3):
            sheet.line([(left, top), (left + 3.2, top + 3.2)], design.palette.text, 1.1)
            sheet.line([(left + 3.2, top), (left, top + 3.2)], design.palette.text, 1.1)
        text = cut(design.voice.title(rng, 1, 3), design.voice.face, 7, step - 7)
        sheet.draw_text(left + 5, top + 2.8, text, design.voice.face, 7, design.palette.text)


def _letters(frame: Frame, line: float) -> None:
    sheet, rng, design, x, y, width, tall = frame
    sheet.draw_text(
        x + 1, y + 2.6, design.voice.title(rng, 1, 4)[:40], design.voice.face, 5.5, design.palette.text
    )
    side = tall - 3.8
    filled, boxes = often(rng, 0.6), int((width - 2) / side)
    figures = "".join(str(digit) for digit in rng.integers(0, 10, count(rng, 3, boxes)))
    for box in range(boxes):
        left = x + 1 + box * side
        sheet.frame(left, y + 3.4, side, side, design.palette.text, line)
        if filled and box < len(figures):
            at = left + side / 2, y + 3.4 + 0.78 * side
            sheet.draw_text(*at, figures[box], design.voice.figures, 2 * side, align="centre")
