"""Training set of the shipped ranking: good prints and misprints of composed designs on two presses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.learn import learn_scatter, pooled
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.print_statistics import ScatterWork, Scene, StatisticsWork
from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import DETECTION
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows

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
