"""Composed page designs, any number from a seed.

Designs are drawn directly into CMYK rasters and not by way of a PDF: 2,500 designs are needed, and one at 200
dpi then takes about a tenth of the time that writing and ripping the same page takes, while the contents
(hard-edged type and line work, images, tints, black type printed over) are those of a RIP's output.

Nothing is shared between designs: words, pictures, colours and layout are all drawn from the design's own
generator, ``stream(seed, "design", index)``. Only solid inks and the letters of the typefaces recur.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from prooflight.errors import RequestError
from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.simulation.corpus.designs import books, display, office, sheets
from prooflight.simulation.corpus.designs.chance import often, pick_weighted, some
from prooflight.simulation.corpus.designs.design_style import DesignStyle
from prooflight.simulation.corpus.designs.inks import BLACK
from prooflight.simulation.corpus.designs.sheet import Sheet

if TYPE_CHECKING:
    Layout = Callable[[Sheet, np.random.Generator, DesignStyle], None]

BLACK_ALONE: Final = 0.30
"""Share of designs in one ink. Of 81 real pages collected for their variety 27 % rip to black alone; presses that
print statements, books and manuals run more of it, those that print marketing less. Assumed: a little above the
measured share."""
SIZES_MM: Final = {
    (210.0, 297.0): 84.0,
    (203.0, 267.0): 5.0,
    (148.0, 210.0): 5.0,
    (210.0, 210.0): 3.0,
    (176.0, 250.0): 2.0,
    (99.0, 210.0): 1.0,
}
"""Width and height with their frequency: A4, magazine, A5, square, B5, a third of A4. [mm]

None is wider than A4: the camera of the studies sees 216 mm.
"""
IN_BLACK: Final[dict[Layout, float]] = {
    office.letter: 10.0,
    office.invoice: 8.0,
    office.form_page: 8.0,
    office.statement: 6.0,
    office.report: 7.0,
    office.table_page: 6.0,
    books.book: 12.0,
    books.dictionary: 4.0,
    books.newspaper: 6.0,
    books.score: 7.0,
    books.manual: 5.0,
    sheets.labels: 3.0,
    sheets.coupons: 2.0,
    sheets.puzzles: 3.0,
    sheets.plan: 3.0,
    sheets.map_page: 1.5,
    sheets.scan: 2.0,
    sheets.tickets: 1.0,
    display.invitation: 2.5,
    display.full_picture: 1.0,
    display.poster: 2.0,
    display.cover: 1.5,
    display.slides: 1.5,
}
"""Frequency of each kind among designs in one ink: mostly office, transactional and book work."""
IN_COLOUR: Final[dict[Layout, float]] = {
    office.letter: 6.5,
    office.invoice: 5.5,
    office.form_page: 2.5,
    office.statement: 5.0,
    office.report: 5.0,
    office.table_page: 3.0,
    office.dashboard: 4.0,
    books.book: 3.0,
    books.newspaper: 3.0,
    books.magazine: 4.0,
    books.newsletter: 4.0,
    books.manual: 2.5,
    books.score: 0.5,
    display.full_picture: 10.0,
    display.poster: 8.0,
    display.cover: 6.0,
    display.slides: 3.0,
    display.menu: 3.0,
    display.certificate: 2.0,
    display.invitation: 6.0,
    display.flyer: 5.0,
    sheets.labels: 2.0,
    sheets.catalogue: 4.0,
    sheets.album: 4.0,
    sheets.calendar: 3.0,
    sheets.tickets: 2.0,
    sheets.map_page: 2.5,
    sheets.plan: 1.5,
    sheets.wrapping: 2.0,
    sheets.scan: 1.5,
    sheets.puzzles: 1.0,
    sheets.coupons: 0.5,
}
"""Frequency of each kind among designs in four inks.

They are tuned so that white, ink and edges spread as on real pages.
"""


RICH_BLACK: Final = ((0.60, 0.80), (0.57, 0.75), (0.54, 0.72), (0.80, 0.98))
"""Least and greatest ink area, C M Y K, of black type in four inks, as colour-managed office documents rip it. [-]"""


class Designs(Protocol):
    """Source of a study's pages; small, and may be sent to worker processes."""

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Corpus:
    """Corpus of all designs of one seed at one resolution."""

    seed: int
    dpi: float
    black_of_four: float = 0.0
    """Share of the designs in four inks whose black type and rules are set in four inks as well."""

    def __repr__(self) -> str:
        # Rows of studies are kept under it: designs as they always were go by the name that they always had.
        more = f", black_of_four={self.black_of_four!r}" if self.black_of_four else ""
        return f"Corpus(seed={self.seed!r}, dpi={self.dpi!r}{more})"

    def page(self, index: int, *, sheet: Callable[..., Sheet] = Sheet) -> Page:
        """Return design ``index``, from 0; there is no last one. sheet: see ``design_page``."""
        return design_page(self.seed, index, dpi=self.dpi, black_of_four=self.black_of_four, sheet=sheet)


def design_name(index: int) -> str:
    """Return the file-name stem of design ``index``, from 0.

    >>> design_name(0)
    'd00001'
    """
    return f"d{index + 1:05d}"


def design_page(
    seed: int, index: int, *, dpi: float, black_of_four: float = 0.0, sheet: Callable[..., Sheet] = Sheet
) -> Page:
    """Draw design ``index`` (from 0) of a seed, the same at every resolution but for the raster. [pixels/inch]

    black_of_four: see ``Corpus``; it changes no design that it is not drawn for. sheet: creates the sheet to
    draw on, of ``Sheet``'s arguments. RequestError: an index below 0, a resolution that is not above 0, or a
    share that is not 0 to 1.
    """
    if index < 0:
        raise RequestError("designs", f"there is no design {index}", remedy="count from 0")
    if not dpi > 0:
        raise RequestError("designs", f"a resolution of {dpi} dpi", remedy="give a dpi above 0")
    if not 0 <= black_of_four <= 1:
        raise RequestError("designs", f"black_of_four of {black_of_four}", remedy="give a share of 0 to 1")
    rng = stream(seed, "design", index)
    black_alone = often(rng, BLACK_ALONE)
    width_mm, height_mm = pick_weighted(rng, SIZES_MM)
    layout = pick_weighted(rng, IN_BLACK if black_alone else IN_COLOUR)
    design = DesignStyle.draw(rng, black_alone=black_alone)
    drawn_on = sheet(width_mm=width_mm, height_mm=height_mm, dpi=dpi)
    layout(drawn_on, rng, design)
    if not black_alone:
        # A generator of its own: whatever else is drawn stays as it is.
        _enrich_black(drawn_on, stream(seed, "rich-black", index), black_of_four)
    return Page(cmyk=drawn_on.cmyk, dpi=dpi, name=design_name(index), number=index + 1)


def _enrich_black(sheet: Sheet, rng: np.random.Generator, share: float) -> None:
    """Print solid areas of black alone in one recipe of four inks, with this probability.

    Pictures have none.
    """
    if not often(rng, share):
        return
    recipe = [round(255 * some(rng, *bounds)) for bounds in RICH_BLACK]
    sheet.cmyk[(sheet.cmyk == BLACK).all(axis=2)] = recipe
