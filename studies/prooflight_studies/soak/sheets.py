"""Input of the soak: prints of whole designs and of forms that differ in three words, and the faults."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import design_page
from prooflight.simulation.corpus.designs.faces import OutlineFace
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight.simulation.drum import LINE_FAULTS, ORDER_FAULTS, DrumFault
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_line.run.sheets.thumbnails import thumbnail_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.drum import Turn
    from prooflight_line.run.sheets.thumbnails import Thumbnail

TEXTS: Final = 3
"""Number of words by which the forms of one template differ."""
FIELD_MM: Final = (34.0, 6.0)
LETTERS: Final = "ABCDEFGHKLMNPRSTUVWXYZ"
TYPE_PT: Final = 11.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoakRing:
    """A job printed once in the press world, and two sheets that are not part of it."""

    thumbnails: tuple[Thumbnail, ...]
    scans: tuple[NDArray[np.uint16], ...]
    blank: NDArray[np.uint16]
    foreign: NDArray[np.uint16]


class RepeatedJob:
    """A job's thumbnails, repeated for so many sheets; ``following.Expected``."""

    def __init__(self, designs: Sequence[Thumbnail | None], sheets: int) -> None:
        self._designs, self._sheets = designs, sheets

    def __len__(self) -> int:
        return self._sheets

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < self._sheets:
            raise IndexError(sheet)
        return self._designs[sheet % len(self._designs)]


def soak_ring(
    press: Press,
    *,
    designs: int,
    templates: int,
    forms: int,
    seed: int,
    progress: Callable[[str], None],
) -> SoakRing:
    """Print a job: so many whole designs, then so many forms of each of some templates, one after the other."""
    session = Session.draw(amounts_of(press), press, stream(seed, "session"))
    thumbnails, scans = [], []

    def printed(page: Page, index: int) -> NDArray[np.uint16]:
        rng = stream(seed, "soak-print", index)
        scan = scan_page(
            page, press=press, request=None, others=(), fetch=lambda _: page, rng=rng, session=session
        )
        return scan.dn

    count = designs + templates * forms
    for index, drawn in enumerate(_pages(press.dpi, designs, templates, forms, seed)):
        progress(f"printing page {index + 1} of {count}")
        page = press.geometry.lay(drawn)
        good = predict(page, sensors=press.sensors, geometry=press.geometry)
        thumbnails.append(thumbnail_of(page, good, press))
        scans.append(printed(page, index))
    unknown_sheet = design_page(seed, count + 1000, dpi=press.dpi)
    white = replace(unknown_sheet, cmyk=np.zeros_like(unknown_sheet.cmyk))
    return SoakRing(
        thumbnails=tuple(thumbnails),
        scans=tuple(scans),
        blank=printed(white, count),
        foreign=printed(unknown_sheet, count + 1),
    )


def _pages(dpi: float, designs: int, templates: int, forms: int, seed: int) -> Iterator[Page]:
    for index in range(designs):
        yield design_page(seed, index, dpi=dpi)
    for template in range(templates):
        empty = design_page(seed, designs + template, dpi=dpi)
        rng = stream(seed, "soak-forms", template)
        high, wide = (extent - size for extent, size in zip(_extent(empty), FIELD_MM[::-1], strict=True))
        places = [
            (float(rng.uniform(10, wide - 10)), float(rng.uniform(10, high - 10))) for _ in range(TEXTS)
        ]
        for _ in range(forms):
            yield _filled_in(empty, places, rng)


def _extent(page: Page) -> tuple[float, float]:
    return page.height_mm, page.width_mm


def _filled_in(empty: Page, places_mm: list[tuple[float, float]], rng: np.random.Generator) -> Page:
    """Return a form with its own words in white fields."""
    cmyk = empty.cmyk.copy()
    for x_mm, y_mm in places_mm:
        field = Sheet(width_mm=FIELD_MM[0], height_mm=FIELD_MM[1], dpi=empty.dpi)
        letters = "".join(rng.choice(list(LETTERS), 8))
        field.draw_text(1.0, 4.6, letters, OutlineFace("DejaVuSans"), TYPE_PT)
        top, left = round(y_mm / empty.pixel_mm), round(x_mm / empty.pixel_mm)
        rows, columns = field.cmyk.shape[:2]
        cmyk[top : top + rows, left : left + columns] = field.cmyk
    return replace(empty, cmyk=cmyk)


def drawn_faults(sheets: int, *, every: int, spacing: int, rng: np.random.Generator) -> dict[int, DrumFault]:
    """Draw faults of all kinds, evenly, one in ``every`` sheets on average.

    They are at least ``spacing`` sheets from each other.
    """
    kinds = (*ORDER_FAULTS, *LINE_FAULTS)
    faults, sheet = dict[int, DrumFault](), spacing
    while True:
        sheet += spacing + int(rng.geometric(1 / (every - spacing + 1)) - 1)
        if sheet >= sheets - spacing:
            return faults
        faults[sheet] = DrumFault.draw(kinds[int(rng.integers(len(kinds)))], rng)


@dataclass(frozen=True, slots=True, kw_only=True)
class Passed:
    """True state of a sheet that passes the camera."""

    page: int | None
    """Page of the job; None: the sheet is not part of it."""
    fault: int | None
    """Index of the fault, among those drawn, that concerns the sheet; None: none does."""


def truth(passing: list[Turn], faults: dict[int, DrumFault]) -> list[Passed]:
    """Return the sheets that pass, one an entry.

    A fault concerns its own sheet, both of two sheets that changed places, the second print of a repeated page, and the
    sheet after a missing page.
    """
    number = {sheet: index for index, sheet in enumerate(faults)}
    of_fault = {id(fault): number[sheet] for sheet, fault in faults.items()}
    swapped = {
        place: number[sheet]
        for sheet, fault in faults.items()
        if fault.kind == "out-of-order"
        for place in (sheet, sheet + 1)
    }
    twice = {sheet: number[sheet] for sheet, fault in faults.items() if fault.kind == "repeated"}
    sheets, pending, came = list[Passed](), None, set[int]()
    for turn in passing:
        if turn.fault is not None and turn.fault.kind == "missing":
            pending = of_fault[id(turn.fault)]
            continue
        fault = pending if turn.fault is None else of_fault[id(turn.fault)]
        if fault is None and turn.page is not None:
            fault = swapped.get(turn.page, twice.get(turn.page) if turn.page in came else None)
        if turn.page is not None:
            came.add(turn.page)
        sheets.append(Passed(page=turn.page, fault=fault))
        pending = None
    return sheets
