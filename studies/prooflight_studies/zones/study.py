"""Zones on prints of the press world: predicted and observed cost, hidden defects, and false-alarm rate."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import trained
from prooflight.commissioning.zones.defects import DARK, SORTS, STREAK_MM, Area, areas_of, disc
from prooflight.commissioning.zones.price import PRINTS, TRIALS, ZonePrints, price_of
from prooflight.detectors.registry import detector
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.pages.parallel import in_order
from prooflight.pages.raster import Page
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.prediction.predict import expected_light
from prooflight.press.pages import job_source
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.detectors.optional import ZonePricing
    from prooflight.pages.zones.zone import Kind
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press

PIXELS: Final = 400
"""Pixels of the camera: the paper's rig with a shorter line."""
PAGE_MM: Final = (38.0, 54.0)
PAGES: Final = 5
ZONES_A_PAGE: Final = 12
ZONE_MM: Final = (8.0, 8.0)
DESIGNS: Final = 24
SPECIMEN_SEED: Final = 1
QUICK_TRIALS: Final = 4
CAME: Final = 2
"""Number of prints at the predicted strength, of each sort in each zone."""
GOOD: Final = 40
"""Number of fresh good prints of a page, with each set of zones."""
NEAR_MM: Final = (0.6, 3.0)
"""Distance of a defect's middle from an ignored zone, beyond its own reach and the strip of 0.5 mm."""
LEAST_PRINTED: Final = 0.25
"""Least share of a piece that must be printed."""
STRONG: Final = {"spot": 2.0, "streak": 60.0, "density": 60.0}
"""Defects put into ignored zones, and next to them."""
QUICK: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Numbers of prints and of those that alarmed."""

    prints: int
    alarms: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRows:
    """Results of one page, by sort of defect."""

    careful_zones: int
    ignored_zones: int
    foretold: list[dict[str, Any]]
    """Rows for each careful zone and sort.

    They hold the least strength before and after, and prints and alarms at the predicted strength.
    """
    rest: list[dict[str, Any]]
    inside: dict[str, Tally]
    """Defects within ignored zones, with the zones in force."""
    inside_bare: dict[str, Tally]
    """The same defects without the zones."""
    beside: list[dict[str, Any]]
    """Rows for each print: sort, caught without zones, caught with them."""
    good: dict[str, Tally]
    """Fresh good prints by kind of zones; ``good_bare``: without the zones."""
    good_bare: dict[str, Tally]


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesResults:
    """Results of the study, as the page shows them."""

    seed: int
    quick: bool
    pages: int
    page_mm: tuple[float, float]
    zone_mm: tuple[float, float]
    prints: int
    trials: int
    promised: float
    careful_share: float
    careful_zones: int
    ignored_zones: int
    price: list[dict[str, Any]]
    """Cost of careful zones by sort: medians before and after, as predicted, and observed alarms."""
    rest: list[dict[str, Any]]
    inside: list[dict[str, Any]]
    beside: list[dict[str, Any]]
    good: list[dict[str, Any]]
    strong: dict[str, float]


def run_zones_study(
    out: Path, *, seed: int, quick: bool = False, progress: Callable[[str], None] = lambda _: None
) -> ZonesResults:
    """Compute the cost of careful and ignored zones on pages, then print; writes zones.md."""
    progress("building a press")
    press = build_press(PressFile.prototype(), seed=SPECIMEN_SEED, pixels=PIXELS)
    press = trained(press, Pieces(corpus=Corpus(seed=seed + 1, dpi=press.dpi)), designs=DESIGNS, seed=seed)
    pages = QUICK if quick else PAGES
    rows: list[PageRows] = []
    work = partial(page_rows, press=press, seed=seed, quick=quick)
    for done, one in enumerate(in_order(work, range(pages), fewest=2), start=1):
        rows.append(one)
        progress(f"page {done} of {pages}")
    promised = detector(None, press).false_alarm_rate
    assert promised is not None
    results = zones_results(rows, seed=seed, nominal_rate=promised, quick=quick)
    write_page(out / "zones.md", "zones", results)
    return results


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """Pieces of composed designs, as large as the study's pages."""

    corpus: Corpus

    def page(self, index: int) -> Page:
        """Return the middle of design ``index``, or another piece of it where that is almost bare."""
        whole = self.corpus.page(index)
        size = [round(extent / whole.pixel_mm) for extent in reversed(PAGE_MM)]
        most, best = -1.0, whole.cmyk
        for down in (0.5, 0.2, 0.8):
            for across in (0.5, 0.1, 0.9):
                top, left = (
                    round(share * (extent - side))
                    for share, extent, side in zip((down, across), whole.cmyk.shape, size, strict=False)
                )
                piece = whole.cmyk[top : top + size[0], left : left + size[1]]
                printed = float(piece.any(axis=2).mean())
                if printed > most:
                    most, best = printed, piece
                if printed >= LEAST_PRINTED:
                    break
        return Page(cmyk=np.ascontiguousarray(best), dpi=whole.dpi, name=whole.name, number=whole.number)


