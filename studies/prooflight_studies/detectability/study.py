"""The smallest spot, the faintest streak and density change that a press would catch on each page of a job.

The strength at which a defect is caught on a page is learned from prints with such defects; the amounts with this
strength follow in closed form; and they are verified on further prints with defects of these amounts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.training.simulated_days import PressDay, fitted
from prooflight.detectors.matched_filter.calibrated import score_of, statistics_vector
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.placing import shows_another
from prooflight.errors import RequestError
from prooflight.pages.job import opened
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight_studies.detectability.closed_form import Reach, Strengths
from prooflight_studies.detectability.defects import DRAWN
from prooflight_studies.detectability.findings import (
    DEFECTS,
    NAMES,
    PRINTS,
    Caught,
    JobReach,
    PageReach,
    job_results,
)
from prooflight_studies.detectability.picture import draw_reach
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.psychometric import SURE, Psychometric

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

HALF: Final = 0.5
LEARNED, VERIFIED = range(2)
"""Uses of a print; no press day is for both."""
LEARNING: Final = 160
"""Number of prints with each defect, over all pages, from which the necessary strength is learned."""
TRIALS: Final = 12
"""Number of prints of each defect on each page; 0.99^12 = 0.89 of the time all are caught."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobPages:
    """The pages of a job as designs, from 0."""

    job: JobSource

    def page(self, index: int) -> Page:
        """Return page ``index`` + 1."""
        return opened(self.job).page(index + 1)


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

    pages: numbers of the job's; None: all. RequestError: the press has no matched filter, or it alarms on good
    prints of all these pages.
    """
    detector = model_of(press)
    results.mkdir(parents=True, exist_ok=True)
    numbers = list(pages or range(1, len(opened(job)) + 1))

    def bench(number: int) -> _Bench:
        source = JobPages(job=job)

        def day(use: int, turn: int) -> PressDay:
            rng = stream(seed, "detectability-session", number, use, turn)
            return PressDay(
                day=SimulatedDay.begin("press", press, rng),
                page=lambda index: fitted(source.page(index), press.geometry),
                residual_variance=detector.model.residual_variance,
                prior=detector.model.prior,
            )

        return _Bench(detector, day, number, stream(seed, "detectability-telling", number))

    alarming: list[str] = []
    detectable: list[int] = []
    wanted = {defect: Psychometric.unknown(detector.guarantee.rate) for defect in DEFECTS}
    left = learning
    for turn, number in enumerate(numbers):
        one = bench(number)
        if one.strengths is None:
            progress(f"page {number}: {PRINTS} good prints of it alarm")
            alarming.append(one.page.name)
            continue
        prints = left // (len(numbers) - turn)
        progress(f"page {number}: {prints} prints with each defect, to learn how strong it must be")
        wanted = one.learned(wanted, prints, stream(seed, "detectability-learning", number))
        left -= prints
        detectable.append(number)
    if not detectable:
        what = f"{PRINTS} good prints of {'it' if len(alarming) == 1 else 'each'} alarm"
        raise RequestError(", ".join(alarming), what, remedy="teach the press by more designs")
    reaches = []
    for number in detectable:
        one = bench(number)  # again, because a job may have more pages than memory holds ready
        assert one.strengths is not None
        half, sure = (
            {defect: of.strength(number, chance) for defect, of in wanted.items()} for chance in (HALF, SURE)
        )
        reach, verified = Reach.of(one.strengths, sure), {}
        for index, defect in enumerate(("none", *DEFECTS)):
            progress(f"page {number}: {trials} prints with {NAMES.get(defect, 'nothing wrong')}")
            rng = stream(seed, "detectability-trials", number, index)
            verified[defect] = one.verified(reach, defect, trials, rng)
        page = PageReach(
            name=one.page.name,
            reach=reach,
            half=Reach.of(one.strengths, half),
            wanted={defect: (half[defect], sure[defect]) for defect in wanted},
            verified=verified,
        )
        draw_reach(results / page.picture, one.page, reach, press)
        reaches.append(page)
    learned = {defect: of.prints for defect, of in wanted.items()}
    job_reach = JobReach(pages=reaches, prints=learned, alarming=alarming)
    shown = job_results(job_reach, press, detector, trials=trials, seed=seed)
    write_page(results / "detectability.md", "detectability", shown)
    return job_reach


class _Bench:
    """One page, every print of it on a press day of its own.

    day: returns the press day of a print by its use, ``LEARNED`` or ``VERIFIED``, and its number: no day is for both.
    """

    def __init__(
        self,
        detector: CalibratedDetector,
        day: Callable[[int, int], PressDay],
        number: int,
        rng: np.random.Generator,
    ) -> None:
        self.detector, self.day, self.number = detector, day, number
        good, self.prepared_page = day(LEARNED, 0).design(number - 1)
        self.page = good.page
        self.strengths = self._strengths(rng)

    def _strengths(self, rng: np.random.Generator) -> Strengths | None:
        """Return the strengths from the first of a few good prints that does not alarm; None if all do."""
        for turn in range(PRINTS):
            analysis, statistics = self._analysed(self.page, self.day(LEARNED, turn), rng)
            statistics_vector(self.detector.model, statistics, self.prepared_page.page_features)
            if self._score(analysis, statistics) <= self.detector.threshold:
                return Strengths.of(analysis.sums, analysis.fit, statistics, self.detector.model.scatter)
        return None

    def learned(
        self, wanted: Mapping[str, Psychometric], prints: int, rng: np.random.Generator
    ) -> dict[str, Psychometric]:
        """Return the posterior after ``prints`` prints of this page with each defect."""
        assert self.strengths is not None
        posteriors = dict(wanted)
        for turn in range(prints):
            day = self.day(LEARNED, PRINTS + turn)
            tried = {defect: one.next(self.number, rng) for defect, one in posteriors.items()}
            reach = Reach.of(self.strengths, tried)
            for defect, strength in tried.items():
                printed = DRAWN[defect](self.page, reach, rng)
                if printed is not None:
                    caught = self._alarms(printed, day, rng)
                    posteriors[defect] = posteriors[defect].seen(self.number, strength, caught=caught)
        return posteriors

    def verified(self, of_page: Reach, defect: str, trials: int, rng: np.random.Generator) -> Caught:
        """Count the prints that are caught, with a defect just as strong as should be, on days without learning."""
        caught = prints = 0
        for turn in range(trials):
            printed = self.page if defect == "none" else DRAWN[defect](self.page, of_page, rng)
            if printed is None:
                continue
            prints += 1
            caught += self._alarms(printed, self.day(VERIFIED, turn), rng)
        return Caught(of=prints, caught=caught)

    def _alarms(self, printed: Page, day: PressDay, rng: np.random.Generator) -> bool:
        return self._score(*self._analysed(printed, day, rng)) > self.detector.threshold

    def _score(self, analysis: ScanAnalysis, statistics: Sequence[Observed]) -> float:
        model = self.detector.model.widened(self.prepared_page.colours.widening)
        values, another = model.vector_of(statistics), shows_another(analysis.registration)
        return score_of(model, values, self.prepared_page.page_features, another=another)

    def _analysed(
        self, printed: Page, day: PressDay, rng: np.random.Generator
    ) -> tuple[ScanAnalysis, list[Observed]]:
        scan = day.day.recorded(day.day.seen_in_press(printed, rng), rng)
        analysis = day.analysed(self.prepared_page, scan)
        return analysis, all_statistics(
            analysis.sums, analysis.marks, analysis.fit, analysis.registration, self.detector.model.scatter
        )
