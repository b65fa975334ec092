"""Charts: bars, lines, areas, pies, clouds of points."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from prooflight.simulation.corpus.designs.chance import count, often, pick_weighted, some
from prooflight.simulation.corpus.designs.design_style import Frame
from prooflight.simulation.corpus.designs.inks import PAPER, grey, lighter
from prooflight.simulation.corpus.designs.setting import cut

if TYPE_CHECKING:
    Plot = Callable[[Frame], None]


def chart(frame: Frame) -> None:
    """Draw a chart of a random kind with its title, in a box."""
    sheet, rng, design, x, y, width, height = frame
    size = float(np.clip(height / 9, 6, 10))
    if often(rng, 0.3):
        sheet.rect(x, y, width, height, lighter(design.palette.tint, 0.7))
    title = cut(design.voice.title(rng, 2, 5), design.voice.bold, size, width - 4)
    sheet.draw_text(x + 2, y + 5, title, design.voice.bold, size, design.palette.strong)
    plot = pick_weighted(rng, KINDS)
    plot(Frame(sheet, rng, design, x + 10, y + 9, width - 13, height - 17))


def _axes(frame: Frame) -> None:
    sheet, rng, design, x, y, width, height = frame
    steps, top = count(rng, 3, 7), 10.0 ** count(rng, 0, 4) * count(rng, 1, 9)
    for step in range(steps + 1):
        down = y + height * (1 - step / steps)
        sheet.rule(x, down, width, grey(0.25 if step else 0.9), 0.35)
        value = f"{top * step / steps:.3g}"
        sheet.draw_text(x - 1, down + 0.8, value, design.voice.figures, 5.5, grey(0.8), align="right")
    sheet.upright(x, y, height, grey(0.9), 0.5)
    names = count(rng, 3, 6)
    for place in range(names):
        name = cut(design.voice.title(rng, 1, 1), design.voice.face, 5.5, 0.9 * width / names)
        at = x + width * (place + 0.5) / names
        sheet.draw_text(at, y + height + 3, name, design.voice.face, 5.5, grey(0.8), align="centre")


def bars(frame: Frame) -> None:
    """Draw groups of upright bars, or stacked ones."""
    sheet, rng, design, x, y, width, height = frame
    _axes(Frame(sheet, rng, design, x, y, width, height))
    groups, series, stacked = count(rng, 4, 14), count(rng, 1, 4), often(rng, 0.4)
    step = width / groups
    for group in range(groups):
        foot = y + height
        for place in range(series):
            value = some(rng, 0.1, 1.0) * height * (1 / series if stacked else 0.97)
            colour = design.palette.chart[place]
            if stacked:
                sheet.rect(x + (group + 0.18) * step, foot - value, 0.64 * step, value, colour)
                foot -= value
            else:
                each = 0.72 * step / series
                sheet.rect(x + (group + 0.14) * step + place * each, foot - value, 0.92 * each, value, colour)


def lines(frame: Frame) -> None:
    """Draw series as lines, sometimes with marks, sometimes filled below."""
    sheet, rng, design, x, y, width, height = frame
    _axes(Frame(sheet, rng, design, x, y, width, height))
    points, filled, marked = count(rng, 6, 60), often(rng, 0.3), often(rng, 0.4)
    along = np.linspace(0, width, points)
    for place in range(count(rng, 1, 5)):
        walk = np.cumsum(rng.normal(some(rng, -0.02, 0.02), 0.08, points)) + some(rng, 0.2, 0.8)
        values = y + height * (1 - np.clip(walk, 0.02, 0.98))
        line, colour = np.stack([x + along, values], axis=1), design.palette.chart[place]
        if filled:
            sheet.polygon([*line.tolist(), (x + width, y + height), (x, y + height)], lighter(colour, 0.6))
        sheet.line(line, colour, some(rng, 0.5, 2.0))
        if marked and points < 20:
            sheet.dots(line, some(rng, 0.5, 1.0), colour)


def pie(frame: Frame) -> None:
    """Draw a pie or ring with its key."""
    sheet, rng, design, x, y, width, height = frame
    shares = rng.dirichlet(np.full(count(rng, 3, 6), 2.0))
    radius = min(height, 0.55 * width) / 2
    at, turn = (x + radius, y + radius), some(rng, 0, 360)
    for place, share in enumerate(shares):
        colour = design.palette.chart[place]
        sheet.ellipse(*at, radius, radius, colour, from_deg=turn, to_deg=turn + 360 * float(share))
        turn += 360 * float(share)
        key = y + 4 + 5.5 * place
        if key < y + height:
            sheet.rect(x + 2 * radius + 5, key - 2.4, 3, 3, colour)
            text = f"{100 * share:.0f} % {design.voice.title(rng, 1, 2)}"
            text = cut(text, design.voice.face, 6.5, width - 2 * radius - 9)
            sheet.draw_text(x + 2 * radius + 10, key, text, design.voice.face, 6.5, design.palette.text)
    if often(rng, 0.4):
        sheet.disc(*at, radius * some(rng, 0.4, 0.65), PAPER)


def points(frame: Frame) -> None:
    """Draw clouds of points."""
    sheet, rng, design, x, y, width, height = frame
    _axes(Frame(sheet, rng, design, x, y, width, height))
    for place in range(count(rng, 1, 3)):
        middle, spread = rng.uniform(0.3, 0.7, 2), rng.uniform(0.05, 0.18, 2)
        cloud = np.clip(rng.normal(middle, spread, (count(rng, 30, 140), 2)), 0.02, 0.98)
        sheet.dots(cloud * (width, height) + (x, y), some(rng, 0.35, 0.8), design.palette.chart[place])


def map_of_values(frame: Frame) -> None:
    """Draw squares whose tint shows a value."""
    sheet, rng, design, x, y, width, height = frame
    rows, columns = count(rng, 5, 14), count(rng, 6, 20)
    values = np.clip(rng.random((rows, columns)) * 0.6 + np.linspace(0, 0.4, columns), 0, 1)
    wide, tall = width / columns, height / rows
    for row, column in np.ndindex(rows, columns):
        tint = lighter(design.palette.strong, float(values[row, column]))
        sheet.rect(x + column * wide, y + row * tall, wide * 0.94, tall * 0.94, tint)


KINDS: dict[Plot, float] = {bars: 3.0, lines: 3.0, pie: 2.0, points: 1.0, map_of_values: 1.0}
"""Frequency of each kind."""
