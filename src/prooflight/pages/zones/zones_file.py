"""``job.zones.json``: the zones of a job's pages, and the price that was shown before they were saved.

Its schema is published as docs/reference/zones.schema.json.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

from pydantic import Field

from prooflight.errors import InputError, JobError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.files.given import GivenFiles
from prooflight.files.schema import Block, Count, Misfit, Name, Number, Positive, checked, parsed
from prooflight.pages.job import parse_pages
from prooflight.pages.zones.zone import Calibration, Kind, PageZones, Zone, contested, share_ignored

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

SCHEMA: Final = 1
"""Version of the schema. 1: zones, the careful share, the price."""
CAREFUL_SHARE: Final = 0.2
"""Default share of careful areas. assumed: the loss of the rest of the page is not noticed (its rate falls
by a fifth), and a careful area, which is small and compared with its own good prints, needs no more."""
MOST_IGNORED: Final = 0.9
"""Largest share of a page that may be ignored: with more, the page's position cannot be measured. assumed"""
OFF_PAGE_MM: Final = 0.5
"""Largest distance that a zone may reach beyond the page, as boxes of PDFs do that were rounded; it is cut
off there."""
LEAST_MM2: Final = 1.0
FILES: Final = GivenFiles(
    error=JobError, remedy="give the zones that `prooflight job zones` wrote", largest_mb=4.0
)

Corner = Annotated[tuple[Number, Number], Field(description="x, y on the page as printed [mm]")]
Extent = Annotated[float, Field(strict=True, ge=-1e4, le=1e4, allow_inf_nan=False)]


class ZoneEntry(Block):
    """One zone, of one page or of several."""

    name: Name
    kind: Kind
    """Treatment of the zone. ignore: not inspected. normal: as without zones. careful: tested with a share
    of the false-alarm rate of its own."""
    pages: Annotated[str, Field(max_length=1000)] = "all"
    """Pages of the job, such as 1,4-6; or all."""
    rectangle_mm: tuple[Extent, Extent, Positive, Positive] | None = None
    """Rectangle as x, y, width and height from the page's top-left corner as printed. [mm]"""
    polygon_mm: Annotated[tuple[Corner, ...], Field(min_length=3, max_length=200)] | None = None
    """Polygon as corners in order. [mm]"""


FIRST_PRICED: Final = "matched_filter"
"""The detector of prices that name none, as all did that were made before others could be priced."""


class PriceEntry(Block):
    """Good prints by which the zones were calibrated, and the price that was shown."""

    press: Name
    """Digest of the press."""
    zones: Name
    """Digest of the zones that were priced."""
    prints: Count
    seed: Count
    page_scores: tuple[Number, ...]
    careful_scores: tuple[Number, ...]
    careful_mean: tuple[Number, ...]
    careful_sd: tuple[Positive, ...]
    detector: Annotated[Name, Field(exclude_if=lambda name: name == FIRST_PRICED)] = FIRST_PRICED
    """Name of the detector that they calibrate, whose scores are on a scale of its own."""
    told: tuple[dict[str, Any], ...] = ()
    """The price as it was shown, one row a zone."""


