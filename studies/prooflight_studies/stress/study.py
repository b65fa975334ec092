"""What no detector was taught by: alarms under every nuisance before and after its good pages were learned, misprints
of kinds that nobody taught, and what a nuisance costs in misprints caught.

The press is what `press build` makes; what it learns is what `press learn` learns.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.adapting import fit_for
from prooflight.commissioning.training.learn import Pages, certain_score
from prooflight.commissioning.training.train import trained
from prooflight.detectors.matched_filter.exchangeability import ExchangeabilityTest, summaries
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.protocol import Day
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.press.scans import Scene
from prooflight_studies.ranking.rows import RESTS_ON
from prooflight_studies.stress.given import load_stress
from prooflight_studies.stress.rows import StressWork

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.stress.given import Stress

SCENE: Final = 60
BUILD_DESIGNS: Final = 136
"""As `press build` prints."""
BUILD_SEED: Final = 90_001
COSTLY: Final = "formation_half"
"""Under which misprints are printed as well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StressPlan:
    """How many designs; no two sets share a design or a press day."""

    seed: int = 41
    learn: int = 40
    """Good pages of a press under a nuisance that are learned from, on days of their own."""
    per_day: int = 4
    runs: int = 10
    """Of so many ..."""
    per_run: int = 30
    """... good pages each under every nuisance, each on one press day."""
    marks: int = 120
    """Designs on which every misprint is drawn that nobody taught."""
    wrong: int = 300
    """Designs printed wrong with and without ``COSTLY``."""

    def days(self, first: int, count: int, per_day: int) -> list[Day]:
        """Press days on which designs ``first`` and further are printed."""
        ends = range(first, first + count, per_day)
        return [Day(of="stress", designs=tuple(range(at, min(at + per_day, first + count)))) for at in ends]

    @property
    def sets(self) -> dict[str, list[Day]]:
        """The days of every set."""
        return {
            "learn": self.days(0, self.learn, self.per_day),
            "judge": self.days(10_000, self.runs * self.per_run, self.per_run),
            "marks": self.days(20_000, self.marks, self.per_day),
            "wrong": self.days(30_000, self.wrong, self.per_day),
        }


