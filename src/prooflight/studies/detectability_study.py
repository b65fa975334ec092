"""The smallest spot, the faintest streak and density change that a press would catch on each page of a job.

How strong a defect must be on each page is learned from prints with such defects; what is so strong where follows in
closed form; and that is verified by further prints with defects just so strong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.atomic import whole_file
from prooflight.commissioning.rehearse import PressDay
from prooflight.deciding.calibrated import check_version, page_score
from prooflight.deciding.families import all_said
from prooflight.errors import RequestError
from prooflight.pages.job import opened
from prooflight.studies.catching import SURE, Catching
from prooflight.studies.detectability import PATCH_TILES, STREAK_WIDTH, Reach, Telling
from prooflight.studies.detectability_picture import draw_reach

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.deciding.calibrated import CalibratedDetector
    from prooflight.deciding.families import Said
    from prooflight.deciding.tolerance import Looked
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.press import Press

HALF: Final = 0.5
LEARNING: Final = 160
"""Prints with each defect, over all pages, from which it is learned how strong it must be."""
TRIALS: Final = 12
"""Of each defect on each page; 0.99^12 = 0.89 of the time all are caught."""
STREAK_MM: Final = 0.254 * STREAK_WIDTH
PRINTS: Final = 4
"""Good prints of a page, one of which must pass."""
BLACK: Final = 3
NAMES: Final = {"spot": "spots", "streak": "streaks", "patch": "pale patches", "ink": "pale inks"}
DEFECTS: Final = tuple(NAMES)
EDGE_MM: Final = 6.0
"""Defects are printed no nearer to the page's edges."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Of one defect on one page, printed as faint as should be caught at 99 %."""

    of: int
    caught: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageReach:
    """One page of the job."""

    name: str
    reach: Reach
    half: Reach
    """What is caught in every second print."""
    wanted: dict[str, tuple[float, float]]
    """By defect: strengths that are caught in every second print and in 99 of 100."""
    verified: dict[str, Caught]
    """By defect; ``none``: good prints that alarmed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobPages:
    """The pages of a job as designs, from 0."""

    job: JobSource

    def page(self, index: int) -> Page:
        """Page ``index`` + 1."""
        return opened(self.job).page(index + 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JobReach:
    """All pages."""

    pages: list[PageReach]
    prints: dict[str, int]
    """By defect: from which it was learned how strong it must be."""
    alarming: list[str]
    """Names of pages of which ``PRINTS`` good prints alarmed: whatever were wrong with them would drown."""


def run_detectability_study(
    job: JobSource,
    press: Press,
    results: Path,
    *,
    pages: Sequence[int] | None = None,
    learning: int = LEARNING,
    trials: int = TRIALS,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _step: None,
) -> JobReach:
    """Write ``detectability.md`` and a picture of each page into ``results``.

    pages: numbers of the job's; None: all. RequestError: the press was not taught our detector, or alarms at good
    prints of all these pages.
    """
    ours = press.ours
    if ours is None:
        remedy = "build it with `prooflight press build --detector quick`"
        raise RequestError("press", f"{press.name} was not taught our detector", remedy=remedy)
    results.mkdir(parents=True, exist_ok=True)
    numbers = list(pages or range(1, len(opened(job)) + 1))

    def bench(number: int) -> _Bench:
        day = PressDay.of(press, JobPages(job=job), seed=seed, first=number)
        day = replace(day, spread=ours.tolerance.spread, prior=ours.tolerance.prior)
        return _Bench(ours, day, number, np.random.default_rng([seed, number, 0]))

    alarming: list[str] = []
    telling: list[int] = []
    wanted = {defect: Catching.unknown(ours.promise.rate) for defect in DEFECTS}
    left = learning
    for turn, number in enumerate(numbers):
        one = bench(number)
        if one.telling is None:
            progress(f"page {number}: {PRINTS} good prints of it alarm")
            alarming.append(one.page.name)
            continue
        prints = left // (len(numbers) - turn)
        progress(f"page {number}: {prints} prints with each defect, to learn how strong it must be")
        wanted = one.learned(wanted, prints, np.random.default_rng([seed, number, 1]))
        left -= prints
        telling.append(number)
    if not telling:
        what = f"{PRINTS} good prints of {'it' if len(alarming) == 1 else 'each'} alarm"
        raise RequestError(", ".join(alarming), what, remedy="teach the press by more designs")
    found = []
    for number in telling:
        one = bench(number)
        assert one.telling is not None
        half, sure = (
            {defect: of.strength(number, chance) for defect, of in wanted.items()} for chance in (HALF, SURE)
        )
        reach, verified = Reach.of(one.telling, sure), {}
        for index, defect in enumerate(("none", *DEFECTS)):
            progress(f"page {number}: {trials} prints with {NAMES.get(defect, 'nothing wrong')}")
            rng = np.random.default_rng([seed, number, 2 + index])
            verified[defect] = one.verified(reach, defect, trials, rng)
        page = PageReach(
            name=one.page.name,
            reach=reach,
            half=Reach.of(one.telling, half),
            wanted={defect: (half[defect], sure[defect]) for defect in wanted},
            verified=verified,
        )
        draw_reach(results / _picture(page), one.page, reach, press)
        found.append(page)
    learned = {defect: of.prints for defect, of in wanted.items()}
    job_reach = JobReach(pages=found, prints=learned, alarming=alarming)
    text = "\n".join(page_lines(job_reach, press, ours, trials=trials, seed=seed))
    with whole_file(results / "detectability.md") as unfinished:
        unfinished.write_text(text + "\n", encoding="utf-8")
    return job_reach


class _Bench:
    """One page on one press day."""

    def __init__(
        self, ours: CalibratedDetector, day: PressDay, number: int, rng: np.random.Generator
    ) -> None:
        self.ours, self.day, self.number = ours, day, number
        good, self.known = day.design(number - 1)
        self.page = good.page
        self.telling = self._telling(rng)

    def _telling(self, rng: np.random.Generator) -> Telling | None:
        """From the first of a few good prints that does not alarm; None if all do."""
        for _ in range(PRINTS):
            looked, said = self._looked(self.page, rng)
            check_version(self.ours.tolerance, said, self.known.portrait)
            if self._score(looked, said) <= self.ours.threshold:
                return Telling.of(looked.sums, looked.fit, said, self.ours.tolerance.scatter)
        return None

    def learned(
        self, wanted: Mapping[str, Catching], prints: int, rng: np.random.Generator
    ) -> dict[str, Catching]:
        """What is known after so many prints of this page with each defect."""
        assert self.telling is not None
        found = dict(wanted)
        for _ in range(prints):
            tried = {defect: one.next(self.number, rng) for defect, one in found.items()}
            reach = Reach.of(self.telling, tried)
            for defect, strength in tried.items():
                printed = _DRAW[defect](self.page, reach, rng)
                if printed is not None:
                    caught = self._alarms(printed, rng)
                    found[defect] = found[defect].seen(self.number, strength, caught=caught)
        return found

    def verified(self, of_page: Reach, defect: str, trials: int, rng: np.random.Generator) -> Caught:
        """Prints with a defect just as strong as should be caught."""
        caught = made = 0
        for _ in range(trials):
            printed = self.page if defect == "none" else _DRAW[defect](self.page, of_page, rng)
            if printed is None:
                continue
            made += 1
            caught += self._alarms(printed, rng)
        return Caught(of=made, caught=caught)

    def _alarms(self, printed: Page, rng: np.random.Generator) -> bool:
        return self._score(*self._looked(printed, rng)) > self.ours.threshold

    def _score(self, looked: Looked, said: Sequence[Said]) -> float:
        return page_score(self.ours.tolerance, said, self.known.portrait, looked.found)

    def _looked(self, printed: Page, rng: np.random.Generator) -> tuple[Looked, list[Said]]:
        room = self.day.room
        looked = self.day.looked(self.known, room.recorded(room.seen_in_press(printed, rng), rng))
        return looked, all_said(looked.sums, looked.fit, looked.found, self.ours.tolerance.scatter)


def spotted(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with a black spot as small as is said to be caught where it lies; None: there is no such place."""
    place = _drawn_tile(page, of_page, of_page.spot_mm, EDGE_MM, rng)
    if place is None:
        return None
    row, column, y_mm, x_mm = place
    centre = np.array([y_mm, x_mm]) / page.pixel_mm
    radius = of_page.spot_mm[row, column] / 2 / page.pixel_mm
    first = np.maximum((centre - radius).astype(int) - 1, 0)
    last = (centre + radius).astype(int) + 2
    window = page.cmyk[first[0] : last[0], first[1] : last[1]]
    down, across = np.ogrid[: window.shape[0], : window.shape[1]]
    far = np.hypot(down + first[0] + 0.5 - centre[0], across + first[1] + 0.5 - centre[1])
    cmyk = page.cmyk.copy()
    # A pixel on the edge is black by as much as is covered, so that the spot's area is what it should be.
    cover = np.clip(radius + 0.5 - far, 0, 1)
    part = cmyk[first[0] : last[0], first[1] : last[1], BLACK]
    part[:] = np.maximum(part, np.rint(255 * cover).astype(np.uint8))
    return replace(page, cmyk=cmyk)


