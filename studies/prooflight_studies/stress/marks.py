"""Misprints on which no detector is trained: a class for each kind, with the amounts that a file states.

They are drawn into the page's raster, before it is printed; a digit by composing the page again. All are used, without
a least effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import RequestError
from prooflight.files.schema import Block, Positive
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight.simulation.misprints.drawing import (
    ALL_INKS,
    FULL,
    INKED,
    LEAST_INK_SHARE,
    SAMPLE_STEP,
    Box,
    rewrite,
)
from prooflight_studies.stress.nuisances import Percent, SheetTexture

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.simulation.misprints.drawing import Region

    Change = Callable[[NDArray[np.float32], slice], None]
    Compose = Callable[[Callable[..., Sheet]], Page]
    """Composition of one page, on the object that the given function returns for ``Sheet``'s arguments."""

BLACK: Final = slice(3, 4)
HAIR_EDGE_MM: Final = 25.0
"""Least distance from the page's edges to the hair's middle (the file's words)."""
MOST_CURVATURE_PER_MM: Final = 0.12
"""Greatest curvature of a hair, to either side (the file's words)."""
SCRATCH_DEG: Final = 30.0
"""Angle between a scratch and the travel, to either side (the file's words; assumed: exactly, and off the travel)."""
SUBPIXELS: Final = 8
"""Subpixels across a raster pixel that a thin mark crosses."""
TRIES: Final = 50
"""Number of windows drawn until two are separate and differ; a page where none do has no such misprint."""
DIGITS: Final = "0123456789"
SIZE_WITHIN_PT: Final = 0.5
"""Greatest difference from a stated size; assumed, since composed type is of any size."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """A page with a misprint."""

    page: Page
    regions_mm: tuple[Region, ...]
    """x, y, width, height of each region concerned; the whole page where all of it is. [mm]"""
    variant: str = ""
    """Amount of the kind, where it has several."""


class Mark(Block):
    """One kind of misprint."""

    what: str

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Return the page with the misprint; None: the kind cannot be on this page. The given page is not changed."""
        raise NotImplementedError


class Hair(Mark):
    """A curved black fibre on the page."""

    width_mm: Positive
    length_mm: Positive
    ink_percent: Percent

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Raise black to ``ink_percent`` where it is less; None: the page is too small for a hair off its edges."""
        extents_mm = np.array([page.width_mm, page.height_mm])
        if (extents_mm < 2 * HAIR_EDGE_MM).any():
            return None
        middle_mm = rng.uniform(HAIR_EDGE_MM, extents_mm - HAIR_EDGE_MM)
        ribbon = Ribbon(
            middle_mm=(float(middle_mm[0]), float(middle_mm[1])),
            angle=float(rng.uniform(0, 2 * np.pi)),
            curvature_per_mm=float(rng.uniform(-MOST_CURVATURE_PER_MM, MOST_CURVATURE_PER_MM)),
            width_mm=self.width_mm,
            length_mm=self.length_mm,
        )
        box, cover = ribbon.on(page)
        ink = np.float32(FULL * self.ink_percent / 100)

        def lay(values: NDArray[np.float32], rows: slice) -> None:
            values += (np.maximum(values, ink) - values) * cover[rows, :, None]

        return _rewritten(page, box, BLACK, lay, rng)


class Scratch(Mark):
    """A straight line along which all inks are lost."""

    width_mm: Positive
    length_mm: Positive
    loss_percent: Percent

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Draw a scratch with its middle on ink; None: there is none."""
        middle = _content(page, rng)
        if middle is None:
            return None
        turn = np.deg2rad(SCRATCH_DEG) * (1 if rng.random() < 0.5 else -1)
        row, column = middle
        ribbon = Ribbon(
            middle_mm=((column + 0.5) * page.pixel_mm, (row + 0.5) * page.pixel_mm),
            angle=float(np.pi / 2 + turn),
            curvature_per_mm=0.0,
            width_mm=self.width_mm,
            length_mm=self.length_mm,
        )
        box, cover = ribbon.on(page)
        left = 1 - cover * np.float32(self.loss_percent / 100)

        def take(values: NDArray[np.float32], rows: slice) -> None:
            values *= left[rows, :, None]

        return _rewritten(page, box, ALL_INKS, take, rng)


