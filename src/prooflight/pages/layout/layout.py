"""Imposition of a job on its sheets, written as ``sides=2,n-up=2x1,pages-a-set=8``.

A side is the content of one passing of the camera. The sides of a job are numbered from 1, sheet after sheet,
the front before the back; ``side`` counts them through the run, from 0, and ``position`` counts passings,
from 0.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

from prooflight.errors import RequestError
from prooflight.files.given import shortly
from prooflight.pages.files import page_name

Order = Literal["alternate", "batch", "loop"]
Backs = Literal["upright", "turned", "long-edge", "short-edge"]
WHERE: Final = "layout"
MOST_ALONG: Final = 64
"""Largest number of places along one edge of a sheet."""
MOST_DEPTH: Final = 1_000_000
MOST_NAMED: Final = 6
"""Largest number of set sizes that a message names."""
MOST_MM: Final = 10_000.0
EXAMPLE: Final = "write e.g. sides=2,n-up=2x1,pages-a-set=8"


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Arrangement of pages on a sheet, and the order in which its sides pass the camera."""

    sides: int = 1
    """Sides of a sheet: 1 or 2."""
    order: Order = "alternate"
    """Order of passing. alternate: front 1, back 1, front 2, back 2. batch: the fronts of ``depth``
    sheets, then their backs. loop: the fronts of ``depth`` sheets, then a back and the next front in turn,
    as when so many sheets fill a duplex loop."""
    depth: int = 1
    """Sheets of a batch, or in the loop."""
    backs: Backs = "upright"
    """Orientation of backs. upright, turned: whether the press prints the raster of a back as it is or
    turned by 180 degrees. long-edge, short-edge: the edge about which the printed sheet is turned over, on
    a press that swaps leading and trailing edge between its sides (``backs_at``)."""
    columns: int = 1
    rows: int = 1
    """Places across the web and along the travel."""
    places: tuple[int, ...] = ()
    """Page of the sheet, from 1, at each place: the front's places row by row from its top left, then the
    back's; empty: in order."""
    repeat: bool = False
    """Whether all places of a side show one page."""
    gutter_mm: tuple[float, float] = (0.0, 0.0)
    """Gap between places, across and along. [mm]"""
    sheet_mm: tuple[float, float] | None = None
    """Width and height of a side, on which the pages are centred; None: the size that its pages need. [mm]"""
    rotate: int = 0
    """Clockwise rotation of pages on the sheet, in degrees: 0, 90, 180 or 270."""
    pages_a_set: int | None = None
    """Pages of a set; None: not stated."""
    job_pages: int | None = None
    """Pages of the job (``of``): unused places on its last sheet stay blank. None: the pages fill all places."""

    @classmethod
    def parse(cls, text: str) -> Layout:
        """Parse ``word=value,...``; RequestError if a word or a value is not valid.

        >>> Layout.parse("sides=2,order=loop:3,n-up=2x1,gutter=4").gutter_mm
        (4.0, 4.0)
        """
        given: dict[str, object] = {}
        for part in text.split(","):
            key, _, value = (one.strip() for one in part.partition("="))
            if key not in _KEYS:
                what = f"{shortly(part.strip())!r} is none of {', '.join(_KEYS)}"
                raise RequestError(WHERE, what, remedy=EXAMPLE)
            fields, read, example = _KEYS[key]
            values = read(value)
            if values is None:
                raise RequestError(WHERE, f"{key} is {shortly(value)!r}", remedy=f"write {key}={example}")
            if fields[0] in given:
                raise RequestError(WHERE, f"{key} is given twice", remedy="give it once")
            given.update(zip(fields, values, strict=True))
        return _checked(cls(**given))  # type: ignore[arg-type]

    @property
    def text(self) -> str:
        """Text of the layout for ``parse``, without values that are the default."""
        gutter, sheet = self.gutter_mm, self.sheet_mm
        texts = {
            "sides": str(self.sides) if self.sides > 1 else "",
            "order": "" if self.order == "alternate" else f"{self.order}:{self.depth}",
            "backs": "" if self.backs == "upright" else self.backs,
            "n-up": f"{self.columns}x{self.rows}" if self.pages_a_side > 1 or self.repeat else "",
            "places": "-".join(map(str, self.places)),
            "repeat": "yes" if self.repeat else "",
            "gutter": f"{gutter[0]:g}x{gutter[1]:g}" if any(gutter) else "",
            "sheet": f"{sheet[0]:g}x{sheet[1]:g}" if sheet else "",
            "rotate": str(self.rotate) if self.rotate else "",
            "pages-a-set": "" if self.pages_a_set is None else str(self.pages_a_set),
        }
        return ",".join(f"{key}={value}" for key, value in texts.items() if value) or "sides=1"

    @property
    def places_a_side(self) -> int:
        """Places on a side."""
        return self.columns * self.rows

    @property
    def pages_a_side(self) -> int:
        """Pages of the job on a side, each counted once."""
        return 1 if self.repeat else self.places_a_side

    @property
    def pages_a_sheet(self) -> int:
        """Pages of the job on a sheet, each counted once."""
        return self.sides * self.pages_a_side

    @property
    def sheets_a_set(self) -> int | None:
        """Sheets of a set; None: not stated."""
        return None if self.pages_a_set is None else self.pages_a_set // self.pages_a_sheet

    def of(self, pages: int) -> Layout:
        """Return the layout of a job with this number of pages; RequestError if its sheets fill no whole sets."""
        sheets, of_set = -(-pages // self.pages_a_sheet), self.sheets_a_set
        if of_set is not None and sheets % of_set and of_set % sheets:
            has, takes = _count(sheets, "sheet"), _count(of_set, "sheet")
            what = f"the {_count(pages, 'page')} of the job fill {has}, and a set takes {takes}"
            whole = [size for size in range(1, sheets + 1) if sheets % size == 0]
            shown = whole if len(whole) <= MOST_NAMED else [*whole[: MOST_NAMED - 1], whole[-1]]
            fitting = " or ".join(str(size * self.pages_a_sheet) for size in shown)
            raise RequestError(
                WHERE, what, remedy=f"give pages-a-set={fitting}, so that whole sets make up the job"
            )
        return replace(self, job_pages=pages)

    def sides_of(self, pages: int) -> int:
        """Return the number of sides of a job with this number of pages, including blank sides of its last sheet."""
        return -(-pages // self.pages_a_sheet) * self.sides

    @property
    def blank_places(self) -> int:
        """Places on the last sheet of the job that stay blank."""
        return 0 if self.job_pages is None else -self.job_pages % self.pages_a_sheet

    def pages_on(self, number: int) -> tuple[int | None, ...]:
        """Return the page numbers, from 1, at the places of side ``number`` of the job, from 1, row by row.

        None: the place stays blank.

        >>> Layout.parse("sides=2,n-up=2x1").pages_on(4)
        (7, 8)
        >>> Layout.parse("sides=2,n-up=2x1").of(5).pages_on(3)
        (5, None)
        """
        first, of_side = self.first_page(number), self.pages_a_side
        back = (number - 1) % self.sides
        own = range(back * of_side, (back + 1) * of_side)
        shown = [first + (self.places[at] - 1 if self.places else at) for at in own]
        pages = [page if self.job_pages is None or page <= self.job_pages else None for page in shown]
        return tuple(pages) * (self.places_a_side if self.repeat else 1)

    def first_page(self, number: int) -> int:
        """Return the number of the first page on the sheet of side ``number``, both from 1: every sheet has one."""
        return (number - 1) // self.sides * self.pages_a_sheet + 1

    def side_name(self, number: int) -> str:
        """Return the name of side ``number`` of the job, from 1: that of its page if it has one, else of its sheet.

        >>> Layout.parse("sides=2").side_name(4), Layout.parse("sides=2,n-up=2x1").side_name(4)
        ('p0004', 's0002-back')
        """
        page = self.pages_on(number)[0]
        if self.pages_a_side == 1 and page is not None:
            return page_name(page)
        sheet, back = divmod(number - 1, self.sides)
        return self.sheet_name(sheet + 1) + (("-front", "-back")[back] if self.sides > 1 else "")

    def sheet_name(self, number: int) -> str:
        """Return the name of sheet ``number`` of the job, from 1: that of its page if it has one."""
        return page_name(number) if self.pages_a_sheet == 1 else f"s{number:04d}"

    def side_at(self, position: int, sheets: int) -> int:
        """Return the side of the run that passes at a position.

        ``sheets`` is the number of sheets of the run, of which the last batch or loop may be incomplete.

        >>> [Layout.parse("sides=2,order=loop:2").side_at(at, 4) for at in range(8)]
        [0, 2, 1, 4, 3, 6, 5, 7]
        """
        if self.sides == 1 or self.order == "alternate":
            return position
        if self.order == "batch":
            batch, at = divmod(position, 2 * self.depth)
            first = batch * self.depth
            own = min(self.depth, sheets - first)
            return 2 * (first + at) if at < own else 2 * (first + at - own) + 1
        depth = min(self.depth, sheets)
        if position < depth:
            return 2 * position
        at, back = divmod(position - depth, 2)
        if at < sheets - depth:
            return 2 * (depth + at) if back else 2 * at + 1
        return 2 * (position - sheets) + 1

    def position_of(self, side: int, sheets: int) -> int:
        """Return the position at which a side of the run passes, the inverse of ``side_at``."""
        if self.sides == 1 or self.order == "alternate":
            return side
        sheet, back = divmod(side, 2)
        if self.order == "batch":
            first = sheet - sheet % self.depth
            own = min(self.depth, sheets - first)
            return first * 2 + (sheet - first) + own * back
        depth = min(self.depth, sheets)
        if not back:
            return sheet if sheet < depth else depth + 2 * (sheet - depth) + 1
        return depth + 2 * sheet if sheet < sheets - depth else sheets + sheet


def backs_at(edge: Backs, *, across_mm: float, along_mm: float) -> Backs:
    """Return whether a back passes upright or turned, by the sheet's size as it enters the press. [mm]

    The press swaps leading and trailing edge, so that it turns the sheet over about an axis across the web.
    If that is the axis about which a reader turns it, the back passes upright, else turned by 180 degrees.
    """
    if edge in ("upright", "turned"):
        return edge
    about_across = (across_mm > along_mm) == (edge == "long-edge")
    return "upright" if about_across else "turned"


# --- values ---


def _checked(layout: Layout) -> Layout:
    wrong = remedy = ""
    every = range(1, layout.pages_a_sheet + 1)
    if layout.places and (layout.repeat or sorted(layout.places) != list(every)):
        wrong = f"places is {'-'.join(map(str, layout.places))}"
        remedy = f"name each page of a sheet once, {'-'.join(map(str, every))} in some order"
        if layout.repeat:
            remedy = "leave it out: repeat puts one page at all positions"
    elif layout.sides == 1 and (layout.order != "alternate" or layout.backs != "upright"):
        wrong, remedy = "order and backs apply only to sheets with two sides", "state sides=2"
    elif layout.pages_a_set is not None and layout.pages_a_set % layout.pages_a_sheet:
        wrong = f"a set takes {_count(layout.pages_a_set, 'page')}, and a sheet {layout.pages_a_sheet}"
        remedy = f"give a multiple of {layout.pages_a_sheet}"
    if wrong:
        raise RequestError(WHERE, wrong, remedy=remedy)
    return layout


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")


def _whole(least: int, most: int) -> Callable[[str], tuple[int, ...] | None]:
    def read(text: str) -> tuple[int, ...] | None:
        fits = text.isascii() and text.isdecimal() and len(text) < 10 and least <= int(text) <= most
        return (int(text),) if fits else None

    return read


def _order(text: str) -> tuple[str, int] | None:
    if text == "alternate":
        return text, 1
    kind, _, depth = text.partition(":")
    parsed = _whole(1, MOST_DEPTH)(depth)
    return (kind, parsed[0]) if kind in ("batch", "loop") and parsed else None


def _grid(text: str) -> tuple[int, int] | None:
    match = re.fullmatch(r"([0-9]{1,3})x([0-9]{1,3})", text)
    if not match:
        return None
    columns, rows = int(match[1]), int(match[2])
    return (columns, rows) if 1 <= columns <= MOST_ALONG and 1 <= rows <= MOST_ALONG else None


def _lengths(*, one: bool, least: float) -> Callable[[str], tuple[tuple[float, float]] | None]:
    """Return a reader of ``AxB``, or of one number for both. [mm]"""

    def read(text: str) -> tuple[tuple[float, float]] | None:
        number = r"([0-9]{1,5}(?:\.[0-9]{1,4})?)"
        match = re.fullmatch(f"{number}x{number}", text) or (re.fullmatch(number, text) if one else None)
        if not match:
            return None
        lengths = float(match[1]), float(match[match.lastindex or 1])
        return (lengths,) if all(least <= length <= MOST_MM for length in lengths) else None

    return read


def _numbers(text: str) -> tuple[tuple[int, ...]] | None:
    if not re.fullmatch(r"[0-9]{1,5}(-[0-9]{1,5})*", text):
        return None
    return (tuple(map(int, text.split("-"))),)


_KEYS: Final[dict[str, tuple[tuple[str, ...], Callable[[str], tuple[object, ...] | None], str]]] = {
    "sides": (("sides",), _whole(1, 2), "1 or 2"),
    "order": (("order", "depth"), _order, "alternate, batch:50 or loop:4"),
    "backs": (
        ("backs",),
        lambda text: (text,) if text in get_args(Backs) else None,
        f"{', '.join(get_args(Backs)[:-1])} or {get_args(Backs)[-1]}",
    ),
    "n-up": (("columns", "rows"), _grid, f"2x1, columns by rows, each up to {MOST_ALONG}"),
    "places": (("places",), _numbers, "2-1, the page of the sheet that each place shows"),
    "repeat": (
        ("repeat",),
        lambda text: (text == "yes",) if text in ("yes", "no") else None,
        "yes or no",
    ),
    "gutter": (("gutter_mm",), _lengths(one=True, least=0.0), "5 or 5x3 [mm]"),
    "sheet": (("sheet_mm",), _lengths(one=False, least=1.0), "450x320 [mm]"),
    "rotate": (
        ("rotate",),
        lambda text: (int(text),) if text in ("0", "90", "180", "270") else None,
        "0, 90, 180 or 270",
    ),
    "pages-a-set": (("pages_a_set",), _whole(1, MOST_DEPTH), "8"),
}
"""For each word: the fields that it sets, the reader of its value (None if invalid), and an example."""
