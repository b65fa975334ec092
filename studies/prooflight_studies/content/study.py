"""Codes on prints of the press world: whether they are read, the damage they tolerate, and the cost of reading."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
import zxingcpp

from prooflight.commissioning.build import build_press
from prooflight.detectors.base import PlannedPage
from prooflight.inspection.codes.finding import page_codes
from prooflight.inspection.codes.reading import read_codes
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_studies.harness.page import plain, stored_results, write_page
from prooflight_studies.paper.study import at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Code
    from prooflight.inspection.codes.finding import PageCode
    from prooflight.press.artefact import Press
    from prooflight_studies.content.numbers import TextResults

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


# --- sheets of codes, and their damage ---

SYMBOLOGIES: Final = ("EAN13", "EAN8", "UPCA", "Code128", "Code39", "ITF", "QRCode", "DataMatrix")
"""Symbologies, as the library that draws them names them."""
LINEAR: Final = frozenset(SYMBOLOGIES[:6])
MODULES_MM: Final = {True: (0.25, 0.30, 0.33, 0.40, 0.50), False: (0.35, 0.45, 0.60, 0.80)}
"""Widths of modules: narrowest bars of linear codes, and squares of the others.

GS1 allows 0.264 mm on retail and 0.255 to 0.615 mm on Data Matrix and QR codes; smaller ones are common.
"""
HEIGHT_MM: Final = 14.0
CELLS: Final = (3, 5)
"""Number of codes across and down a sheet."""
A4_MM: Final = (210.0, 297.0)
MARGIN_MM: Final = 12.0
DIGITS: Final = {"EAN13": 12, "EAN8": 7, "UPCA": 11, "ITF": 14}
LETTERS: Final = "ABCDEFGHJKLMNPQRSTUVWXYZ0123456789"
CHARACTERS: Final = 12

DAMAGES: Final = ("streak", "void", "low contrast", "blur")
STREAK_MM: Final = (0.1, 1.5)
"""Width of a white line along the travel, through the code's middle third."""
VOID_MM: Final = (0.5, 10.0)
"""Diameter of a white disc in the code."""
INK_LEFT: Final = (0.8, 0.15)
"""Remaining share of the code's ink."""
BLUR_MM: Final = (0.05, 0.6)
"""Standard deviation of the blur."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A code on a sheet."""

    symbology: str
    text: str
    module_mm: float
    turned: bool
    """Whether the code runs along the travel."""
    rows: slice
    columns: slice
    """Area of the code on the sheet's raster, without quiet zone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """Damage of one code."""

    kind: str
    severity: float


def code_sheet(number: int, *, dpi: float, rng: np.random.Generator) -> tuple[Page, tuple[Placed, ...]]:
    """Draw a sheet of codes of all symbologies, one in a cell, black on white; cells too small for one stay empty."""
    pixel_mm = MM_PER_INCH / dpi
    cmyk = np.zeros((round(A4_MM[1] / pixel_mm), round(A4_MM[0] / pixel_mm), 4), np.uint8)
    across, down = CELLS
    cell_mm = np.array(A4_MM[::-1]) / (down, across)
    placed = []
    for cell in range(across * down):
        symbology = SYMBOLOGIES[(number * across * down + cell) % len(SYMBOLOGIES)]
        linear = symbology in LINEAR
        module_mm = float(rng.choice(MODULES_MM[linear]))
        text = _text(symbology, rng)
        pattern = _raster(_pattern(symbology, text), module_mm, pixel_mm, linear=linear)
        turned = bool(rng.integers(2))
        if turned:
            pattern = np.rot90(pattern)
        room = np.rint((cell_mm - MARGIN_MM) / pixel_mm).astype(int)
        if np.any(np.array(pattern.shape) > room):
            pattern, turned = np.rot90(pattern), not turned
        if np.any(np.array(pattern.shape) > room):
            continue
        corner = np.rint(np.array(divmod(cell, across)) * cell_mm / pixel_mm + MARGIN_MM / 2 / pixel_mm)
        corner = corner.astype(int) + rng.integers(0, room - pattern.shape + 1)
        rows, columns = (
            slice(int(at), int(at) + size) for at, size in zip(corner, pattern.shape, strict=True)
        )
        cmyk[rows, columns, 3] = pattern
        placed.append(
            Placed(
                symbology=symbology, text=text, module_mm=module_mm, turned=turned, rows=rows, columns=columns
            )
        )
    return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04d}", number=number), tuple(placed)


def damaged(
    page: Page, placed: tuple[Placed, ...], *, rng: np.random.Generator
) -> tuple[Page, tuple[Damage, ...]]:
    """Return a copy of a sheet on which every code is damaged."""
    cmyk = page.cmyk.copy()
    damages = []
    for at, code in enumerate(placed):
        kind, severity = DAMAGES[at % len(DAMAGES)], float(rng.random())
        ink = cmyk[code.rows, code.columns, 3]
        cmyk[code.rows, code.columns, 3] = _DAMAGE[kind](ink, severity, page.pixel_mm, rng)
        damages.append(Damage(kind=kind, severity=severity))
    return replace(page, cmyk=cmyk), tuple(damages)


def between(limits: tuple[float, float], severity: float) -> float:
    """Interpolate geometrically from the first limit at severity 0 to the second at 1."""
    return float(limits[0] * (limits[1] / limits[0]) ** severity)


def _streak(
    ink: NDArray[np.uint8], severity: float, pixel_mm: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    width = max(1, round(between(STREAK_MM, severity) / pixel_mm))
    first = int(ink.shape[1] * rng.uniform(1 / 3, 2 / 3)) - width // 2
    left = ink.copy()
    left[:, max(first, 0) : first + width] = 0
    return left


def _void(
    ink: NDArray[np.uint8], severity: float, pixel_mm: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    radius = between(VOID_MM, severity) / 2 / pixel_mm
    row, column = (size * rng.uniform(0.3, 0.7) for size in ink.shape)
    rows, columns = np.ogrid[: ink.shape[0], : ink.shape[1]]
    return np.where((rows - row) ** 2 + (columns - column) ** 2 <= radius**2, np.uint8(0), ink)


def _low_contrast(
    ink: NDArray[np.uint8], severity: float, pixel_mm: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    return np.rint(ink * between(INK_LEFT, severity)).astype(np.uint8)


def _blur(
    ink: NDArray[np.uint8], severity: float, pixel_mm: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    sd = between(BLUR_MM, severity) / pixel_mm
    return cv2.GaussianBlur(ink, (0, 0), sd, borderType=cv2.BORDER_CONSTANT)


_DAMAGE = {"streak": _streak, "void": _void, "low contrast": _low_contrast, "blur": _blur}


def _text(symbology: str, rng: np.random.Generator) -> str:
    if digits := DIGITS.get(symbology):
        return "".join(str(digit) for digit in rng.integers(0, 10, digits))
    return "".join(rng.choice(list(LETTERS), CHARACTERS))


def _pattern(symbology: str, text: str) -> NDArray[np.bool_]:
    """Return the dark modules (rows, columns), without quiet zone."""
    drawn = zxingcpp.create_barcode(text, getattr(zxingcpp.BarcodeFormat, symbology))
    dark = np.array(drawn.to_image(scale=1, add_hrt=False, add_quiet_zones=False)) < 128
    rows, columns = np.flatnonzero(dark.any(axis=1)), np.flatnonzero(dark.any(axis=0))
    return dark[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _raster(dark: NDArray[np.bool_], module_mm: float, pixel_mm: float, *, linear: bool) -> NDArray[np.uint8]:
    """Return the ink of a code, its edges at the nearest raster pixels as a RIP sets them."""
    columns = np.rint(np.arange(dark.shape[1] + 1) * module_mm / pixel_mm).astype(int)
    if linear:
        bars = np.repeat(dark[0], np.diff(columns))
        return np.tile(np.where(bars, np.uint8(255), np.uint8(0)), (round(HEIGHT_MM / pixel_mm), 1))
    rows = np.rint(np.arange(dark.shape[0] + 1) * module_mm / pixel_mm).astype(int)
    whole = np.repeat(np.repeat(dark, np.diff(rows), axis=0), np.diff(columns), axis=1)
    return np.where(whole, np.uint8(255), np.uint8(0))
