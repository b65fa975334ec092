"""Price of zones: detected defects in them and outside them, before and after, and false alarms on good prints.

Good prints of the job's own pages are made on the simulated press, one a day, and inspected with the zones
and without. Some give mean and standard deviation of the careful areas' statistics; the others calibrate
them. Then more good prints get defects, of adaptively chosen sizes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.zones.defects import (
    SORTS,
    Caught,
    Trial,
    areas_of,
    caught,
    next_strength,
    with_defect,
)
from prooflight.detectors.base import Detector, PlannedPage, PreparedPage
from prooflight.detectors.false_alarm_rate import least_false_alarm_rate
from prooflight.detectors.optional import GoodPrint, PricesZones, ZonePricing
from prooflight.detectors.registry import detector as detector_of
from prooflight.errors import RequestError
from prooflight.pages.job import JobSource, opened
from prooflight.pages.parallel import in_order
from prooflight.pages.zones.zone import PageZones
from prooflight.pages.zones.zones_file import JobZones, PriceEntry
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.captures import SimulatedDay

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


AreaKey = tuple[str, str]
"""Name and kind of an area."""
Shown = Callable[[Iterable[Any], int, str], Iterable[Any]]

PRINTS: Final = 90
"""Default number of prints: two thirds of them, their tail extrapolated tenfold, reach one good page in 600."""
TRIALS: Final = 24
"""Number of prints with a defect, of each sort in each area."""
ROUNDS: Final = 4
"""Number of rounds; after each, the next strengths are chosen."""
READY: Final = 4
"""Greatest number of prepared pages in memory, some 200 MB each."""
PARTS: Final = ("least", "low", "high")


@dataclass(frozen=True, slots=True, kw_only=True)
class PricedArea:
    """Price of one zone, or of the rest of the pages."""

    name: str
    kind: str
    pages: tuple[int, ...]
    before: dict[str, Caught]
    """Detection by sort of defect, without zones."""
    after: dict[str, Caught]


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """Price of zones."""

    areas: tuple[PricedArea, ...]
    promised: float
    """Target false-alarm rate, without zones and with them. [-]"""
    good: int
    """Number of good prints that were inspected."""
    alarmed_before: int
    alarmed_after: int
    """Number of them that alarmed with zones; each is judged by the others."""
    extrapolated: bool
    """Whether careful areas' share of the false-alarm rate rests on an extrapolated tail."""
    entry: PriceEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """Defect to try."""

    area: AreaKey
    sort: str
    strength: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """Result of a tried defect."""

    wish: Wish
    before: bool
    """Whether it is detected without zones."""
    after: bool
    """Whether it is detected with zones."""


