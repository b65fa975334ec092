"""Marks of a stated size at a stated place, drawn into the page's raster before it is printed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.commissioning.zones.defects import disc
from prooflight.simulation.misprints.drawing import ALL_INKS, FULL, Box, plateau, rewrite
from prooflight.simulation.misprints.marks import lay
from prooflight_studies.stress.marks import BLACK, MOST_CURVATURE_PER_MM, SCRATCH_DEG, Ribbon

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

Point = tuple[float, float]
"""x, y on the page. [mm]"""
CYAN, MAGENTA = slice(0, 1), slice(1, 2)
NO_INK: Final = 0.0
THIN_MM: Final = 0.15
"""Width of hairs and scratches."""
STREAK_MM: Final = (0.5, 20.0)
BAND_MM: Final = (20.0, 2.0)
SMEAR_MM: Final = (10.0, 4.0)
AREA_MM: Final = (8.0, 8.0)
"""Width and height of what has a contrast: a streak, a band, a smear; an area that is fainter or blurred."""
SMEAR_EDGE_MM: Final = 1.5
"""Over which a smear fades out."""
BLUR_EDGE_SHARE: Final = 0.2
DROPLETS: Final = 5
DROPLET_MM: Final = 0.4
SPLASH_MM: Final = (1.0, 3.0)
"""How far a splash's droplets lie from its middle."""
ALONG_BORDER_DEG: Final = 5.0
"""How far hairs and scratches at the border turn from the travel, so that they stay there."""


def spot(
    page: Page,
    at: Point,
    *,
    diameter_mm: float,
    rng: np.random.Generator,
    inks: slice = BLACK,
    share: float = 0.9,
    towards: float = FULL,
) -> Page:
    """Draw a round spot: inks go the share of the way to full ink, or to none for a void."""
    side = diameter_mm + 4 * page.pixel_mm
    box = _box(page, at, (side, side))
    x, y = _centres_mm(box, page)
    weight = share * disc(
        np.hypot(x - at[0], (y - at[1])[:, None]), diameter_mm=diameter_mm, pixel_mm=page.pixel_mm
    )
    return _inked(page, box, inks, weight, towards, rng)


def splash(page: Page, at: Point, *, rng: np.random.Generator) -> Page:
    """Draw a spot of 1.2 mm, 80 % magenta, and five droplets about it."""
    page = spot(page, at, diameter_mm=1.2, rng=rng, inks=MAGENTA, share=0.8)
    for _ in range(DROPLETS):
        turn, away = rng.uniform(0, 2 * np.pi), rng.uniform(*SPLASH_MM)
        there = (at[0] + away * np.cos(turn), at[1] + away * np.sin(turn))
        page = spot(page, there, diameter_mm=DROPLET_MM, rng=rng, inks=MAGENTA, share=0.8)
    return page


def thin(
    page: Page,
    at: Point,
    *,
    length_mm: float,
    angle: float,
    rng: np.random.Generator,
    curvature_per_mm: float = 0.0,
    inks: slice = BLACK,
    share: float = 0.7,
    towards: float = FULL,
) -> Page:
    """Draw a line 0.15 mm wide: a hair, or a scratch where ink goes to none. angle: from x towards y. [radian]"""
    ribbon = Ribbon(
        middle_mm=at,
        angle=angle,
        curvature_per_mm=curvature_per_mm,
        width_mm=THIN_MM,
        length_mm=length_mm,
    )
    box, cover = ribbon.on(page)
    return _inked(page, box, inks, share * cover, towards, rng)


def hair(page: Page, at: Point, *, length_mm: float, rng: np.random.Generator, border: bool = False) -> Page:
    """Draw a hair of 70 % black, curved to either side; at the border it is straight and along the travel."""
    angle = _along(rng) if border else float(rng.uniform(0, 2 * np.pi))
    bend = 0.0 if border else float(rng.uniform(-MOST_CURVATURE_PER_MM, MOST_CURVATURE_PER_MM))
    return thin(page, at, length_mm=length_mm, angle=angle, curvature_per_mm=bend, rng=rng)


def scratch(
    page: Page, at: Point, *, length_mm: float, rng: np.random.Generator, border: bool = False
) -> Page:
    """Draw a straight line without any ink."""
    turn = np.deg2rad(SCRATCH_DEG) * (1 if rng.random() < 0.5 else -1)
    angle = _along(rng) if border else float(np.pi / 2 + turn)
    return thin(page, at, length_mm=length_mm, angle=angle, rng=rng, inks=ALL_INKS, share=1.0, towards=NO_INK)


