"""A page of business charts: bars, lines and a pie, drawn from one year's invented figures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prooflight.simulation.corpus.sample_job import faces, inks, quay
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, Sheet, column

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_SEASON = np.array([1.02, 0.98, 1.0, 0.96, 0.92, 0.86, 0.8, 0.78, 0.95, 1.06, 1.16, 1.34])
_CHANNELS = ("Counter", "By post", "Cafés and hotels", "Standing orders", "Markets")
_CHANNEL_INKS = (quay.TEAL, quay.APRICOT, quay.BEAN, quay.LEAF, inks.STRAW)


def page(sheet: Sheet, rng: np.random.Generator) -> None:
    """Draw the year in figures."""
    sheet.begin("Charts")
    quay.letterhead(sheet)
    sheet.text(LEFT_MM, 50, "The year in figures", faces.SERIF, 24, ink=quay.TEAL)
    kilos = np.rint(np.stack([_SEASON * 1450, _SEASON[::-1] ** 0.4 * 620]) * rng.uniform(0.94, 1.06, (2, 12)))
    _bars(sheet, LEFT_MM + 12, 68, RIGHT_MM - LEFT_MM - 12, 62, kilos)
    index = 100 * np.exp(np.cumsum(rng.normal([[0.004], [0.009], [-0.001]], 0.028, (3, 36)), axis=1))
    x, width = column(0, 4)
    _lines(sheet, x + 12, 164, width - 12, 88, index)
    shares = rng.dirichlet(np.array([26.0, 21.0, 30.0, 14.0, 9.0]) * 8)
    _pie(sheet, column(4, 2), 164, shares)


def _frame(sheet: Sheet, x: float, y: float, width: float, height: float, ticks: NDArray[np.float64]) -> None:
    low, high = ticks[0], ticks[-1]
    for tick in ticks:
        level = y + height * (1 - (tick - low) / (high - low))
        base = tick == low
        sheet.rule(x, level, x + width, level, inks.BLACK if base else inks.HAIRLINE, 0.6 if base else 0.3)
        sheet.text(x - 2, level + 0.9, f"{tick:,.0f}", faces.SANS, 6.4, ink=inks.GREY, align="right")


def _bars(sheet: Sheet, x: float, y: float, width: float, height: float, kilos: NDArray[np.float64]) -> None:
    sheet.text(LEFT_MM, y - 7, "Coffee sold, kilograms a month", faces.BOLD, 11)
    ticks = np.arange(0.0, 2401.0, 400.0)
    _frame(sheet, x, y, width, height, ticks)
    for place, (name, ink) in enumerate((("beans", quay.TEAL), ("ground", quay.APRICOT))):
        left = RIGHT_MM - 44 + 24 * place
        sheet.rect(left, y - 9.4, 3, 3, ink)
        sheet.text(left + 4.6, y - 7, name, faces.SANS, 7)
    slot = width / 12
    for month in range(12):
        for series, ink in enumerate((quay.TEAL, quay.APRICOT)):
            tall = round(height * kilos[series, month] / ticks[-1], 1)
            left = round(x + slot * month + 1.3 + 5.2 * series, 1)
            sheet.rect(left, y + height - tall, 5.0, tall, ink)
            top, label = y + height - tall - 1.0, f"{kilos[series, month]:,.0f}"
            sheet.text(left + 2.5, top, label, faces.SANS, 4.6, ink=inks.GREY, align="centre")
        sheet.text(x + slot * (month + 0.5), y + height + 4, _MONTHS[month], faces.SANS, 6.8, align="centre")


def _lines(sheet: Sheet, x: float, y: float, width: float, height: float, index: NDArray[np.float64]) -> None:
    sheet.text(LEFT_MM, y - 7, "Price of green coffee, January 2022 = 100", faces.BOLD, 11)
    low = 20.0 * math.floor((index.min() - 4) / 20)
    high = 20.0 * math.ceil((index.max() + 4) / 20)
    _frame(sheet, x, y, width, height, np.arange(low, high + 1, 20))
    for year in range(4):
        across = x + width * year / 3
        sheet.rule(across, y + height, across, y + height + 1.5, inks.BLACK, 0.6)
        if year < 3:
            sheet.text(across + width / 6, y + height + 4, str(2022 + year), faces.SANS, 6.8, align="centre")
    styles = (("Brazil", quay.TEAL, ()), ("Ethiopia", inks.EMBER, (5, 1.6)), ("Kenya", quay.BEAN, (1.4, 1.4)))
    for place, (series, (name, ink, dash)) in enumerate(zip(index, styles, strict=True)):
        months = x + width * np.arange(36) / 35
        levels = y + height * (1 - (series - low) / (high - low))
        points = [(float(a), float(b)) for a, b in zip(months, levels, strict=True)]
        sheet.canvas.setStrokeColor(inks.colour(ink))
        sheet.canvas.setLineWidth(1.3)
        sheet.canvas.setLineJoin(1)
        sheet.canvas.setDash(*([dash] if dash else []))
        sheet.canvas.drawPath(sheet.path(points, closed=False), stroke=1, fill=0)
        left = x + 3 + 26 * place
        sheet.canvas.line(*sheet.at(left, y + height + 10.4), *sheet.at(left + 8, y + height + 10.4))
        sheet.canvas.setDash()
        sheet.text(left + 10, y + height + 11.2, name, faces.SANS, 7)


def _pie(sheet: Sheet, span: tuple[float, float], y: float, shares: NDArray[np.float64]) -> None:
    left, width = span
    sheet.text(left, y - 7, "Where it was sold", faces.BOLD, 11)
    radius, start = width / 2 - 1, 90.0
    centre_x, centre_y = left + width / 2, y + radius + 1
    for share, ink in zip(shares, _CHANNEL_INKS, strict=True):
        sweep = -360.0 * float(share)
        path = sheet.canvas.beginPath()
        x, up = sheet.at(centre_x, centre_y)
        reach = sheet.at(centre_x + radius, centre_y)[0] - x
        path.moveTo(x, up)
        path.arcTo(x - reach, up - reach, x + reach, up + reach, start, sweep)
        path.close()
        sheet.canvas.setFillColor(inks.colour(ink))
        sheet.canvas.setStrokeColor(inks.colour(inks.PAPER))
        sheet.canvas.setLineWidth(1.0)
        sheet.canvas.drawPath(path, stroke=1, fill=1)
        start += sweep
    for place, (name, share, ink) in enumerate(zip(_CHANNELS, shares, _CHANNEL_INKS, strict=True)):
        line = y + 2 * radius + 9 + 5.6 * place
        sheet.rect(left, line - 2.8, 3.4, 3.4, ink)
        sheet.text(left + 6, line, name, faces.SANS, 7)
        sheet.text(left + width, line, f"{100 * share:.1f} %", faces.SANS, 7, align="right")