class Cast(Mark):
    """Too much or too little of one ink on the left or the right half, with a hard edge between."""

    amount_percent: Percent

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Change an ink that this half has; it is reduced where all of it is full. None: the page is blank."""
        rows, columns = page.cmyk.shape[:2]
        halves = [
            Box(top=0, left=left, bottom=rows, right=right)
            for left, right in ((0, columns // 2), (columns // 2, columns))
        ]
        choices = [
            (half, ink)
            for half in halves
            for ink in np.flatnonzero(_shares(page, half) >= LEAST_INK_SHARE).tolist()
        ]
        if not choices:
            return None
        half, ink = choices[int(rng.integers(len(choices)))]
        amount = self.amount_percent / 100
        plane = page.cmyk[half.rows, half.columns, ink]
        tints = plane[(plane > 0) & (plane < FULL)].size
        more = rng.random() < 0.5 and tints >= np.count_nonzero(plane) / 2
        gain = np.float32(1 + amount if more else 1 - amount)

        def multiply(values: NDArray[np.float32], rows: slice) -> None:
            values *= gain

        return _rewritten(page, half, slice(ink, ink + 1), multiply, rng)


class TextExchanged(Mark):
    """Two windows of the page, exchanged."""

    window_mm: tuple[Positive, Positive]
    """Width, height. [mm]"""

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Exchange windows that are both on content, separate, and different; None: no two are."""
        pair = _windows(page, self.window_mm, rng)
        if pair is None:
            return None
        cmyk = page.cmyk.copy()
        for place, source in (pair, pair[::-1]):
            cmyk[place.rows, place.columns] = page.cmyk[source.rows, source.columns]
        regions = tuple(box.region_mm(page) for box in pair)
        return Drawn(page=replace(page, cmyk=cmyk), regions_mm=regions)


class GlyphExchanged(Mark):
    """A window that shows content from elsewhere on the page."""

    window_mm: tuple[Positive, Positive]
    """Width, height. [mm]"""

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Copy between windows that are both on content, separate, and different; None: no two are."""
        pair = _windows(page, self.window_mm, rng)
        if pair is None:
            return None
        place, source = pair
        cmyk = page.cmyk.copy()
        cmyk[place.rows, place.columns] = page.cmyk[source.rows, source.columns]
        return Drawn(page=replace(page, cmyk=cmyk), regions_mm=(place.region_mm(page),))


class Mottle(Mark):
    """Unevenness that all inks have in common."""

    rms_percent: Percent
    grain_mm: Positive

    def drawn(self, page: Page, rng: np.random.Generator) -> Drawn | None:
        """Apply mottle to the whole page; None: it is blank."""
        whole = Box.whole(page)
        if (_shares(page, whole) < LEAST_INK_SHARE).all():
            return None
        texture = SheetTexture.draw(page, self.grain_mm, rng)
        rms = np.float32(self.rms_percent / 100)
        x_mm = (np.arange(whole.right) + 0.5) * page.pixel_mm

        def scatter(values: NDArray[np.float32], rows: slice) -> None:
            y_mm = (np.arange(rows.start, rows.stop) + 0.5) * page.pixel_mm
            field = texture.at(*np.meshgrid(x_mm, y_mm))
            values *= np.maximum(1 + rms * field, 0)[..., None]

        return _rewritten(page, whole, ALL_INKS, scatter, rng)


class Digit(Block):
    """One digit of printed text replaced by another of the same face and size, as its composer would have set it."""

    what: str
    sizes_pt: tuple[Positive, ...]

    def drawn(self, page: Page, rng: np.random.Generator, compose: Compose) -> Drawn | None:
        """Return the page composed again with one digit changed; None: it has no digit of about these sizes.

        Sizes that the page has are equally likely. compose: composes this very page on another sheet.
        """
        noted = NotedDigits()
        compose(noted.sheet)
        of_sizes = {
            size: [at for at, each in enumerate(noted.sizes_pt) if abs(each - size) <= SIZE_WITHIN_PT]
            for size in self.sizes_pt
        }
        sizes = [size for size, places in of_sizes.items() if places]
        for _ in range(TRIES if sizes else 0):
            size = sizes[int(rng.integers(len(sizes)))]
            at = int(rng.choice(of_sizes[size]))
            slip = NotedDigits(slip_at=at, slip=int(rng.integers(1, 10)))
            changed = replace(compose(slip.sheet), name=page.name)
            box = _changed(page, changed)
            if box is not None:  # else a picture lies over it
                return Drawn(page=changed, regions_mm=(box.region_mm(page),), variant=f"{size:g} pt")
        return None


@dataclass(slots=True, kw_only=True, eq=False)
class NotedDigits:
    """Record of a page's digits in the order in which they are set, optionally with one of them wrong."""

    slip_at: int | None = None
    slip: int = 0
    """Difference of the wrong digit from the right one, modulo 10."""
    sizes_pt: list[float] = field(default_factory=list)

    def sheet(self, **how: float) -> Sheet:
        """Return a sheet that records its digits here."""
        return _NotingSheet(self, **how)

    def set(self, letter: str, size_pt: float) -> str:
        """Return the letter that is drawn for a letter."""
        if letter not in DIGITS:
            return letter
        self.sizes_pt.append(size_pt)
        wrong = self.slip_at == len(self.sizes_pt) - 1
        return DIGITS[(int(letter) + self.slip) % 10] if wrong else letter