@dataclass(kw_only=True)
class ZonePrints:
    """Prints of pages with zones; small and picklable, with a cache of prepared pages in each worker."""

    job: JobSource
    press: Press
    zones: JobZones
    numbers: tuple[int, ...]
    """Pages that have zones."""
    seed: int
    detector: str | None = None
    """Name of the detector; None: the press's default."""
    _ready: dict[int, tuple[Page, PreparedPage | None, PreparedPage]] = field(default_factory=dict)

    def __call__(self, request: int | tuple[int, Sequence[Wish]]) -> Any:
        """Inspect a good print by its number, or defects on one."""
        if isinstance(request, int):
            return self.good(request)
        return self.tried(*request)

    def good(self, index: int) -> GoodPrint:
        """Inspect one good print without zones and with them."""
        rng = stream(self.seed, "zones-print", index)
        page, bare, zoned = self.ready(self.page_of(rng))
        scan = self.printed(page, rng)
        inspection = zoned.inspect(scan)
        after = self.pricing.score(inspection)
        before = after if bare is None else self.pricing.score(bare.inspect(scan))
        careful = inspection.stored_arrays.get("careful")
        return GoodPrint(number=page.number, before=before, after=after, careful=careful)

    def tried(self, index: int, wishes: Sequence[Wish]) -> list[Tried]:
        """Try defects, each put by itself into the scan of one more good print.

        The zones are calibrated. A defect in an area that this print's page does not have is left out.
        """
        rng = stream(self.seed, "zones-trial", index)
        page, bare, zoned = self.ready(self.page_of(rng))
        scan = self.printed(page, rng)
        zones = self.zones.page(page)
        shift = zoned.inspect(scan).verdict.shift_mm or (0.0, 0.0)
        assert zones is not None
        areas, results = {(one.name, one.kind): one for one in areas_of(zones)}, []
        for wish in wishes:
            area = areas.get(wish.area)
            if area is None:
                continue
            defective = with_defect(
                scan.dn, wish.sort, wish.strength, area, page=page, press=self.press, shift_mm=shift, rng=rng
            )
            if defective is None:
                continue
            inspection = zoned.inspect(Scan(dn=defective, name=scan.name))
            score = (
                self.pricing.score(inspection)
                if bare is None
                else self.pricing.score(bare.inspect(Scan(dn=defective, name="")))
            )
            results.append(
                Tried(
                    wish=wish,
                    before=self.pricing.alarms(score),
                    after=inspection.verdict.verdict == "misprint",
                )
            )
        return results

    @cached_property
    def pricing(self) -> ZonePricing:
        """The detector's pricing."""
        return pricing_of(self.press, self.detector)[1]

    def page_of(self, rng: np.random.Generator) -> int:
        """Return the page of a print, by the first number that its stream draws."""
        return self.numbers[int(rng.integers(len(self.numbers)))]

    def printed(self, page: Page, rng: np.random.Generator) -> Scan:
        """Print a good page on a day of its own."""
        day = SimulatedDay.begin("press", self.press, rng)
        return Scan(dn=day.recorded(day.seen_in_press(page, rng), rng), name=page.name)

    def ready(self, number: int) -> tuple[Page, PreparedPage | None, PreparedPage]:
        """Return a page, prepared without zones and with them.

        None: both are the same but for careful areas.
        """
        if number not in self._ready:
            if len(self._ready) >= READY:
                self._ready.clear()
            context = self.press.press_context(1)
            detector = pricing_of(self.press, self.detector)[0].at(context)
            page = self.press.geometry.lay(opened(self.job).page(number))
            zones = self.zones.page(page)
            assert zones is not None
            bare = detector.prepare(PlannedPage(page, context)) if "ignore" in zones.kinds else None
            self._ready[number] = page, bare, detector.prepare(PlannedPage(page, context, zones))
        return self._ready[number]


