"""Pool of sheets of a press that differs from the one it was trained on, printed and scored once.

Weeks of production are drawn from the pool.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.train import trained
from prooflight.detectors.base import PlannedPage
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.registry import detector
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight.scans.scan import Scan
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.print_statistics import Scene
from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.harness.result_cache import digest_of, minutes_spent, run_pieces
from prooflight_studies.harness.versions import DETECTION
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.base import Detector

TARGET_RATE: Final = 0.01
TIMES: Final = 1.5
"""Factor on the press world's amounts by which good prints of this press vary."""
BLACK_OF_FOUR: Final = 0.5
"""Share of its designs with type in a black of four inks; the training designs have none."""
TRAINING_OFFSET: Final = 500
"""Offset from the study's seed to that of the designs and days on which the press is trained."""
SCENE: Final = 64
"""Number of this study's scene, distinct from those of other studies of the same seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoolPlan:
    """Size of the pool."""

    seed: int
    days: int = 70
    designs_a_day: int = 20
    misprint_every: int = 4
    """One design in this many is also printed wrong; kinds take turns."""
    training_designs: int = DESIGNS

    @classmethod
    def quick(cls, seed: int) -> PoolPlan:
        """Return a small plan that exercises the whole study."""
        return cls(seed=seed, days=8, designs_a_day=6, misprint_every=2, training_designs=24)

    @property
    def of_days(self) -> list[Day]:
        """Press days with their designs."""
        return in_days("test", range(self.days * self.designs_a_day), self.designs_a_day)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pool:
    """Scored sheets, one a row."""

    score: NDArray[np.float64]
    day: NDArray[np.int64]
    """First design of the day on which each sheet was printed."""
    kind: NDArray[np.str_]
    """Kind of the misprint; "": a good print."""
    severity: NDArray[np.float64]
    threshold: float
    """Threshold of the press as trained."""
    guarantee: str
    """Target false-alarm rate of the press, in words."""
    minutes: float
    """Time that printing and scoring took, of one core."""

    @property
    def good(self) -> NDArray[np.bool_]:
        """Mask of the good prints."""
        return self.kind == ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoolWork:
    """Prints of a day's designs with score, day, kind and severity of each, by the press's own detector."""

    scene: Scene
    every: int

    def __call__(self, day: Day, /) -> dict[str, NDArray[Any]]:
        """Return the rows of a day."""
        bench, trained_detector = self.scene.day(day), _detector(self.scene.press)
        context = _press(self.scene.press).press_context(threads=1)
        columns: dict[str, list[Any]] = defaultdict(list)
        for index in day.designs:
            good = bench.day.good(bench.page(index))
            prepared = trained_detector.prepare(PlannedPage(good.page, context))
            for copy in range(1 + (index % self.every == 0)):
                rng, printed = self.scene.rng(index, copy), good
                if copy:
                    others = rng.permutation([other for other in day.designs if other != index])[:3].tolist()
                    kind = self.scene.kind(index // self.every, copy)
                    wrong = bench.wrong(good, kind, others, rng)
                    if wrong is None:
                        continue
                    printed = wrong
                verdict = prepared.inspect(Scan(dn=bench.scan(printed, rng))).verdict
                row = {"score": verdict.score, "day": day.designs[0], "kind": printed.kind}
                for name, value in (row | {"severity": printed.severity}).items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        return rows | {"score": rows["score"].astype(float), "kind": rows["kind"].astype("U16")}


def printed_pool(
    plan: PoolPlan,
    cache: Path,
    *,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> Pool:
    """Train the press, print sheets unlike its training set, and score them; cache: folder of presses and rows."""
    path = _trained_press(plan, cache, progress)
    press = Press.load(path)
    scene = Scene(
        press=path,
        pages=Corpus(seed=plan.seed, dpi=press.dpi, black_of_four=BLACK_OF_FOUR),
        seed=plan.seed,
        number=SCENE,
        times=TIMES,
        misprints=1,
    )
    digest = digest_of(
        {
            "worlds": worlds_digest(),
            "algorithms": DETECTION,
            "press": press.digest,
            "scene": repr(replace(scene, press=None)),  # type: ignore[arg-type]
            "every": plan.misprint_every,
        }
    )
    work, days = PoolWork(scene=scene, every=plan.misprint_every), plan.of_days
    rows = run_pieces(
        work,
        days,
        cache / "pool",
        digest=digest,
        processes=processes,
        progress=lambda done, of: progress(f"printing and scoring: {done} of {of} press days"),
    )
    return Pool(
        **{name: rows[name] for name in ("score", "day", "kind", "severity")},
        threshold=model_of(press).threshold,
        guarantee=str(model_of(press).guarantee),
        minutes=minutes_spent(days, cache / "pool", digest=digest),
    )


def _trained_press(plan: PoolPlan, cache: Path, progress: Callable[[str], None]) -> Path:
    """Return the path of the press as it is delivered; cached."""
    press = build_press(at_pitch(PressFile.prototype(), REDUCED_PITCH_MM), seed=SPECIMEN_SEED)
    facts = {
        "worlds": worlds_digest(),
        "algorithms": DETECTION,
        "press": press.digest,
        "seed": plan.seed,
        "teaching": plan.training_designs,
    }
    path = cache / f"{digest_of(facts)[:16]}.press"
    if not path.is_file():
        progress(f"training a press on {plan.training_designs} designs")
        trained_press = trained(
            press,
            Corpus(seed=plan.seed + TRAINING_OFFSET, dpi=press.dpi),
            designs=plan.training_designs,
            seed=plan.seed + TRAINING_OFFSET,
            false_alarm_rate=TARGET_RATE,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        trained_press.save(path)
    return path


@lru_cache(maxsize=2)
def _press(path: Path) -> Press:
    return Press.load(path)


@lru_cache(maxsize=2)
def _detector(path: Path) -> Detector:
    return detector("matched_filter", _press(path))