class _NotingSheet(Sheet):
    def __init__(self, noted: NotedDigits, **how: float) -> None:
        super().__init__(**how)
        self._noted = noted

    def _set(self, letter: str, size_pt: float) -> str:
        return self._noted.set(letter, size_pt)


MARKS: Final[Mapping[str, type[Mark | Digit]]] = {
    "hair": Hair,
    "scratch": Scratch,
    "cast": Cast,
    "text_exchanged": TextExchanged,
    "glyph_exchanged": GlyphExchanged,
    "mottle": Mottle,
    "digit": Digit,
}
"""Classes by the name of a file's table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ribbon:
    """A thin mark of constant curvature and even width."""

    middle_mm: tuple[float, float]
    """x, y. [mm]"""
    angle: float
    """Direction at the middle, from x towards y. [radian]"""
    curvature_per_mm: float
    width_mm: float
    length_mm: float

    def on(self, page: Page) -> tuple[Box, NDArray[np.float32]]:
        """Return the part of a page that the mark touches, and its coverage of each pixel, 0..1."""
        pixel = page.pixel_mm
        at = np.linspace(-self.length_mm / 2, self.length_mm / 2, 257)
        x_mm, y_mm = self._line(at)
        reach = self.width_mm / 2 + pixel
        rows, columns = page.cmyk.shape[:2]
        (left, right), (top, bottom) = (
            (
                min(max(int((line.min() - reach) / pixel), 0), most - 1),
                min(max(int((line.max() + reach) / pixel) + 1, 1), most),
            )
            for line, most in ((x_mm, columns), (y_mm, rows))
        )
        box = Box(top=top, left=left, bottom=bottom, right=right)
        row, column = (each + 0.5 for each in np.indices(box.shape))
        off, along = self._from_line((column + left) * pixel, (row + top) * pixel)
        near = np.nonzero((np.abs(off) <= reach) & (np.abs(along) <= self.length_mm / 2 + pixel))
        inside = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
        across, down = np.meshgrid(inside, inside)
        off, along = self._from_line(
            (near[1][:, None] + left + across.ravel()) * pixel,
            (near[0][:, None] + top + down.ravel()) * pixel,
        )
        covered = (np.abs(off) <= self.width_mm / 2) & (np.abs(along) <= self.length_mm / 2)
        cover = np.zeros(box.shape, np.float32)
        cover[near] = covered.mean(axis=1)
        return box, cover

    def _line(self, along: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points of the middle line at these positions along it. [mm]"""
        half = self.curvature_per_mm * along / 2
        chord = along * np.sinc(half / np.pi)
        return (
            self.middle_mm[0] + chord * np.cos(self.angle + half),
            self.middle_mm[1] + chord * np.sin(self.angle + half),
        )

    def _from_line(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the distances of points from the middle line, and their positions along it. [mm]

        The line may be straight.
        """
        x, y = x_mm - self.middle_mm[0], y_mm - self.middle_mm[1]
        ahead = x * np.cos(self.angle) + y * np.sin(self.angle)
        aside = y * np.cos(self.angle) - x * np.sin(self.angle)
        bend = self.curvature_per_mm
        to_centre = np.hypot(1 - bend * aside, bend * ahead)
        off = (2 * aside - bend * (ahead**2 + aside**2)) / (1 + to_centre)
        if abs(bend) < 1e-6:
            return off, ahead
        return off, np.arctan2(bend * ahead, 1 - bend * aside) / bend


def draw_mark(
    page: Page, mark: Mark | Digit, *, rng: np.random.Generator, compose: Compose | None = None
) -> Drawn | None:
    """Draw a misprint of that kind; None: it cannot be on this page, or changes nothing of it.

    compose: composes this very page on another sheet. RequestError: a digit, on a page that is not composed.
    """
    if isinstance(mark, Digit):
        if compose is None:
            raise RequestError(
                "misprint.digit",
                "a raster alone does not state the positions of its digits",
                remedy="use it on composed pages",
            )
        return mark.drawn(page, rng, compose)
    drawn = mark.drawn(page, rng)
    return None if drawn is None or np.array_equal(drawn.page.cmyk, page.cmyk) else drawn


def _rewritten(page: Page, box: Box, inks: slice, change: Change, rng: np.random.Generator) -> Drawn:
    cmyk = page.cmyk.copy()
    rewrite(cmyk, box, inks, change, rng)
    return Drawn(page=replace(page, cmyk=cmyk), regions_mm=(box.region_mm(page),))


def _changed(page: Page, other: Page) -> Box | None:
    """Return the least box that holds all differences of two pages of one size; None: there are none."""
    rows, columns = np.nonzero(page.packed != other.packed)
    if not rows.size:
        return None
    return Box(
        top=int(rows.min()), left=int(columns.min()), bottom=int(rows.max()) + 1, right=int(columns.max()) + 1
    )


def _content(page: Page, rng: np.random.Generator) -> tuple[int, int] | None:
    """Return a random pixel (row, column) that has ink; None: there is none."""
    inked = np.argwhere(page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP].max(axis=2) >= INKED)
    if not len(inked):
        return None
    row, column = inked[int(rng.integers(len(inked)))] * SAMPLE_STEP
    return int(row), int(column)


def _windows(page: Page, window_mm: tuple[float, float], rng: np.random.Generator) -> tuple[Box, Box] | None:
    """Return two windows about content that are separate and differ; None: there are none."""
    width_mm, height_mm = window_mm
    for _ in range(TRIES):
        boxes = []
        for _ in range(2):
            middle = _content(page, rng)
            if middle is None:
                return None
            boxes.append(Box.around(page, middle, width_mm=width_mm, height_mm=height_mm))
        one, other = boxes
        separate = (
            one.bottom <= other.top
            or other.bottom <= one.top
            or one.right <= other.left
            or other.right <= one.left
        )
        shown, elsewhere = (page.cmyk[box.rows, box.columns] for box in boxes)
        if separate and not np.array_equal(shown, elsewhere):
            return one, other
    return None


def _shares(page: Page, box: Box) -> NDArray[np.float64]:
    """Return the share of a part of the page that each ink covers, (4,), 0..1."""
    sample = page.cmyk[box.rows, box.columns][::SAMPLE_STEP, ::SAMPLE_STEP]
    shares: NDArray[np.float64] = sample.reshape(-1, 4).mean(axis=0) / FULL
    return shares