def zones_of(kind: Kind, rng: np.random.Generator) -> list[ZoneEntry]:
    """Return zones spread over a page, each at a random position in a cell of its own."""
    zones = []
    columns, rows = 3, ZONES_A_PAGE // 3
    cell = PAGE_MM[0] / columns, PAGE_MM[1] / rows
    for number in range(ZONES_A_PAGE):
        row, column = divmod(number, columns)
        x, y = (
            round(place * side + float(rng.uniform(2.0, side - extent - 2.0)), 2)
            for place, side, extent in zip((column, row), cell, ZONE_MM, strict=True)
        )
        zones.append(ZoneEntry(name=f"{kind} {number + 1}", kind=kind, rectangle_mm=(x, y, *ZONE_MM)))
    return zones


def page_rows(index: int, *, press: Press, seed: int, quick: bool = False) -> PageRows:
    """Measure one page with careful zones, and with ignored ones; its design took no part in training."""
    page = Pieces(corpus=Corpus(seed=seed + 2, dpi=press.dpi)).page(index)
    rng = stream(seed, "zones-study", index)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "p0001.tif"
        write_tiff(page, path)
        source = job_source(path, press)
        priced = partial(price_of, source, press, seed=seed * 1000 + index, processes=1)
        sizes = [(page.width_mm, page.height_mm)]
        careful = JobZones.create(zones_of("careful", rng), sizes)
        ignored = JobZones.create(zones_of("ignore", rng), sizes)
        price = priced(careful, trials=QUICK_TRIALS if quick else TRIALS)
        bench = Bench(source, press, careful.priced(price.entry), seed=seed * 1000 + index)
        foretold = list(bench.foretold(price, came=1 if quick else CAME))
        good = {"careful": bench.good(10 if quick else GOOD, first=0)}
        rest = [
            {
                "sort": sort.name,
                "before": _finite(one.before[sort.name].least),
                "after": _finite(one.after[sort.name].least),
            }
            for one in price.areas
            if one.kind == "rest"
            for sort in SORTS
        ]
        without = priced(ignored, trials=0)
        bench = Bench(source, press, ignored.priced(without.entry), seed=seed * 1000 + index)
        good |= {"ignored": bench.good(10 if quick else GOOD, first=1000)}
        inside = {sort.name: bench.inside(sort.name) for sort in SORTS}
        near = [row for sort in ("spot", "streak") for row in bench.alongside(sort)]
    return PageRows(
        careful_zones=len(careful.document.zones),
        ignored_zones=len(ignored.document.zones),
        foretold=foretold,
        rest=rest,
        inside={name: zoned for name, (zoned, _) in inside.items()},
        inside_bare={name: bare for name, (_, bare) in inside.items()},
        beside=near,
        good={name: zoned for name, (zoned, _) in good.items()},
        good_bare={name: bare for name, (_, bare) in good.items()},
    )


