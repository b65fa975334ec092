"""Evaluation of the matched filter in the press world, with and without each of its parts; writes a page of results.

An interrupted study resumes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.learn import (
    Pages,
    certain_score,
    learn_scatter,
    pooled,
)
from prooflight.detectors.false_alarm_rate import conformal_threshold
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.operating import Scored, least_cost
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.result_cache import digest_of, minutes_spent, run_pieces
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.press.findings import PressFindings, PressPlan
from prooflight_studies.press.judging import (
    ALPHAS,
    FALSE_ALARM_RATE,
    MATCHED_FILTER,
    MethodResult,
    check_rates,
    judged,
    parts_of,
)
from prooflight_studies.press.results import press_results
from prooflight_studies.press.scans import ScatterWork, Scene, StatisticsWork

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.harness.folder import Folder
    from prooflight_studies.harness.protocol import Day
    from prooflight_studies.harness.result_cache import Rows, Work
    from prooflight_studies.press.judging import Verdicts

SCHEMA: Final = 2
"""Version of the rows; a change of the measurement invalidates cached results."""
LOOSER: Final = 1.5
"""Factor on the variation of good prints where a press is worse than assumed."""


def run_press_study(
    press_file: PressFile,
    results: Path,
    *,
    cache: Path,
    plan: PressPlan,
    processes: int | None = None,
    real: Folder | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> PressFindings:
    """Scan, train, tune, test, and write ``PressFindings.page`` into ``results``.

    press_file: of two sensors, the first of which is the ideal world's. cache: folder of rows, from which an
    interrupted study resumes. real: pages of real documents, in addition to the composed designs.
    """
    started = time.perf_counter()
    press = build_press(at_pitch(press_file, REDUCED_PITCH_MM), seed=SPECIMEN_SEED)
    bench = _Bench(press=press, cache=cache, plan=plan, processes=processes, progress=progress)
    scans = _scanned(bench, real)
    lessons = Pages.of(scans.training).joined(Pages.of(scans.learning))
    verdicts = judged(
        scans.main,
        scans.scatter,
        training=lessons,
        good=scans.rate_pages,
        seed=plan.seed,
        trees=plan.trees,
        ablations=plan.ablations,
        processes=processes,
        progress=progress,
    )
    checks, tried = check_rates(verdicts, scans.rate_pages, scans.trial, calibration=plan.calibration)
    findings = PressFindings(
        plan=plan,
        pitch_mm=REDUCED_PITCH_MM,
        fringes=press.fringes,
        main=scans.main,
        verdicts=verdicts,
        kept=checks,
        tried=tried,
        looser=_looser(verdicts, scans.looser, plan),
        ideal=judged(scans.ideal, scans.ideal_scatter, seed=plan.seed, trees=plan.trees, ablations=False),
        real=None if scans.real is None else _on_real(verdicts, scans.main, scans.rate_pages, scans.real),
    )
    write_page(results / findings.page, "press", press_results(findings))
    progress(
        f"done in {(time.perf_counter() - started) / 60:.0f} minutes; all rows, in this sitting or before, took "
        f"{sum(bench.minutes):.0f} minutes of one process"
    )
    return findings


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bench:
    """Press, plan and cache folder of the work."""

    press: Press
    cache: Path
    plan: PressPlan
    processes: int | None
    progress: Callable[[str], None]
    minutes: list[float] = field(default_factory=list)
    """Minutes of one process that each scene's rows took, whenever they were computed."""

    def save_press(self, press: Press) -> Path:
        """Save a press to a file for the workers and return its path."""
        path = self.cache / f"{press.digest[:16]}.press"
        path.parent.mkdir(parents=True, exist_ok=True)
        press.save(path)
        return path

    def digest(self, scene: Scene) -> str:
        """Return the digest of all that a scene's rows depend on except their day, so that a scene can grow."""
        facts = {
            "schema": SCHEMA,
            "worlds": worlds_digest(),
            "pilot": self.plan.pilot,
            "press": scene.press.name,
            "scene": repr(replace(scene, press=Path())),
        }
        return digest_of(facts)

    def scatter(self, scene: Scene, days: list[Day], what: str) -> Scatter:
        """Learn the scatter of statistics from good prints."""
        drawn = self._rows(ScatterWork(scene=scene), scene, days, "scatter", what)
        return learn_scatter({name: pooled(values) for name, values in drawn.items()})

    def statistics(self, scene: Scene, scatter: Scatter, days: list[Day], what: str) -> Rows:
        """Return the statistics of every scan of a scene."""
        return self._rows(StatisticsWork(scene=scene, scatter=scatter), scene, days, "said", what)

    def _rows(self, work: Work[Day], scene: Scene, days: list[Day], kind: str, what: str) -> Rows:
        folder, digest = self.cache / kind, self.digest(scene)
        rows = run_pieces(
            work, days, folder, digest=digest, processes=self.processes, progress=self.progress_of(what)
        )
        self.minutes.append(minutes_spent(days, folder, digest=digest))
        return rows

    def progress_of(self, what: str) -> Callable[[int, int], None]:
        """Return a progress callback for a list of pieces."""
        return lambda done, of: self.progress(f"{what}: {done} of {of} press days")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scans:
    """Statistics of every scan of each scene, and the scatter of statistics in either world."""

    scatter: Scatter
    main: Rows
    looser: Rows
    ideal_scatter: Scatter
    ideal: Rows
    real: Rows | None
    rate_pages: Rows
    training: Rows
    learning: Rows
    trial: Rows