def patch(
    page: Page,
    at: Point,
    size_mm: tuple[float, float],
    *,
    share: float,
    rng: np.random.Generator,
    inks: slice = ALL_INKS,
    towards: float = NO_INK,
    edge_mm: float = 0.0,
) -> Page:
    """Move inks by a share of the way to full ink or to none in a rectangle; its sides fade over ``edge_mm``."""
    box = _box(page, at, size_mm)
    down, across = (
        plateau(count, edge_mm / page.pixel_mm) if edge_mm else np.ones(count) for count in box.shape
    )
    return _inked(page, box, inks, share * down[:, None] * across, towards, rng)


def blurred(page: Page, at: Point, *, sigma_mm: float, rng: np.random.Generator) -> Page:
    """Smear all inks of a square by a Gaussian."""
    box, sigma = _box(page, at, AREA_MM), sigma_mm / page.pixel_mm
    smooth = cv2.GaussianBlur(
        page.cmyk[box.rows, box.columns].astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_REPLICATE
    )
    down, across = (plateau(count, count * BLUR_EDGE_SHARE) for count in box.shape)
    cmyk = page.cmyk.copy()

    def smear(values: NDArray[np.float32], rows: slice) -> None:
        values += (smooth[rows] - values) * (down[rows, None] * across)[..., None]

    rewrite(cmyk, box, ALL_INKS, smear, rng)
    return replace(page, cmyk=cmyk)


def _inked(
    page: Page, box: Box, inks: slice, weight: NDArray[np.floating], towards: float, rng: np.random.Generator
) -> Page:
    cmyk = page.cmyk.copy()
    lay(cmyk, box, inks, weight.astype(np.float32), towards, rng)
    return replace(page, cmyk=cmyk)


def _box(page: Page, at: Point, size_mm: tuple[float, float]) -> Box:
    """Return the part of a rectangle about a point that is on the page."""
    rows, columns = page.cmyk.shape[:2]
    (left, right), (top, bottom) = (
        (
            min(max(round((middle - extent / 2) / page.pixel_mm), 0), most - 1),
            min(max(round((middle + extent / 2) / page.pixel_mm), 1), most),
        )
        for middle, extent, most in zip(at, size_mm, (columns, rows), strict=True)
    )
    return Box(top=top, left=left, bottom=max(bottom, top + 1), right=max(right, left + 1))


def _centres_mm(box: Box, page: Page) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return the centres of a box's pixels: x of its columns, y of its rows. [mm]"""
    columns, rows = np.arange(box.left, box.right), np.arange(box.top, box.bottom)
    return (columns + 0.5) * page.pixel_mm, (rows + 0.5) * page.pixel_mm


def _along(rng: np.random.Generator) -> float:
    return float(np.pi / 2 + np.deg2rad(rng.uniform(-ALONG_BORDER_DEG, ALONG_BORDER_DEG)))


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedMark:
    """One mark of the table, and how far it reaches from its middle."""

    name: str
    draw: Callable[[Page, Point, np.random.Generator], Page]
    reach_mm: float


def _spot(name: str, diameter_mm: float, inks: slice, share: float) -> NamedMark:
    def draw(page: Page, at: Point, rng: np.random.Generator) -> Page:
        return spot(page, at, diameter_mm=diameter_mm, rng=rng, inks=inks, share=share)

    return NamedMark(name=name, draw=draw, reach_mm=diameter_mm / 2)


def _hair(name: str, length_mm: float) -> NamedMark:
    def draw(page: Page, at: Point, rng: np.random.Generator) -> Page:
        return hair(page, at, length_mm=length_mm, rng=rng)

    return NamedMark(name=name, draw=draw, reach_mm=length_mm / 2)


SMALLEST: Final = _spot("black spot, 0.5 mm, 90 %", 0.5, BLACK, 0.9)
LETTERS: Final = _spot("black spot, 1 mm, 90 %", 1.0, BLACK, 0.9)
"""Mark for bare paper between and beside lines of text."""
NAMED: Final = (
    _spot("black spot, 0.8 mm, 90 %", 0.8, BLACK, 0.9),
    _spot("magenta spot, 1.2 mm, 80 %", 1.2, MAGENTA, 0.8),
    NamedMark(
        name="splash: 1.2 mm of magenta 80 % and five droplets of 0.4 mm",
        draw=lambda page, at, rng: splash(page, at, rng=rng),
        reach_mm=SPLASH_MM[1] + DROPLET_MM / 2,
    ),
    _hair("hair, 0.15 x 20 mm, black 70 %", 20.0),
    _spot("black spot, 2 mm, 90 %", 2.0, BLACK, 0.9),
    _spot("black spot, 4 mm, 90 %", 4.0, BLACK, 0.9),
    _hair("curved hair, 0.15 x 6 mm, black 70 %", 6.0),
    _spot("cyan spot, 2 mm, 50 %", 2.0, CYAN, 0.5),
    _spot("magenta spot, 3 mm, 80 %", 3.0, MAGENTA, 0.8),
)
ON_TINTS: Final = 4
"""The first so many are printed on flat tints as well."""
HEADLINE: Final = (*NAMED[:ON_TINTS], SMALLEST)
"""Marks for which a share of 95 % or 99 % is promised, so that they are printed most often."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of mark for curves: what its level is, and on which places it can be."""

    what: str
    """Description of the mark, with what stays the same at all levels."""
    unit: str
    levels: tuple[float, float]
    """The least and the greatest that is printed."""
    places: tuple[str, ...]
    extent_mm: tuple[float, float] = (0.0, 0.0)
    """Width and height of it that lie within its place."""
    draw: Callable[[Page, Point, float, bool, np.random.Generator], Page] | None = None
    """Takes page, place, level and whether it is at the border; None: the page is composed with another letter."""

    @property
    def takes(self) -> bool:
        """Whether it takes ink away, so that it needs some: no such mark is possible on bare paper."""
        return "paper" not in self.places


