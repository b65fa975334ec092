"""Sheets of numbers like those of invoices, with one digit of one number wrong."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from prooflight.pages.raster import MM_PER_INCH, Page

if TYPE_CHECKING:
    from numpy.typing import NDArray

POINTS: Final = (6, 8, 10)
FACES: Final = ("helv", "hebo", "tiro", "cour", "DejaVuSans", "STIXGeneral")
"""Faces: Helvetica, Helvetica Bold, Times, Courier as MuPDF draws PDF's base fonts; the others come with matplotlib."""
WRONGS: Final = ("swapped", "dropped", "replaced")
"""Kinds of errors: two neighbouring digits exchanged, a digit missing, a digit replaced by another."""
PAGE_MM: Final = (100.0, 70.0)
MARGIN_MM: Final = 6.0
LEADING: Final = 1.3
"""Distance from row to row. [sizes]"""
COLUMNS_MM: Final = (6.0, 42.0, 60.0, 94.0)
"""Left edge of the words, and right edges of the numbers."""
FINE: Final = 8
"""Steps of an outline per raster pixel: a pixel is inked if its centre is inside."""
POINT_MM: Final = MM_PER_INCH / 72
BLACK: Final = (0, 0, 0, 255)
COLOURS: Final = ((255, 180, 0, 0), (0, 255, 230, 0), (230, 0, 255, 60), (0, 0, 0, 180))
"""CMYK colours of text that is not black: blue, red, green, grey."""
TINTS: Final = ((0, 0, 0, 26), (0, 0, 51, 0), (38, 0, 0, 0), (0, 26, 38, 13))
"""CMYK tints behind every second row of sheets that have a tint."""
ITEMS: Final = ("Item", "Order", "Paper A4", "Carriage", "Discount", "Service", "Lot", "Unit", "Account")
LEAST_DIGITS: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """A number on a sheet."""

    text: str
    right_mm: float
    baseline_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TextSheet:
    """Content of a sheet, before rasterisation."""

    points: int
    face: str
    ink: tuple[int, int, int, int]
    tint: tuple[int, int, int, int] | None
    items: tuple[Number, ...]
    """Words, set from the left at ``right_mm``; otherwise like the numbers."""
    numbers: tuple[Number, ...]

    def raster(self, number: int, *, dpi: float) -> Page:
        """Rasterise the page."""
        pixel_mm = MM_PER_INCH / dpi
        cmyk = np.zeros((round(PAGE_MM[1] / pixel_mm), round(PAGE_MM[0] / pixel_mm), 4), np.uint8)
        leading_mm = self.points * LEADING * POINT_MM
        if self.tint is not None:
            for top_mm in np.arange(MARGIN_MM, PAGE_MM[1] - MARGIN_MM - leading_mm, 2 * leading_mm):
                rows = slice(*(round(y / pixel_mm) for y in (top_mm, top_mm + leading_mm)))
                across = slice(round((MARGIN_MM - 2) / pixel_mm), -round((MARGIN_MM - 2) / pixel_mm))
                cmyk[rows, across] = self.tint
        for of, left in ((self.items, True), (self.numbers, False)):
            for one in of:
                self._set(cmyk, one, pixel_mm, left=left)
        return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04d}", number=number)

    def _set(self, cmyk: NDArray[np.uint8], one: Number, pixel_mm: float, *, left: bool) -> None:
        size_px = self.points * POINT_MM / pixel_mm
        pen = one.right_mm / pixel_mm
        if not left:
            pen -= sum(advance(self.face, letter) for letter in one.text) * size_px
        for letter in one.text:
            if letter != " ":
                mask, x, y = inked(self.face, letter, size_px, pen, one.baseline_mm / pixel_mm)
                cmyk[y : y + mask.shape[0], x : x + mask.shape[1]][mask] = self.ink
            pen += advance(self.face, letter) * size_px


def text_sheet(points: int, *, rng: np.random.Generator) -> TextSheet:
    """Draw a sheet with rows of a word and three numbers."""
    leading_mm = points * LEADING * POINT_MM
    items, numbers = [], []
    for baseline_mm in np.arange(MARGIN_MM + 0.75 * leading_mm, PAGE_MM[1] - MARGIN_MM, leading_mm):
        baseline = float(baseline_mm)
        items.append(Number(text=str(rng.choice(ITEMS)), right_mm=COLUMNS_MM[0], baseline_mm=baseline))
        for column, right_mm in enumerate(COLUMNS_MM[1:]):
            if rng.random() < 0.85:
                numbers.append(Number(text=_number(column, rng), right_mm=right_mm, baseline_mm=baseline))
    return TextSheet(
        points=points,
        face=str(rng.choice(FACES)),
        ink=BLACK if rng.random() < 0.5 else COLOURS[int(rng.integers(len(COLOURS)))],
        tint=None if rng.random() < 0.5 else TINTS[int(rng.integers(len(TINTS)))],
        items=tuple(items),
        numbers=tuple(numbers),
    )


