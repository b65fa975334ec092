"""Price of zones: detected defects in them and outside them, before and after, and false alarms on good prints.

Good prints of the job's own pages are made on the simulated press, one a day, and inspected with the zones
and without. Some give mean and standard deviation of the careful areas' statistics; the others calibrate
them. Then more good prints get defects, of adaptively chosen sizes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.zones.caught import Caught, Trial, caught, next_strength
from prooflight.commissioning.zones.defects import SORTS, areas_of, with_defect
from prooflight.detectors.base import PlannedPage
from prooflight.detectors.false_alarm_rate import FURTHEST, least_false_alarm_rate
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector
from prooflight.detectors.matched_filter.glyphs.scoring import NONE
from prooflight.detectors.matched_filter.zones import MOST_OF_RATE, ZonedJudge, baseline_of, careful_scores
from prooflight.errors import RequestError
from prooflight.pages.job import opened
from prooflight.pages.parallel import in_order
from prooflight.pages.zones.zone import PageZones
from prooflight.pages.zones.zones_file import PriceEntry
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.captures import SimulatedDay

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.detector import MatchedFilterPage
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight.press.artefact import Press

    AreaKey = tuple[str, str]
    """Name and kind of an area."""
    Shown = Callable[[Iterable[Any], int, str], Iterable[Any]]

PRINTS: Final = 90
"""Default number of prints: two thirds of them, their tail extrapolated tenfold, reach one good page in 600."""
LEARNING: Final = 3
"""Number of prints of which one measures the usual statistics of careful areas; the others calibrate them."""
FEWEST_PRINTS: Final = 12
LUCK: Final = 1.5
"""Factor on the number of prints where only some pages have a careful area, since fewer may be drawn than expected."""
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPrint:
    """Scores of one good print."""

    number: int
    """Number of its page."""
    before: float
    """Score without zones."""
    after: float
    """Score of the page as a whole without ignored areas."""
    careful: NDArray[np.float32] | None
    """Statistics (statistics,) of careful areas; None: the page has no careful area."""


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
    _ready: dict[int, tuple[Page, MatchedFilterPage | None, MatchedFilterPage]] = field(default_factory=dict)

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
        after = zoned.whole_score(inspection)
        before = after if bare is None else bare.whole_score(bare.inspect(scan))
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
                zoned.whole_score(inspection)
                if bare is None
                else bare.whole_score(bare.inspect(Scan(dn=defective, name="")))
            )
            results.append(
                Tried(
                    wish=wish,
                    before=score > zoned.detector.calibrated.threshold,
                    after=inspection.verdict.verdict == "misprint",
                )
            )
        return results

    def page_of(self, rng: np.random.Generator) -> int:
        """Return the page of a print, by the first number that its stream draws."""
        return self.numbers[int(rng.integers(len(self.numbers)))]

    def printed(self, page: Page, rng: np.random.Generator) -> Scan:
        """Print a good page on a day of its own."""
        day = SimulatedDay.begin("press", self.press, rng)
        return Scan(dn=day.recorded(day.seen_in_press(page, rng), rng), name=page.name)

    def ready(self, number: int) -> tuple[Page, MatchedFilterPage | None, MatchedFilterPage]:
        """Return a page, prepared without zones and with them.

        None: both are the same but for careful areas.
        """
        if number not in self._ready:
            if len(self._ready) >= READY:
                self._ready.clear()
            context = self.press.press_context(1)
            assert self.press.ours is not None
            detector = MatchedFilterDetector(press_context=context, calibrated=self.press.ours)
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
    processes: int | None = None,
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Price:
    """Compute the price of zones on the pages of a job.

    prints: number of good ones, which calibrate the zones. trials: number of prints with a defect, of each
    sort in each area; 0: detection is not measured. RequestError: the press was not trained with the
    matched-filter detector, or there are too few prints for its false-alarm rate.
    """
    detector = press.ours
    if detector is None:
        what = f"press {press.name} was not taught our detector"
        raise RequestError("zones", what, remedy="build it with `prooflight press build`")
    bare = zones.unpriced()
    if prints < (fewest := fewest_prints(bare, detector.ranking_rate)):
        raise RequestError("prints", f"{prints} are too few for these zones", remedy=f"give {fewest} or more")
    work = ZonePrints(job=job, press=press, zones=bare, numbers=tuple(bare.of_pages), seed=seed)
    pages = [work.page_of(stream(work.seed, "zones-print", index)) for index in range(prints)]
    good: list[GoodPrint] = _page_by_page(work, range(prints), pages, processes, shown, "printing good pages")
    entry = _entry(good, zones, press.digest, seed=seed)
    calibrated = bare.priced(entry)
    calibration = calibrated.calibration
    assert calibration is not None
    judges = {
        careful: ZonedJudge.by(calibration, bare.document.careful_share, careful=careful)
        for careful in {one.careful is not None for one in good}
    }
    careful_rate = max(judge.rates(detector.ranking_rate)[1] for judge in judges.values())  # may be refused
    scored = [one for at, one in enumerate(good) if at % LEARNING]
    after = sum(_alarms(one, scored, judges[one.careful is not None], detector) for one in scored)
    areas: tuple[PricedArea, ...] = ()
    if trials:
        results = _tried(
            replace(work, zones=calibrated, _ready={}), trials, detector.ranking_rate, processes, shown
        )
        areas = tuple(_priced(results, work.numbers, bare, detector.ranking_rate))
    least = least_false_alarm_rate(len(entry.careful_scores)) if entry.careful_scores else 0.0
    return Price(
        areas=areas,
        promised=detector.guarantee.rate,
        good=len(scored),
        alarmed_before=sum(one.before > detector.threshold for one in scored),
        alarmed_after=after,
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


def fewest_prints(zones: JobZones, rate: float) -> int:
    """Return the number of good prints that most likely suffices for the careful areas' share of a false-alarm rate.

    Of the prints that show a careful area, all but one in ``LEARNING`` calibrate, their tail extrapolated,
    and one less of them: each is judged by the others.
    """
    pages = [{zone.kind for zone in of_page} for of_page in zones.of_pages.values()]
    share = sum("careful" in kinds for kinds in pages) / len(pages)
    if not share:
        return FEWEST_PRINTS
    needed = (1 / (FURTHEST * MOST_OF_RATE * rate) + 1) * LEARNING / (LEARNING - 1) / share
    return max(math.ceil(needed * (1.0 if share == 1 else LUCK)), FEWEST_PRINTS)


def _entry(good: Sequence[GoodPrint], zones: JobZones, press_digest: str, *, seed: int) -> PriceEntry:
    careful = [one.careful for one in good if one.careful is not None]
    learned = np.array(careful[::LEARNING])
    others = np.array([one for at, one in enumerate(careful) if at % LEARNING])
    mean = sd = scores = np.zeros(0)
    if careful:
        if len(others) < 2 or len(learned) < 2:
            raise RequestError("prints", "too few show a careful area", remedy="give more of them")
        baseline = baseline_of(learned)
        mean, sd = baseline
        scores = careful_scores(others, baseline)
    return PriceEntry(
        press=press_digest,
        zones=zones.zones_digest,
        prints=len(good),
        seed=seed,
        page_scores=tuple(round(one.after, 6) for one in good),
        careful_scores=tuple(np.round(scores, 6).tolist()),
        careful_mean=tuple(np.round(mean, 6).tolist()),
        careful_sd=tuple(np.round(sd, 6).tolist()),
    )


def _alarms(
    one: GoodPrint, scored: Sequence[GoodPrint], judge: ZonedJudge, detector: CalibratedDetector
) -> bool:
    """Return whether a good print alarms, judged by the others."""
    others = [other for other in scored if other is not one]
    left = replace(judge, page_good=np.sort([other.after for other in others]))
    values = np.zeros(judge.baseline.shape[1]) if one.careful is None else one.careful
    if judge.careful_good.size:
        theirs = np.array([other.careful for other in others if other.careful is not None])
        left = replace(left, careful_good=np.sort(careful_scores(theirs, judge.baseline)))
    return detector.decided(left.decide(detector, one.after, values), NONE).misprint


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
