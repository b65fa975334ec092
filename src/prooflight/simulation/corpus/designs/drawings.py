"""Line work: music, maps, plans, circuits, puzzles, wire frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.simulation.corpus.designs.chance import count, often, pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle, Frame
from prooflight.simulation.corpus.designs.inks import BLACK, PAPER, Ink, between, grey, lighter
from prooflight.simulation.corpus.designs.photographs import clouds

if TYPE_CHECKING:
    from prooflight.simulation.corpus.designs.sheet import Sheet


def music(
    sheet: Sheet,
    rng: np.random.Generator,
    design: DesignStyle,
    x: float,
    y: float,
    width: float,
    space: float,
) -> float:
    """Draw one staff with notes, ``space`` mm between its lines, and return its lower edge. [mm]"""
    bars, ink = count(rng, 3, 6), design.palette.text
    for line in range(5):
        sheet.rule(x, y + line * space, width, ink, 0.35)
    clef = np.linspace(0, 4.5 * np.pi, 60)
    spiral = np.stack([np.cos(clef) * (0.3 + 0.1 * clef), 3.0 - clef * 0.32 + np.sin(clef) * 0.9], axis=1)
    sheet.line(np.array([x + 2.5 * space, y]) + space * spiral, ink, 1.0)
    for bar in range(bars):
        start, wide = x + 5 * space + bar * (width - 5 * space) / bars, (width - 5 * space) / bars
        sheet.upright(start + wide, y, 4 * space, ink, 0.6)
        notes, beamed = count(rng, 2, 8), often(rng, 0.5)
        heights = np.clip(np.cumsum(rng.integers(-3, 4, notes)) + count(rng, 0, 7), -3, 11)
        beam = y - 2.6 * space
        for note, height in enumerate(heights.tolist()):
            at, level = start + (note + 0.6) * wide / (notes + 0.4), y + (8 - height) * space / 2
            hollow = not beamed and rng.random() < 0.3
            sheet.ellipse(at, level, 0.62 * space, 0.44 * space, ink, turn_deg=-20)
            if hollow:
                sheet.ellipse(at, level, 0.4 * space, 0.2 * space, PAPER, turn_deg=-35)
            top = beam if beamed else level - 3.4 * space
            sheet.upright(at + 0.56 * space, top, level - top, ink, 0.5)
            for ledger in range(5, (13 - height) // 2 if height < 0 else 5):
                sheet.rule(at - space, y + ledger * space, 2 * space, ink, 0.35)
        if beamed:
            left, right = start + 0.6 * wide / (notes + 0.4), start + (notes - 0.4) * wide / (notes + 0.4)
            sheet.rect(left + 0.5 * space, beam, right - left, 0.5 * space, ink)
    return y + 4 * space


def contour_map(frame: Frame) -> None:
    """Draw a relief in contour lines with water, woods, roads and names."""
    sheet, rng, design, x, y, width, height = frame
    step = 0.8
    rows, columns = round(height / step), round(width / step)
    land = clouds(rng, rows, columns, falling=1.6, coarse=some(rng, 2, 5))
    colour = not design.separation.black_alone
    tone = np.digitize(land, np.linspace(-1.6, 2.0, 9)).astype(np.float32) / 9
    if colour:
        tinted = between(design.palette.tint, lighter(design.palette.third, 0.5), tone)
        sheet.picture(x, y, width, height, tinted.astype(np.uint8))
    sea = land < some(rng, -1.2, -0.7)
    _areas(sheet, sea, x, y, step, lighter(design.palette.strong, 0.35) if colour else grey(0.2))
    for level in np.linspace(-1.5, 2.4, count(rng, 9, 22)):
        _areas(sheet, land > level, x, y, step, lighter(design.palette.strong, 0.7), line_pt=0.35)
    for _ in range(count(rng, 3, 8)):
        _road(Frame(sheet, rng, design, x, y, width, height))
    for _ in range(count(rng, 8, 30)):
        place = x + some(rng, 0.03, 0.85) * width, y + some(rng, 0.05, 0.97) * height
        sheet.disc(place[0] - 1.2, place[1] - 0.8, 0.6, design.palette.text)
        sheet.draw_text(
            *place, design.voice.title(rng, 1, 1)[:12], design.voice.italic, pick(rng, (5.5, 6.5, 9))
        )
    sheet.frame(x, y, width, height, design.palette.text, 0.9)


def _areas(
    sheet: Sheet, inside: np.ndarray, x: float, y: float, step: float, ink: Ink, *, line_pt: float = 0.0
) -> None:
    outlines, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    for outline in outlines:
        points = np.array((x, y)) + (outline[:, 0] + 0.5) * step
        if len(points) > 8:
            kernel = np.ones(5) / 5  # takes the stairs out of a line that follows cells
            ring = np.pad(points, ((2, 2), (0, 0)), mode="wrap").T
            smooth = np.stack([np.convolve(place, kernel, "valid") for place in ring], axis=1)
            if line_pt:
                sheet.line(smooth, ink, line_pt, closed=True)
            else:
                sheet.polygon(smooth, ink)


def _road(frame: Frame) -> None:
    sheet, rng, design, x, y, width, height = frame
    along = np.linspace(0, 1, 80)
    across = np.clip(some(rng, 0.1, 0.9) + np.cumsum(rng.normal(0, 0.012, 80)), 0.005, 0.995)
    path = np.stack([along, across], axis=1) if often(rng, 0.5) else np.stack([across, along], axis=1)
    points, weight = path * (width, height) + (x, y), some(rng, 1.2, 3.5)
    sheet.line(points, design.palette.text, weight + 0.9)
    sheet.line(points, design.palette.bright if often(rng, 0.5) else PAPER, weight)


def street_map(frame: Frame) -> None:
    """Draw blocks of a town between its streets."""
    sheet, rng, design, x, y, width, height = frame
    sheet.rect(x, y, width, height, lighter(design.palette.tint, 0.8))
    turn = some(rng, -0.25, 0.25)

    def place(u: float, v: float) -> tuple[float, float]:
        left = x + width * min(max(u + turn * (v - 0.5) * 0.6, 0.0), 1.0)
        return left, y + height * min(max(v - turn * (u - 0.5) * 0.6, 0.0), 1.0)

    across = np.cumsum(rng.uniform(0.03, 0.13, 30))
    down = np.cumsum(rng.uniform(0.03, 0.1, 30))
    gap = 0.008
    for u0, u1 in zip(across[across < 1], across[1:], strict=False):
        for v0, v1 in zip(down[down < 1], down[1:], strict=False):
            kind = rng.random()
            ink = (
                design.palette.third if kind < 0.08 else lighter(design.palette.strong, some(rng, 0.15, 0.4))
            )
            corners = [(u0 + gap, v0 + gap), (u1 - gap, v0 + gap), (u1 - gap, v1 - gap), (u0 + gap, v1 - gap)]
            sheet.polygon([place(float(u), float(v)) for u, v in corners], ink)
            if kind > 0.75:
                at = place(float(u0) + 2 * gap, (float(v0) + float(v1)) / 2)
                sheet.draw_text(
                    *at, design.voice.title(rng, 1, 1)[:8], design.voice.face, 5, design.palette.text
                )
    for _ in range(count(rng, 1, 3)):
        _road(Frame(sheet, rng, design, x, y, width, height))
    sheet.frame(x, y, width, height, design.palette.text, 0.7)


def floor_plan(frame: Frame) -> None:
    """Draw rooms with walls, doors, dimensions and names."""
    sheet, rng, design, x, y, width, height = frame
    _rooms(Frame(sheet, rng, design, x, y, width, height), depth=count(rng, 3, 4))
    sheet.frame(x, y, width, height, BLACK, 3.0)
    below = y + height + 5
    sheet.rule(x, below, width, BLACK, 0.4)
    for tick in np.linspace(x, x + width, count(rng, 4, 8)).tolist():
        sheet.upright(tick, below - 1.4, 2.8, BLACK, 0.5)
        sheet.draw_text(tick + 1, below - 0.8, design.voice.number(rng), design.voice.figures, 5.5)


def _rooms(frame: Frame, *, depth: int) -> None:
    sheet, rng, design, x, y, width, height = frame
    if depth == 0 or min(width, height) < 22:
        if often(rng, 0.25):
            sheet.rect(x + 1, y + 1, width - 2, height - 2, design.palette.tint)
        at, name = (x + width / 2, y + height / 2), design.voice.title(rng, 1, 1)[:10]
        sheet.draw_text(*at, name, design.voice.face, 7, design.palette.text, align="centre")
        area = f"{width * height / 100:.1f}"
        sheet.draw_text(
            at[0], at[1] + 3.4, area, design.voice.figures, 6, design.palette.text, align="centre"
        )
        return
    share, door = some(rng, 0.35, 0.65), some(rng, 2.5, 5)
    if width > height:
        cut = x + share * width
        gap = some(rng, y + 3, y + height - 3 - 2 * door)
        sheet.upright(cut, y, gap - y, BLACK, 2.0)
        sheet.upright(cut, gap + door, y + height - gap - door, BLACK, 2.0)
        sheet.ellipse(cut, gap, door, door, BLACK, line_pt=0.35, from_deg=0, to_deg=90)
        _rooms(Frame(sheet, rng, design, x, y, share * width, height), depth=depth - 1)
        _rooms(Frame(sheet, rng, design, cut, y, width - share * width, height), depth=depth - 1)
    else:
        cut = y + share * height
        gap = some(rng, x + 3, x + width - 3 - 2 * door)
        sheet.rule(x, cut, gap - x, BLACK, 2.0)
        sheet.rule(gap + door, cut, x + width - gap - door, BLACK, 2.0)
        sheet.ellipse(gap, cut, door, door, BLACK, line_pt=0.35, from_deg=0, to_deg=90)
        _rooms(Frame(sheet, rng, design, x, y, width, share * height), depth=depth - 1)
        _rooms(Frame(sheet, rng, design, x, cut, width, height - share * height), depth=depth - 1)


def wire_frame(frame: Frame) -> None:
    """Draw a surface or ring of lines in perspective."""
    sheet, rng, design, x, y, width, height = frame
    around, across = (np.linspace(0, 2 * np.pi, count(rng, *lines)) for lines in ((28, 60), (14, 30)))
    u, v = np.meshgrid(around, across)
    thick, tilt, lobes = some(rng, 0.2, 0.5), some(rng, 0.4, 1.2), count(rng, 0, 5)
    radius = 1 + thick * np.cos(v) + 0.12 * np.sin(lobes * u)
    if often(rng, 0.5):  # a surface over a plane instead of a ring
        waves, phases = rng.uniform(0.5, 2.0, 2), rng.uniform(0, 6, 2)
        lift = np.sin(waves[0] * u + phases[0]) * np.cos(waves[1] * v + phases[1])
        flat = np.stack([(u - v) * 0.6, (u + v) * 0.3 * np.cos(tilt) - lift - 2.2 * np.cos(tilt)], axis=-1)
    else:
        lift = radius * np.sin(u) * np.cos(tilt) + thick * np.sin(v) * np.sin(tilt)
        flat = np.stack([radius * np.cos(u), lift], axis=-1)
    scaled = flat / np.abs(flat).max() * min(width, height) / 2 + (x + width / 2, y + height / 2)
    for line in (*scaled, *scaled.transpose(1, 0, 2)):
        sheet.line(line, design.palette.strong, 0.35)


def crossword(
    sheet: Sheet, rng: np.random.Generator, design: DesignStyle, x: float, y: float, side: float
) -> None:
    """Draw a grid with black cells and numbers."""
    cells = 2 * count(rng, 5, 9) + 1
    dark = rng.random((cells, cells)) < 0.2
    dark |= dark[::-1, ::-1]
    pitch, number = side / cells, 1
    sheet.modules(x, y, pitch, dark, BLACK)
    for line in range(cells + 1):
        sheet.rule(x, y + line * pitch, side, BLACK, 0.6)
        sheet.upright(x + line * pitch, y, side, BLACK, 0.6)
    for row, column in np.argwhere(~dark & (rng.random((cells, cells)) < 0.4)).tolist():
        sheet.draw_text(x + column * pitch + 0.5, y + row * pitch + 2.1, str(number), design.voice.figures, 5)
        number += 1


def circuit(frame: Frame) -> None:
    """Draw parts joined by square-cornered wires, with their names."""
    sheet, rng, design, x, y, width, height = frame
    parts = rng.uniform((0.08, 0.08), (0.92, 0.92), (count(rng, 14, 34), 2)) * (width, height) + (x, y)
    for (x0, y0), (x1, y1) in zip(parts.tolist(), parts[1:].tolist(), strict=False):
        sheet.line([(x0, y0), (x1, y0), (x1, y1)], design.palette.text, 0.5)
        sheet.disc(x1, y0, 0.6, design.palette.text)
    for place, (left, top) in enumerate(parts.tolist()):
        wide, tall = some(rng, 4, 14), some(rng, 4, 10)
        sheet.rect(left - wide / 2, top - tall / 2, wide, tall, pick(rng, (PAPER, design.palette.tint)))
        sheet.frame(left - wide / 2, top - tall / 2, wide, tall, design.palette.strong, 0.8)
        name = f"{pick(rng, ('R', 'C', 'U', 'L', 'Q'))}{place + 1}"
        sheet.draw_text(left, top + 0.9, name, design.voice.figures, 6, design.palette.text, align="centre")