class Bench:
    """Prints of one page with its zones in force."""

    def __init__(self, source: JobSource, press: Press, zones: JobZones, *, seed: int) -> None:
        self.prints = ZonePrints(job=source, press=press, zones=zones, numbers=(1,), seed=seed)
        self.page, self.bare, self.zoned = self.prints.ready(1)
        of_page = zones.page(self.page)
        assert of_page is not None
        self.areas = areas_of(of_page)
        self.seed, self._next = seed, 0

    def alarms(self, page: Page, rng: np.random.Generator) -> tuple[bool, bool]:
        """Return whether one more print of a page alarms with zones, and without."""
        scan = self.prints.printed(page, rng)
        with_zones = self.zoned.inspect(scan)
        if self.bare is None:
            return _alarmed(with_zones), without_zones(self.prints.pricing, with_zones)
        return _alarmed(with_zones), _alarmed(self.bare.inspect(scan))

    def good(self, count: int, *, first: int) -> tuple[Tally, Tally]:
        """Count alarms on fresh good prints, with zones and without."""
        outcomes = [self.alarms(self.page, self._rng(first + at)) for at in range(count)]
        return tuple(Tally(prints=count, alarms=sum(column)) for column in zip(*outcomes, strict=True))  # type: ignore[return-value]

    def foretold(self, price: Any, *, came: int) -> Iterator[dict[str, Any]]:
        """Yield the predicted cost of every careful zone and sort, and the alarms of prints at that strength."""
        by_name = {area.name: area for area in self.areas}
        for priced in price.areas:
            if priced.kind != "careful":
                continue
            for sort in SORTS:
                least = priced.after[sort.name].least
                tally = Tally(prints=0, alarms=0)
                if np.isfinite(least):
                    tally = self._tally(sort.name, least, by_name[priced.name], came)[0]
                yield {
                    "sort": sort.name,
                    "before": _finite(priced.before[sort.name].least),
                    "after": _finite(least),
                    "prints": tally.prints,
                    "alarms": tally.alarms,
                }

    def inside(self, sort: str) -> tuple[Tally, Tally]:
        """Count alarms on strong defects wholly in every ignored zone: with zones, and without."""
        reach = STRONG["spot"] / 2 if sort == "spot" else 0.0
        wholly = [
            Area(name=area.name, kind=area.kind, holds=partial(_within, area=area, reach=reach))
            for area in self.areas
            if area.kind == "ignore"
        ]
        outcomes = [self._tally(sort, STRONG[sort], area, 1) for area in wholly]
        return tuple(  # type: ignore[return-value]
            Tally(prints=sum(one.prints for one in column), alarms=sum(one.alarms for one in column))
            for column in zip(*outcomes, strict=True)
        )

    def alongside(self, sort: str) -> Iterator[dict[str, Any]]:
        """Yield the alarms on strong defects close to every ignored zone."""
        others = [area for area in self.areas if area.kind == "ignore"]
        for area in others:
            near = Area(
                name=area.name, kind="beside", holds=partial(_near, area=area, sort=sort, others=others)
            )
            misprinted = self._printed_with(sort, STRONG[sort], near)
            if misprinted is None:
                continue
            with_zones, without = self.alarms(misprinted, self._rng(self._count()))
            yield {"sort": sort, "with": with_zones, "without": without}

    def _tally(self, sort: str, strength: float, area: Area, count: int) -> tuple[Tally, Tally]:
        outcomes = []
        for _ in range(count):
            misprinted = self._printed_with(sort, strength, area)
            if misprinted is not None:
                outcomes.append(self.alarms(misprinted, self._rng(self._count())))
        zoned, bare = ([pair[at] for pair in outcomes] for at in (0, 1))
        return Tally(prints=len(outcomes), alarms=sum(zoned)), Tally(prints=len(outcomes), alarms=sum(bare))

    def _printed_with(self, sort: str, strength: float, area: Area) -> Page | None:
        rng = self._rng(self._count())
        return printed_with(self.page, sort, strength, area, sensors=self.prints.press.sensors, rng=rng)

    def _count(self) -> int:
        self._next += 1
        return 10_000 + self._next

    def _rng(self, index: int) -> np.random.Generator:
        return stream(self.seed, "zones-came", index)


