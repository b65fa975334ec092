"""Two pages of flat colour: a label in the spot ink, and a poster in saturated process colours."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prooflight.simulation.corpus.sample_job import copy_text, faces, inks
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, Sheet, column

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.inks import Ink

_SKY = inks.percent(0, 8, 90, 0)
_SUN = inks.percent(0, 100, 92, 0)
_SEAS = (inks.percent(100, 0, 20, 0), inks.percent(100, 40, 0, 0), inks.percent(100, 85, 0, 10))
_SAND = inks.percent(0, 55, 100, 0)


def spot_page(sheet: Sheet) -> None:
    """Draw the spot colour solid and in tints, with black overprinting it and knocked out of it."""
    sheet.begin("Spot colour and overprint")
    sheet.spot(0, 0, 210, 150, 5, reference=False)
    sheet.know(0, 0, 18, 150, inks.SPOT, "spot")
    sheet.know(192, 0, 18, 150, inks.SPOT, "spot")
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
    sheet.spot(x, 203, half, 46, 5, reference=False)
    sheet.rect(x + half, 203, half, 46, blue)
    sheet.know(x, 239, half, 10, inks.SPOT, "spot")
    sheet.know(x + half, 239, half, 10, blue)
    if name == "overprint":
        with sheet.overprinting():
            _black(sheet, x, half)
        sheet.know(x + 5, 208, half - 10, 8, inks.over(inks.SPOT), "overprint on spot")
        sheet.know(x + half + 5, 208, half - 10, 8, inks.over(blue), "overprint")
    else:
        _black(sheet, x, half)
        sheet.know(x + 5, 208, half - 10, 8, inks.BLACK, "knock-out of spot")
        sheet.know(x + half + 5, 208, half - 10, 8, inks.BLACK, "knock-out")
    sheet.paragraph(x, 252, width, text, faces.style(faces.ITALIC, 10.4, 14))


def _black(sheet: Sheet, x: float, half: float) -> None:
    for left in (x, x + half):
        sheet.rect(left + 5, 208, half - 10, 8, inks.BLACK)
        sheet.text(left + half / 2, 232, "Black", faces.BOLD, 26, align="centre")


def poster(sheet: Sheet) -> None:
    """Draw a flat, saturated, full-bleed poster of a regatta."""
    sheet.begin("Poster in flat colours")
    sheet.rect(0, 0, 210, 297, _SKY)
    sheet.know(0, 0, 210, 18, _SKY)
    sheet.circle(140, 118, 52, _SUN)
    sheet.know(112, 86, 56, 40, _SUN)
    for place, ink in enumerate(_SEAS):
        _wave(sheet, 150 + 26 * place, 8.0 + 3 * place, 0.9 * place, ink)
    sheet.know(0, 168, 30, 6, _SEAS[0])
    sheet.know(0, 272, 210, 25, _SEAS[2])
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
