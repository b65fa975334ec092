"""Test form pages: step wedges, gradients, grey balance, two blacks, overprint and the spot colour; and a poster."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prooflight.simulation.corpus.sample_job import copy_text, faces, inks
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, TOP_MM, Sheet, column

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.inks import Ink

_WEDGES: tuple[tuple[str, tuple[float, float, float, float]], ...] = (
    ("Cyan", (1, 0, 0, 0)),
    ("Magenta", (0, 1, 0, 0)),
    ("Yellow", (0, 0, 1, 0)),
    ("Black", (0, 0, 0, 1)),
    ("Red", (0, 1, 1, 0)),
    ("Green", (1, 0, 1, 0)),
    ("Blue", (1, 1, 0, 0)),
    ("Three inks", (1, 1, 1, 0)),
)
_STEPS_PERCENT = (2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
_SKY = inks.percent(0, 8, 90, 0)
_SUN = inks.percent(0, 100, 92, 0)
_SEAS = (inks.percent(100, 0, 20, 0), inks.percent(100, 40, 0, 0), inks.percent(100, 85, 0, 10))
_SAND = inks.percent(0, 55, 100, 0)


def _head(sheet: Sheet, title: str, lead: str) -> None:
    sheet.label(LEFT_MM, TOP_MM + 3, "Test form")
    sheet.label(RIGHT_MM, TOP_MM + 3, "Lantern Press, press one", align="right")
    sheet.rule(LEFT_MM, TOP_MM + 5.6, RIGHT_MM, TOP_MM + 5.6, inks.HAIRLINE, 0.3)
    sheet.text(LEFT_MM, 44, title, faces.SERIF, 24, ink=inks.NIGHT)
    sheet.paragraph(LEFT_MM, 47, column(0, 5)[1], lead, faces.style(faces.ITALIC, 11, 15, ink=inks.GREY))


def wedges(sheet: Sheet) -> None:
    """Draw tint steps of each ink and of their overprints, and fine detail."""
    sheet.begin("Test form: tints and fine detail")
    lead = "Each ink alone, each pair, all three. The two palest steps go first when a head clogs."
    _head(sheet, "Step wedges", lead)
    pitch, tall = 12.0, 13.0
    for row, (name, weights) in enumerate(_WEDGES):
        y = 64 + 16.0 * row
        sheet.text(LEFT_MM, y + 7.8, name, faces.SANS, 7.4)
        for place, step in enumerate(_STEPS_PERCENT):
            ink = inks.percent(*(step * weight for weight in weights))
            sheet.rect(LEFT_MM + 26 + pitch * place, y, pitch, tall, ink)
    for place, step in enumerate(_STEPS_PERCENT):
        middle = LEFT_MM + 26 + pitch * (place + 0.5)
        sheet.text(middle, 62.6, f"{step}", faces.SANS, 6, ink=inks.GREY, align="centre")
    _fine_lines(sheet, 204)
    _small_type(sheet, 240)


def _fine_lines(sheet: Sheet, y: float) -> None:
    """Draw line pairs that halve in width, dark on paper and paper on dark."""
    sheet.text(LEFT_MM, y, "Lines, mm", faces.SANS, 7.4)
    x = LEFT_MM + 26
    for width in (0.1, 0.2, 0.3, 0.5):
        sheet.label(x, y - 3, f"{width:g}")
        for flip, (under, ink) in enumerate(((inks.PAPER, inks.BLACK), (inks.NIGHT, inks.PAPER))):
            left = x + 17 * flip
            for top in (y - 1, y + 11):
                sheet.rect(left, top, 16, 10, under)
            for place in range(int(16 / width / 2)):
                sheet.rect(left + 2 * width * place, y - 1, width, 10, ink)
            for place in range(int(10 / width / 2)):
                sheet.rect(left, y + 11 + 2 * width * place, 16, width, ink)
        x += 36


def _small_type(sheet: Sheet, y: float) -> None:
    text = "A nozzle dries and leaves a pale scratch a hair wide."
    sizes = (4, 5, 6, 7, 8)
    for flip, (under, ink) in enumerate(((inks.PAPER, inks.BLACK), (inks.NIGHT, inks.PAPER))):
        x, width = column(3 * flip, 3)
        sheet.rect(x, y, width, 35, under)
        down = y + 4.0
        for size in sizes:
            down += 0.9 * size
            sheet.text(x + 4, down, f"{size} pt", faces.SANS, 4.6, ink=ink)
            sheet.text(x + 12, down, text, faces.SERIF, size, ink=ink)


def gradients(sheet: Sheet) -> None:
    """Draw smooth ramps with known values, one smooth shading, and the grey-balance square."""
    sheet.begin("Test form: gradients and grey balance")
    lead = "Ramps from paper to full ink, then between colours. Look for steps and stripes."
    _head(sheet, "Gradients", lead)
    x, width = column(1, 5)
    columns = round(width * 10)
    full = inks.FULL
    ramps: tuple[tuple[str, Ink, Ink], ...] = (
        ("Cyan", inks.PAPER, (full, 0, 0, 0)),
        ("Magenta", inks.PAPER, (0, full, 0, 0)),
        ("Yellow", inks.PAPER, (0, 0, full, 0)),
        ("Black", inks.PAPER, inks.BLACK),
        ("Three-ink grey", inks.PAPER, inks.percent(75, 66, 66, 0)),
        ("Sky", inks.percent(70, 20, 0, 0), inks.percent(0, 30, 50, 0)),
        ("Night", inks.percent(100, 80, 20, 60), inks.percent(20, 60, 0, 0)),
    )
    y = 64.0
    for name, start, end in ramps:
        sheet.text(LEFT_MM, y + 6.4, name, faces.SANS, 7.4)
        sheet.picture(x, y, ramp(start, end, rows=100, columns=columns))
        y += 12.5
    sheet.text(LEFT_MM, y + 6.4, "Shading", faces.SANS, 7.4)
    _shading(sheet, x, y, width, 10)
    _grey_balance(sheet, 178)


def ramp(start: Ink, end: Ink, *, rows: int, columns: int) -> NDArray[np.uint8]:
    """Return a linear ramp across, from one ink mixture to another -> (rows, columns, 4) bytes, rounded to nearest."""
    share = np.linspace(0.0, 1.0, columns)[:, None]
    line = np.rint((1 - share) * np.array(start) + share * np.array(end)).astype(np.uint8)
    return np.repeat(line[None], rows, axis=0)


def _shading(sheet: Sheet, x: float, y: float, width: float, height: float) -> None:
    """Draw a PDF axial shading, as layout programs write it, not an image."""
    sheet.canvas.saveState()
    clip = sheet.path([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])
    sheet.canvas.clipPath(clip, stroke=0, fill=0)
    left, right = sheet.at(x, y + height / 2), sheet.at(x + width, y + height / 2)
    colours = [inks.colour(inks.percent(0, 90, 30, 0)), inks.colour(inks.percent(100, 10, 60, 0))]
    sheet.canvas.linearGradient(*left, *right, colours, extend=True)
    sheet.canvas.restoreState()


def _grey_balance(sheet: Sheet, y: float) -> None:
    """Draw cyan fixed at 50 %, magenta and yellow from 32 to 48 %: the neutral one lies near the middle."""
    sheet.text(LEFT_MM, y, "Grey balance", faces.SERIF, 16, ink=inks.NIGHT)
    recipe = "cyan 50 %, on a ground of 40 % black"
    sheet.text(RIGHT_MM, y, recipe, faces.ITALIC, 10, ink=inks.GREY, align="right")
    steps = (32, 36, 40, 44, 48)
    x, width = column(1, 5)
    ground = inks.percent(0, 0, 0, 40)
    sheet.rect(x, y + 5, width, 82, ground)
    pitch_x, pitch_y = 27.8, 15.2
    for row, yellow in enumerate(steps):
        down = y + 10.0 + pitch_y * row
        sheet.text(x - 3, down + 7.4, f"Y {yellow}", faces.SANS, 6.4, ink=inks.GREY, align="right")
        for place, magenta in enumerate(steps):
            across = round(x + 5 + pitch_x * place, 1)
            sheet.rect(across, round(down, 1), 22, 12, inks.percent(50, magenta, yellow, 0))
    for place, magenta in enumerate(steps):
        middle = x + 16 + pitch_x * place
        sheet.text(middle, y + 91, f"M {magenta}", faces.SANS, 6.4, ink=inks.GREY, align="centre")


def two_blacks(sheet: Sheet) -> None:
    """Draw a page of rich black with a panel of black ink alone."""
    sheet.begin("Rich black")
    sheet.rect(0, 0, 210, 297, inks.RICH_BLACK)
    x, width = column(3, 3)
    sheet.rect(x, 36, 210 - x, 150, inks.BLACK)
    sheet.text(LEFT_MM, 70, "Two", faces.SERIF, 72, ink=inks.PAPER)
    sheet.text(x + 8, 70, "blacks", faces.SERIF, 72, ink=inks.PAPER)
    rich = faces.style(size_pt=10.6, leading_pt=15.4, ink=inks.SAND)
    sheet.paragraph(LEFT_MM, 84, width - 8, copy_text.RICH, rich)
    alone = faces.style(size_pt=10.6, leading_pt=15.4, ink=inks.PAPER)
    sheet.paragraph(x + 8, 84, width - 8, copy_text.ALONE, alone)
    for place, grey in enumerate((100, 98, 95, 92, 88, 84)):
        left = LEFT_MM + 29 * place
        ink = inks.percent(60, 40, 40, grey)
        sheet.rect(left, 214, 25, 30, ink)
        sheet.text(left, 249, f"60/40/40/{grey}", faces.SANS, 6, ink=inks.HAIRLINE)
    sheet.text(LEFT_MM, 206, "How deep is deep enough?", faces.ITALIC, 13, ink=inks.STRAW)
    sheet.rule(LEFT_MM, 262, RIGHT_MM, 262, inks.PAPER, 0.25)
    sheet.text(LEFT_MM, 268, "The line above is a quarter of a point.", faces.SERIF, 7, ink=inks.PAPER)


def spot_page(sheet: Sheet) -> None:
    """Draw the spot colour solid and in tints, with black overprinting it and knocked out of it."""
    sheet.begin("Spot colour and overprint")
    sheet.spot(0, 0, 210, 150, 5)
    with sheet.overprinting():
        sheet.text(LEFT_MM, 62, "Lantern", faces.SERIF, 84)
        sheet.text(LEFT_MM, 92, "Orange", faces.SERIF, 84)
        style = faces.style(size_pt=11.4, leading_pt=16)
        sheet.paragraph(LEFT_MM, 106, column(0, 4)[1], copy_text.SPOT, style)
    for place in range(5):
        sheet.spot(LEFT_MM + 34 * place, 158, 34, 22, place + 1)
        sheet.text(LEFT_MM + 34 * place, 185, f"{20 * (place + 1)} %", faces.SANS, 6.8, ink=inks.GREY)
    _pair(sheet, 0, copy_text.OVERPRINTED, "overprint")
    _pair(sheet, 3, copy_text.KNOCKED_OUT, "knock-out")


def _pair(sheet: Sheet, first: int, text: str, name: str) -> None:
    """Draw black bars and type over the spot colour and over process blue, overprinting or knocking out."""
    x, width = column(first, 3)
    half = width / 2
    blue = inks.percent(100, 60, 0, 0)
    sheet.label(x, 200, name, ink=inks.BLACK)
    sheet.spot(x, 203, half, 46, 5)
    sheet.rect(x + half, 203, half, 46, blue)
    if name == "overprint":
        with sheet.overprinting():
            _black(sheet, x, half)
    else:
        _black(sheet, x, half)
    sheet.paragraph(x, 252, width, text, faces.style(faces.ITALIC, 10.4, 14))


def _black(sheet: Sheet, x: float, half: float) -> None:
    for left in (x, x + half):
        sheet.rect(left + 5, 208, half - 10, 8, inks.BLACK)
        sheet.text(left + half / 2, 232, "Black", faces.BOLD, 26, align="centre")


def poster(sheet: Sheet) -> None:
    """Draw a flat, saturated, full-bleed poster of a regatta."""
    sheet.begin("Poster in flat colours")
    sheet.rect(0, 0, 210, 297, _SKY)
    sheet.circle(140, 118, 52, _SUN)
    for place, ink in enumerate(_SEAS):
        _wave(sheet, 150 + 26 * place, 8.0 + 3 * place, 0.9 * place, ink)
    _boat(sheet, 62, 172, 1.0, inks.PAPER, inks.percent(0, 100, 40, 0))
    _boat(sheet, 164, 196, 0.72, _SAND, inks.PAPER)
    for place, text in enumerate(("Harrowick", "Sound")):
        sheet.text(LEFT_MM - 1, 52 + 25 * place, text, faces.BOLD, 68, ink=_SEAS[2])
    sheet.text(LEFT_MM, 266, "Regatta", faces.BOLD, 40, ink=_SKY)
    sheet.text(RIGHT_MM, 258, "Saturday 21 June", faces.BOLD, 15, ink=inks.PAPER, align="right")
    start = "first gun at ten, off the Customs House"
    sheet.text(RIGHT_MM, 266, start, faces.ITALIC, 13, ink=inks.PAPER, align="right")


def _wave(sheet: Sheet, y: float, swell: float, phase: float, ink: Ink) -> None:
    crest = [(2.0 * step, y + swell * math.sin(2 * math.pi * step / 46 + phase)) for step in range(-1, 108)]
    sheet.polygon([*crest, (214, 297), (-2, 297)], ink)


def _boat(sheet: Sheet, x: float, y: float, scale: float, sail: Ink, jib: Ink) -> None:
    def at(*points: tuple[float, float]) -> list[tuple[float, float]]:
        return [(x + scale * across, y + scale * down) for across, down in points]

    sheet.polygon(at((2, -62), (2, -8), (34, -8)), sail)
    sheet.polygon(at((-2, -54), (-2, -8), (-24, -8)), jib)
    sheet.polygon(at((-28, -4), (38, -4), (26, 8), (-18, 8)), inks.BLACK)
    sheet.rect(x - 0.8 * scale, y - 64 * scale, 1.6 * scale, 60 * scale, inks.BLACK)