def with_wrong_digit(sheet: TextSheet, wrong: str, *, rng: np.random.Generator) -> TextSheet:
    """Return the sheet with one number of at least four digits wrong; wrong: one of ``WRONGS``."""
    able = [at for at, one in enumerate(sheet.numbers) if _places(one.text, wrong)]
    at = int(rng.choice(able))
    text = sheet.numbers[at].text
    place = int(rng.choice(_places(text, wrong)))
    if wrong == "swapped":
        changed = text[:place] + text[place + 1] + text[place] + text[place + 2 :]
    elif wrong == "dropped":
        changed = text[:place] + "\N{FIGURE SPACE}" + text[place + 1 :]
    else:
        others = [digit for digit in "0123456789" if digit != text[place]]
        changed = text[:place] + str(rng.choice(others)) + text[place + 1 :]
    numbers = list(sheet.numbers)
    numbers[at] = replace(numbers[at], text=changed)
    return replace(sheet, numbers=tuple(numbers))


def _places(text: str, wrong: str) -> list[int]:
    """Return the positions at which a number can have this error."""
    digits = [at for at, letter in enumerate(text) if letter.isdigit()]
    if len(digits) < LEAST_DIGITS:
        return []
    if wrong == "swapped":
        return [at for at in digits if at + 1 in digits and text[at] != text[at + 1]]
    return digits


def _number(column: int, rng: np.random.Generator) -> str:
    if column == 0:
        return "".join(str(digit) for digit in rng.integers(0, 10, int(rng.integers(5, 9))))
    if column == 1:
        return str(int(rng.integers(1, 1000)))
    return f"{float(rng.integers(100, 10**7)) / 100:,.2f}"


@lru_cache(maxsize=8)
def _file(face: str) -> bytes:
    if len(face) == len("helv"):
        import pymupdf  # imported late: an extra

        return bytes(pymupdf.Font(face).buffer)
    from pathlib import Path

    import matplotlib as mpl

    return (Path(mpl.get_data_path()) / "fonts" / "ttf" / f"{face}.ttf").read_bytes()


@lru_cache(maxsize=64)
def _font(face: str, size_px: float) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(io.BytesIO(_file(face)), size_px, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=4096)
def advance(face: str, letter: str) -> float:
    """Return the advance width of a letter. [em]"""
    letter = "0" if letter == "\N{FIGURE SPACE}" else letter
    return float(_font(face, 2048).getlength(letter)) / 2048


@lru_cache(maxsize=4096)
def _outline(face: str, letter: str, size_px: float) -> tuple[NDArray[np.bool_], int, int]:
    """Return a letter ``FINE`` times as large, and its corner relative to the pen."""
    font = _font(face, size_px * FINE)
    left, top, right, bottom = (round(edge) for edge in font.getbbox(letter, anchor="ls"))
    picture = Image.new("1", (max(right - left, 1) + 2, max(bottom - top, 1) + 2))
    ImageDraw.Draw(picture).text((1 - left, 1 - top), letter, fill=1, font=font, anchor="ls")
    return np.asarray(picture), left - 1, top - 1


def inked(
    face: str, letter: str, size_px: float, pen_px: float, baseline_px: float
) -> tuple[NDArray[np.bool_], int, int]:
    """Return the raster pixels of a letter and the column and row of its corner."""
    if letter == "\N{FIGURE SPACE}":
        return np.zeros((0, 0), np.bool_), 0, 0
    fine, left, top = _outline(face, letter, size_px)
    x, y = round(pen_px * FINE) + left, round(baseline_px * FINE) + top
    before = y % FINE, x % FINE
    after = [-(size + first) % FINE for size, first in zip(fine.shape, before, strict=True)]
    padded = np.pad(fine, tuple(zip(before, after, strict=True)))
    return padded[FINE // 2 :: FINE, FINE // 2 :: FINE], x // FINE, y // FINE