class ZonesDocument(Block):
    """Content of the whole file."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    careful_share: Annotated[float, Field(strict=True, gt=0, le=0.5, allow_inf_nan=False)] = CAREFUL_SHARE
    """Share of the nominal false-alarm rate that careful areas may use."""
    zones: Annotated[tuple[ZoneEntry, ...], Field(min_length=1, max_length=2000)]
    price: PriceEntry | None = None
    """Price of the zones; null: they were not priced yet, and are not in force."""


def schema() -> dict[str, Any]:
    """Return the JSON Schema of the file."""
    return {"title": "job.zones.json", **ZonesDocument.model_json_schema(by_alias=True)}


@dataclass(frozen=True, slots=True, kw_only=True)
class JobZones:
    """Zones of the pages of one job."""

    document: ZonesDocument
    of_pages: Mapping[int, tuple[Zone, ...]]
    """Zones by page, from 1; pages without any are left out."""
    sizes_mm: tuple[tuple[float, float], ...]
    """Sizes of the job's pages."""

    @classmethod
    def create(
        cls,
        entries: Sequence[ZoneEntry],
        sizes_mm: Sequence[tuple[float, float]],
        *,
        careful_share: float = CAREFUL_SHARE,
        where: object = "zones",
    ) -> Self:
        """Create zones that are not yet priced; JobError if a zone is of no page, or not on it.

        ``sizes_mm`` are the sizes of the job's pages.
        """
        try:
            document = ZonesDocument(zones=tuple(entries), careful_share=careful_share)
        except ValueError as error:
            what = "there is no zone" if not entries else "cannot be zones"
            raise JobError(where, what, remedy="give 1 to 2,000 zones, and a share of at most 0.5") from error
        return cls.of(document, sizes_mm, where=where)

    @classmethod
    def read(cls, path: Path, sizes_mm: Sequence[tuple[float, float]]) -> Self:
        """Read zones from a file; JobError if it is none, or its zones do not fit pages of these sizes."""
        try:
            document = checked(ZonesDocument, parsed(FILES.read_text(path)))
        except Misfit as error:
            raise JobError(path, str(error), remedy=FILES.remedy) from error
        return cls.of(document, sizes_mm, where=path)

    @classmethod
    def of(cls, document: ZonesDocument, sizes_mm: Sequence[tuple[float, float]], *, where: object) -> Self:
        """Create zones from a document, checked against the job's pages."""
        of_pages: dict[int, tuple[Zone, ...]] = {}
        for entry in document.zones:
            zone = _zone(entry, where)
            for number in _pages(entry, len(sizes_mm), where):
                _refuse_off_page(zone, number, sizes_mm[number - 1], where)
                of_pages[number] = (*of_pages.get(number, ()), zone)
        for number, zones in of_pages.items():
            _refuse_all_ignored(zones, number, sizes_mm[number - 1], where)
        ordered = dict(sorted(of_pages.items()))
        return cls(document=document, of_pages=ordered, sizes_mm=tuple(sizes_mm))

    def without(self, name: str) -> tuple[ZoneEntry, ...]:
        """Return the zones except the one of this name; RequestError: there is none."""
        left = tuple(one for one in self.document.zones if one.name != name)
        if len(left) == len(self.document.zones):
            names = ", ".join(repr(one.name) for one in self.document.zones[:5])
            raise RequestError("zones", f"none is called {name!r}", remedy=f"name one of {names}")
        return left

    @property
    def zones_digest(self) -> str:
        """SHA-256 of the zones alone, to which their price refers."""
        return _digest(self.document.model_dump(mode="json", include={"zones", "careful_share"}))

    @property
    def digest(self) -> str:
        """SHA-256 of all content: equal digests, equal verdicts."""
        return _digest(self.document.model_dump(mode="json", by_alias=True))

    @property
    def kinds(self) -> frozenset[Kind]:
        """Kinds of its zones."""
        return frozenset(zone.kind for zone in self.document.zones)

    def page(self, page: Page) -> PageZones | None:
        """Return the zones of a page as it enters the press, turned or not, as they were priced; None if it
        has none.
        """
        zones = self.of_pages.get(page.number)
        if zones is None:
            return None
        width_mm, height_mm = self.sizes_mm[page.number - 1]
        if abs(page.width_mm - height_mm) < abs(page.width_mm - width_mm):
            zones = tuple(zone.turned(height_mm) for zone in zones)
        return PageZones(zones=zones, careful_share=self.document.careful_share, calibration=self.calibration)

    @property
    def calibration(self) -> Calibration | None:
        """Scores of good prints with the zones; None: they were not priced yet."""
        price = self.document.price
        if price is None:
            return None
        return Calibration(
            page_scores=price.page_scores,
            careful_scores=price.careful_scores,
            careful_mean=price.careful_mean,
            careful_sd=price.careful_sd,
        )

    def contested(self) -> list[str]:
        """Return notes for people about zones that overlap, a line a pair."""
        pairs = {
            (one.name, other.name): number
            for number, zones in reversed(tuple(self.of_pages.items()))
            for one, other in contested(zones)
        }
        return [
            f"page {number}: the careful zone {one!r} overlaps the ignored {other!r}; there, careful applies"
            for (one, other), number in pairs.items()
        ]

    def refuse_unpriced(self, press_digest: str, detector: str, *, where: object) -> None:
        """Raise RequestError if the zones were not priced on the press of this digest, and for this detector.

        Without a price that was shown, no false-alarm rate is guaranteed.
        """
        price, remedy = (
            self.document.price,
            "run `prooflight zones price`, which shows what they cost, with --save",
        )
        if price is None:
            raise RequestError(where, "its zones have not been priced", remedy=remedy)
        if price.press != press_digest:
            raise RequestError(where, "its zones were priced on another press", remedy=remedy)
        if price.detector != detector:
            what = f"its zones were priced for the detector {price.detector!r}"
            raise RequestError(where, what, remedy=f"{remedy} --detector {detector}")
        if price.zones != self.zones_digest:
            raise RequestError(where, "its zones were changed after they had been priced", remedy=remedy)

    def unpriced(self) -> JobZones:
        """Return the same zones without a price."""
        return replace(self, document=self.document.model_copy(update={"price": None}))

    def priced(self, price: PriceEntry) -> JobZones:
        """Return the same zones with a price."""
        return replace(self, document=self.document.model_copy(update={"price": price}))

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        raw = self.document.model_dump(mode="json", by_alias=True)
        raw["zones"] = [
            {name: value for name, value in zone.items() if value is not None} for zone in raw["zones"]
        ]
        if raw["price"] is None:
            del raw["price"]
        with whole_file(path) as unfinished:
            unfinished.write_text(json.dumps(raw, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _digest(raw: Any) -> str:
    text = json.dumps(raw, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _zone(entry: ZoneEntry, where: object) -> Zone:
    if (entry.rectangle_mm is None) == (entry.polygon_mm is None):
        what = f"zone {entry.name!r} needs either rectangle_mm or polygon_mm"
        raise JobError(where, what, remedy="give x, y, width and height, or the corners")
    if entry.rectangle_mm is not None:
        zone = Zone.rectangle(entry.name, entry.kind, entry.rectangle_mm)
    else:
        assert entry.polygon_mm is not None
        zone = Zone(name=entry.name, kind=entry.kind, corners_mm=entry.polygon_mm)
    if zone.area_mm2 < LEAST_MM2:
        what = f"zone {entry.name!r} is of {zone.area_mm2:.2f} mm2"
        raise JobError(where, what, remedy=f"a zone has {LEAST_MM2:g} mm2 or more")
    return zone


def _pages(entry: ZoneEntry, count: int, where: object) -> Sequence[int]:
    if entry.pages == "all":
        return range(1, count + 1)
    try:
        return parse_pages(entry.pages, count)
    except InputError as error:
        raise JobError(where, f"zone {entry.name!r}: {error.what}", remedy=error.remedy) from error


def _refuse_off_page(zone: Zone, number: int, size_mm: tuple[float, float], where: object) -> None:
    x, y, width, height = zone.box
    over = max(-x, -y, x + width - size_mm[0], y + height - size_mm[1])
    if over > OFF_PAGE_MM:
        what = f"zone {zone.name!r} reaches {over:.1f} mm beyond page {number}"
        raise JobError(where, what, remedy=f"the page is {size_mm[0]:.1f} x {size_mm[1]:.1f} mm")


def _refuse_all_ignored(
    zones: tuple[Zone, ...], number: int, size_mm: tuple[float, float], where: object
) -> None:
    share = share_ignored(PageZones(zones=zones, careful_share=CAREFUL_SHARE), *size_mm)
    if share > MOST_IGNORED:
        what = f"zones ignore {share:.0%} of page {number}"
        raise JobError(where, what, remedy=f"leave {1 - MOST_IGNORED:.0%} of each page to be inspected")
