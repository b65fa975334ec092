"""Marks: logos, bar codes, square codes, ornaments, patterns, stamps, signatures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.simulation.corpus.designs.chance import count, pick, some
from prooflight.simulation.corpus.designs.inks import BLACK, PAPER, Ink, lighter

if TYPE_CHECKING:
    from prooflight.simulation.corpus.designs.sheet import Sheet
    from prooflight.simulation.corpus.designs.vocabulary import Voice

_FINDER = np.pad(np.pad(np.ones((3, 3), np.bool_), 1, constant_values=False), 1, constant_values=True)


def logo(
    sheet: Sheet, rng: np.random.Generator, x: float, y: float, side: float, ink: Ink, second: Ink
) -> None:
    """Draw a company's sign in a square of ``side`` mm."""
    half = side / 2
    mid_x, mid_y = x + half, y + half
    middle, kind = np.array((mid_x, mid_y)), count(rng, 0, 6)
    if kind == 0:
        for ring, colour in zip((1.0, 0.72, 0.44), (ink, PAPER, second), strict=True):
            sheet.disc(mid_x, mid_y, half * ring, colour)
    elif kind == 1:
        petals, first = count(rng, 4, 9), rng.random()
        for petal in range(petals):
            angle = 2 * np.pi * petal / petals + first
            left, top = mid_x + 0.55 * half * np.cos(angle), mid_y + 0.55 * half * np.sin(angle)
            turn = float(np.rad2deg(angle))
            sheet.ellipse(left, top, 0.42 * half, 0.2 * half, (ink, second)[petal % 2], turn_deg=turn)
    elif kind == 2:
        sheet.polygon(middle + half * _star(count(rng, 5, 9), some(rng, 0.35, 0.75), some(rng, 0, 1)), ink)
        sheet.disc(mid_x, mid_y, 0.28 * half, second)
    elif kind == 3:
        bars = count(rng, 3, 6)
        for bar in range(bars):
            tall = side * some(rng, 0.3, 1.0)
            left, colour = x + bar * side / bars, (ink, second)[bar % 2]
            sheet.rect(left, y + side - tall, 0.75 * side / bars, tall, colour)
    elif kind == 4:
        corners = middle - half + rng.uniform(0, side, (3, 3, 2))
        for triangle, colour in zip(corners, (lighter(ink, 0.5), ink, second), strict=True):
            sheet.polygon(triangle, colour)
    elif kind == 5:
        dark = rng.random((6, 3)) < 0.55
        sheet.modules(x, y, side / 6, np.hstack([dark, dark[:, ::-1]]), ink)
    else:
        sheet.disc(mid_x, mid_y, half, ink)
        along = np.linspace(-1, 1, 40)
        for lift in (-0.3, 0.05, 0.4):
            wave = np.stack([0.9 * half * along, half * (lift + 0.18 * np.sin(5 * along))], axis=1)
            sheet.line(middle + wave, PAPER, side * 0.18)


