"""The price of zones: what is caught in them and beside them, before and after, and what good prints do.

Good prints of the job's own pages are made on the simulated press, one a day, and looked at with the zones and without.
By some the careful areas' statistics get mean and standard deviation; the others calibrate them. Then more good prints
get defects, of sizes chosen on the way.
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
from prooflight.detectors.matched_filter.glyphs.weighing import NONE
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
"""By default: two thirds of them, their tail drawn on tenfold, speak of one good page in 600."""
LEARNING: Final = 3
"""One print in so many says what is usual in careful areas; the others calibrate it."""
FEWEST_PRINTS: Final = 12
LUCK: Final = 1.5
"""Where pages are drawn of which some have no careful area, fewer prints may show one than should."""
TRIALS: Final = 24
"""Prints with a defect, of each sort in each area."""
ROUNDS: Final = 4
"""After each, the next strengths are chosen."""
READY: Final = 4
"""Pages kept made ready, some 200 MB each."""
PARTS: Final = ("least", "low", "high")


@dataclass(frozen=True, slots=True, kw_only=True)
class PricedArea:
    """One zone, or the rest of the pages."""

    name: str
    kind: str
    pages: tuple[int, ...]
    before: dict[str, Caught]
    """By sort of defect, without zones."""
    after: dict[str, Caught]


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """What zones cost."""

    areas: tuple[PricedArea, ...]
    promised: float
    """Rate of false alarms, without zones and with them. [-]"""
    good: int
    """Good prints that were looked at ..."""
    alarmed_before: int
    alarmed_after: int
    """... and alarmed; each by what the others say."""
    extrapolated: bool
    """Whether careful areas' share of the promise rests on a tail drawn on."""
    entry: PriceEntry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPrint:
    """What one good print said."""

    number: int
    """Of its page."""
    before: float
    """Score without zones."""
    after: float
    """Score of the page as a whole with what is ignored taken out."""
    careful: NDArray[np.float32] | None
    """(statistics,) None: the page has no careful area."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """A defect to try."""

    area: AreaKey
    sort: str
    strength: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """What became of it."""

    wish: Wish
    before: bool
    """Whether it is caught without zones ..."""
    after: bool
    """... and with them."""


@dataclass(kw_only=True)
class ZonePrints:
    """Prints of pages with zones; small and picklable, and keeps its pages made ready where it works."""

    job: JobSource
    press: Press
    zones: JobZones
    numbers: tuple[int, ...]
    """Pages that have zones."""
    seed: int
    _ready: dict[int, tuple[Page, MatchedFilterPage | None, MatchedFilterPage]] = field(default_factory=dict)

    def __call__(self, asked: int | tuple[int, Sequence[Wish]]) -> Any:
        """A good print by its number; or what becomes of defects on one."""
        if isinstance(asked, int):
            return self.good(asked)
        return self.tried(*asked)

    def good(self, index: int) -> GoodPrint:
        """One good print, looked at without zones and with them."""
        rng = stream(self.seed, "zones-print", index)
        page, bare, zoned = self.ready(self.page_of(rng))
        scan = self.printed(page, rng)
        inspection = zoned.inspect(scan)
        after = zoned.whole_score(inspection)
        before = after if bare is None else bare.whole_score(bare.inspect(scan))
        careful = inspection.kept.get("careful")
        return GoodPrint(number=page.number, before=before, after=after, careful=careful)

    def tried(self, index: int, wishes: Sequence[Wish]) -> list[Tried]:
        """What becomes of defects, each put by itself into the scan of one more good print.

        The zones are calibrated. A defect in an area that this print's page does not have is left out.
        """
        rng = stream(self.seed, "zones-trial", index)
        page, bare, zoned = self.ready(self.page_of(rng))
        scan = self.printed(page, rng)
        zones = self.zones.page(page)
        shift = zoned.inspect(scan).verdict.shift_mm or (0.0, 0.0)
        assert zones is not None
        areas, found = {(one.name, one.kind): one for one in areas_of(zones)}, []
        for wish in wishes:
            area = areas.get(wish.area)
            if area is None:
                continue
            spoilt = with_defect(
                scan.dn, wish.sort, wish.strength, area, page=page, press=self.press, shift_mm=shift, rng=rng
            )
            if spoilt is None:
                continue
            inspection = zoned.inspect(Scan(dn=spoilt, name=scan.name))
            score = (
                zoned.whole_score(inspection)
                if bare is None
                else bare.whole_score(bare.inspect(Scan(dn=spoilt, name="")))
            )
            found.append(
                Tried(
                    wish=wish,
                    before=score > zoned.detector.calibrated.threshold,
                    after=inspection.verdict.verdict == "misprint",
                )
            )
        return found

    def page_of(self, rng: np.random.Generator) -> int:
        """Which page a print is of, by the first that its stream draws."""
        return self.numbers[int(rng.integers(len(self.numbers)))]

    def printed(self, page: Page, rng: np.random.Generator) -> Scan:
        """A good print of a day of its own."""
        day = SimulatedDay.begin("press", self.press, rng)
        return Scan(dn=day.recorded(day.seen_in_press(page, rng), rng), name=page.name)

    def ready(self, number: int) -> tuple[Page, MatchedFilterPage | None, MatchedFilterPage]:
        """A page, made ready without zones and with them; None: that is the same but for careful areas."""
        if number not in self._ready:
            if len(self._ready) >= READY:
                self._ready.clear()
            station = self.press.station(1)
            assert self.press.ours is not None
            detector = MatchedFilterDetector(station=station, calibrated=self.press.ours)
            page = self.press.geometry.lay(opened(self.job).page(number))
            zones = self.zones.page(page)
            assert zones is not None
            bare = detector.prepare(PlannedPage(page, station)) if "ignore" in zones.kinds else None
            self._ready[number] = page, bare, detector.prepare(PlannedPage(page, station, zones))
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
    """The price of zones on the pages of a job.

    prints: good ones, that calibrate the zones. trials: prints with a defect, of each sort in each area; 0: nothing is
    asked of what is caught. RequestError: the press was not taught our detector, or so few prints cannot speak of so
    rare alarms as it promises.
    """
    ours = press.ours
    if ours is None:
        what = f"press {press.name} was not taught our detector"
        raise RequestError("zones", what, remedy="build it with `prooflight press build`")
    bare = zones.unpriced()
    if prints < (fewest := fewest_prints(bare, ours.ranking_rate)):
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
    careful_rate = max(judge.rates(ours.ranking_rate)[1] for judge in judges.values())  # may be refused
    scored = [one for at, one in enumerate(good) if at % LEARNING]
    after = sum(_alarms(one, scored, judges[one.careful is not None], ours) for one in scored)
    areas: tuple[PricedArea, ...] = ()
    if trials:
        found = _tried(
            replace(work, zones=calibrated, _ready={}), trials, ours.ranking_rate, processes, shown
        )
        areas = tuple(_priced(found, work.numbers, bare, ours.ranking_rate))
    least = least_false_alarm_rate(len(entry.careful_scores)) if entry.careful_scores else 0.0
    return Price(
        areas=areas,
        promised=ours.promise.rate,
        good=len(scored),
        alarmed_before=sum(one.before > ours.threshold for one in scored),
        alarmed_after=after,
        extrapolated=0 < careful_rate < least,
        entry=entry.model_copy(update={"told": tuple(map(_told, areas))}),
    )


def _page_by_page(
    work: ZonePrints,
    asked: Sequence[Any],
    pages: Sequence[int],
    processes: int | None,
    shown: Shown,
    what: str,
) -> list[Any]:
    """What becomes of each print, in the order in which they are asked for.

    They are made page by page: to make a page ready takes longer than to look at a print of it, and few stay ready.
    """
    order = sorted(range(len(asked)), key=pages.__getitem__)
    made = in_order(work, [asked[at] for at in order], processes=processes)
    found = dict(zip(order, shown(made, len(asked), what), strict=True))
    return [found[at] for at in range(len(asked))]


def fewest_prints(zones: JobZones, rate: float) -> int:
    """How many good prints can speak of what careful areas may use of a promised rate, most likely.

    Of the prints that show a careful area, all but one in ``LEARNING`` must do, their tail drawn on, and one less of
    them: each is judged by the others.
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


