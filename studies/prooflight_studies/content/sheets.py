"""Sheets of codes, and their damage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
import zxingcpp

from prooflight.pages.raster import MM_PER_INCH, Page

if TYPE_CHECKING:
    from numpy.typing import NDArray

SYMBOLOGIES: Final = ("EAN13", "EAN8", "UPCA", "Code128", "Code39", "ITF", "QRCode", "DataMatrix")
"""Symbologies, as the library that draws them names them."""
LINEAR: Final = frozenset(SYMBOLOGIES[:6])
MODULES_MM: Final = {True: (0.25, 0.30, 0.33, 0.40, 0.50), False: (0.35, 0.45, 0.60, 0.80)}
"""Widths of modules: narrowest bars of linear codes, and squares of the others.

GS1 allows 0.264 mm on retail and 0.255 to 0.615 mm on Data Matrix and QR codes; smaller ones are common.
"""
HEIGHT_MM: Final = 14.0
"""Height of the bars."""
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
    """Severity, 0 to 1."""


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
