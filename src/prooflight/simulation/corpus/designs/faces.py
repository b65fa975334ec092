"""Typefaces as masks of ink: glyphs on the raster grid without grey, at places that do not depend on the grid.

Faces: DejaVu (Bitstream Vera licence), STIX General (SIL OFL 1.1) and Computer Modern (BaKoMa), which come with
matplotlib, so that no face of the system is needed. Advances are taken unhinted, from the design grid, so that lines
break alike at every resolution; the glyph itself is FreeType's monochrome rendering (with its drop-out control, so
that stems thinner than a pixel stay whole).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from prooflight.simulation.corpus.designs.chance import count, often, some

_DESIGN_PX = 2048  # units per em of DejaVu; all faces here are scalable, so any large size would do
_SMALLEST_PX = 3.0  # below, FreeType refuses or draws dots


@dataclass(frozen=True, slots=True)
class Glyph:
    """Ink of a letter: mask (rows, columns), its corner right of and above the pen, in pixels."""

    mask: NDArray[np.bool_]
    left: int
    top: int


class Face(Protocol):
    """A typeface."""

    def advance(self, letter: str) -> float:
        """Return the distance by which the pen moves on. [em]"""

    def glyph(self, letter: str, size_px: float) -> Glyph:
        """Return the letter at a size of ``size_px`` pixels per em."""


@dataclass(frozen=True, slots=True)
class OutlineFace:
    """Face by the name of its file, e.g. ``DejaVuSans-Bold``."""

    stem: str

    def advance(self, letter: str) -> float:
        """Return the advance, as ``Face``."""
        return _advance(self.stem, letter)

    def glyph(self, letter: str, size_px: float) -> Glyph:
        """Return the glyph, as ``Face``."""
        return _glyph(self.stem, letter, max(size_px, _SMALLEST_PX))


@lru_cache(maxsize=96)
def _font(stem: str, size_px: float) -> ImageFont.FreeTypeFont:
    import matplotlib

    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{stem}.ttf"
    return ImageFont.truetype(path, size_px, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=8192)
def _advance(stem: str, letter: str) -> float:
    return float(_font(stem, _DESIGN_PX).getlength(letter)) / _DESIGN_PX


@lru_cache(maxsize=2048)
def _glyph(stem: str, letter: str, size_px: float) -> Glyph:
    try:
        return _rendered(stem, letter, size_px)
    except OSError:  # FreeType's monochrome renderer gives up on some hinted outlines of a few pixels
        large = _rendered(stem, letter, 4 * size_px)
        return Glyph(large.mask[::4, ::4], round(large.left / 4), round(large.top / 4))


def _rendered(stem: str, letter: str, size_px: float) -> Glyph:
    font = _font(stem, size_px)
    left, top, right, bottom = (round(edge) for edge in font.getbbox(letter, mode="1", anchor="ls"))
    if right <= left or bottom <= top:
        return Glyph(np.zeros((0, 0), np.bool_), 0, 0)
    picture = Image.new("1", (right - left + 2, bottom - top + 2))
    ImageDraw.Draw(picture).text((1 - left, 1 - top), letter, fill=1, font=font, anchor="ls")
    return Glyph(np.asarray(picture), left - 1, top - 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class StrokeFace:
    """Invented ideographs of straight strokes, as dense as those of East Asian print; one em wide each."""

    weight_em: float
    strokes: tuple[NDArray[np.float32], ...]
    """Strokes (strokes, 4) of each ideograph: x and y of both ends, 0..1 from its top-left corner. [em]"""
    _drawn: dict[tuple[str, float], Glyph] = field(default_factory=dict, repr=False)

    FIRST = 0xE000
    """First code point of the ideographs, in Unicode's private use area."""

    def advance(self, letter: str) -> float:
        """Return the advance, as ``Face``; other letters are DejaVu's."""
        return 1.0 if ord(letter) >= self.FIRST else OutlineFace("DejaVuSans").advance(letter)

    def glyph(self, letter: str, size_px: float) -> Glyph:
        """Return the glyph, as ``Face``."""
        if ord(letter) < self.FIRST:
            return OutlineFace("DejaVuSans").glyph(letter, size_px)
        key = letter, size_px
        if key not in self._drawn:
            self._drawn[key] = self._draw(self.strokes[ord(letter) - self.FIRST], size_px)
        return self._drawn[key]

    def _draw(self, strokes: NDArray[np.float32], size_px: float) -> Glyph:
        side = int(np.ceil(size_px)) + 2
        ink = np.zeros((side, side), np.uint8)
        weight = max(round(self.weight_em * size_px), 1)
        for x0, y0, x1, y1 in np.rint(strokes * size_px).astype(int).tolist():
            cv2.line(ink, (x0, y0), (x1, y1), 1, weight)
        return Glyph(ink.astype(np.bool_), 0, -round(0.86 * size_px))

    @property
    def letters(self) -> str:
        """Return all its ideographs."""
        return "".join(chr(self.FIRST + place) for place in range(len(self.strokes)))

    @classmethod
    def draw(cls, rng: np.random.Generator) -> StrokeFace:
        """Draw a set of ideographs, each of level and upright strokes with a few slanting ones."""
        return cls(
            weight_em=some(rng, 0.055, 0.1),
            strokes=tuple(_ideograph(rng) for _ in range(count(rng, 90, 160))),
        )


def _ideograph(rng: np.random.Generator) -> NDArray[np.float32]:
    strokes = []
    for _ in range(count(rng, 4, 10)):
        x, y = some(rng, 0.08, 0.5), some(rng, 0.08, 0.85)
        if often(rng, 0.5):
            strokes.append((x, y, some(rng, x + 0.2, 0.92), y))
        elif often(rng, 0.6):
            strokes.append((x + 0.3, y / 2, x + 0.3, some(rng, y / 2 + 0.25, 0.95)))
        else:
            strokes.append((x + 0.2, y / 1.5, x + some(rng, -0.05, 0.4), min(y / 1.5 + 0.35, 0.95)))
    return np.array(strokes, np.float32)