def _alarms(one: GoodPrint, scored: Sequence[GoodPrint], judge: ZonedJudge, ours: CalibratedDetector) -> bool:
    """Whether a good print alarms by what the others say."""
    others = [other for other in scored if other is not one]
    left = replace(judge, page_good=np.sort([other.after for other in others]))
    values = np.zeros(judge.baseline.shape[1]) if one.careful is None else one.careful
    if judge.careful_good.size:
        theirs = np.array([other.careful for other in others if other.careful is not None])
        left = replace(left, careful_good=np.sort(careful_scores(theirs, judge.baseline)))
    return ours.decided(left.decide(ours, one.after, values), NONE).misprint


def _tried(
    work: ZonePrints, trials: int, rate: float, processes: int | None, shown: Shown
) -> dict[tuple[AreaKey, str], list[Tried]]:
    """Trials by area and sort, in ``ROUNDS``."""
    keys = _areas(work.zones, work.numbers)
    found: dict[tuple[AreaKey, str], list[Tried]] = defaultdict(list)
    rng, index = stream(work.seed, "zones-strengths"), 0
    for part in np.array_split(np.arange(trials), min(ROUNDS, trials)):
        asked = []
        for _ in part:
            wishes = []
            for key in keys:
                for sort in SORTS:
                    before = [_trial(one, key) for one in found[key, sort.name]]
                    strength = next_strength(before, sort.within, rng, false_alarms=rate)
                    wishes.append(Wish(area=key, sort=sort.name, strength=strength))
            asked.append((index, tuple(wishes)))
            index += 1
        pages = [work.page_of(stream(work.seed, "zones-trial", at)) for at, _ in asked]
        for print_ in _page_by_page(work, asked, pages, processes, shown, "trying defects"):
            for one in print_:
                found[one.wish.area, one.wish.sort].append(one)
    return found


