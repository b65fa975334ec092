"""Layout of a chart to print: patches between registration marks, and the recipe file that states their places.

A page, seen as printed, (0, 0) its top-left corner, millimetres:

- a registration mark in each corner, a black square with a white square of a third of its side in the middle; the one
  at the top left has a companion, a black bar on its right, so that a turned page is noticed;
- between the upper marks the page number in binary, eight squares, black for 1, most significant first, after a black
  start square and before a white and a black stop square;
- patches in rows and columns with paper between them, in an order shuffled over the whole chart, so that an uneven
  press does not look like a property of a recipe.

Everything is a multiple of 0.1 mm. The recipe file is CGATS text; its keywords PROOFLIGHT_* hold the
geometry, its columns PAGE, ROW and COLUMN (from 1) the place of each patch. Measured spectra are added to it
as columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.errors import ChartError, RequestError
from prooflight.inks.cgats import Table, number, read_tables, write_tables

STEPS_PER_MM: Final = 10  # every edge lies on this raster
SMALLEST_PATCH_MM: Final = 5.0  # the aperture of a hand-held spectrophotometer, or some 50 camera pixels
LARGEST_MM: Final = 3000.0  # the widest digital presses; a page's TIFF then takes 3.6 GB
_BITS: Final = 8
_LAYOUT: Final = "1"  # version of the keywords
_AS_WRITTEN: Final = "give the file that `chart make` wrote"
_FIELDS: Final = ("width_mm", "height_mm", "margin_mm", "mark_mm", "patch_mm", "gap_mm")

Box = tuple[float, float, float, float]
"""Box as x, y, width, height. [mm]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Geometry of a chart's pages, in multiples of 0.1 mm."""

    width_mm: float = 210.0
    height_mm: float = 297.0
    margin_mm: float = 10.0
    """Width of the unprinted margin around the marks, which a printer's grippers may need."""
    mark_mm: float = 6.0
    """Side of a registration mark; a zone as wide stays free inside it."""
    patch_mm: float = 8.0
    gap_mm: float = 1.0

    def __post_init__(self) -> None:
        for name in _FIELDS:
            value = getattr(self, name)
            if not 0 < value <= LARGEST_MM or abs(value * STEPS_PER_MM - round(value * STEPS_PER_MM)) > 1e-6:
                raise RequestError(
                    "chart layout",
                    f"{name} = {value:g}",
                    remedy=f"give a multiple of 0.1 above 0, at most {LARGEST_MM:g}",
                )
        if self.patch_mm < SMALLEST_PATCH_MM:
            what = f"patches of {self.patch_mm:g} mm"
            raise RequestError("chart layout", what, remedy=f"make them at least {SMALLEST_PATCH_MM:g} mm")
        if (
            self.columns < 1
            or self.rows < 1
            or self.code_boxes(1)[-1][0] > self.width_mm - 2 * self._inset_mm
        ):
            what = f"a page of {self.width_mm:g} x {self.height_mm:g} mm has no room for patches and marks"
            raise RequestError("chart layout", what, remedy="take a larger page or smaller patches")

    @property
    def _inset_mm(self) -> float:
        """Return the distance from the edge of the page to the far side of a mark's free zone."""
        return self.margin_mm + 2 * self.mark_mm

    @property
    def columns(self) -> int:
        """Return the number of patches side by side."""
        return int((self.width_mm - 2 * self.margin_mm + self.gap_mm + 1e-6) // (self.patch_mm + self.gap_mm))

    @property
    def rows(self) -> int:
        """Return the number of patches below each other."""
        return int(
            (self.height_mm - 2 * self._inset_mm + self.gap_mm + 1e-6) // (self.patch_mm + self.gap_mm)
        )

    @property
    def patches_per_page(self) -> int:
        """Return the number of places for patches on one page."""
        return self.rows * self.columns

    def patch_box(self, row: int, column: int) -> Box:
        """Return the place of the patch in ``row`` and ``column``, both from 1."""
        pitch = self.patch_mm + self.gap_mm
        x = self.margin_mm + (column - 1) * pitch
        y = self._inset_mm + (row - 1) * pitch
        return round(x, 1), round(y, 1), self.patch_mm, self.patch_mm

    def mark_boxes(self) -> tuple[Box, Box, Box, Box]:
        """Return the registration marks: top left, top right, bottom left, bottom right."""
        right = round(self.width_mm - self.margin_mm - self.mark_mm, 1)
        bottom = round(self.height_mm - self.margin_mm - self.mark_mm, 1)
        (a, b, c, d) = (
            (x, y, self.mark_mm, self.mark_mm)
            for y in (self.margin_mm, bottom)
            for x in (self.margin_mm, right)
        )
        return a, b, c, d

    def code_boxes(self, page: int) -> list[Box]:
        """Return the black squares that encode the page number, between the upper marks, centred on their height."""
        bits = [1, *(page >> bit & 1 for bit in reversed(range(_BITS))), 0, 1]
        side = round(self.mark_mm / 3, 1)
        left, top = self.margin_mm + 5 * self.mark_mm, self.margin_mm + self.mark_mm / 3
        return [(round(left + at * side, 1), round(top, 1), side, side) for at, bit in enumerate(bits) if bit]

    def black_and_white(self, page: int) -> list[tuple[Box, bool]]:
        """Return marks, companion bar and page number, to be painted in this order; True is black."""
        third = round(self.mark_mm / 3, 1)
        painted: list[tuple[Box, bool]] = []
        for x, y, side, _ in self.mark_boxes():
            painted += [
                ((x, y, side, side), True),
                ((round(x + third, 1), round(y + third, 1), third, third), False),
            ]
        bar = (round(self.margin_mm + 2 * self.mark_mm, 1), self.margin_mm, third, self.mark_mm)
        return [*painted, (bar, True), *((box, True) for box in self.code_boxes(page))]

    def keywords(self) -> tuple[tuple[str, str], ...]:
        """Return the geometry as keywords, declared as CGATS wants."""
        values = {"LAYOUT": _LAYOUT, **{name.upper(): f"{getattr(self, name):g}" for name in _FIELDS}}
        pairs = [(f"PROOFLIGHT_{name}", value) for name, value in values.items()]
        return tuple(pair for name, value in pairs for pair in (("KEYWORD", name), (name, value)))

    @classmethod
    def of(cls, where: object, table: Table) -> Self:
        """Read the geometry from a recipe file's keywords; ChartError if they do not hold one."""
        version = table.keyword("PROOFLIGHT_LAYOUT")
        values = {name: number(table.keyword(f"PROOFLIGHT_{name.upper()}") or "") for name in _FIELDS}
        if version != _LAYOUT or not np.isfinite(list(values.values())).all():
            what = "its keywords do not state the positions of patches"
            raise ChartError(
                where, what, remedy="give the recipe file that `chart make` wrote next to the chart"
            )
        try:
            return cls(**values)
        except RequestError as error:
            raise ChartError(where, f"{error.where}: {error.what}", remedy=error.remedy) from None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedRecipes:
    """Recipes of a printed chart and their places."""

    layout: Layout
    cmyk: NDArray[np.float64]
    """Ink fractions (n, 4), exact in 8 bits. [-]"""
    place: NDArray[np.int64]
    """Page, row and column (n, 3), each from 1."""

    @property
    def pages(self) -> int:
        """Return the number of pages."""
        return int(self.place[:, 0].max())


def place_recipes(cmyk: NDArray[np.float64], layout: Layout, rng: np.random.Generator) -> PlacedRecipes:
    """Shuffle recipes (n, 4) over as many pages as they need, row by row."""
    at = rng.permutation(len(cmyk))
    page, on_page = np.divmod(np.arange(len(cmyk)), layout.patches_per_page)
    if page[-1] + 1 >= 2**_BITS:
        what = f"{len(cmyk)} patches need {page[-1] + 1} pages"
        raise RequestError(
            "--patches", what, remedy=f"take smaller patches or fewer: at most {2**_BITS - 1} pages"
        )
    row, column = np.divmod(on_page, layout.columns)
    return PlacedRecipes(layout=layout, cmyk=cmyk[at], place=np.stack([page, row, column], axis=1) + 1)


def write_recipes(path: Path, placed: PlacedRecipes) -> None:
    """Write the recipe file: CGATS text with the geometry in its keywords."""
    keywords = (
        ("ORIGINATOR", "Prooflight"),
        ("DESCRIPTOR", f"{len(placed.cmyk)} patches, pages: {placed.pages}"),
        *placed.layout.keywords(),
    )
    rows = tuple(
        (str(at), *map(str, place), *map(repr, recipe))
        for at, (place, recipe) in enumerate(
            zip(placed.place.tolist(), (placed.cmyk * 100).tolist(), strict=True), start=1
        )
    )
    fields = ("SAMPLE_ID", "PAGE", "ROW", "COLUMN", *(f"CMYK_{ink}" for ink in INK_LETTERS))
    write_tables(path, [Table(kind="CGATS.17", keywords=keywords, fields=fields, rows=rows)])


def read_recipe_file(path: Path) -> PlacedRecipes:
    """Read a file that ``write_recipes`` wrote, with or without measured columns.

    ChartError if it is something else.
    """
    table = read_tables(path)[0]
    layout = Layout.of(path, table)
    wanted = ("PAGE", "ROW", "COLUMN", *(f"CMYK_{ink}" for ink in INK_LETTERS))
    missing = [name for name in wanted if name not in table.fields]
    if missing:
        raise ChartError(path, f"the column {missing[0]} is missing", remedy=_AS_WRITTEN)
    values = table.numbers(wanted)
    if not np.isfinite(values).all() or not values.size:
        raise ChartError(path, "positions or recipes are not numbers", remedy=_AS_WRITTEN)
    _refuse_places(path, table, layout, values[:, :3])
    outside = (values[:, 3:] < 0) | (values[:, 3:] > 100)
    if outside.any():
        row, ink = np.argwhere(outside)[0]
        what = f"{table.line(row)}: {INK_LETTERS[ink]} is {values[row, 3 + ink]:g}"
        raise ChartError(path, what, remedy="recipes go from 0 to 100 per cent")
    cmyk = np.round(values[:, 3:] * 2.55) / 255.0
    return PlacedRecipes(layout=layout, cmyk=cmyk, place=values[:, :3].astype(np.int64))


def _refuse_places(path: Path, table: Table, layout: Layout, places: NDArray[np.float64]) -> None:
    """Raise ChartError if a patch (n, 3) is at no place of the layout, or two are at the same."""
    most = (2**_BITS - 1, layout.rows, layout.columns)
    wrong = ((places != np.floor(places)) | (places < 1) | (places > most)).any(axis=1)
    if wrong.any():
        row = int(wrong.argmax())
        page, line, column = places[row]
        what = f"{table.line(row)}: there is no row {line:g}, column {column:g} on a page {page:g}"
        raise ChartError(path, what, remedy=_AS_WRITTEN)
    _, first, patches = np.unique(places, axis=0, return_index=True, return_counts=True)
    if patches.max() > 1:
        what = f"{table.line(int(first[patches.argmax()]))}: another patch is at the same position"
        raise ChartError(path, what, remedy=_AS_WRITTEN)
