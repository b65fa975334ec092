"""The pages that are printed: composed designs, nearly blank pages, and pages with every place for a mark."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import design_name
from prooflight.simulation.corpus.designs.chance import pick, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle
from prooflight.simulation.corpus.designs.inks import BLACK
from prooflight.simulation.corpus.designs.sheet import MM_PER_PT, Sheet
from prooflight.simulation.misprints.drawing import INKED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight_studies.visible.marks import Point

BLANK_MM: Final = (210.0, 297.0)
"""Size of nearly blank pages."""
PLACES_MM: Final = (90.0, 100.0)
TINT_SHARE: Final = 0.4
TINTS: Final = ((0, 0, 0, 1), (1, 0, 0, 0), (0, 1, 0, 0), (1, 1, 0, 0), (0, 1, 1, 0), (1, 0, 1, 0))
"""Inks of a tint, C M Y K."""
SIZES_PT: Final = (4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 16.0)
"""Sizes of type; each has as many lines as fit."""
LEADING: Final = 1.25
AREAS_MM: Final[Mapping[str, tuple[float, float, float, float]]] = {
    "paper": (50.0, 8.0, 82.0, 42.0),
    "tint": (53.0, 56.0, 82.0, 92.0),
    "photo": (8.0, 57.0, 40.0, 92.0),
    "text": (7.0, 7.0, 40.0, 45.0),
    "border of paper": (1.0, 10.0, 3.0, 90.0),
    "border of tint": (87.0, 58.0, 89.0, 90.0),
}
"""Left, top, right and bottom of the area in which marks are centred."""
CLEAR_MM: Final = 6.0
"""Least distance from a mark on bare paper to the nearest ink and to the page's edges."""
NEAR_TEXT_MM: Final = (1.2, 2.5)
"""Distance from a mark between or beside lines of text to the nearest ink."""
LETTER_MM: Final = 5.0
"""Greatest height and width of a letter."""
TINT_COVER: Final = (0.1, 0.6)
"""Ink area of a tint, all inks together."""
TINT_CLEAR_MM: Final = 2.0
"""Least distance from a mark on a tint to the tint's end."""
TRIES: Final = 100
EDGE: Final = INKED
"""Step of an ink that is an edge: a quarter of full ink."""