def _within(
    x: NDArray[np.floating], y: NDArray[np.floating], *, area: Area, reach: float
) -> NDArray[np.bool_]:
    """Return an area without the strip of this width inside its edges."""
    inside = area.holds(x, y)
    for dx in (-reach, 0.0, reach):
        for dy in (-reach, 0.0, reach):
            inside &= area.holds(x + dx, y + dy)
    return inside


def _near(
    x: NDArray[np.floating], y: NDArray[np.floating], *, area: Area, sort: str, others: list[Area]
) -> NDArray[np.bool_]:
    """Return a frame about a zone, outside of it and of other zones; streaks run through it up and down."""
    reach = STRONG["spot"] / 2 if sort == "spot" else 0.5
    inner, outer = (NEAR_MM[0] + reach, NEAR_MM[1] + reach)
    near = np.zeros((y.size, x.size), bool)
    for dx in np.linspace(-outer, outer, 7):
        for dy in np.linspace(-outer, outer, 7):
            near |= area.holds(x + dx, y + dy)
    for other in others:
        for dx in np.linspace(-inner, inner, 7):
            for dy in np.linspace(-inner, inner, 7):
                near &= ~other.holds(x + dx, y + dy)
    return near


def _alarmed(inspection: Inspection) -> bool:
    return inspection.verdict.verdict == "misprint"


def without_zones(pricing: ZonePricing, inspection: Inspection) -> bool:
    """Return whether the same scan alarms by the page as a whole at the press's own threshold."""
    return pricing.alarms(pricing.score(inspection))


