"""The shipped ranking: trained on all rows, and evaluated by cross-validation over press days."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.adapting import adapted
from prooflight.commissioning.training.learn import Pages, certain_score, learn_model, learn_scatter, pooled
from prooflight.commissioning.training.train import Plan
from prooflight.detectors.cost import FLOOR_AREA_MM2
from prooflight.detectors.false_alarm_rate import GoodScores, ReferenceScores
from prooflight.detectors.matched_filter.shipped import ShippedRanking
from prooflight.pages.parallel import in_order
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.print_statistics import ScatterWork, Scene, StatisticsWork
from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import DETECTION
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows

FOLDS: Final = 4
TREES: Final = 240
LEFT_OUT_TREES: Final = 120
"""Number of trees of rankings that measure the value of training on a kind."""
RATES: Final = (0.01, 0.02, 0.05)
OF_A_PRESS: Final = len(Plan.of(DESIGNS).calibrate)
"""Number of good pages that calibrate a ranking for a press, as many as `press build` prints for that."""
SIZES: Final = (20, 40, 80, OF_A_PRESS, 320)
"""Numbers of good pages for calibration; the others are for a press that learned from its real pages."""
PARTS: Final = 6
"""Number of parts of a fold's rows, each judged by a model that is calibrated on other good pages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingRows:
    """All rows of all presses, in one order."""

    pages: Pages
    day: NDArray[np.int64]
    another: NDArray[np.bool_]
    severity: NDArray[np.float64]
    floor_mm2: NDArray[np.float64]
    """``FloorFinding.area_mm2`` of each row."""
    names: list[str]
    scatter: Scatter
    """Scatter of the first press; each press has its own after its calibration."""

    @classmethod
    def of(cls, every: list[Lesson]) -> TrainingRows:
        """Concatenate the rows; presses are numbered in their order."""
        sets = [(number, rows) for number, lesson in enumerate(every) for rows in lesson.rows]
        pages = Pages.of(sets[0][1], sets[0][0])
        for number, rows in sets[1:]:
            pages = pages.joined(Pages.of(rows, number))
        names = sets[0][1]["names"][: pages.values.shape[1]].tolist()
        one = {
            name: np.concatenate([rows[name] for _, rows in sets])
            for name in ("day", "another", "severity", "floor_mm2")
        }
        return cls(pages=pages, **one, names=names, scatter=every[0].scatter)

    @property
    def fold(self) -> NDArray[np.int64]:
        """Return the fold in which each row is judged; press days take turns."""
        return np.asarray(np.unique(self.day, return_inverse=True)[1] % FOLDS)

    def model(self, which: NDArray[np.bool_], rng: np.random.Generator, trees: int) -> Any:
        """Train a model on some rows."""
        return learn_model(
            self.pages.rows(which),
            names=self.names,
            scatter=self.scatter,
            rng=rng,
            screened=True,
            trees=trees,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JudgedFold:
    """Rows that one fold judges, with their scores and kinds."""

    rows: NDArray[np.int64]
    score: NDArray[np.float64]
    """Scores by detectors calibrated on ``SIZES`` good pages, (sizes, rows); of one size where a kind was left out."""
    kind: NDArray[np.str_]
    """Kinds by the detector of ``OF_A_PRESS``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoldWork:
    """Judgement of a fold, given its number and the kind that is left out of training ("": none).

    Scores are those of a press's own detector: each part of a press's rows is judged by the model calibrated on as many
    of its good pages of the other folds as a press has. More of them would give other scores.
    """

    training: TrainingRows
    seed: int

    def __call__(self, task: tuple[int, str]) -> JudgedFold:
        """Judge the rows of one fold."""
        index, without = task
        training, pages = self.training, self.training.pages
        mine = training.fold == index
        learn = ~mine & (pages.kind != without if without else True)
        rng = stream(self.seed, "ranking-fold", index)
        model = training.model(learn, rng, LEFT_OUT_TREES if without else TREES)
        judged = mine & (~pages.bad | (pages.kind == without)) if without else mine
        sizes = (OF_A_PRESS,) if without else SIZES
        score, kind = np.empty((len(sizes), len(mine))), np.zeros(len(mine), "U16")
        part = np.unique(training.day, return_inverse=True)[1] // FOLDS % PARTS
        for one, turn in product(np.unique(pages.press), range(PARTS)):
            here = pages.press == one
            own = rng.permutation(np.flatnonzero(here & ~mine & ~pages.bad))
            now = judged & here & (part == turn)
            if not now.any():
                continue
            these, another = pages.rows(now), training.another[now]
            for place, size in enumerate(sizes):
                fit = adapted(model, pages.rows(own[:size]))
                score[place, now] = certain_score(fit, these, another)
                if size == OF_A_PRESS:
                    kind[now] = fit.kinds_of(these.values, these.page_features)
        rows = np.flatnonzero(judged)
        return JudgedFold(rows=rows, score=score[:, rows], kind=kind[rows])


def run_ranking_study(
    results: Path,
    *,
    cache: Path,
    plan: RankingPlan | None = None,
    ship: Path | None = None,
    left_out: bool = True,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Train, evaluate, and write ``ranking.md`` into ``results``; ship: path for the ranking, if it is to be shipped.

    left_out: whether each kind is also judged by a ranking that was trained without it.
    """
    plan = plan or RankingPlan()
    training = TrainingRows.of(lessons(plan, cache, processes=processes, progress=progress))
    pages, work = training.pages, FoldWork(training=training, seed=plan.seed)
    kinds = np.unique(pages.kind[pages.bad]).tolist()
    tasks = [(fold, "") for fold in range(FOLDS)]
    tasks += [(fold, kind) for kind in kinds for fold in range(FOLDS)] if left_out else []
    folds: dict[str, list[JudgedFold]] = {kind: [] for kind in ("", *kinds)}
    for (_, kind), one in zip(tasks, in_order(work, tasks, processes=processes, fewest=2), strict=True):
        folds[kind].append(one)
        progress(f"judged {'all kinds' if not kind else 'without ' + kind}")
    judged = in_rows(folds[""])
    by_size = judged.score
    scores, design = by_size[SIZES.index(OF_A_PRESS)], _design(pages)[~pages.bad]
    model = training.model(np.ones(len(pages.bad), bool), stream(plan.seed, "ranking-trees"), TREES)
    assert model.screen is not None
    ranking = ShippedRanking(
        model=model,
        references=ReferenceScores(
            pages=np.array(SIZES),
            worst=np.stack([GoodScores.of(score[~pages.bad], design).worst for score in by_size]),
        ),
        misprints=np.sort(scores[pages.bad]),
    )
    size_mb = 0.0
    if ship is not None:
        ranking.save(ship)
        size_mb = ship.stat().st_size / 1e6
    findings = {
        "plan": {name: getattr(plan, name) for name in RankingPlan.__slots__},
        "worlds": worlds_digest(),
        "size_mb": size_mb,
        "good": int((~pages.bad).sum()),
        "misprints": int(pages.bad.sum()),
        "statistics": len(training.names),
        "of_a_press": OF_A_PRESS,
        "rates": [_at(scores, pages, rate) for rate in RATES],
        "sizes": [
            {"pages": size} | _at(score, pages, RATES[0]) for size, score in zip(SIZES, by_size, strict=True)
        ],
        "deciding": int(model.screen.statistic.size),
        "floor": {
            "good": int((training.floor_mm2[~pages.bad] >= FLOOR_AREA_MM2).sum()),
            "misprints": int((training.floor_mm2[pages.bad] >= FLOOR_AREA_MM2).sum()),
        },
        "kinds": [_kind(kind, training, scores, judged.kind, folds[kind]) for kind in kinds],
    }
    write_page(results / "ranking.md", "ranking", findings)
    return findings


def in_rows(folds: Sequence[JudgedFold]) -> JudgedFold:
    """Concatenate folds in the order of their rows."""
    rows = np.concatenate([one.rows for one in folds])
    order = np.argsort(rows)
    return JudgedFold(
        rows=rows[order],
        score=np.concatenate([one.score for one in folds], axis=1)[:, order],
        kind=np.concatenate([one.kind for one in folds])[order],
    )


def _design(pages: Pages) -> NDArray[np.int64]:
    """Return a number for each design and press."""
    return np.asarray(pages.design + 10_000_000 * pages.press)


def _at(scores: NDArray[np.float64], pages: Pages, rate: float) -> dict[str, float]:
    threshold = np.quantile(scores[~pages.bad], 1 - rate, method="higher")
    return {
        "rate": rate,
        "threshold": float(threshold),
        "caught": float((scores[pages.bad] > threshold).mean()),
    }


def _kind(
    kind: str,
    training: TrainingRows,
    scores: NDArray[np.float64],
    assigned: NDArray[np.str_],
    left_out: list[JudgedFold],
) -> dict[str, Any]:
    """Return the figures of one kind at 1 % false alarms: caught, named right, and caught without training on it."""
    pages = training.pages
    threshold = np.quantile(scores[~pages.bad], 1 - RATES[0], method="higher")
    mine = pages.kind == kind
    hit = mine & (scores > threshold)
    figures: dict[str, Any] = {
        "kind": kind,
        "count": int(mine.sum()),
        "caught": float(hit.sum() / mine.sum()),
        "named": float((assigned[hit] == kind).mean()) if hit.any() else None,
        "untaught": None,
    }
    if left_out:
        without = in_rows(left_out)
        score, bad = without.score[0], pages.bad[without.rows]
        figures["untaught"] = float(
            (score[bad] > np.quantile(score[~bad], 1 - RATES[0], method="higher")).mean()
        )
    return figures


# --- training set: good prints and misprints of composed designs on two presses ---

FIRST_SCENE: Final = 40
"""Number of this study's first scene, distinct from those of other studies of the same seed."""
TRAINING_SEED: Final = 31
"""Seed of designs, days, prints and misprints for training; no results are published on it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RankingPlan:
    """Numbers of designs for training; each is printed once well, and ``misprints`` times wrong."""

    seed: int = TRAINING_SEED
    pilot: int = 32
    """Number of designs of each press, printed once, well, from which the scatter of its statistics is learned."""
    two_sensors: int = 800
    """Number of designs on the press of two sensors."""
    one_sensor: int = 200
    """Number of designs on the press of one sensor."""
    misprints: int = 2
    good: int = 480
    """Number of further designs on the press of two sensors, printed once, well."""
    per_day: int = 4

    @classmethod
    def quick(cls) -> RankingPlan:
        """Return a small plan that exercises the whole study."""
        return cls(pilot=6, two_sensors=24, one_sensor=12, good=12)

    def days(self, first: int, count: int) -> list[Day]:
        """Return the press days on which ``count`` designs from ``first`` on are printed."""
        return in_days("learn", range(first, first + count), self.per_day)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lesson:
    """Rows of one press."""

    name: str
    scatter: Scatter
    rows: tuple[Rows, ...]


def lessons(
    plan: RankingPlan,
    cache: Path,
    *,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[Lesson]:
    """Return the rows of every press of the plan; cache: folder of the rows, so that an interrupted study resumes."""
    two, one = PressFile.preset(TWO_SENSORS), PressFile.prototype()
    bench = _Bench(plan=plan, cache=cache, processes=processes, progress=progress)
    return [
        bench.lesson("two sensors", two, 0, (plan.two_sensors, plan.misprints), (plan.good, 0)),
        bench.lesson("one sensor", one, 1, (plan.one_sensor, plan.misprints)),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bench:
    plan: RankingPlan
    cache: Path
    processes: int | None
    progress: Callable[[str], None]

    def lesson(self, name: str, press_file: PressFile, number: int, *sets: tuple[int, int]) -> Lesson:
        """Return the rows of one press, of sets of (designs, misprints of each); no two share a design or a day."""
        press = build_press(at_pitch(press_file, REDUCED_PITCH_MM), seed=SPECIMEN_SEED)
        path = self.cache / f"{press.digest[:16]}.press"
        path.parent.mkdir(parents=True, exist_ok=True)
        press.save(path)
        designs = Corpus(seed=self.plan.seed, dpi=press.dpi)
        scene = Scene(
            press=path, pages=designs, seed=self.plan.seed, number=FIRST_SCENE + 8 * number, misprints=0
        )
        digest = self._digest(scene, press)
        pilot = self.plan.days(number * 100_000, self.plan.pilot)
        drawn = self._computed(ScatterWork(scene=scene), pilot, "scatter", digest, f"{name}: scatter")
        scatter = learn_scatter({of: pooled(values) for of, values in drawn.items()})
        rows = []
        for at, (count, misprints) in enumerate(sets, 1):
            days = self.plan.days(number * 100_000 + at * 10_000, count)
            of_set = replace(scene, number=scene.number + at, misprints=misprints)
            work = StatisticsWork(scene=of_set, scatter=scatter)
            label = f"{name}: good prints" + (" and misprints" if misprints else "")
            rows.append(self._computed(work, days, "rows", self._digest(of_set, press), label))
        return Lesson(name=name, scatter=scatter, rows=tuple(rows))

    def _digest(self, scene: Scene, press: Press) -> str:
        facts = {
            "worlds": worlds_digest(),
            "algorithms": DETECTION,
            "press": press.digest,
            "pilot": self.plan.pilot,
            "scene": repr(replace(scene, press=None)),  # type: ignore[arg-type]
        }
        return digest_of(facts)

    def _computed(
        self, work: ScatterWork | StatisticsWork, days: list[Day], kind: str, digest: str, what: str
    ) -> Rows:
        return run_pieces(
            work,
            days,
            self.cache / kind,
            digest=digest,
            processes=self.processes,
            progress=lambda done, of: self.progress(f"{what}: {done} of {of} press days"),
        )
