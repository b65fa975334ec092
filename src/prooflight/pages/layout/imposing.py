"""Imposition of pages on the raster of one side, and the map between points of a page and of its side.

A place is the same map in millimetres and in raster pixels: a rectangle on the side, and the number of
quarter turns, clockwise, of its page in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import JobError, RequestError
from prooflight.pages.layout.layout import WHERE, Layout
from prooflight.pages.raster import MM_PER_INCH, Page

SAME_MM: Final = 0.5
"""Largest difference between the pages on one side, which is less than the cutting tolerance; they are cut
or filled at their right and lower edges."""

Box = tuple[float, float, float, float]
"""A rectangle: x, y, width and height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Position of a page on its side, in one unit: mm or raster pixels."""

    x: float
    y: float
    width: float
    """Width across the side."""
    height: float
    turns: int
    """Quarter turns of the page, clockwise."""

    def on_side(self, x: float, y: float) -> tuple[float, float]:
        """Map a point of the page to the side."""
        return (
            (self.x + x, self.y + y),
            (self.x + self.width - y, self.y + x),
            (self.x + self.width - x, self.y + self.height - y),
            (self.x + y, self.y + self.height - x),
        )[self.turns]

    def on_page(self, x: float, y: float) -> tuple[float, float]:
        """Map a point of the side to the page, the inverse of ``on_side``; the result may be outside the page."""
        x, y = x - self.x, y - self.y
        return ((x, y), (y, self.width - x), (self.width - x, self.height - y), (self.height - y, x))[
            self.turns
        ]

    def meets(self, box: Box) -> bool:
        """Return whether a rectangle of the side shares any area with the place."""
        x, y, width, height = box
        across = min(x + width, self.x + self.width) - max(x, self.x)
        along = min(y + height, self.y + self.height) - max(y, self.y)
        return across > 0 and along > 0

    def turned(self, width: float, height: float, turns: int = 1) -> Place:
        """Return the place on a side of this width and height after the side is turned by quarter turns, clockwise."""
        place = self
        for _ in range(turns % 4):
            place = Place(
                x=height - place.y - place.height,
                y=place.x,
                width=place.height,
                height=place.width,
                turns=(place.turns + 1) % 4,
            )
            width, height = height, width
        return place


def side_size(page: tuple[float, float], layout: Layout) -> tuple[float, float]:
    """Return width and height of a side whose pages have this size. [mm]

    RequestError: they need more than the sheet has.
    """
    cell = page[::-1] if layout.rotate % 180 else page
    grid = layout.columns, layout.rows
    needs = tuple(
        many * extent + (many - 1) * gap
        for many, extent, gap in zip(grid, cell, layout.gutter_mm, strict=True)
    )
    sheet = layout.sheet_mm
    if sheet is None:
        return needs[0], needs[1]
    if any(need > has + SAME_MM for need, has in zip(needs, sheet, strict=True)):
        what = (
            f"{grid[0]} x {grid[1]} pages need {needs[0]:.1f} x {needs[1]:.1f} mm, "
            f"and the sheet has {sheet[0]:g} x {sheet[1]:g} mm"
        )
        raise RequestError(WHERE, what, remedy="give a larger sheet, fewer pages on it, or rotate=90")
    return sheet


def places_on(
    page: tuple[float, float],
    side: tuple[float, float],
    gutter: tuple[float, float],
    layout: Layout,
    *,
    back: bool,
) -> list[Place]:
    """Return the places of the pages of a side, row by row from the top left of the side as it was imposed.

    ``page``, ``side`` and ``gutter`` are width and height, all in one unit. The pages are centred on the
    side, rounded to a whole unit if the unit is a pixel and all are whole. A back that the press turns is
    turned with all its places.
    """
    width, height = page[::-1] if layout.rotate % 180 else page
    left = (side[0] - layout.columns * width - (layout.columns - 1) * gutter[0]) / 2
    top = (side[1] - layout.rows * height - (layout.rows - 1) * gutter[1]) / 2
    if all(isinstance(one, int) for one in (*page, *side, *gutter)):
        left, top = int(left // 1), int(top // 1)
    places = [
        Place(
            x=left + column * (width + gutter[0]),
            y=top + row * (height + gutter[1]),
            width=width,
            height=height,
            turns=layout.rotate // 90,
        )
        for row in range(layout.rows)
        for column in range(layout.columns)
    ]
    if back and layout.backs == "turned":
        return [place.turned(*side, turns=2) for place in places]
    return places


def refuse_other_size(
    number: int, size_mm: tuple[float, float], first: int, first_mm: tuple[float, float]
) -> None:
    """Raise JobError if page ``number`` differs in size from page ``first`` of its sheet."""
    if any(abs(one - other) > SAME_MM for one, other in zip(size_mm, first_mm, strict=True)):
        what = (
            f"is {size_mm[0]:.1f} x {size_mm[1]:.1f} mm, and page {first}, on the same sheet, "
            f"{first_mm[0]:.1f} x {first_mm[1]:.1f} mm"
        )
        raise JobError(f"page {number}", what, remedy="give all pages of a sheet one size")


def imposed(pages: Sequence[Page], layout: Layout, number: int) -> Page:
    """Return side ``number`` of the job, from 1, with these pages at its places, as the press prints it.

    The pages are those of ``Layout.pages_on``. RequestError: they need more than the sheet has. JobError:
    their rasters do not match.
    """
    first = pages[0]
    for page in pages[1:]:
        if page.dpi != first.dpi:
            what = f"has {page.dpi:g} pixels/inch, and page {first.number} {first.dpi:g}"
            raise JobError(f"page {page.number}", what, remedy="give all pages of a sheet one resolution")
        refuse_other_size(
            page.number, (page.width_mm, page.height_mm), first.number, (first.width_mm, first.height_mm)
        )
    back = layout.sides > 1 and number % 2 == 0
    plain = layout.places_a_side == 1 and not layout.rotate and layout.sheet_mm is None
    if plain:
        raster = first.cmyk[::-1, ::-1] if back and layout.backs == "turned" else first.cmyk
        return _side(np.ascontiguousarray(raster), pages, layout, number)
    size = first.cmyk.shape[1], first.cmyk.shape[0]
    gutter = _pixels(layout.gutter_mm[0], first), _pixels(layout.gutter_mm[1], first)
    side_mm = side_size((first.width_mm, first.height_mm), layout)
    cell = size[::-1] if layout.rotate % 180 else size
    side = (
        max(_pixels(side_mm[0], first), layout.columns * cell[0] + (layout.columns - 1) * gutter[0]),
        max(_pixels(side_mm[1], first), layout.rows * cell[1] + (layout.rows - 1) * gutter[1]),
    )
    raster = np.zeros((side[1], side[0], 4), np.uint8)
    for page, place in zip(pages, places_on(size, side, gutter, layout, back=back), strict=True):
        x, y, width, height = int(place.x), int(place.y), int(place.width), int(place.height)
        own = page.cmyk[: size[1], : size[0]]
        if own.shape[:2] != (size[1], size[0]):
            short = size[1] - own.shape[0], size[0] - own.shape[1]
            own = np.pad(own, ((0, short[0]), (0, short[1]), (0, 0)))
        raster[y : y + height, x : x + width] = np.rot90(own, k=-place.turns)
    return _side(raster, pages, layout, number)


def _side(raster: NDArray[np.uint8], pages: Sequence[Page], layout: Layout, number: int) -> Page:
    return Page(
        cmyk=raster,
        dpi=pages[0].dpi,
        name=layout.side_name(number),
        number=number,
        edge_sd_mm=max(page.edge_sd_mm for page in pages),
        warnings=tuple(dict.fromkeys(warning for page in pages for warning in page.warnings)),
    )


def _pixels(length_mm: float, page: Page) -> int:
    return round(length_mm * page.dpi / MM_PER_INCH)