def _star(points: int, inner: float, turn: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    angle = np.arange(2 * points) * np.pi / points + turn
    radius = np.where(np.arange(2 * points) % 2, inner, 1.0)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def bar_code(
    sheet: Sheet,
    rng: np.random.Generator,
    x: float,
    y: float,
    width: float,
    height: float,
    voice: Voice | None = None,
) -> None:
    """Draw upright bars of one to four modules, as in Code 128.

    Its digits stand below when a voice is given.
    """
    symbols = count(rng, 9, 16)
    module = width / (11 * symbols + 2)
    pen = x
    for _ in range(symbols):
        widths = _code_128(rng)
        for place, modules in enumerate(widths):
            if place % 2 == 0:
                sheet.rect(pen, y, modules * module, height, BLACK)
            pen += modules * module
    sheet.rect(pen, y, 2 * module, height, BLACK)
    if voice is not None:
        digits = "".join(str(digit) for digit in rng.integers(0, 10, symbols))
        size = min(9.0, 1.6 * width / symbols / 0.35)
        at = x + width / 2, y + height + 0.4 * size
        sheet.draw_text(*at, digits, voice.figures, size, align="centre", spread_em=0.2)


def _code_128(rng: np.random.Generator) -> list[int]:
    """Draw six widths of 1 to 4 modules that add up to 11 (ISO/IEC 15417)."""
    widths = [1] * 6
    for _ in range(5):
        widths[pick(rng, [place for place in range(6) if widths[place] < 4])] += 1
    return widths


def square_code(
    sheet: Sheet, rng: np.random.Generator, x: float, y: float, side: float, ink: Ink = BLACK
) -> None:
    """Draw squares like a QR code (ISO/IEC 18004): three finders, timing lines, and random modules."""
    modules = 4 * count(rng, 1, 8) + 17
    dark = rng.random((modules, modules)) < 0.5
    dark[6, :], dark[:, 6] = np.arange(modules) % 2 == 0, np.arange(modules) % 2 == 0
    for top, left in ((0, 0), (0, modules - 7), (modules - 7, 0)):
        dark[max(top - 1, 0) : top + 8, max(left - 1, 0) : left + 8] = False
        dark[top : top + 7, left : left + 7] = _FINDER
    sheet.modules(x, y, side / modules, dark, ink)


def signature(sheet: Sheet, rng: np.random.Generator, x: float, y: float, width: float, ink: Ink) -> None:
    """Draw a handwritten scrawl along a line."""
    along = np.linspace(0, 1, 160)
    waves = count(rng, 5, 11)
    high, turns = some(rng, 0.05, 0.12), 2 * np.pi * waves * along
    height = width * high * (1.2 - along) * np.sin(turns + some(rng, 0, 6))
    sway = 0.05 * width * np.sin(turns + some(rng, 0, 6))
    slow = 0.06 * width * np.sin(2 * np.pi * some(rng, 0.5, 2) * along)
    sheet.line(np.stack([x + width * along + sway, y - height - slow], axis=1), ink, some(rng, 0.6, 1.4))


def stamp(
    sheet: Sheet, rng: np.random.Generator, x: float, y: float, radius: float, ink: Ink, voice: Voice
) -> None:
    """Draw a round rubber stamp."""
    sheet.ellipse(x, y, radius, radius, ink, line_pt=1.6)
    sheet.ellipse(x, y, 0.72 * radius, 0.72 * radius, ink, line_pt=0.7)
    for row, lift in enumerate((-0.28, 0.1, 0.48)):
        text = voice.number(rng) if row == 1 else voice.title(rng, 1, 1)[:9]
        face = voice.figures if row == 1 else voice.bold
        sheet.draw_text(x, y + lift * radius, text, face, 0.7 * radius, ink, align="centre")


def border(sheet: Sheet, rng: np.random.Generator, margin: float, ink: Ink) -> None:
    """Draw an ornamental frame round the page: repeated links, corners with rosettes."""
    wide, tall = sheet.width_mm - 2 * margin, sheet.height_mm - 2 * margin
    for inset, line in ((0.0, some(rng, 0.8, 3)), (some(rng, 5, 9), 0.6)):
        sheet.frame(margin + inset, margin + inset, wide - 2 * inset, tall - 2 * inset, ink, line)
    step, size, kind = some(rng, 4, 8), some(rng, 1.0, 1.9), count(rng, 0, 2)
    middle = margin + 3.2
    for length, upright in ((wide - 6.4, False), (tall - 6.4, True)):
        links = max(int(length / step), 1)
        for link in range(links + 1):
            along = middle + link * length / links
            for across in (middle, (sheet.width_mm if upright else sheet.height_mm) - middle):
                x, y = (across, along) if upright else (along, across)
                if kind == 0:
                    sheet.disc(x, y, size, ink)
                elif kind == 1:
                    sheet.polygon(np.array([(-1, 0), (0, -1), (1, 0), (0, 1)]) * size + (x, y), ink)
                else:
                    sheet.ellipse(x, y, size * 1.3, size * 1.3, ink, line_pt=0.7)


def pattern(
    sheet: Sheet,
    rng: np.random.Generator,
    x: float,
    y: float,
    width: float,
    height: float,
    ink: Ink,
    second: Ink,
) -> None:
    """Fill a box with a repeated motif, as on wrapping paper; motifs differ a little from one another."""
    pitch, kind = some(rng, 6, 18), count(rng, 0, 4)
    for row in range(int(height / pitch) + 1):
        for place in range(int(width / pitch) + 1):
            left, top = x + (place + 0.5 * (row % 2)) * pitch, y + row * pitch
            size = pitch * some(rng, 0.2, 0.48)
            colour = (ink, second)[(place + row) % 2]
            if not (
                x < left - size and left + size < x + width and y < top - size and top + size < y + height
            ):
                continue
            if kind == 0:
                sheet.disc(left, top, size, colour)
            elif kind == 1:
                sheet.polygon(size * _star(count(rng, 4, 7), 0.45, rng.random()) + (left, top), colour)
            elif kind == 2:
                sheet.ellipse(left, top, size, size, colour, line_pt=some(rng, 0.5, 2.5))
            elif kind == 3:
                sheet.ellipse(left, top, size, 0.4 * size, colour, turn_deg=some(rng, 0, 180))
            else:
                logo(sheet, rng, left - size, top - size, 2 * size, colour, second)


def rays(sheet: Sheet, rng: np.random.Generator, ink: Ink, second: Ink) -> None:
    """Fill the whole page with rays, rings or stripes of two colours."""
    kind = count(rng, 0, 2)
    wide, tall = sheet.width_mm, sheet.height_mm
    sheet.rect(0, 0, wide, tall, ink)
    centre_x, centre_y = some(rng, 0.1, 0.9) * wide, some(rng, 0.1, 0.9) * tall
    centre = np.array((centre_x, centre_y))
    number = count(rng, 8, 26)
    if kind == 0:
        reach = wide + tall
        for ray in range(number):
            ends = 2 * np.pi * (ray + np.array([0.0, 0.5])) / number
            rim = centre + reach * np.stack([np.cos(ends), np.sin(ends)], axis=1)
            sheet.polygon([centre, *rim], second)
    elif kind == 1:
        for ring in range(2 * number, 0, -1):
            radius = ring * (wide + tall) / (3.2 * number)
            sheet.disc(centre_x, centre_y, radius, (ink, second)[ring % 2])
    else:
        slope, step = some(rng, -0.8, 0.8) * wide, tall / number
        for stripe in range(-number, 2 * number):
            y = stripe * step * 1.5
            thick = step * some(rng, 0.3, 0.9)
            sheet.polygon([(0, y), (wide, y + slope), (wide, y + slope + thick), (0, y + thick)], second)
