"""Figure next to the second page of each chapter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prooflight.simulation.corpus.sample_job import copy_text, faces, inks
from prooflight.simulation.corpus.sample_job.pictures import Shot, develop

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.copy_text import Chapter
    from prooflight.simulation.corpus.sample_job.inks import Ink
    from prooflight.simulation.corpus.sample_job.sheet import Sheet


def in_margin(sheet: Sheet, chapter: Chapter, x: float, y: float, width: float) -> None:
    """Draw the figure that belongs to a chapter into the margin column at (x, y). [mm]"""
    draw = {
        copy_text.LIGHT.number: light_in_paper,
        copy_text.INKS.number: three_discs,
        copy_text.RUN.number: coins,
    }
    draw[chapter.number](sheet, x, y, width)


def below(sheet: Sheet, chapter: Chapter, x: float, bottom: float, width: float) -> None:
    """Fill the foot of a chapter's last page, where it has one to fill, down to ``bottom``. [mm]"""
    draw = {copy_text.INKS.number: screens, copy_text.RUN.number: photographer}
    if chapter.number in draw:
        draw[chapter.number](sheet, x, bottom, width)


def light_in_paper(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw a section through a sheet: a ray that enters near a dot of ink and leaves through it."""
    surface, depth = y + 24, 17.0
    sheet.rect(x, surface, width, depth, inks.SAND)
    sheet.know(x, surface + depth - 2, width, 2, inks.SAND)
    for start in (9.0, 35.0):
        sheet.rect(x + start, surface - 1.6, 12, 1.6, inks.percent(100, 0, 0, 0))
        sheet.know(x + start + 9, surface - 1.6, 3, 1.6, inks.percent(100, 0, 0, 0))
    rays = (
        ((3.0, -20.0), (6.5, 0.0), (5.2, 6.0), (9.0, 11.0), (11.5, 7.0), (14.0, 0.0), (16.5, -18.0)),
        ((26.0, -20.0), (28.0, 0.0), (31.5, 8.0), (26.0, 12.5), (23.5, 6.0), (24.5, 0.0), (23.0, -18.0)),
        ((44.0, -20.0), (40.5, 0.0), (38.0, 6.5), (44.0, 10.5), (50.0, 5.5), (50.6, 0.0), (51.0, -18.0)),
    )
    for ray in rays:
        points = [(x + across, surface + down) for across, down in ray]
        sheet.canvas.setStrokeColor(inks.colour(inks.EMBER))
        sheet.canvas.setLineWidth(0.7)
        sheet.canvas.setLineJoin(1)
        sheet.canvas.drawPath(sheet.path(points, closed=False), stroke=1, fill=0)
        (tip_x, tip_y), (tail_x, _) = points[-1], points[-2]
        lean = (tip_x - tail_x) * 0.06
        sheet.polygon(
            [(tip_x + lean, tip_y - 1.2), (tip_x - 0.9, tip_y + 1), (tip_x + 0.9, tip_y + 1)], inks.EMBER
        )
    text = (
        "Three ways through the same sheet. The ray on the left goes in by clean paper and out through ink; the "
        "middle one meets no ink at all; the one on the right pays on the way in. Seen from above, the shadow of "
        "each dot is wider than the dot."
    )
    sheet.paragraph(x, surface + depth + 3, width, text, faces.caption())


def three_discs(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw cyan, magenta and yellow discs that overprint each other."""
    radius = 15.0
    middle, full = x + width / 2, inks.FULL
    discs = (
        (middle, y + radius, (full, 0, 0, 0)),
        (middle - 9, y + radius + 15, (0, full, 0, 0)),
        (middle + 9, y + radius + 15, (0, 0, full, 0)),
    )
    with sheet.overprinting():
        for across, down, ink in discs:
            sheet.circle(across, down, radius, ink)
    sheet.know(middle - 2, y + 22, 4, 4, (full, full, full, 0), "overprint")
    sheet.know(middle - 3, y + 36, 6, 3, (0, full, full, 0), "overprint")
    sheet.know(middle - 3, y + 4, 6, 6, (full, 0, 0, 0))
    text = (
        "Cyan, magenta and yellow, each laid over the other two. Where two meet there is blue, red or green; in the "
        "middle, where all three do, the untidy brown that the key plate exists to replace."
    )
    sheet.paragraph(x, y + 49, width, text, faces.caption())


def coins(sheet: Sheet, x: float, y: float, width: float) -> None:
    """Draw a photograph of coins."""
    shot = Shot(
        name="coins", centre=(0.25, 0.3), zoom=1.5, tone=(1.1, 1.0, 0.82), black_point=20, white_point=235
    )
    sheet.picture(x, y, develop(shot, width, 72))
    text = (
        "Greek coins found at Pompeii. Each was struck by hand, and no two are alike; yet anyone who had handled a "
        "thousand could tell a bad one at a glance, with no good one beside it."
    )
    sheet.paragraph(x, y + 75, width, text, faces.caption())


def screens(sheet: Sheet, x: float, bottom: float, width: float) -> None:
    """Draw the dots of each ink at its angle, enlarged, and the four of them combined."""
    gap = 3.0
    side = (width - 4 * gap) / 5
    top = bottom - 11 - side
    full = inks.FULL
    plates = ((15.0, (full, 0, 0, 0)), (75.0, (0, full, 0, 0)), (0.0, (0, 0, full, 0)), (45.0, inks.BLACK))
    for place, (angle, ink) in enumerate(plates):
        left = x + place * (side + gap)
        with sheet.overprinting():
            _dots(sheet, left, top, side, angle, ink)
            _dots(sheet, x + 4 * (side + gap), top, side, angle, ink)
        sheet.label(left, top - 2, f"{angle:g}°")
    sheet.label(x + 4 * (side + gap), top - 2, "together")
    text = "The four screens of a process tint, ten times enlarged, at their own angles."
    sheet.paragraph(x, bottom - 8, width, text, faces.caption())


def _dots(sheet: Sheet, left: float, top: float, side: float, angle_deg: float, ink: Ink) -> None:
    pitch, radius = 1.7, 0.56
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    reach = math.ceil(side / pitch)
    for row in range(-reach, reach + 1):
        for step in range(-reach, reach + 1):
            across = side / 2 + pitch * (step * cos - row * sin)
            down = side / 2 + pitch * (step * sin + row * cos)
            if radius <= across <= side - radius and radius <= down <= side - radius:
                sheet.circle(left + across, top + down, radius, ink)


def photographer(sheet: Sheet, x: float, bottom: float, width: float) -> None:
    """Draw a photograph across the measure."""
    height = 76.0
    shot = Shot(name="camera", centre=(0.5, 0.3), tone=(1.05, 1.0, 0.93), gamma=1.1, soften=0.7)
    sheet.picture(x, bottom - height - 8, develop(shot, width, height))
    sheet.paragraph(x, bottom - 6, width, "Somebody still has to look.", faces.caption())