def _trial(one: Tried, key: AreaKey) -> Trial:
    """As it counts for the next strength: what is ignored is asked for what was caught there without zones."""
    return Trial(strength=one.wish.strength, caught=one.before if key[1] == "ignore" else one.after)


def _areas(zones: JobZones, numbers: Sequence[int]) -> list[AreaKey]:
    found: dict[AreaKey, None] = {}
    for number in numbers:
        of_page = PageZones(zones=zones.of_pages[number], careful_share=zones.document.careful_share)
        found |= {(area.name, area.kind): None for area in areas_of(of_page)}
    return list(found)


def _priced(
    found: dict[tuple[AreaKey, str], list[Tried]], numbers: Sequence[int], zones: JobZones, rate: float
) -> Iterator[PricedArea]:
    for name, kind in _areas(zones, numbers):
        before: dict[str, Caught] = {}
        after: dict[str, Caught] = {}
        for sort in SORTS:
            tried = found[(name, kind), sort.name]
            if not tried:
                continue
            for told, of in ((before, "before"), (after, "after")):
                seen = [Trial(strength=one.wish.strength, caught=getattr(one, of)) for one in tried]
                told[sort.name] = caught(seen, sort.within, false_alarms=rate)
        if kind == "ignore":
            after = dict.fromkeys(after, Caught(least=np.inf, low=np.inf, high=np.inf))
        pages = tuple(
            number
            for number in numbers
            if any(zone.name == name for zone in zones.of_pages[number]) or kind == "rest"
        )
        yield PricedArea(name=name, kind=kind, pages=pages, before=before, after=after)


def _told(area: PricedArea) -> dict[str, Any]:
    """A row for the file; null: nothing is caught."""

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
