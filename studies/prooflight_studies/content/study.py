"""Codes on prints of the press world: whether they are read, the damage they tolerate, and the cost of reading."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.detectors.base import PlannedPage
from prooflight.inspection.codes.finding import page_codes
from prooflight.inspection.codes.reading import read_codes
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_studies.content.sheets import DAMAGES, code_sheet, damaged
from prooflight_studies.harness.page import plain, write_page
from prooflight_studies.harness.parts import stored_results
from prooflight_studies.paper.study import at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from prooflight.detectors.verdict import Code
    from prooflight.inspection.codes.finding import PageCode
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_studies.content.numbers import TextResults
    from prooflight_studies.content.sheets import Damage, Placed

PITCHES_MM: Final = (0.105, 0.127)
SHEETS: Final = 40
"""Number of sheets: a little over 500 codes at each pitch, 15 a sheet less those that fit no cell."""
SHEETS_A_DAY: Final = 6
QUICK: Final = 2
SPECIMEN_SEED: Final = 1
NAMES: Final = {
    "EAN13": "EAN-13",
    "EAN8": "EAN-8",
    "UPCA": "UPC-A",
    "Code128": "Code 128",
    "Code39": "Code 39",
    "ITF": "ITF",
    "QRCode": "QR Code",
    "DataMatrix": "Data Matrix",
}
WORN: Final = 1.5
"""Grade below which a code is a warning: C."""
READ_GOAL: Final = 0.998
COST_GOAL_MS: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One code on one print."""

    pitch_mm: float
    symbology: str
    module_mm: float
    found: bool
    """Whether the code was found in the lines that the camera must see of the page."""
    asked: bool
    """Whether inspection reads it on scans."""
    damage: Damage | None
    right: bool = False
    misread: bool = False
    grade: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Processor time for one sheet, on one core. [ms]"""

    finding_ms: float
    """Time to find the codes, once a design."""
    reading_ms: float
    """Time to read all its codes, every sheet."""
    codes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentResults:
    """Results of the study, as the page shows them."""

    seed: int
    sheets: int
    days: int
    read_goal: float
    cost_goal_ms: float
    read: list[dict[str, float | int | str]]
    """Good prints by pitch and symbology."""
    totals: list[dict[str, float | int | str]]
    """Good prints by pitch."""
    too_fine: list[dict[str, float | int | str]]
    """Good prints by pitch and module."""
    damaged: list[dict[str, float | int | str]]
    """Damaged prints by pitch and damage."""
    finding_ms: float
    reading_ms_a_code: float
    reading_ms_a_page: float
    codes_a_page: float


def run_content_study(
    out: Path, *, seed: int, quick: bool = False, progress: Callable[[str], None] = lambda _: None
) -> ContentResults:
    """Print sheets of codes at both pitches, good and damaged, and read them; writes content.md."""
    sheets = QUICK if quick else SHEETS
    rows: list[Row] = []
    costs: list[Cost] = []
    for pitch_mm in PITCHES_MM:
        progress(f"building a press with a pixel pitch of {pitch_mm} mm")
        press = build_press(at_pitch(PressFile.prototype(), pitch_mm), seed=SPECIMEN_SEED)
        for number in range(1, sheets + 1):
            progress(f"{pitch_mm} mm: sheet {number} of {sheets}")
            more, cost = _sheet(press, pitch_mm, number, seed=seed)
            rows += more
            costs.append(cost)
    results = _results(rows, costs, seed=seed, sheets=sheets)
    page = out / "content.md"
    write_page(page, "content", plain(results) | {"text": stored_results(page).get("text")})
    return results


def write_text(out: Path, results: TextResults) -> None:
    """Write the results on numbers into content.md, next to those on codes."""
    page = out / "content.md"
    write_page(page, "content", {"totals": []} | stored_results(page) | {"text": plain(results)})


def _sheet(press: Press, pitch_mm: float, number: int, *, seed: int) -> tuple[list[Row], Cost]:
    """Print one sheet well and damaged on the same press day, and read its codes."""
    rng = stream(seed, "content-sheet", number)
    page, placed = code_sheet(number, dpi=press.dpi, rng=rng)
    spoilt, damages = damaged(page, placed, rng=rng)
    planned = PlannedPage(page, press.press_context(threads=1))
    _ = planned.expected
    begun = time.process_time()
    codes = page_codes(planned, press.sensors, press.geometry)
    finding_ms = (time.process_time() - begun) * 1e3
    day = stream(seed, "content-session", (number - 1) // SHEETS_A_DAY)
    session = Session.draw(amounts_of(press), press, day)
    reads, reading_ms = [], 0.0
    for printed in (page, spoilt):
        dn = _printed(printed, press, session, rng)
        begun = time.process_time()
        reads.append(
            read_codes(codes, dn, IN_PLACE, page=page, sensors=press.sensors, geometry=press.geometry)
        )
        reading_ms = reading_ms or (time.process_time() - begun) * 1e3
    rows = []
    for at, one in enumerate(placed):
        index = _index_of(one, codes, page)
        for read, damage in zip(reads, (None, damages[at]), strict=True):
            rows.append(_row(pitch_mm, one, index, codes, read, damage))
    return rows, Cost(finding_ms=finding_ms, reading_ms=reading_ms, codes=len(codes))


def _printed(page: Page, press: Press, session: Session, rng: np.random.Generator) -> np.ndarray:
    scan = scan_page(
        page, press=press, request=None, others=(), fetch=lambda _: page, rng=rng, session=session
    )
    return scan.dn


def _index_of(placed: Placed, codes: Iterable[PageCode], page: Page) -> int | None:
    """Return the index of the found code that a placed one is; None: it was not found."""
    middle = [(part.start + part.stop) / 2 * page.pixel_mm for part in (placed.columns, placed.rows)]
    for at, code in enumerate(codes):
        x, y, width, height = code.box_mm
        if x <= middle[0] <= x + width and y <= middle[1] <= y + height:
            return at
    return None


def _row(
    pitch_mm: float,
    placed: Placed,
    index: int | None,
    codes: tuple[PageCode, ...],
    read: tuple[Code, ...],
    damage: Damage | None,
) -> Row:
    of_code = Row(
        pitch_mm=pitch_mm,
        symbology=NAMES[placed.symbology],
        module_mm=placed.module_mm,
        found=index is not None,
        asked=index is not None and codes[index].sure,
        damage=damage,
    )
    if index is None:
        return of_code
    code = read[index]
    return replace(
        of_code,
        right=code.read == code.text,
        misread=code.read is not None and code.read != code.text,
        grade=code.grade,
    )


def _results(rows: list[Row], costs: list[Cost], *, seed: int, sheets: int) -> ContentResults:
    good = [row for row in rows if row.damage is None]
    bad = [row for row in rows if row.damage is not None and row.asked]
    codes = sum(cost.codes for cost in costs)
    return ContentResults(
        seed=seed,
        sheets=sheets,
        days=-(-sheets // SHEETS_A_DAY),
        read_goal=READ_GOAL,
        cost_goal_ms=COST_GOAL_MS,
        read=[
            _of_good(pitch, name, [row for row in good if (row.pitch_mm, row.symbology) == (pitch, name)])
            for pitch in PITCHES_MM
            for name in NAMES.values()
        ],
        totals=[
            _of_good(pitch, "all", [row for row in good if row.pitch_mm == pitch]) for pitch in PITCHES_MM
        ],
        too_fine=[
            _of_module(
                pitch, module, [row for row in good if (row.pitch_mm, row.module_mm) == (pitch, module)]
            )
            for pitch in PITCHES_MM
            for module in sorted({row.module_mm for row in good})
        ],
        damaged=[
            _of_damaged(pitch, kind, [row for row in bad if row.pitch_mm == pitch and _kind(row) == kind])
            for pitch in PITCHES_MM
            for kind in DAMAGES
        ],
        finding_ms=float(np.median([cost.finding_ms for cost in costs])),
        reading_ms_a_code=sum(cost.reading_ms for cost in costs) / max(codes, 1),
        reading_ms_a_page=float(np.median([cost.reading_ms for cost in costs])),
        codes_a_page=codes / len(costs),
    )


def _kind(row: Row) -> str:
    return "" if row.damage is None else row.damage.kind


def _of_good(pitch: float, name: str, rows: list[Row]) -> dict[str, float | int | str]:
    readable = [row for row in rows if row.asked]
    return {
        "pitch_mm": pitch,
        "symbology": name,
        "printed": len(rows),
        "found": sum(row.found for row in rows),
        "asked": len(readable),
        "read": sum(row.right for row in readable),
        "misread": sum(row.misread for row in rows),
        "grade": float(np.mean([row.grade for row in readable if row.grade is not None] or [np.nan])),
    }


def _of_module(pitch: float, module: float, rows: list[Row]) -> dict[str, float | int | str]:
    return {
        "pitch_mm": pitch,
        "module_mm": module,
        "pixels": module / pitch,
        "printed": len(rows),
        "found": sum(row.found for row in rows),
        "asked": sum(row.asked for row in rows),
    }


def _of_damaged(pitch: float, kind: str, rows: list[Row]) -> dict[str, float | int | str]:
    unread = [row for row in rows if not row.right]
    warned = [row for row in rows if row.right and row.grade is not None and row.grade < WORN]
    return {
        "pitch_mm": pitch,
        "damage": kind,
        "printed": len(rows),
        "unread": len(unread),
        "misread": sum(row.misread for row in rows),
        "warned": len(warned),
        "gentlest_unread": min((row.damage.severity for row in unread if row.damage), default=float("nan")),
        "gentlest_warned": min((row.damage.severity for row in warned if row.damage), default=float("nan")),
    }
