"""Marks: the places of a run's defects on the sheet and along the paper path, from the journal's rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.inspection.common_cause import COLUMN_KINDS, SHEET_KINDS
from prooflight_line.run.places import around, gap_mm

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from prooflight.detectors.verdict import Region
    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.places import Box

SAME_MM: Final = 3.0
"""Distance below which two regions of a sheet are one mark, as for incidents (``common_cause.NEAR_MM``)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One defect on one sheet."""

    sheet: int
    x_mm: float
    """Middle, from the left edge of the printed page."""
    y_mm: float
    """Middle, from the top edge of the printed page."""
    across_mm: float
    """Middle across the paper path, from where the page's left edge is nominally."""
    along_mm: float
    """Middle along the paper path, from the camera's line 0."""
    width_mm: float
    height_mm: float
    kind: str
    score: float
    ink: str = ""
    """Letter of the ink that is off; empty: not known."""


def marks_of(records: Iterable[PageRecord], geometry: ScanGeometry) -> list[Mark]:
    """Return the marks of all misprints, in the order of the records.

    Regions that are near each other are one mark, but each region of a streak is a mark of its own: regions of a
    misprint that was judged a streak belong to it where they are in its column. Regions that describe the print
    as a whole (density, register, bands) are no marks. Sheets with faults of the paper path are left out, since
    their lines do not say where they were on it.
    """
    marks: list[Mark] = []
    for record in records:
        verdict = record.verdict
        if verdict.verdict != "misprint" or record.faults:
            continue
        shift = verdict.shift_mm or (0.0, 0.0)
        top = record.first_line * geometry.line_pitch_mm + geometry.lead_in_mm + shift[1]
        streak = verdict.regions[0] if verdict.kind in COLUMN_KINDS and verdict.regions else None
        boxes: list[tuple[Region, Box]] = []
        for region in verdict.regions:
            if region.kind in SHEET_KINDS:
                continue
            of_streak = streak is not None and _gap(region.x_mm, region.width_mm, streak) <= SAME_MM
            kind = verdict.kind or region.kind if of_streak else region.kind
            box = region.x_mm, region.y_mm, region.width_mm, region.height_mm
            near = None if kind in COLUMN_KINDS else _near(box, [one for _, one in boxes])
            if near is None:
                boxes.append((replace(region, kind=kind), box))
            else:
                boxes[near] = boxes[near][0], around(boxes[near][1], box)
        for region, (left, upper, width, height) in boxes:
            x, y = left + width / 2, upper + height / 2
            mark = Mark(
                sheet=record.sheet,
                x_mm=x,
                y_mm=y,
                across_mm=x + shift[0],
                along_mm=top + y,
                width_mm=width,
                height_mm=height,
                kind=region.kind,
                score=region.score,
                ink=region.ink,
            )
            marks.append(mark)
    return marks


def _gap(left_mm: float, width_mm: float, other: Region) -> float:
    return max(left_mm - other.x_mm - other.width_mm, other.x_mm - left_mm - width_mm)


def _near(box: Box, others: Sequence[Box]) -> int | None:
    """Return the first of other boxes that is less than ``SAME_MM`` from a box; None: none is."""
    return next((at for at, one in enumerate(others) if gap_mm(box, one, column=False) < SAME_MM), None)


def sheet_distance_mm(records: Sequence[PageRecord], geometry: ScanGeometry) -> float | None:
    """Return the median distance along the paper path from one sheet to the next; None: fewer than two came."""
    came = [record for record in records if record.first_line > 0 or record.sheet == 0]
    sheets = np.array([record.sheet for record in came])
    lines = np.array([record.first_line for record in came])
    span = np.diff(sheets)
    steps = np.diff(lines)[span > 0] / span[span > 0]
    steps = steps[steps > 0]
    return float(np.median(steps)) * geometry.line_pitch_mm if steps.size else None