INKED: Final = ("tint", "photo", "text", "border")
EVERYWHERE: Final = ("paper", *INKED)
KINDS: Final[Mapping[str, Kind]] = {
    "spot": Kind(
        what="black, 90 %",
        unit="mm",
        levels=(0.2, 3.2),
        places=EVERYWHERE,
        draw=lambda page, at, level, _, rng: spot(page, at, diameter_mm=level, rng=rng),
    ),
    "void": Kind(
        what="all inks gone",
        unit="mm",
        levels=(0.2, 3.2),
        places=INKED,
        draw=lambda page, at, level, _, rng: spot(
            page, at, diameter_mm=level, rng=rng, inks=ALL_INKS, share=1.0, towards=NO_INK
        ),
    ),
    "hair": Kind(
        what="black, 70 %, 0.15 mm wide; its length",
        unit="mm",
        levels=(1.0, 20.0),
        places=EVERYWHERE,
        extent_mm=(10.0, 10.0),
        draw=lambda page, at, level, border, rng: hair(page, at, length_mm=level, rng=rng, border=border),
    ),
    "scratch": Kind(
        what="all inks gone, 0.15 mm wide; its length",
        unit="mm",
        levels=(1.0, 20.0),
        places=INKED,
        extent_mm=(10.0, 10.0),
        draw=lambda page, at, level, border, rng: scratch(page, at, length_mm=level, rng=rng, border=border),
    ),
    "streak": Kind(
        what="black added, 0.5 x 20 mm along the travel",
        unit="%",
        levels=(2.0, 80.0),
        places=EVERYWHERE,
        extent_mm=STREAK_MM,
        draw=lambda page, at, level, _, rng: patch(
            page, at, STREAK_MM, share=level / 100, rng=rng, inks=BLACK, towards=FULL
        ),
    ),
    "band": Kind(
        what="all inks weaker, 20 x 2 mm across the travel",
        unit="%",
        levels=(2.0, 80.0),
        places=INKED,
        extent_mm=BAND_MM,
        draw=lambda page, at, level, _, rng: patch(page, at, BAND_MM, share=level / 100, rng=rng),
    ),
    "smear": Kind(
        what="a film of black, 10 x 4 mm",
        unit="%",
        levels=(1.0, 40.0),
        places=EVERYWHERE,
        extent_mm=SMEAR_MM,
        draw=lambda page, at, level, _, rng: patch(
            page, at, SMEAR_MM, share=level / 100, rng=rng, inks=BLACK, towards=FULL, edge_mm=SMEAR_EDGE_MM
        ),
    ),
    "local density": Kind(
        what="all inks weaker in 8 x 8 mm",
        unit="%",
        levels=(2.0, 80.0),
        places=INKED,
        extent_mm=AREA_MM,
        draw=lambda page, at, level, _, rng: patch(page, at, AREA_MM, share=level / 100, rng=rng),
    ),
    "blur": Kind(
        what="8 x 8 mm smeared; standard deviation",
        unit="mm",
        levels=(0.04, 0.8),
        places=("photo", "text"),
        extent_mm=AREA_MM,
        draw=lambda page, at, level, _, rng: blurred(page, at, sigma_mm=level, rng=rng),
    ),
    "wrong glyph": Kind(what="another letter; size of type", unit="pt", levels=(4.0, 16.0), places=("text",)),
    "missing glyph": Kind(what="no letter; size of type", unit="pt", levels=(4.0, 16.0), places=("text",)),
}


def levels_of(kind: str, count: int) -> list[float]:
    """Return so many levels of a kind, evenly by octaves."""
    return [float(level) for level in np.geomspace(*KINDS[kind].levels, count)]
