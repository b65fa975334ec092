"""Stress study: alarms under nuisances before and after learning, and misprints of kinds without training.

It measures false alarms under every nuisance before and after its good pages were learned, misprints of untrained
kinds, and the misprints that a nuisance hides. The press is made as `press build` makes it; it learns as `press learn`
does.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.adapting import fit_for
from prooflight.commissioning.training.learn import Pages, certain_score
from prooflight.commissioning.training.train import trained
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.exchangeability import ExchangeabilityTest, summaries
from prooflight.detectors.matched_filter.glyphs.scoring import NONE
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus, design_name
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.operating import Scored, bootstrap_cost, least_cost
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.print_statistics import Scene, StatisticsWork
from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import DETECTION
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.stress.rows import StressWork, load_stress

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs
    from prooflight_studies.harness.folder import Folder
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.stress.rows import Stress

SCENE, REAL_SCENE = 60, 61
BUILD_SEED: Final = 90_001
MOST_UNTOLD, OFTEN_TOLD = 0.03, 0.95
"""False-alarm rate of a run that need not be reported, and share of runs above it that must be."""
COSTLY: Final = "formation_half"
"""Nuisance under which misprints are printed as well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StressPlan:
    """Numbers of designs; no two sets share a design or a press day."""

    seed: int = 53
    learn: int = 40
    """Number of good pages of a press under a nuisance that are learned, on days of their own."""
    per_day: int = 4
    runs: int = 10
    """Number of runs under every nuisance."""
    per_run: int = 30
    """Number of good pages of each run, printed on one press day."""
    marks: int = 120
    """Number of designs on which every misprint is drawn that no detector is trained on."""
    wrong: int = 300
    """Number of designs printed wrong with and without ``COSTLY``."""
    good: int = 2240
    """Number of further designs, printed once, well."""
    rounds: int = 5
    """Number of rounds in which every real page is printed once well and once wrong."""

    def days(self, first: int, count: int, per_day: int) -> list[Day]:
        """Return the press days on which ``count`` designs from ``first`` on are printed."""
        return in_days("stress", range(first, first + count), per_day)

    @property
    def sets(self) -> dict[str, list[Day]]:
        """Press days of every set."""
        return {
            "learn": self.days(0, self.learn, self.per_day),
            "judge": self.days(10_000, self.runs * self.per_run, self.per_run),
            "marks": self.days(20_000, self.marks, self.per_day),
            "wrong": self.days(30_000, self.wrong, self.per_day),
            "good": self.days(40_000, self.good, self.per_day),
        }


