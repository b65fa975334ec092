"""Common parts of drawing a misprint: its description, places on the page, soft edges, ink that rounding preserves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_NAMES
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.worlds import amount, entry

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

FULL = 255.0
ALL_INKS = slice(0, 4)
LEAST_INK_SHARE = 1e-3
"""assumed: a page has an ink that covers 0.1 % of it, 60 mm2 of A4; fewer is a mark in a corner."""
INKED = 64
"""assumed: a quarter of full ink or more is content that a defect can hit."""
SAMPLE_STEP = 4
"""Step in pixels, both ways, of the sample that shows which inks a page has, and where."""
BAND_VALUES = 2**17
"""Number of ink values processed at once, so that they stay in the processor's cache."""
NOISE_STARTS = 2**16
BELOW_ONE = 1 - 2**-14
"""Factor that keeps 254 + noise below 255 in 32-bit floats."""

Region = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Misprint:
    """Misprint of a page."""

    kind: str
    severity: float
    scope: Literal["global", "local"]
    """Scope of the kind, as ``worlds.toml`` has it."""
    detail: str
    """Description in a printer's terms, e.g. ``magenta faded to 20 % over the page``."""
    region_mm: Region
    """Place concerned as x, y, width, height; the whole page where it is global. [mm]"""
    regions_mm: tuple[Region, ...] = ()
    """Place of each spot where there are several. [mm]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """Misprinted page: its raster, and its placement under the camera."""

    page: Page
    placement: Placement
    """``IN_PLACE`` unless the misprint displaces the page; it is added to a good print's own placement."""
    misprint: Misprint


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Rows top..bottom and columns left..right of a raster, last ones excluded. [pixels]"""

    top: int
    left: int
    bottom: int
    right: int

    @classmethod
    def whole(cls, page: Page) -> Box:
        """Return the box of a whole page."""
        return cls(top=0, left=0, bottom=page.cmyk.shape[0], right=page.cmyk.shape[1])

    @classmethod
    def around(cls, page: Page, centre: tuple[int, int], *, width_mm: float, height_mm: float) -> Box:
        """Return a box about a pixel (row, column), at most as large as the page and moved onto it."""
        edges = []
        for at, extent_mm, most in zip(centre, (height_mm, width_mm), page.cmyk.shape[:2], strict=True):
            extent = min(max(round(extent_mm / page.pixel_mm), 1), most)
            edges.append((min(max(at - extent // 2, 0), most - extent), extent))
        (top, height), (left, width) = edges
        return cls(top=top, left=left, bottom=top + height, right=left + width)

    @property
    def rows(self) -> slice:
        """Return the rows as an index of a raster."""
        return slice(self.top, self.bottom)

    @property
    def columns(self) -> slice:
        """Return the columns as an index of a raster."""
        return slice(self.left, self.right)

    @property
    def shape(self) -> tuple[int, int]:
        """Return the number of rows and of columns."""
        return self.bottom - self.top, self.right - self.left

    def region_mm(self, page: Page) -> Region:
        """Return x, y, width, height, to a micrometre. [mm]"""
        corners = np.array([self.left, self.top, *self.shape[::-1]]) * page.pixel_mm
        x, y, width, height = (round(float(v), 3) for v in corners)
        return x, y, width, height


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mishap:
    """Input of a kind of misprint: the page and the rest of its job."""

    kind: str
    page: Page
    severity: float
    rng: np.random.Generator
    """Generator of inks, places and shapes: the same draws whatever the severity."""
    rounding: np.random.Generator
    others: Sequence[int]
    """Numbers of the job's other pages."""
    fetch: Callable[[int], Page]
    """Function that returns them."""

    def drawn(
        self,
        detail: str,
        *,
        cmyk: NDArray[np.uint8] | None = None,
        boxes: Sequence[Box] = (),
        placement: Placement = IN_PLACE,
    ) -> Drawn:
        """Return the result.

        cmyk: the printed raster, if not the page itself; boxes: places concerned, none for the page.
        """
        page, places = self.page, tuple(boxes) or (Box.whole(self.page),)
        around = Box(
            top=min(box.top for box in places),
            left=min(box.left for box in places),
            bottom=max(box.bottom for box in places),
            right=max(box.right for box in places),
        )
        misprint = Misprint(
            kind=self.kind,
            severity=self.severity,
            scope=entry(self.kind)["scope"],
            detail=detail,
            region_mm=around.region_mm(page),
            regions_mm=tuple(box.region_mm(page) for box in places) if len(places) > 1 else (),
        )
        printed = page if cmyk is None else replace(page, cmyk=cmyk)
        return Drawn(page=printed, placement=placement, misprint=misprint)

    def amount(self, name: str) -> float:
        """Return an amount of ``worlds.toml`` that depends on severity."""
        return amount(self.kind, name, self.severity)

    def between(self, name: str) -> float:
        """Draw an amount of ``worlds.toml`` that does not, from low to high.

        assumed: uniformly by octaves.
        """
        spec = entry(self.kind)[name]
        return self.by_octaves(spec["low"], spec["high"])

    def by_octaves(self, low: float, high: float) -> float:
        """Draw an amount from low to high, all octaves equally likely."""
        return float(low * (high / low) ** self.rng.random())

    def rewritten(
        self, box: Box, inks: slice, change: Callable[[NDArray[np.float32], slice], None]
    ) -> NDArray[np.uint8]:
        """Return the page's raster after ``rewrite``."""
        cmyk = self.page.cmyk.copy()
        rewrite(cmyk, box, inks, change, self.rounding)
        return cmyk

    def ink_shares(self) -> NDArray[np.float64]:
        """Return the share of the page that each ink covers (4,), 0..1."""
        sample = self.page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP]
        shares: NDArray[np.float64] = sample.reshape(-1, 4).mean(axis=0) / FULL
        return shares

    def inks(self) -> list[int]:
        """Return the inks that the page has; all four if it is blank."""
        share = self.ink_shares()
        return np.flatnonzero(share >= LEAST_INK_SHARE).tolist() or list(range(4))

    def one_ink(self) -> slice:
        """Draw an ink that the page has, as an index of planes."""
        ink = int(self.rng.choice(self.inks()))
        return slice(ink, ink + 1)

    def one_or_all_inks(self) -> slice:
        """Draw one ink or all; assumed: as often one as all."""
        one = self.one_ink()
        return one if self.rng.random() < 0.5 else ALL_INKS

    def content(self, inks: slice = ALL_INKS, *, rows: int | None = None) -> tuple[int, int]:
        """Draw a pixel (row, column) that has some of these inks, of the first ``rows``; anywhere if none has.

        A defect that hits no content is no misprint and would be drawn again.
        """
        sample = self.page.cmyk[:rows:SAMPLE_STEP, ::SAMPLE_STEP, inks]
        return self._one_of(sample.max(axis=2) >= INKED, rows)

    def edge(self) -> tuple[int, int]:
        """Draw a pixel where ink changes to the right or below; anywhere if there is none."""
        ink = self.page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP].max(axis=2).astype(np.int16)
        down, across = (np.abs(np.diff(ink, axis=axis, append=ink.take([-1], axis))) for axis in (0, 1))
        return self._one_of(down + across >= INKED)

    def paper(self) -> tuple[int, int]:
        """Draw a pixel of bare paper; anywhere if there is none."""
        return self._one_of(self.page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP].max(axis=2) < INKED)

    def _one_of(self, wanted: NDArray[np.bool_], rows: int | None = None) -> tuple[int, int]:
        candidates = np.flatnonzero(wanted)
        place = self.rng.random()
        if not candidates.size:
            return self.anywhere(rows=rows)
        row, column = divmod(int(candidates[int(place * candidates.size)]), wanted.shape[1])
        return row * SAMPLE_STEP, column * SAMPLE_STEP

    def anywhere(self, *, rows: int | None = None) -> tuple[int, int]:
        """Draw a pixel (row, column) of the page, or of its first rows."""
        most, columns = self.page.cmyk.shape[:2]
        return int(self.rng.integers(rows or most)), int(self.rng.integers(columns))


