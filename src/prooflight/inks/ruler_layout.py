"""Layout of a ruler page: marks from which a camera's position, pitch, sharpness, light and planes are measured.

A page, seen as printed, (0, 0) its top-left corner, millimetres. It is drawn on a lattice that begins at the
margin, of cells 96 mm wide and groups 92 mm high, so that the mark at a place depends on the place alone, not
on the size of the page. Each cell begins with a comb along the travel; next to it each group has, from above:

- a comb across: bars 2 mm wide, 4 mm apart;
- square markers (ArUco 4x4), whose numbers encode their slot and group;
- squares turned by 5 degrees, whose edges give sharpness both ways (ISO 12233);
- crosses of one ink each, black, cyan, magenta, yellow in turn;
- a strip of solid black, and one of bare paper.

Every edge but those of turned squares is a multiple of 0.1 mm. Combs and crosses are measured by the middle
between their edges, which neither a fat print nor a blurred one moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.errors import RequestError
from prooflight.inks.chart_layout import LARGEST_MM, STEPS_PER_MM, Box

CELL_MM: Final = 96.0
GROUP_MM: Final = 92.0
BAR_MM: Final = 2.0
"""Width of a comb's bar and of a cross's arm.

The pitch of bars is twice that. At 0.3 mm a pixel that is 7 pixels.
"""
PERIOD_MM: Final = 2 * BAR_MM
TOOTH_MM: Final = 8.0
"""Length of a comb's bar."""
MARKER_MM: Final = 9.6
MODULES: Final = 6
"""Number of modules on a marker's side: 4 of its number in a black border."""
SLOT_MM: Final = 24.0
SLOTS: Final = 3
SQUARE_MM: Final = 12.0
SLANT_DEG: Final = 5.0
"""Angle of a turned square; ISO 12233 asks for 5 degrees."""
CROSS_MM: Final = 9.6
MARGIN_MM: Final = 10.0
MOST_CELLS: Final = 8
MOST_GROUPS: Final = 10
"""Greatest number of groups: markers have 250 numbers, of which 8 cells take 24 a group."""
LEAST_MM: Final = (124.0, 120.0)
"""Least width and height of a page: it holds two combs each way."""
DICTIONARY: Final = cv2.aruco.DICT_4X4_250
_COMB_Y, _MARKER_Y, _SQUARE_Y, _CROSS_Y, _SOLID_Y, _WHITE_Y = 0.0, 12.0, 26.0, 44.0, 58.0, 72.0
_SOLID_MM, _WHITE_MM = 10.0, 16.0
_GROUP_LEFT_MM: Final = 12.0
"""Distance from a cell's left edge to the marks next to its comb."""
_END_MM: Final = 88.0
_CROSS_ORDER: Final = "KCMY"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """Straight bar with paper on both sides."""

    box: Box
    upright: bool
    """Whether it runs along the travel, so that its edges give a position across.

    Otherwise they give one along.
    """
    ink: str = "K"


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker:
    """Coded square."""

    number: int
    x_mm: float
    y_mm: float
    """Position of its top-left corner along the travel."""

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """Return the corners (4, 2): top left, top right, bottom right, bottom left."""
        return np.array([self.x_mm, self.y_mm]) + MARKER_MM * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Slanted:
    """Turned square of black."""

    x_mm: float
    y_mm: float
    """Position of its centre along the travel."""

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """Return the corners (4, 2), clockwise as printed from the one at the top left."""
        turn = math.radians(SLANT_DEG)
        across = np.array([math.cos(turn), math.sin(turn)])
        along = np.array([-math.sin(turn), math.cos(turn)])
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        middle = np.array([self.x_mm, self.y_mm])
        return np.array([middle + SQUARE_MM / 2 * (a * across + b * along) for a, b in signs])