def price_of(
    job: JobSource,
    press: Press,
    zones: JobZones,
    *,
    prints: int = PRINTS,
    trials: int = TRIALS,
    seed: int = 1,
    detector: str | None = None,
    processes: int | None = None,
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Price:
    """Compute the price of zones on the pages of a job.

    prints: number of good ones, which calibrate the zones. trials: number of prints with a defect, of each
    sort in each area; 0: detection is not measured. detector: its name; None: the press's default. RequestError:
    its zones have no price, or there are too few prints for its false-alarm rate.
    """
    own, pricing = pricing_of(press, detector)
    assert own.false_alarm_rate is not None
    bare = zones.unpriced()
    if prints < (fewest := pricing.fewest_prints(careful_share(bare))):
        raise RequestError("prints", f"{prints} are too few for these zones", remedy=f"give {fewest} or more")
    work = ZonePrints(
        job=job, press=press, zones=bare, numbers=tuple(bare.of_pages), seed=seed, detector=detector
    )
    pages = [work.page_of(stream(work.seed, "zones-print", index)) for index in range(prints)]
    good: list[GoodPrint] = _page_by_page(work, range(prints), pages, processes, shown, "printing good pages")
    calibration = pricing.calibration(good)
    entry = PriceEntry(
        press=press.digest,
        zones=zones.zones_digest,
        prints=prints,
        seed=seed,
        detector=own.name,
        **asdict(calibration),
    )
    calibrated = bare.priced(entry)
    scored, careful_rate = pricing.alarmed(good, calibration, bare.document.careful_share)
    areas: tuple[PricedArea, ...] = ()
    if trials:
        results = _tried(replace(work, zones=calibrated, _ready={}), trials, pricing.rate, processes, shown)
        areas = tuple(_priced(results, work.numbers, bare, pricing.rate))
    least = least_false_alarm_rate(len(entry.careful_scores)) if entry.careful_scores else 0.0
    return Price(
        areas=areas,
        promised=own.false_alarm_rate,
        good=len(scored),
        alarmed_before=sum(pricing.alarms(one.before) for one, _ in scored),
        alarmed_after=sum(alarmed for _, alarmed in scored),
        extrapolated=0 < careful_rate < least,
        entry=entry.model_copy(update={"told": tuple(map(_row, areas))}),
    )


def _page_by_page(
    work: ZonePrints,
    requests: Sequence[Any],
    pages: Sequence[int],
    processes: int | None,
    shown: Shown,
    what: str,
) -> list[Any]:
    """Return the result of each print, in the order of the requests.

    They are made page by page: to prepare a page takes longer than to inspect a print of it, and few stay
    prepared.
    """
    order = sorted(range(len(requests)), key=pages.__getitem__)
    results = in_order(work, [requests[at] for at in order], processes=processes)
    by_index = dict(zip(order, shown(results, len(requests), what), strict=True))
    return [by_index[at] for at in range(len(requests))]


def careful_share(zones: JobZones) -> float:
    """Return the share of the pages with zones that have a careful area. [-]"""
    pages = [{zone.kind for zone in of_page} for of_page in zones.of_pages.values()]
    return sum("careful" in kinds for kinds in pages) / len(pages)


def pricing_of(press: Press, name: str | None = None) -> tuple[Detector, ZonePricing]:
    """Return a detector of a press, by the user's name, and its pricing; RequestError: its zones have no price."""
    own = detector_of(name, press)
    if not isinstance(own, PricesZones):
        what = f"{own.name!r} of press {press.name} does not price zones"
        raise RequestError(
            "zones", what, remedy="build the press with `prooflight press build --detector quick`"
        )
    return own, own.zone_pricing


def _tried(
    work: ZonePrints, trials: int, rate: float, processes: int | None, shown: Shown
) -> dict[tuple[AreaKey, str], list[Tried]]:
    """Run the trials by area and sort, in ``ROUNDS``."""
    keys = _areas(work.zones, work.numbers)
    results: dict[tuple[AreaKey, str], list[Tried]] = defaultdict(list)
    rng, index = stream(work.seed, "zones-strengths"), 0
    for part in np.array_split(np.arange(trials), min(ROUNDS, trials)):
        requests = []
        for _ in part:
            wishes = []
            for key in keys:
                for sort in SORTS:
                    before = [_trial(one, key) for one in results[key, sort.name]]
                    strength = next_strength(before, sort.within, rng, false_alarms=rate)
                    wishes.append(Wish(area=key, sort=sort.name, strength=strength))
            requests.append((index, tuple(wishes)))
            index += 1
        pages = [work.page_of(stream(work.seed, "zones-trial", at)) for at, _ in requests]
        for print_ in _page_by_page(work, requests, pages, processes, shown, "trying defects"):
            for one in print_:
                results[one.wish.area, one.wish.sort].append(one)
    return results


def _trial(one: Tried, key: AreaKey) -> Trial:
    """Return a trial as it counts for the next strength: in ignored areas, the detection without zones."""
    return Trial(strength=one.wish.strength, caught=one.before if key[1] == "ignore" else one.after)


def _areas(zones: JobZones, numbers: Sequence[int]) -> list[AreaKey]:
    areas: dict[AreaKey, None] = {}
    for number in numbers:
        of_page = PageZones(zones=zones.of_pages[number], careful_share=zones.document.careful_share)
        areas |= {(area.name, area.kind): None for area in areas_of(of_page)}
    return list(areas)


def _priced(
    results: dict[tuple[AreaKey, str], list[Tried]], numbers: Sequence[int], zones: JobZones, rate: float
) -> Iterator[PricedArea]:
    for name, kind in _areas(zones, numbers):
        before: dict[str, Caught] = {}
        after: dict[str, Caught] = {}
        for sort in SORTS:
            tried = results[(name, kind), sort.name]
            if not tried:
                continue
            for by_sort, of in ((before, "before"), (after, "after")):
                seen = [Trial(strength=one.wish.strength, caught=getattr(one, of)) for one in tried]
                by_sort[sort.name] = caught(seen, sort.within, false_alarms=rate)
        if kind == "ignore":
            after = dict.fromkeys(after, Caught(least=np.inf, low=np.inf, high=np.inf))
        pages = tuple(
            number
            for number in numbers
            if any(zone.name == name for zone in zones.of_pages[number]) or kind == "rest"
        )
        yield PricedArea(name=name, kind=kind, pages=pages, before=before, after=after)


def _row(area: PricedArea) -> dict[str, Any]:
    """Return a row for the file; null: nothing is detected."""

    def plain(of: dict[str, Caught]) -> dict[str, Any]:
        return {
            name: {part: None if not np.isfinite(v := getattr(one, part)) else round(v, 3) for part in PARTS}
            for name, one in of.items()
        }

    return {
        "name": area.name,
        "kind": area.kind,
        "pages": list(area.pages),
        "before": plain(area.before),
        "after": plain(area.after),
    }
