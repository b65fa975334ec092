"""How surely the places and amounts of a journal are known, from prints with known defects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.cmyk import NAME_OF_INK
from prooflight_line.causes.marks import marks_of
from prooflight_line.causes.nozzles import streaks_of
from prooflight_line.journal.records import PageRecord
from prooflight_studies.plant.defects import NEAR_MM
from prooflight_studies.plant.prints import REGISTER_MM, WEAKER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.causes.marks import Mark
    from prooflight_studies.plant.prints import DefectPrint


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of one measured quantity."""

    what: str
    unit: str
    prints: int
    measured: int
    """Prints on which it was measured at all."""
    bias: float | None
    sd: float | None
    most: float | None
    """Absolute error that 95 of 100 stay below."""


def errors_of(prints: Sequence[DefectPrint], geometry: ScanGeometry) -> list[Errors]:
    """Return the errors of places of spots and streaks, and of amounts of inks."""
    spots = [one for one in prints if one.what == "spot"]
    found = [(one, mark) for one in spots if (mark := _mark(one, geometry)) is not None]
    rows = [
        _errors(
            "position of a spot, across", "mm", len(spots), [mark.x_mm - one.x_mm for one, mark in found]
        ),
        _errors("position of a spot, along", "mm", len(spots), [mark.y_mm - one.y_mm for one, mark in found]),
    ]
    for what, name in (("nozzle", "failing nozzle"), ("scratch", "line of 0.4 mm")):
        own = [one for one in prints if one.what == what]
        off = [place - one.x_mm for one in own if (place := _streak_mm([one], geometry)) is not None]
        rows.append(_errors(f"position of a {name}, one sheet", "mm", len(own), off))
    density = [one for one in prints if one.what == "density"]
    off = [100 * (amount - (WEAKER - 1)) for amount in _amounts(density, "gain-{}")]
    rows.append(_errors("density of an ink that is 15 % weaker", "%", len(density), off))
    register = [one for one in prints if one.what == "register"]
    off = [amount - REGISTER_MM for amount in _amounts(register, "register-{}-x")]
    rows.append(_errors("register of a plane that is 0.3 mm off", "mm", len(register), off))
    good = [one.amounts for one in prints if one.what == "good"]
    for name, scale, unit in (("gain", 100.0, "%"), ("register", 1.0, "mm")):
        values = [scale * value for amounts in good for key, value in amounts.items() if key.startswith(name)]
        rows.append(
            _errors(f"{name} of good prints, including their actual variation", unit, len(good), values)
        )
    return rows


def _errors(what: str, unit: str, prints: int, off: Sequence[float]) -> Errors:
    errors: NDArray[np.float64] = np.array(off)
    several = errors.size > 1
    measured = prints if "good prints" in what else errors.size
    return Errors(
        what=what,
        unit=unit,
        prints=prints,
        measured=measured,
        bias=float(errors.mean()) if several else None,
        sd=float(errors.std(ddof=1)) if several else None,
        most=float(np.quantile(np.abs(errors), 0.95)) if several else None,
    )


def _mark(one: DefectPrint, geometry: ScanGeometry) -> Mark | None:
    """Return the mark that is nearest to the defect; None: none is near."""
    marks = marks_of([as_record(one, 0)], geometry)
    off = [max(abs(mark.x_mm - one.x_mm), abs(mark.y_mm - one.y_mm)) for mark in marks]
    at = int(np.argmin(off)) if off else -1
    return marks[at] if off and off[at] < NEAR_MM else None


def _streak_mm(prints: Sequence[DefectPrint], geometry: ScanGeometry) -> float | None:
    records = [as_record(one, sheet) for sheet, one in enumerate(prints)]
    streaks = streaks_of(marks_of(records, geometry), least_sheets=1)
    near = [one for one in streaks if abs(one.x_mm - prints[0].x_mm) < NEAR_MM]
    return near[0].x_mm if near else None


def _amounts(prints: Sequence[DefectPrint], name: str) -> list[float]:
    """Return what a run records of the ink that is off, of the prints on which it records something."""
    keys = [(one, name.format(NAME_OF_INK[one.ink])) for one in prints]
    return [one.amounts[key] for one, key in keys if key in one.amounts]


def as_record(one: DefectPrint, sheet: int) -> PageRecord:
    """Return the journal's row of a print; its page lies in its place."""
    verdict = replace(one.verdict, shift_mm=(0.0, 0.0))
    return PageRecord(sheet=sheet, job_page=sheet, verdict=verdict, late=False, first_line=0, time_s=0.0)