def nearly_blank(seed: int, index: int, *, dpi: float) -> Page:
    """Compose a page with one band, one gradient or one line of type, and nothing else."""
    rng = stream(seed, "visible-blank", index)
    style = DesignStyle.draw(rng, black_alone=False)
    sheet = Sheet(width_mm=BLANK_MM[0], height_mm=BLANK_MM[1], dpi=dpi)
    x, y = some(rng, 8, 40), some(rng, 10, 180)
    width, height = some(rng, 30, 100), some(rng, 2, 15)
    what = index % 3
    if what == 0:
        sheet.rect(x, y, width, height, style.palette.strong)
    elif what == 1:
        sheet.blend(x, y, width, height, style.palette.tint, style.palette.strong, turn_deg=some(rng, 0, 180))
    else:
        style.heading(sheet, x, y, width, style.voice.title(rng, 1, 4), some(rng, 9, 18))
    return Page(cmyk=sheet.cmyk, dpi=dpi, name=design_name(index), number=index + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Slip:
    """A letter of the text that is set wrong."""

    letter: int
    """Index of the letter in the order in which all are set."""
    instead: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacesPage:
    """Bare paper, a 40 % tint that runs off the page, a photo, and text of many sizes, on one small page."""

    page: Page
    letters: tuple[tuple[str, float], ...]
    """Every letter as it is set, and its size. [pt]"""

    @classmethod
    def composed(cls, seed: int, index: int, *, dpi: float, slip: Slip | None = None) -> PlacesPage:
        """Compose page ``index`` of a seed, the same at every resolution but for its raster."""
        rng = stream(seed, "visible-page", index)
        style = DesignStyle.draw(rng, black_alone=False)
        while style.voice.script != "latin":
            style = DesignStyle.draw(rng, black_alone=False)
        sheet = _Noting(width_mm=PLACES_MM[0], height_mm=PLACES_MM[1], dpi=dpi, slip=slip)
        cyan, magenta, yellow, black = (ink * round(255 * TINT_SHARE) for ink in pick(rng, TINTS))
        sheet.rect(49.0, 52.0, PLACES_MM[0] - 49.0, 44.0, (cyan, magenta, yellow, black))
        sheet.picture(5.0, 54.0, 38.0, 41.0, style.photograph(rng, 38.0, 41.0))
        y, line = 5.0, 0
        while y + LEADING * SIZES_PT[line % len(SIZES_PT)] * MM_PER_PT <= 49.0:
            size = SIZES_PT[line % len(SIZES_PT)]
            y += LEADING * size * MM_PER_PT
            _set_line(sheet, rng, style, y, size)
            line += 1
        page = Page(cmyk=sheet.cmyk, dpi=dpi, name=design_name(index), number=index + 1)
        return cls(page=page, letters=tuple(sheet.letters))

    def point(
        self, place: str, extent_mm: tuple[float, float], rng: np.random.Generator, *, takes: bool
    ) -> Point:
        """Draw a point of a place, so that as much of a mark as possible is within it.

        takes: the mark takes ink away, so that it is centred on ink where ``TRIES`` draws hit any.
        """
        name = place if place != "border" else "border of tint" if takes else "border of paper"
        left, top, right, bottom = AREAS_MM[name]
        across, down = 0.0 if place == "border" else extent_mm[0], extent_mm[1]
        at = (left, top)
        for _ in range(TRIES):
            at = _within(left, right, across, rng), _within(top, bottom, down, rng)
            row, column = (int(each / self.page.pixel_mm) for each in reversed(at))
            if not takes or self.page.cmyk[row, column].max() >= INKED:
                break
        return at


def _within(low: float, high: float, extent: float, rng: np.random.Generator) -> float:
    margin = min(extent, high - low) / 2
    return float(rng.uniform(low + margin, high - margin))


def _set_line(sheet: Sheet, rng: np.random.Generator, style: DesignStyle, y: float, size_pt: float) -> None:
    """Set words from x = 5 mm as far as 43 mm."""
    face, em, pen = style.voice.face, size_pt * MM_PER_PT, 5.0
    for word in style.voice.prose(rng, 30):
        wide = em * sum(map(face.advance, word))
        if pen + wide > 43.0:
            break
        sheet.draw_text(pen, y, word, face, size_pt, BLACK)
        pen += wide + em * face.advance(" ")


class _Noting(Sheet):
    """A sheet that records its letters, and sets one of them wrong if there is a slip."""

    def __init__(self, *, slip: Slip | None, **how: float) -> None:
        super().__init__(**how)
        self.letters: list[tuple[str, float]] = []
        self._slip = slip

    def _set(self, letter: str, size_pt: float) -> str:
        self.letters.append((letter, size_pt))
        slip = self._slip
        return letter if slip is None or slip.letter != len(self.letters) - 1 else slip.instead


def slip_of(
    letters: tuple[tuple[str, float], ...], size_pt: float, *, missing: bool, rng: np.random.Generator
) -> Slip:
    """Draw a letter of that size to leave out, or to replace by another one of the page."""
    here = [at for at, (letter, size) in enumerate(letters) if size == size_pt and letter.isalpha()]
    at = int(rng.choice(here))
    if missing:
        return Slip(letter=at, instead=" ")
    was = letters[at][0]
    others = sorted({letter for letter, _ in letters if letter.isalpha() and letter.islower()} - {was})
    return Slip(letter=at, instead=str(rng.choice(others)))


def bare(page: Page, reach_mm: float, clear_mm: float = CLEAR_MM) -> NDArray[np.bool_]:
    """Mask of pixels (rows, columns) on which a mark may be centred so that no ink and no edge of the page is near."""
    return _from_ink(page) * page.pixel_mm > reach_mm + clear_mm


def flat_tint(page: Page, reach_mm: float) -> NDArray[np.bool_]:
    """Mask of pixels on which a mark may be centred so that it is within one flat tint."""
    cover = page.cmyk.sum(axis=2, dtype=np.uint16) / 255
    flat = (cover >= TINT_COVER[0]) & (cover <= TINT_COVER[1])
    packed = page.packed
    same = packed[:, 1:] == packed[:, :-1]
    flat[:, 1:] &= same
    flat[:, :-1] &= same
    same = packed[1:] == packed[:-1]
    flat[1:] &= same
    flat[:-1] &= same
    return _inwards(flat) * page.pixel_mm > reach_mm + TINT_CLEAR_MM


def near_text(page: Page, reach_mm: float) -> NDArray[np.bool_]:
    """Mask of pixels on which a mark is on bare paper, and its nearest ink is a letter 1.2 to 2.5 mm away."""
    ink = (page.packed != 0).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(ink)
    small = (stats[:, 2:4] * page.pixel_mm <= LETTER_MM).all(axis=1)
    small[0] = False
    away, to_letter = (
        _from_ink(page),
        cv2.distanceTransform(1 - small[labels].astype(np.uint8), cv2.DIST_L2, 5),
    )
    low, high = ((reach_mm + each) / page.pixel_mm for each in NEAR_TEXT_MM)
    return np.asarray((away > low) & (away < high) & (to_letter <= away + 1))


WHERE: Final = {"paper": bare, "tint": flat_tint, "near text": near_text}
"""Search for places on a composed design, by their name."""


def somewhere(page: Page, wanted: NDArray[np.bool_], rng: np.random.Generator) -> Point | None:
    """Draw one of these pixels and return its centre; None: there is none."""
    pixels = np.flatnonzero(wanted)
    share = rng.random()
    if not pixels.size:
        return None
    row, column = divmod(int(pixels[int(share * pixels.size)]), wanted.shape[1])
    return (column + 0.5) * page.pixel_mm, (row + 0.5) * page.pixel_mm


def edge_length_m(page: Page) -> float:
    """Measure how difficult a page is: the length of all edges of a quarter of full ink and more. [m]"""
    ink = page.cmyk.astype(np.int16)
    steps = sum(
        int((np.abs(np.diff(ink, axis=axis)).max(axis=2) >= EDGE).sum(dtype=np.int64)) for axis in (0, 1)
    )
    return steps * page.pixel_mm / 1000


def ink_share(page: Page) -> float:
    """Return the share of the page that has any ink. [-]"""
    return float((page.packed != 0).mean())


def _from_ink(page: Page) -> NDArray[np.float32]:
    """Return the distance of each pixel from ink and from the page's edges. [pixels]"""
    return _inwards(page.packed == 0)


def _inwards(inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the distance of each pixel inside from the nearest one outside, or off the page. [pixels]"""
    ringed = np.pad(inside.astype(np.uint8), 1)
    return np.asarray(cv2.distanceTransform(ringed, cv2.DIST_L2, 5)[1:-1, 1:-1], np.float32)