def _scanned(bench: _Bench, real: Folder | None) -> _Scans:
    """Scan all scenes, one after the other; no two have a number, and so a day, in common."""
    press, plan = bench.press, bench.plan
    designs = Corpus(seed=plan.seed, dpi=press.dpi)
    scene = Scene(
        press=bench.save_press(press), pages=designs, seed=plan.seed, number=0, misprints=plan.misprints
    )
    good = replace(scene, misprints=0)
    scatter = bench.scatter(good, plan.days_of("pilot"), "pilot")

    def statistics(name: str, scene: Scene, what: str) -> Rows:
        return bench.statistics(scene, scatter, plan.days_of(name), what)

    main = statistics("designs", replace(scene, number=1), "scans")
    looser = statistics("looser", replace(good, number=2, times=LOOSER), "looser press")
    alone = replace(press, sensors=press.sensors[:1], clipped=press.clipped[:1], variation={"all_times": 0.0})
    ideal = Scene(
        press=bench.save_press(alone), pages=designs, seed=plan.seed, number=3, world="ideal", misprints=2
    )
    ideal_scatter = bench.scatter(
        replace(ideal, misprints=0), plan.days_of("ideal_pilot"), "ideal world, pilot"
    )
    ideal_rows = bench.statistics(ideal, ideal_scatter, plan.days_of("ideal"), "ideal world")
    real_rows = None
    if real is not None:
        of_real = replace(scene, number=4, pages=real, misprints=3)
        real_rows = bench.statistics(of_real, scatter, _fitting(real, press, plan), "real pages")
    lesson = replace(scene, number=6, misprints=plan.teaching_misprints)
    return _Scans(
        scatter=scatter,
        main=main,
        looser=looser,
        ideal_scatter=ideal_scatter,
        ideal=ideal_rows,
        real=real_rows,
        rate_pages=statistics("promise", replace(good, number=5), "good pages that promise"),
        training=statistics("teaching", lesson, "designs that teach"),
        learning=statistics("learning", replace(good, number=7), "good pages that teach"),
        trial=statistics("trial", replace(good, number=8), "good pages that try promises"),
    )


def _fitting(real: Folder, press: Press, plan: PressPlan) -> list[Day]:
    """Return press days of the real pages that are no wider than the press sees."""
    fits = [press.geometry.sees(min(size)) for size in real.sizes_mm]
    days = [
        replace(day, designs=tuple(index for index in day.designs if fits[index]))
        for day in plan.days(0, len(real))
    ]
    return [day for day in days if day.designs]


def _looser(verdicts: Verdicts, rows: Rows, plan: PressPlan) -> dict[str, NDArray[np.bool_]]:
    """Return alarms on good pages of a press that varies more, before and after its own good pages were learned."""
    model, pages = verdicts.detectors[0], Pages.of(rows)
    score = certain_score(model, pages, rows["another"])
    learned = np.unique(pages.design)[: plan.looser_known]
    mine = np.isin(pages.design, learned)
    rate = max(FALSE_ALARM_RATE, 1.01 / (len(learned) + 1))
    threshold = conformal_threshold(score[mine], pages.design[mine], false_alarm_rate=rate)
    times = f"variations {LOOSER:g} times those assumed"
    return {
        f"{times}, nothing learned": score[~mine] > model.threshold,
        f"{times}, {len(learned)} good pages learned": score[~mine] > threshold,
    }


def _on_real(verdicts: Verdicts, main: Rows, calibration: Rows, rows: Rows) -> MethodResult:
    """Return the result on real pages of the first part's detector and thresholds."""
    model, pages = verdicts.detectors[0], Pages.of(rows)
    part = parts_of(main)
    tune = Pages.of(main).rows(part == 1).joined(Pages.of(calibration))
    another = np.concatenate([main["another"][part == 1], calibration["another"]])
    day = np.concatenate([main["day"][part == 1], calibration["day"]])
    of_tune = Scored(score=certain_score(model, tune, another), bad=tune.bad, design=tune.design, day=day)
    score = certain_score(model, pages, rows["another"])
    return MethodResult(
        name=MATCHED_FILTER,
        scored=Scored(score=score, bad=pages.bad, design=pages.design, day=rows["day"]),
        part=np.zeros(len(score), np.int64),
        alarms=np.stack([score > least_cost(of_tune, alpha).threshold for alpha in ALPHAS]),
        nominal_alarms=score > model.threshold,
    )


__all__ = ["PressFindings", "PressPlan", "run_press_study"]