def run_stress_study(
    stress_file: Path,
    results: Path,
    *,
    cache: Path,
    plan: StressPlan | None = None,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Build a press, print, judge, and write ``stress.md`` into ``results``; cache: where rows are kept."""
    plan, stress = plan or StressPlan(), load_stress(stress_file)
    press_file = at_pitch(PressFile.preset(TWO_SENSORS), REDUCED_PITCH_MM)
    press = build_press(press_file, seed=SPECIMEN_SEED)
    progress("building the press as `press build` does")
    press = trained(
        press,
        Corpus(seed=BUILD_SEED, dpi=press.dpi),
        designs=BUILD_DESIGNS,
        seed=plan.seed,
        processes=processes,
    )
    assert press.ours is not None
    every = _rows(press, press_file, stress, plan, cache, processes, progress)
    found = judged_stress(press.ours, every, plan)
    page = {
        "plan": {name: getattr(plan, name) for name in StressPlan.__slots__},
        "build_designs": BUILD_DESIGNS,
        "promise": str(press.ours.promise),
        "rate": press.ours.promise.rate,
        "worlds": worlds_digest(),
        "stress": stress.digest,
        "unmade": _unmade(every["marks"]),
        **found,
    }
    write_page(results / "stress.md", "stress", page)
    return page


def _rows(
    press: Press,
    press_file: PressFile,
    stress: Stress,
    plan: StressPlan,
    cache: Path,
    processes: int | None,
    progress: Callable[[str], None],
) -> dict[str, Rows]:
    assert press.ours is not None
    path = cache / f"{press.digest[:16]}.press"
    path.parent.mkdir(parents=True, exist_ok=True)
    press.save(path)
    scene = Scene(
        press=path,
        pages=Corpus(seed=plan.seed, dpi=press.dpi),
        seed=plan.seed,
        number=SCENE,
        misprints=1,
    )
    plain = StressWork(
        scene=scene,
        scatter=press.ours.model.scatter,
        stress=stress,
        nuisances=(),
        marks=(),
        press_file=press_file,
    )
    nuisances = tuple(stress.nuisances)
    works = {
        "learn": replace(plain, nuisances=nuisances),
        "judge": replace(plain, nuisances=nuisances),
        "marks": replace(plain, marks=tuple(stress.marks)),
        "wrong": replace(plain, wrong_under=("", COSTLY)),
    }
    facts = {
        "algorithms": {name: ALGORITHMS[name] for name in RESTS_ON},
        "stress": stress.digest,
        "worlds": worlds_digest(),
        "press": press.digest,
        "seed": plan.seed,
        "marks": list(stress.marks),
    }
    return {
        name: run_pieces(
            works[name],
            days,
            cache / name,
            digest=digest_of(facts),
            processes=processes,
            progress=lambda done, of, name=name: progress(f"{name}: {done} of {of} press days"),  # type: ignore[misc]
        )
        for name, days in plan.sets.items()
    }


def judged_stress(ours: CalibratedDetector, every: dict[str, Rows], plan: StressPlan) -> dict[str, Any]:
    """What comes of the rows, by the detector as it was built and as each nuisance's good pages made it fit."""
    learn, judge, wrong = every["learn"], every["judge"], every["wrong"]
    fits = {name: _fit(ours, learn, name) for name in np.unique(learn["nuisance"]).tolist() if name}
    nuisances = []
    for name in ["", *fits]:
        here = judge["nuisance"] == name
        fit = fits.get(name)
        nuisances.append(
            {
                "nuisance": name,
                "scans": int(here.sum()),
                "before": int((_scores(ours, judge, here) > ours.threshold).sum()),
                "after": None if fit is None else int((_scores(fit, judge, here) > fit.threshold).sum()),
                "told_before": _told(ours, judge, here, plan.seed),
                "told_after": None if fit is None else _told(fit, judge, here, plan.seed),
                "runs": plan.runs,
            }
        )
    return {
        "nuisances": nuisances,
        "marks": [_mark(ours, every["marks"], kind) for kind in np.unique(every["marks"]["kind"]) if kind],
        "costly": COSTLY,
        "caught": _caught(ours, wrong, wrong["nuisance"] == ""),
        "caught_costly": _caught(fits[COSTLY], wrong, wrong["nuisance"] == COSTLY),
        "good_alarms": _good_alarms(ours, every),
    }


def _fit(ours: CalibratedDetector, rows: Rows, nuisance: str) -> CalibratedDetector:
    """As `press learn` makes it fit by those good pages."""
    here = rows["nuisance"] == nuisance
    return fit_for(
        ours.model,
        ours.scores.reference,
        Pages.of(rows).rows(here),
        rows["another"][here],
        false_alarm_rate=ours.promise.asked,
        misprint_rate=ours.misprint_rate,
        real=True,
    )


def _scores(ours: CalibratedDetector, rows: Rows, here: NDArray[np.bool_]) -> NDArray[np.float64]:
    return certain_score(ours.model, Pages.of(rows).rows(here), rows["another"][here])


def _told(ours: CalibratedDetector, rows: Rows, here: NDArray[np.bool_], seed: int) -> list[int | None]:
    """Of each run, after how many pages it says that its promise does not hold; None: it does not."""
    found: list[int | None] = []
    pages = Pages.of(rows).rows(here)
    said = summaries(ours.model, ours.model.deviations(pages.values, pages.page_features))
    day = rows["day"][here]
    for number, one in enumerate(np.unique(day)):
        test, rng = ExchangeabilityTest.of(ours), stream(seed, "stress-ties", number)
        after = None
        for count, summary in enumerate(said[day == one], 1):
            test.add(summary, rng)
            if test.suspended:
                after = count
                break
        found.append(after)
    return found


def _mark(ours: CalibratedDetector, rows: Rows, kind: str) -> dict[str, Any]:
    here = rows["kind"] == kind
    caught = int((_scores(ours, rows, here) > ours.threshold).sum())
    return {"kind": str(kind), "count": int(here.sum()), "caught": caught}


def _caught(ours: CalibratedDetector, rows: Rows, where: NDArray[np.bool_]) -> dict[str, Any]:
    here = where & (rows["kind"] != "")
    hit = _scores(ours, rows, here) > ours.threshold
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


def _unmade(rows: Rows) -> dict[str, int]:
    """Of each kind, on how many pages it could not be."""
    return dict(sorted(Counter(rows["unmade_kind"].tolist()).items()))


def _good_alarms(ours: CalibratedDetector, every: dict[str, Rows]) -> dict[str, int]:
    """All good prints without a nuisance, of every set."""
    alarms = scans = 0
    for rows in every.values():
        here = (rows["kind"] == "") & (rows["nuisance"] == "")
        alarms += int((_scores(ours, rows, here) > ours.threshold).sum())
        scans += int(here.sum())
    return {"alarms": alarms, "scans": scans}