@dataclass(frozen=True, slots=True, kw_only=True)
class RulerLayout:
    """Geometry of a ruler page."""

    width_mm: float = 210.0
    height_mm: float = 297.0

    def __post_init__(self) -> None:
        for name, value, least in (
            ("width", self.width_mm, LEAST_MM[0]),
            ("height", self.height_mm, LEAST_MM[1]),
        ):
            if not least <= value <= LARGEST_MM or abs(value * STEPS_PER_MM - round(value * 10)) > 1e-6:
                what = f"a page {value:g} mm in {name}"
                remedy = f"give a multiple of 0.1 mm from {least:g} to {LARGEST_MM:g}"
                raise RequestError("ruler page", what, remedy=remedy)

    @classmethod
    def largest(cls) -> RulerLayout:
        """Return the layout of the largest page, which holds the marks of any other."""
        return cls(
            width_mm=2 * MARGIN_MM + MOST_CELLS * CELL_MM, height_mm=2 * MARGIN_MM + MOST_GROUPS * GROUP_MM
        )

    @property
    def _right_mm(self) -> float:
        return self.width_mm - MARGIN_MM

    @property
    def _bottom_mm(self) -> float:
        return self.height_mm - MARGIN_MM

    @property
    def cells_mm(self) -> tuple[float, ...]:
        """Return the left edge of each cell."""
        lefts = (MARGIN_MM + at * CELL_MM for at in range(MOST_CELLS))
        return tuple(left for left in lefts if left + TOOTH_MM <= self._right_mm)

    @property
    def groups_mm(self) -> tuple[float, ...]:
        """Return the top edge of each group."""
        tops = (MARGIN_MM + at * GROUP_MM for at in range(MOST_GROUPS))
        return tuple(top for top in tops if top + TOOTH_MM <= self._bottom_mm)

    def bars(self) -> Iterator[Bar]:
        """Yield the bars of all combs."""
        for cell in self.cells_mm:
            tops = (MARGIN_MM + at * PERIOD_MM for at in range(int(MOST_GROUPS * GROUP_MM / PERIOD_MM)))
            for top in tops:
                yield from self._fitting(_bar(cell, top, TOOTH_MM, BAR_MM, upright=False))
            lefts = (cell + _GROUP_LEFT_MM + at * PERIOD_MM for at in range(19))
            for left in lefts:
                for group in self.groups_mm:
                    yield from self._fitting(_bar(left, group + _COMB_Y, BAR_MM, TOOTH_MM, upright=True))

    def _fitting(self, bar: Bar) -> Iterator[Bar]:
        if self._holds(bar.box):
            yield bar

    def markers(self) -> Iterator[Marker]:
        """Yield the coded squares."""
        for row, group in enumerate(self.groups_mm):
            for column, left in self._slots():
                x, y = round(left + 4, 1), round(group + _MARKER_Y, 1)
                if self._holds((x, y, MARKER_MM, MARKER_MM)):
                    yield Marker(number=row * MOST_CELLS * SLOTS + column, x_mm=x, y_mm=y)

    def squares(self) -> Iterator[Slanted]:
        """Yield the turned squares."""
        for group in self.groups_mm:
            for _, left in self._slots():
                x, y = left + SLOT_MM / 2, group + _SQUARE_Y + 7
                half = 0.6 * SQUARE_MM
                if self._holds((x - half, y - half, 2 * half, 2 * half)):
                    yield Slanted(x_mm=x, y_mm=y)

    def crosses(self) -> Iterator[tuple[Bar, Bar]]:
        """Yield the crosses of one ink each: the upright arm, and the other."""
        for group in self.groups_mm:
            for column, left in self._slots():
                for half in range(2):
                    ink = _CROSS_ORDER[(2 * column + half) % len(_CROSS_ORDER)]
                    x, y = left + 1 + 12 * half, group + _CROSS_Y
                    arm = (CROSS_MM - BAR_MM) / 2
                    box = (round(x, 1), round(y, 1), CROSS_MM, CROSS_MM)
                    if self._holds(box):
                        yield (
                            _bar(x + arm, y, BAR_MM, CROSS_MM, upright=True, ink=ink),
                            _bar(x, y + arm, CROSS_MM, BAR_MM, upright=False, ink=ink),
                        )

    def strips(self) -> Iterator[tuple[Box, bool]]:
        """Yield the uniform areas, and whether they are solid black; others are bare paper."""
        for group in self.groups_mm:
            for cell in self.cells_mm:
                left = cell + _GROUP_LEFT_MM
                width = round(min(cell + _END_MM, self._right_mm) - left, 1)
                for top, height, solid in ((_SOLID_Y, _SOLID_MM, True), (_WHITE_Y, _WHITE_MM, False)):
                    box = (round(left, 1), round(group + top, 1), width, height)
                    if width >= PERIOD_MM and self._holds(box):
                        yield box, solid

    @property
    def checked_mm(self) -> tuple[float, float]:
        """Return the distances that a person measures with a rule to know the print's true size.

        They lead from the first to the last fine line, across and along.
        """
        return tuple(  # type: ignore[return-value]
            math.floor((extent - 2 * MARGIN_MM) / 10) * 10.0 for extent in (self.width_mm, self.height_mm)
        )

    def check_lines(self) -> Iterator[Box]:
        """Yield the fine lines between which a person measures, in the margins."""
        across, along = self.checked_mm
        for x in (MARGIN_MM, MARGIN_MM + across):
            yield round(x - 0.1, 1), 4.0, 0.2, 4.0
        for y in (MARGIN_MM, MARGIN_MM + along):
            yield 4.0, round(y - 0.1, 1), 4.0, 0.2

    def painted(self) -> Iterator[tuple[NDArray[np.float64], tuple[int, int, int, int]]]:
        """Yield the corners (n, 2) [mm] of everything that is printed, and ink levels 0..255."""
        black = _ink("K")
        for bar in self.bars():
            yield _corners(bar.box), black
        for marker in self.markers():
            for box in _modules(marker):
                yield _corners(box), black
        for square in self.squares():
            yield square.corners_mm, black
        for arms in self.crosses():
            for arm in arms:
                yield _corners(arm.box), _ink(arm.ink)
        for box, solid in self.strips():
            if solid:
                yield _corners(box), black
        for box in self.check_lines():
            yield _corners(box), black

    def _slots(self) -> Iterator[tuple[int, float]]:
        for cell_at, cell in enumerate(self.cells_mm):
            for slot in range(SLOTS):
                yield cell_at * SLOTS + slot, cell + _GROUP_LEFT_MM + slot * SLOT_MM

    def _holds(self, box: Box) -> bool:
        x, y, width, height = box
        return x + width <= self._right_mm + 1e-6 and y + height <= self._bottom_mm + 1e-6


def _bar(x: float, y: float, width: float, height: float, *, upright: bool, ink: str = "K") -> Bar:
    return Bar(box=(round(x, 1), round(y, 1), width, height), upright=upright, ink=ink)


def _ink(letter: str) -> tuple[int, int, int, int]:
    c, m, y, k = (255 * (letter == one) for one in INK_LETTERS)
    return c, m, y, k


def _corners(box: Box) -> NDArray[np.float64]:
    x, y, width, height = box
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def _modules(marker: Marker) -> Iterator[Box]:
    """Yield the black modules of a marker, those of a row that touch as one box."""
    side = MARKER_MM / MODULES
    for row, line in enumerate(_black(marker.number)):
        edges = np.flatnonzero(np.diff(line, prepend=False, append=False)).tolist()
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            yield (
                round(marker.x_mm + first * side, 1),
                round(marker.y_mm + row * side, 1),
                round((end - first) * side, 1),
                side,
            )


@cache
def _black(number: int) -> NDArray[np.bool_]:
    """Return which modules of a marker are black, (6, 6)."""
    image = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(DICTIONARY), number, MODULES)
    return np.asarray(image < 128)