def streaked(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with a black streak 0.5 mm wide as faint as is said to be caught where it lies."""
    x = (np.arange(of_page.streak_percent.size) + 0.5) * of_page.pixel_mm + of_page.left_mm
    columns = np.flatnonzero(_inside(x, page.width_mm) & np.isfinite(of_page.streak_percent))
    if not columns.size:
        return None
    column = int(rng.choice(columns))
    left, right = (round((x[column] + side * STREAK_MM / 2) / page.pixel_mm) for side in (-1, 1))
    amount = of_page.streak_percent[column] / 100
    cmyk = page.cmyk.copy()
    part = cmyk[:, left:right, BLACK]
    part[:] = _rounded(part + amount * (255.0 - part), rng)
    return replace(page, cmyk=cmyk)


def patched(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with less of all inks in a square, by as much as is said to be caught where it lies."""
    side_mm = PATCH_TILES * of_page.tile_mm
    place = _drawn_tile(page, of_page, of_page.patch_percent, EDGE_MM + side_mm / 2, rng)
    if place is None:
        return None
    row, column, *middle_mm = place
    down, across = (
        slice(*(round((at + side * side_mm / 2) / page.pixel_mm) for side in (-1, 1))) for at in middle_mm
    )
    cmyk = page.cmyk.copy()
    cmyk[down, across] = _rounded(cmyk[down, across] * (1 - of_page.patch_percent[row, column] / 100), rng)
    return replace(page, cmyk=cmyk)


def paled(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with less of one ink, by as much as is said to be caught."""
    known = {letter: least for letter, least in of_page.inks_percent.items() if np.isfinite(least)}
    if not known:
        return None
    letter = str(rng.choice(sorted(known)))
    ink = "CMYK".index(letter)
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = _rounded(cmyk[..., ink] * (1 - known[letter] / 100), rng)
    return replace(page, cmyk=cmyk)


_DRAW: Final = {"spot": spotted, "streak": streaked, "patch": patched, "ink": paled}


def _drawn_tile(
    page: Page, of_page: Reach, least: NDArray[np.float64], edge_mm: float, rng: np.random.Generator
) -> tuple[int, int, float, float] | None:
    """Row and column of a tile where ``least`` is finite, and its middle on the page, y and x. [mm]"""
    y, x = (
        np.arange(count) * of_page.tile_mm + of_page.tile_mm / 2 + first
        for count, first in zip(least.shape, (of_page.top_mm, of_page.left_mm), strict=True)
    )
    inside = _inside(y, page.height_mm, edge_mm)[:, None] & _inside(x, page.width_mm, edge_mm)
    rows, columns = np.nonzero(inside & np.isfinite(least))
    if not rows.size:
        return None
    drawn = int(rng.integers(rows.size))
    row, column = int(rows[drawn]), int(columns[drawn])
    return row, column, float(y[row]), float(x[column])


def _inside(place_mm: NDArray[np.floating], extent_mm: float, edge_mm: float = EDGE_MM) -> NDArray[np.bool_]:
    return np.asarray((place_mm > edge_mm) & (place_mm < extent_mm - edge_mm))


def _rounded(values: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.uint8]:
    """To whole codes, at random, so that the mean is right."""
    return np.clip(np.floor(values + rng.random(values.shape)), 0, 255).astype(np.uint8)


def _picture(page: PageReach) -> str:
    return f"detectability-{page.name}.png"


def page_lines(
    job: JobReach, press: Press, ours: CalibratedDetector, *, trials: int, seed: int
) -> Iterator[str]:
    """``detectability.md``."""
    yield "# What would be caught before it is printed"
    yield ""
    yield (
        f"Press {press.name} ({len(press.sensors)} sensor{'s' * (len(press.sensors) > 1)}, camera pixels of "
        f"{press.geometry.pixel_pitch_mm:.3f} mm on the page), our detector; {ours.promise}. The least that is "
        "caught in 99 of 100 prints of the press world: medians over the page with the 5th and 95th percentile in "
        "brackets, and the share of places where nothing of the kind is."
    )
    yield ""
    if job.alarming:
        yield (
            f"Not foretold: {', '.join(job.alarming)}, of which {PRINTS} good prints alarmed, so that whatever were "
            "wrong would drown. Most likely no design that taught the press is like that."
        )
        yield ""
    yield from _reach_lines((page.name, page.reach) for page in job.pages)
    yield "The same, caught in every second print:"
    yield ""
    yield from _reach_lines((page.name, page.half) for page in job.pages)
    yield (
        "How strong a defect must be was learned from prints of these pages with such defects: for each page from its "
        "own first, and as far as they are few from those of the others. Strength: what the defect adds to the "
        "statistic that tells it best, in standard deviations of good prints (of a spot: of the noise of the pixels "
        "under it, edges left out), in closed form from the page's own information."
    )
    yield ""
    yield "Strengths that are caught in every second print, and in 99 of 100:"
    yield ""
    yield "| page | " + " | ".join(NAMES.values()) + " |"
    yield "|---" * (len(NAMES) + 1) + "|"
    for page in job.pages:
        strengths = (
            " - ".join(f"{float(f'{one:.2g}'):g}" for one in page.wanted[defect]) for defect in NAMES
        )
        yield f"| {page.name} | " + " | ".join(strengths) + " |"
    yield "| prints of all pages | " + " | ".join(str(job.prints[defect]) for defect in NAMES) + " |"
    yield ""
    yield (
        f"Verified: {trials} further prints of each page with each defect at a place drawn at random, just as strong "
        f"as should be caught at 99 %, and as many good prints; every print by itself, one press day a page, seed "
        f"{seed}."
    )
    yield ""
    yield (
        "| page | "
        + " | ".join(f"{name} caught" for name in NAMES.values())
        + " | good prints that alarmed |"
    )
    yield "|---" * (len(NAMES) + 2) + "|"
    rows = [(page.name, page.verified) for page in job.pages]
    every = {
        defect: Caught(
            of=sum(found[defect].of for _, found in rows),
            caught=sum(found[defect].caught for _, found in rows),
        )
        for defect in (*DEFECTS, "none")
    }
    for name, found in [*rows, ("all", every)]:
        yield f"| {name} | " + " | ".join(_share(found[defect]) for defect in (*DEFECTS, "none")) + " |"
    yield ""
    for page in job.pages:
        yield f"![{page.name}]({_picture(page)})"
        yield ""


def _reach_lines(pages: Iterable[tuple[str, Reach]]) -> Iterator[str]:
    yield (
        "| page | black spot [mm] | nowhere | black streak of 0.5 mm [% ink] | nowhere | "
        "loss of all inks in 16 mm [%] | nowhere | loss of one ink all over [%] |"
    )
    yield "|---" * 8 + "|"
    for name, reach in pages:
        inks = ", ".join(_of_ink(letter, least) for letter, least in reach.inks_percent.items())
        cells = (_spread(a) for a in (reach.spot_mm, reach.streak_percent, reach.patch_percent))
        yield f"| {name} | " + " | ".join(" | ".join(cell) for cell in cells) + f" | {inks} |"
    yield ""


def _spread(values: NDArray[np.float64]) -> tuple[str, str]:
    known = values[~np.isnan(values)]
    finite = known[np.isfinite(known)]
    nowhere = f"{1 - finite.size / max(known.size, 1):.0%}"
    if not finite.size:
        return "-", nowhere
    low, middle, high = np.percentile(finite, (5, 50, 95))
    return f"{middle:.2g} [{low:.2g}-{high:.2g}]", nowhere


def _of_ink(letter: str, least: float) -> str:
    return f"{letter} {least:.0f}" if np.isfinite(least) else f"{letter} -"


def _share(found: Caught) -> str:
    return f"{found.caught} of {found.of}" if found.of else "-"