def run_stress_study(
    stress_file: Path,
    results: Path,
    *,
    cache: Path,
    plan: StressPlan | None = None,
    real: Folder | None = None,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Build a press, print, judge, and write ``stress.md`` into ``results``; cache: folder of rows.

    real: pages of real documents, in addition to the composed designs.
    """
    plan, stress = plan or StressPlan(), load_stress(stress_file)
    press_file = at_pitch(PressFile.preset(TWO_SENSORS), REDUCED_PITCH_MM)
    untrained = build_press(press_file, seed=SPECIMEN_SEED)
    progress("building the press as `press build` does")
    press = trained(
        untrained,
        Corpus(seed=BUILD_SEED, dpi=untrained.dpi),
        designs=DESIGNS,
        seed=plan.seed,
        processes=processes,
    )
    bench = _Bench(
        press=untrained,
        press_file=press_file,
        scatter=model_of(press).model.scatter,
        stress=stress,
        plan=plan,
        cache=cache,
        processes=processes,
        progress=progress,
    )
    every = bench.rows()
    judged = judged_stress(model_of(press), every, plan)
    of_real = None if real is None else _as_built(model_of(press), bench.real_rows(real), plan)
    page = {
        "plan": {name: getattr(plan, name) for name in StressPlan.__slots__},
        "build_designs": DESIGNS,
        "promise": str(model_of(press).guarantee),
        "rate": model_of(press).guarantee.rate,
        "worlds": worlds_digest(),
        "stress": stress.digest,
        "unmade": _unmade(every["marks"]),
        "real": of_real,
        **judged,
    }
    write_page(results / "stress.md", "stress", page)
    return page


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bench:
    """Computation and cache of rows, with all that they depend on; the ranking that judges them is none of it."""

    press: Press
    press_file: PressFile
    scatter: Scatter
    """Scatter that its statistics are normalised by."""
    stress: Stress
    plan: StressPlan
    cache: Path
    processes: int | None
    progress: Callable[[str], None]

    def rows(self) -> dict[str, Rows]:
        """Return the rows of every set of the plan, on composed designs."""
        scene = self._scene(Corpus(seed=self.plan.seed, dpi=self.press.dpi), SCENE)
        plain = StressWork(
            scene=scene,
            scatter=self.scatter,
            stress=self.stress,
            nuisances=(),
            marks=(),
            press_file=self.press_file,
        )
        nuisances = tuple(self.stress.nuisances)
        works = {
            "learn": replace(plain, nuisances=nuisances),
            "judge": replace(plain, nuisances=nuisances),
            "marks": replace(plain, marks=tuple(self.stress.marks)),
            "wrong": replace(plain, wrong_under=("", COSTLY)),
            "good": plain,
        }
        return {name: self._computed(works[name], days, name) for name, days in self.plan.sets.items()}

    def real_rows(self, real: Folder) -> Rows:
        """Return rows of the real pages that the press sees in full width.

        Each is printed once well and once wrong in every round.
        """
        pages = Rounds(folder=real)
        fits = [self.press.geometry.sees(min(size)) for size in real.sizes_mm]
        designs = [index for index in range(self.plan.rounds * len(fits)) if fits[index % len(fits)]]
        work = StatisticsWork(scene=self._scene(pages, REAL_SCENE), scatter=self.scatter)
        return self._computed(work, in_days("stress", designs, self.plan.per_day), "real")

    def _scene(self, pages: Designs, number: int) -> Scene:
        path = self.cache / f"{self.press.digest[:16]}.press"
        path.parent.mkdir(parents=True, exist_ok=True)
        self.press.save(path)
        return Scene(press=path, pages=pages, seed=self.plan.seed, number=number, misprints=1)

    def _computed(self, work: StressWork | StatisticsWork, days: list[Day], name: str) -> Rows:
        facts = {
            "algorithms": DETECTION,
            "stress": self.stress.digest,
            "worlds": worlds_digest(),
            "press": self.press.digest,
            "build": (BUILD_SEED, DESIGNS),  # how the press was trained
            "seed": self.plan.seed,
        }
        if isinstance(work, StressWork) and work.marks:
            facts["marks"] = list(work.marks)
        return run_pieces(
            work,
            days,
            self.cache / name,
            digest=digest_of(facts),
            processes=self.processes,
            progress=lambda done, of: self.progress(f"{name}: {done} of {of} press days"),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounds:
    """Pages of a folder, repeated: in each round they are new designs."""

    folder: Folder

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0."""
        return replace(self.folder.page(index % len(self.folder)), name=design_name(index))


def judged_stress(detector: CalibratedDetector, every: dict[str, Rows], plan: StressPlan) -> dict[str, Any]:
    """Judge the rows by the detector as built, and as recalibrated on each nuisance's good pages."""
    learn, judge, wrong = every["learn"], every["judge"], every["wrong"]
    fits = {name: _fit(detector, learn, name) for name in np.unique(learn["nuisance"]).tolist() if name}
    nuisances = []
    for name in ["", *fits]:
        here = judge["nuisance"] == name
        fit = fits.get(name)
        day = judge["day"][here]
        alarm, told = _judged_runs(detector, judge, here, plan.seed)
        after, told_after = (None, None) if fit is None else _judged_runs(fit, judge, here, plan.seed)
        beyond = [alarm[day == one].mean() > MOST_UNTOLD for one in np.unique(day)]
        of_beyond = [page for page, far in zip(told, beyond, strict=True) if far and page is not None]
        nuisances.append(
            {
                "nuisance": name,
                "scans": int(here.sum()),
                "before": int(alarm.sum()),
                "after": None if after is None else int(after.sum()),
                "told_before": told,
                "beyond": sum(beyond),
                "beyond_told": len(of_beyond),
                "untold": bool(alarm.mean() > MOST_UNTOLD and len(of_beyond) < OFTEN_TOLD * sum(beyond)),
                "told_after": told_after,
                "runs": plan.runs,
            }
        )
    return {
        "nuisances": nuisances,
        "marks": [
            _mark(detector, every["marks"], kind) for kind in np.unique(every["marks"]["kind"]) if kind
        ],
        "costly": COSTLY,
        "caught": _caught(detector, wrong, wrong["nuisance"] == ""),
        "caught_costly": _caught(fits[COSTLY], wrong, wrong["nuisance"] == COSTLY),
        "composed": _as_built(detector, _plain(every), plan),
        "floor": True,
    }


def _fit(detector: CalibratedDetector, rows: Rows, nuisance: str) -> CalibratedDetector:
    """Calibrate on those good pages as `press learn` does."""
    here = rows["nuisance"] == nuisance
    return fit_for(
        detector.model,
        detector.references,
        Pages.of(rows).rows(here),
        rows["another"][here],
        false_alarm_rate=detector.guarantee.requested_rate,
        misprint_rate=detector.misprint_rate,
        real=True,
        glyphs=rows["glyphs"][here],
    )


def _scores(
    detector: CalibratedDetector, rows: Rows, here: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ranking's scores, and those of ranking, glyphs and floor together."""
    ranking = certain_score(detector.model, Pages.of(rows).rows(here), rows["another"][here])
    return ranking, _of_all_tests(detector, ranking, rows, here)


def _of_all_tests(
    detector: CalibratedDetector, ranking: NDArray[np.float64], rows: Rows, here: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return scores above the threshold where ranking, glyphs or floor alarm; of another page neither of the last."""
    another = rows["another"][here]
    glyphs, floor_mm2 = (
        np.where(another, none, rows[name][here]) for name, none in (("glyphs", NONE), ("floor_mm2", 0.0))
    )
    return np.array([detector.decide(*one).score for one in zip(ranking, glyphs, floor_mm2, strict=True)])


def _judged_runs(
    detector: CalibratedDetector, rows: Rows, here: NDArray[np.bool_], seed: int
) -> tuple[NDArray[np.bool_], list[int | None]]:
    """Return which pages alarm, and for each run the page at which the test rejects exchangeability (None: never)."""
    ends: list[int | None] = []
    pages, (ranking, score) = Pages.of(rows).rows(here), _scores(detector, rows, here)
    page_summaries = summaries(
        detector.model, detector.model.deviations(pages.values, pages.page_features), ranking
    )
    day = rows["day"][here]
    for number, one in enumerate(np.unique(day)):
        test, rng = ExchangeabilityTest.of(detector), stream(seed, "stress-ties", number)
        after = None
        for count, summary in enumerate(page_summaries[day == one], 1):
            test.add(summary, rng)
            if test.suspended:
                after = count
                break
        ends.append(after)
    return score > detector.threshold, ends


def _mark(detector: CalibratedDetector, rows: Rows, kind: str) -> dict[str, Any]:
    here = rows["kind"] == kind
    ranking, score = _scores(detector, rows, here)
    caught, without = (int((one > detector.threshold).sum()) for one in (score, ranking))
    return {"kind": str(kind), "count": int(here.sum()), "caught": caught, "without_glyphs": without}


def _caught(detector: CalibratedDetector, rows: Rows, where: NDArray[np.bool_]) -> dict[str, Any]:
    here = where & (rows["kind"] != "")
    hit = _scores(detector, rows, here)[1] > detector.threshold
    upper = rows["severity"][here] >= 1 / 3
    return {
        "count": int(hit.size),
        "caught": int(hit.sum()),
        "upper_count": int(upper.sum()),
        "upper_caught": int(hit[upper].sum()),
        "kinds": {
            str(kind): [int(hit[rows["kind"][here] == kind].sum()), int((rows["kind"][here] == kind).sum())]
            for kind in np.unique(rows["kind"][here])
        },
    }


def _plain(every: dict[str, Rows]) -> Rows:
    """Return all good prints without a nuisance, of every set, and the misprints of the twelve kinds."""
    scores = "glyphs", "floor_mm2", "widening"
    columns = ("design", "day", "kind", "severity", "values", "portrait", "another", *scores)
    parts = []
    for name, rows in every.items():
        here = (rows["nuisance"] == "") & ((rows["kind"] == "") | (name == "wrong"))
        parts.append({column: rows[column][here] for column in columns})
    return {column: np.concatenate([part[column] for part in parts]) for column in columns}


def _as_built(detector: CalibratedDetector, rows: Rows, plan: StressPlan) -> dict[str, Any]:
    """Return false alarms, misses, kinds named and c(1) of the detector as it was built.

    Kinds are those named by the ranking; the verdicts of glyphs or floor alone name none of the twelve kinds. c(1) is
    at the threshold that costs least on the good pages and misprints on which the ranking was evaluated.
    """
    pages = Pages.of(rows)
    score, named = np.empty(len(pages.kind)), np.zeros(len(pages.kind), bool)
    for times in np.unique(rows["widening"]):
        here, model = rows["widening"] == times, detector.model.widened(times)
        those, another = pages.rows(here), rows["another"][here]
        score[here] = certain_score(model, those, another)
        kinds = np.where(another, WRONG_PAGE_KIND, model.kinds_of(those.values, those.page_features))
        named[here] = kinds == those.kind
    by_ranking, score = (
        score > detector.threshold,
        _of_all_tests(detector, score, rows, np.ones(score.size, bool)),
    )
    bad, alarm, upper = pages.bad, score > detector.threshold, rows["severity"] >= 1 / 3
    judged = Scored(score=score, bad=bad, design=pages.design, day=rows["day"])
    cost = bootstrap_cost(
        judged, 1.0, threshold=_least_cost_elsewhere(detector), rng=stream(plan.seed, "stress-bootstrap")
    )
    return {
        "good": int((~bad).sum()),
        "alarms": int((alarm & ~bad).sum()),
        "alarms_by_glyphs": int((alarm & ~by_ranking & ~bad).sum()),
        "misprints": int(bad.sum()),
        "caught": int((alarm & bad).sum()),
        "caught_by_glyphs": int((alarm & ~by_ranking & bad).sum()),
        "upper_misprints": int((bad & upper).sum()),
        "upper_caught": int((alarm & bad & upper).sum()),
        "named": int((named & by_ranking & bad).sum()),
        "designs": int(np.unique(pages.design).size),
        "days": int(np.unique(rows["day"]).size),
        "cost": cost,
    }


def _least_cost_elsewhere(detector: CalibratedDetector) -> float:
    good, wrong = detector.scores.reference.worst, shipped_ranking().misprints
    number = np.arange(good.size + wrong.size)
    bad = number >= good.size
    pages = Scored(score=np.concatenate([good, wrong]), bad=bad, design=number, day=number)
    return least_cost(pages, 1.0).threshold


def _unmade(rows: Rows) -> dict[str, int]:
    """Return for each kind the number of pages on which it could not be."""
    return dict(sorted(Counter(rows["unmade_kind"].tolist()).items()))
