"""The smallest spot, the faintest streak and density change that a press would catch on each page of a job.

In closed form ahead of printing, then verified: such defects are printed into simulated prints and looked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.atomic import whole_file
from prooflight.commissioning.rehearse import PressDay
from prooflight.deciding.calibrated import check_version, page_score
from prooflight.deciding.families import all_said
from prooflight.deciding.tolerance import look
from prooflight.errors import RequestError
from prooflight.pages.job import opened
from prooflight.studies.detectability import STREAK_WIDTH, GoodPage, reach
from prooflight.studies.detectability_picture import draw_reach

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.deciding.calibrated import CalibratedDetector
    from prooflight.deciding.families import Said
    from prooflight.deciding.tolerance import Looked, PreparedPage
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.press import Press
    from prooflight.studies.detectability import Reach

TRIALS: Final = 12
"""Of each defect on each page; 0.99^12 = 0.89 of the time all are caught."""
STREAK_MM: Final = 0.254 * STREAK_WIDTH
PRINTS: Final = 4
"""Good prints of a page, one of which must pass."""
BLACK: Final = 3
DEFECTS: Final = ("spot", "streak", "density")
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
    verified: dict[str, Caught]
    """By defect; ``none``: good prints that alarmed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobPages:
    """The pages of a job as designs, from 0."""

    job: JobSource

    def page(self, index: int) -> Page:
        """Page ``index`` + 1."""
        return opened(self.job).page(index + 1)