def inks_named(inks: slice) -> str:
    """Return ``cyan`` or another ink's name, or ``all inks``."""
    return INK_NAMES[inks.start] if inks.stop - inks.start == 1 else "all inks"


def rewrite(
    cmyk: NDArray[np.uint8],
    box: Box,
    inks: slice,
    change: Callable[[NDArray[np.float32], slice], None],
    rng: np.random.Generator,
) -> None:
    """Change part of a raster (rows, columns, 4) in place, a band of rows at a time.

    change(values, rows) alters values (rows, columns, inks), 0..255, in place; rows count from the box's top.
    The result is rounded up or down at random so that the mean is preserved: half a per cent of a tint is
    less than one step of a byte. Values that it does not change stay exactly as they are.
    """
    place = cmyk[box.rows, box.columns, inks]
    rows, columns, planes = place.shape
    step = max(BAND_VALUES // (columns * planes), 1)
    noise = rng.random(min(step, rows) * columns * planes + NOISE_STARTS, dtype=np.float32)
    noise *= np.float32(BELOW_ONE)
    for top in range(0, rows, step):
        band = slice(top, min(top + step, rows))
        values = place[band].astype(np.float32)
        change(values, band)
        start = int(rng.integers(NOISE_STARTS))  # so that no pattern repeats along the travel
        values += noise[start : start + values.size].reshape(values.shape)
        np.minimum(values, np.float32(FULL), out=values)
        place[band] = values


def plateau(count: int, taper: float) -> NDArray[np.float32]:
    """Return weights (count,) that rise from 0 over ``taper`` places as a raised cosine, stay 1, and fall likewise."""
    at = np.arange(count) + 0.5
    inwards = np.minimum(at, count - at) / max(min(taper, count / 2), 0.5)
    weights: NDArray[np.float32] = (0.5 - 0.5 * np.cos(np.pi * np.minimum(inwards, 1))).astype(np.float32)
    return weights