def _finite(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None


def zones_results(
    rows: list[PageRows], *, seed: int, nominal_rate: float, quick: bool = False
) -> ZonesResults:
    """Combine the rows of all pages."""
    foretold = [row for one in rows for row in one.foretold]
    near = [row for one in rows for row in one.beside]

    def tally(part: str, name: str) -> dict[str, int]:
        tallies = [getattr(one, part)[name] for one in rows]
        return {"prints": sum(one.prints for one in tallies), "alarms": sum(one.alarms for one in tallies)}

    return ZonesResults(
        seed=seed,
        quick=quick,
        pages=len(rows),
        page_mm=PAGE_MM,
        zone_mm=ZONE_MM,
        prints=PRINTS,
        trials=QUICK_TRIALS if quick else TRIALS,
        promised=nominal_rate,
        careful_share=0.2,
        careful_zones=sum(one.careful_zones for one in rows),
        ignored_zones=sum(one.ignored_zones for one in rows),
        price=[
            {
                "sort": sort.name,
                "unit": sort.unit,
                **_medians([row for row in foretold if row["sort"] == sort.name]),
                "prints": sum(row["prints"] for row in foretold if row["sort"] == sort.name),
                "alarms": sum(row["alarms"] for row in foretold if row["sort"] == sort.name),
            }
            for sort in SORTS
        ],
        rest=[
            {
                "sort": sort.name,
                "unit": sort.unit,
                **_medians([row for one in rows for row in one.rest if row["sort"] == sort.name]),
            }
            for sort in SORTS
        ],
        inside=[
            {
                "sort": sort.name,
                "with": tally("inside", sort.name),
                "without": tally("inside_bare", sort.name),
            }
            for sort in SORTS
        ],
        beside=[
            {
                "sort": sort,
                "prints": len(of),
                "with": sum(row["with"] for row in of),
                "without": sum(row["without"] for row in of),
                "lost": sum(row["without"] and not row["with"] for row in of),
            }
            for sort in ("spot", "streak")
            if (of := [row for row in near if row["sort"] == sort]) is not None
        ],
        good=[
            {"zones": name, "with": tally("good", name), "without": tally("good_bare", name)}
            for name in ("careful", "ignored")
        ],
        strong=dict(STRONG),
    )


def _medians(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return medians of the least caught strength before and after, and the number of zones with one.

    null: not caught in half of the zones.
    """
    figures: dict[str, Any] = {"zones": len(rows)}
    for name in ("before", "after"):
        values = [np.inf if row[name] is None else row[name] for row in rows]
        figures[name] = _finite(float(np.median(values))) if values else None
        figures[f"{name}_known"] = sum(np.isfinite(value) for value in values)
    both = [row["before"] / row["after"] for row in rows if row["before"] and row["after"]]
    figures["better"] = round(float(np.median(both)), 2) if both else None
    figures["compared"] = len(both)
    return figures


# --- defects drawn into the page's raster, before press and camera ---


def printed_with(
    page: Page,
    sort: str,
    strength: float,
    area: Area,
    *,
    sensors: Sequence[SensorModel],
    rng: np.random.Generator,
) -> Page | None:
    """Return a page with a defect of ``SORTS`` somewhere in an area; None: the area has no pixel on the page.

    sensors: of the camera, whose signal decides where a print is dark.
    """
    rows, columns = page.cmyk.shape[:2]
    x, y = ((np.arange(count) + 0.5) * page.pixel_mm for count in (columns, rows))
    of_area = area.holds(x, y)
    down, across = np.nonzero(of_area)
    if not down.size:
        return None
    at = int(rng.integers(down.size))
    x0, y0 = np.array([x[across[at]], y[down[at]]]) + rng.uniform(-0.5, 0.5, 2) * page.pixel_mm
    if sort == "density":
        share = of_area * (strength / 100)
    elif sort == "spot":
        distance = np.hypot(x - x0, (y - y0)[:, None])
        share = disc(distance, diameter_mm=strength, pixel_mm=page.pixel_mm)
    else:
        share = of_area * (np.abs(x - x0) <= STREAK_MM / 2) * (strength / 100)
    ink = page.cmyk.astype(np.float64)
    if sort == "density" or _dark(page.cmyk[share > 0], sensors):
        ink *= 1 - share[..., None]
    elif sort == "spot":
        here = share > 0
        ink[here, 3] = _black(page.cmyk[here], share[here], sensors[0])
    else:  # on top of the other inks: a hole in them would show white beside it where planes are out of register
        ink[..., 3] += share * (255 - ink[..., 3])
    # Tints keep their mean: a loss of 1 % of a tint is less than a step.
    cmyk = np.floor(ink + rng.random(ink.shape)).clip(0, 255).astype(np.uint8)
    cmyk[share == 0] = page.cmyk[share == 0]
    return replace(page, cmyk=cmyk)


def _black(cmyk: NDArray[np.uint8], share: NDArray[np.floating], sensor: SensorModel) -> NDArray[np.float64]:
    """Return the black ink for a share of the darkening by solid black on each pixel.

    cmyk (pixels, 4); share and the result (pixels,).
    """
    black = np.repeat(cmyk[:, None], 256, axis=1)
    black[..., 3] = np.arange(256)
    light = expected_light(black.reshape(-1, 4), sensor)[0].reshape(-1, 256)
    bare = expected_light(cmyk, sensor)[0]
    wanted = bare + share * (light[:, -1] - bare)
    return np.abs(light - wanted[:, None]).argmin(axis=1).astype(np.float64)


def _dark(cmyk: NDArray[np.uint8], sensors: Sequence[SensorModel]) -> bool:
    """Return whether pixels (pixels, 4) give the camera less than ``DARK`` of the paper's signal."""
    seen = [expected_light(cmyk, sensor)[0].mean() / sensor.white_dn for sensor in sensors]
    return bool(np.mean(seen) < DARK)