def run_detectability_study(
    job: JobSource,
    press: Press,
    results: Path,
    *,
    pages: Sequence[int] | None = None,
    trials: int = TRIALS,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[PageReach]:
    """Write ``detectability.md`` and a picture of each page into ``results``.

    pages: numbers of the job's; None: all. RequestError: the press was not taught our detector.
    """
    ours = press.ours
    if ours is None:
        remedy = "build it with `prooflight press build --detector quick`"
        raise RequestError("press", f"{press.name} was not taught our detector", remedy=remedy)
    results.mkdir(parents=True, exist_ok=True)
    found = []
    for number in pages or range(1, len(opened(job)) + 1):
        bench = _Bench(
            press, ours, PressDay.of(press, JobPages(job=job), seed=seed, first=number), number - 1
        )
        progress(f"page {number}: what would be caught")
        one = bench.reach(np.random.default_rng([seed, number, 0]))
        verified = {}
        for index, defect in enumerate(("none", *DEFECTS)):
            progress(f"page {number}: {trials} prints with {defect if index else 'nothing wrong'}")
            rng = np.random.default_rng([seed, number, 1 + index])
            verified[defect] = bench.verified(one, defect, trials, rng)
        page = PageReach(name=bench.page.name, reach=one, verified=verified)
        draw_reach(results / _picture(page), bench.page, one, press)
        found.append(page)
    text = "\n".join(page_lines(found, press, ours, trials=trials, seed=seed))
    with whole_file(results / "detectability.md") as unfinished:
        unfinished.write_text(text + "\n", encoding="utf-8")
    return found


class _Bench:
    """One page on one press day."""

    def __init__(self, press: Press, ours: CalibratedDetector, day: PressDay, index: int) -> None:
        self.press, self.ours, self.day = press, ours, day
        self.page = day.page(index)
        self.known: PreparedPage = day.known(self.page)[0]

    def reach(self, rng: np.random.Generator) -> Reach:
        """From the first of a few good prints that does not alarm; RequestError if all do."""
        for _ in range(PRINTS):
            looked, said = self._looked(self.page, rng)
            check_version(self.ours.tolerance, said, self.known.portrait)
            if (
                page_score(self.ours.tolerance, said, self.known.portrait, looked.found)
                <= self.ours.threshold
            ):
                good = GoodPage(ours=self.ours, said=said, portrait=self.known.portrait)
                return reach(good, looked.sums, looked.fit)
        what = f"{PRINTS} good prints of it alarm"
        raise RequestError(f"page {self.page.number}", what, remedy="teach the press by more designs")

    def verified(self, of_page: Reach, defect: str, trials: int, rng: np.random.Generator) -> Caught:
        caught = made = 0
        for _ in range(trials):
            printed = self.page if defect == "none" else _DRAW[defect](self.page, of_page, rng)
            if printed is None:
                continue
            made += 1
            looked, said = self._looked(printed, rng)
            score = page_score(self.ours.tolerance, said, self.known.portrait, looked.found)
            caught += score > self.ours.threshold
        return Caught(of=made, caught=int(caught))

    def _looked(self, printed: Page, rng: np.random.Generator) -> tuple[Looked, list[Said]]:
        scan = self.day.scan(printed, rng)
        tolerance = self.ours.tolerance
        looked = look(
            self.known,
            scan,
            sensors=self.press.sensors,
            geometry=self.press.geometry,
            spread=tolerance.spread,
        )
        return looked, all_said(looked.sums, looked.fit, looked.found, tolerance.scatter)


def spotted(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with a black spot as small as is said to be caught where it lies; None: there is no such place."""
    side = of_page.spot_mm.shape
    y, x = (np.arange(count) * of_page.tile_mm + of_page.tile_mm / 2 for count in side)
    inside = (
        _inside(x + of_page.left_mm, page.width_mm)[None]
        & _inside(y + of_page.top_mm, page.height_mm)[:, None]
    )
    rows, columns = np.nonzero(inside & np.isfinite(of_page.spot_mm))
    if not rows.size:
        return None
    drawn = int(rng.integers(rows.size))
    row, column = rows[drawn], columns[drawn]
    centre = np.array([y[row] + of_page.top_mm, x[column] + of_page.left_mm]) / page.pixel_mm
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


def thickened(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """The page with more or less of one ink, by as much as is said to be caught."""
    known = {letter: least for letter, least in of_page.inks_percent.items() if least < 100}
    if not known:
        return None
    letter = str(rng.choice(sorted(known)))
    ink, sign = "CMYK".index(letter), rng.choice((-1, 1))
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = _rounded(cmyk[..., ink] * (1 + sign * known[letter] / 100), rng)
    return replace(page, cmyk=cmyk)


_DRAW: Final = {"spot": spotted, "streak": streaked, "density": thickened}


def _inside(place_mm: NDArray[np.floating], extent_mm: float) -> NDArray[np.bool_]:
    return np.asarray((place_mm > EDGE_MM) & (place_mm < extent_mm - EDGE_MM))


def _rounded(values: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.uint8]:
    """To whole codes, at random, so that the mean is right."""
    return np.clip(np.floor(values + rng.random(values.shape)), 0, 255).astype(np.uint8)


def _picture(page: PageReach) -> str:
    return f"detectability-{page.name}.png"


def page_lines(
    pages: Sequence[PageReach], press: Press, ours: CalibratedDetector, *, trials: int, seed: int
) -> Iterator[str]:
    """``detectability.md``."""
    yield "# What would be caught before it is printed"
    yield ""
    yield (
        f"Press {press.name} ({len(press.sensors)} sensor{'s' * (len(press.sensors) > 1)}, camera pixels of "
        f"{press.geometry.pixel_pitch_mm:.3f} mm on the page), our detector; {ours.promise}. The least that is "
        "caught in 99 of 100 prints of the press world, in closed form from each page's own information; medians over "
        "the page with the 5th and 95th percentile in brackets, and the share of places where nothing of the kind is."
    )
    yield ""
    yield "| page | black spot [mm] | nowhere | black streak of 0.5 mm [% ink] | nowhere | one ink all over [%] |"
    yield "|---" * 6 + "|"
    for page in pages:
        inks = ", ".join(_of_ink(letter, least) for letter, least in page.reach.inks_percent.items())
        spot, streak = (_spread(a) for a in (page.reach.spot_mm, page.reach.streak_percent))
        yield f"| {page.name} | {' | '.join(spot)} | {' | '.join(streak)} | {inks} |"
    yield ""
    yield (
        f"Verified: {trials} prints of each page with each defect at a place drawn at random, just as faint as should "
        f"be caught there at 99 %, and as many good prints; every print by itself, one press day a page, seed {seed}."
    )
    yield ""
    yield "| page | spots caught | streaks caught | density changes caught | good prints that alarmed |"
    yield "|---" * 5 + "|"
    rows = [(page.name, page.verified) for page in pages]
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
    for page in pages:
        yield f"![{page.name}]({_picture(page)})"
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
