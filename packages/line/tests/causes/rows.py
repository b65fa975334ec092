"""Journal rows with marks at chosen places of the paper path."""

from __future__ import annotations

from prooflight.detectors.verdict import Region, Verdict
from prooflight.scans.geometry import ScanGeometry
from prooflight_line.journal.records import PageRecord

GEOMETRY = ScanGeometry(pixels=2048, pixel_pitch_mm=0.1, line_pitch_mm=0.1, lead_in_mm=2.0, lead_out_mm=2.0)
DISTANCE_MM = 310.0
PAGE_MM = 297.0


def region(
    x: float, y: float, *, kind: str = "spots-voids", width: float = 1.0, height: float = 1.0, ink: str = ""
) -> Region:
    """Return a region about a middle."""
    return Region(
        x_mm=x - width / 2,
        y_mm=y - height / 2,
        width_mm=width,
        height_mm=height,
        score=9.0,
        kind=kind,
        ink=ink,
    )


def row(sheet: int, *regions: Region, shift: tuple[float, float] = (0.0, 0.0), **more: object) -> PageRecord:
    """Return the row of a sheet; with regions it is a misprint of the first one's kind."""
    kind = regions[0].kind if regions else None
    verdict = Verdict(
        page=f"p{sheet + 1:04}",
        verdict="misprint" if regions else "good",
        kind=kind,
        regions=regions,
        shift_mm=shift,
    )
    told = {"late": False, "first_line": round(sheet * DISTANCE_MM / 0.1), "time_s": 0.2 * sheet} | more
    return PageRecord(sheet=sheet, job_page=sheet, verdict=verdict, **told)  # type: ignore[arg-type]


def rolled(distance_mm: float, *, sheets: int, start_mm: float = 40.0, x: float = 70.0) -> list[PageRecord]:
    """Return sheets that a roller of this circumference marks at every turn; sheets lie up to 0.5 mm off."""
    marks: dict[int, list[Region]] = {}
    shifts = [(0.0, 0.5 * (-1) ** sheet) for sheet in range(sheets)]
    place = start_mm
    while place < sheets * DISTANCE_MM:
        sheet = int(place / DISTANCE_MM)
        y = place - sheet * DISTANCE_MM - GEOMETRY.lead_in_mm - shifts[sheet][1]
        if 0 < y < PAGE_MM:
            marks.setdefault(sheet, []).append(region(x, y))
        place += distance_mm
    return [row(sheet, *marks.get(sheet, ()), shift=shifts[sheet]) for sheet in range(sheets)]
