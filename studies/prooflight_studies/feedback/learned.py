"""Good prints of presses that are not like the simulated ones: what is promised after some are learned, and kept."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import trained
from prooflight.press.artefact import Press
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.feedback.pool import RESTS_ON, TRAINING_OFFSET
from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.harness.result_cache import Rows, digest_of, minutes_spent, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.paper.study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.press.scans import Scene, scan_row
from prooflight_studies.stress.given import load_stress
from prooflight_studies.stress.stressed import stressed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.pages.raster import Page
    from prooflight_studies.stress.given import Stress

SCENE: Final = 65
"""Number of this study's scene, distinct from those of other studies of the same seed."""
PATCHES, GROWTH = "patchy_tables", "edges 20 um out"
GROWTH_UM: Final = 20.0
LEARNED: Final = (20, 40, 80)
"""Numbers of good pages that are learned."""
PER_DAY: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedPlan:
    """Numbers of prints and repetitions."""

    seed: int
    designs: int = 160
    """Number of page designs, each printed once, well, by each press."""
    teaching: int = 24
    """Number of simulated designs that the press is trained on; they measure the scatter of statistics."""
    repeats: int = 200
    """Number of random choices of the pages that are learned; the others are judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedRow:
    """One press after one number of pages."""

    press: str
    learned: int
    promised: float
    """Mean over repetitions of the promised rate. [-]"""
    realised: float
    """Mean over repetitions of the share of other good prints that alarm. [-]"""
    low: float
    """Lower end of the 95 % interval of ``realised``: Clopper and Pearson's of one print of each design."""
    high: float
    alike: float
    """Share of repetitions in which simulated pages were not told apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearnedWork:
    """Measurement of a day's designs, printed once by each press."""

    scene: Scene
    scatter: Scatter
    stress: Stress

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        bench = self.scene.day(day)
        rng = stream(self.scene.seed, "stress-day", self.scene.number, day.designs[0])
        patchy = replace(bench, day=stressed(bench.day, self.stress.nuisance(PATCHES), rng=rng))
        columns: dict[str, list[Any]] = defaultdict(list)
        for index in day.designs:
            good, prepared = bench.design(index)
            grown = replace(good, page=grown_edges(good.page, GROWTH_UM))
            for name, under, printed in (("", bench, good), (PATCHES, patchy, good), (GROWTH, bench, grown)):
                row, _ = scan_row(
                    bench, prepared, under.scan(printed, self.scene.rng(index, 0)), self.scatter
                )
                row |= {"design": index, "day": day.designs[0], "printed_by": name, "kind": ""}
                for key, value in row.items():
                    columns[key].append(value)
        rows = {key: np.array(values) for key, values in columns.items()}
        return rows | {"kind": rows["kind"].astype("U16"), "printed_by": rows["printed_by"].astype("U24")}


def grown_edges(page: Page, growth_um: float) -> Page:
    """Return the page with every edge of every ink moved outwards, by less than a pixel of its raster.

    A pixel takes the share of its greatest neighbour that the edge has moved into it.
    """
    share = growth_um / 25_400 * page.dpi
    if not 0 <= share <= 1:
        raise ValueError(f"edges move by {share:.2f} pixels of the raster, more than one")
    most = cv2.dilate(page.cmyk, np.ones((3, 3), np.uint8))
    mixed = page.cmyk + share * (most.astype(np.float32) - page.cmyk)
    return replace(page, cmyk=np.rint(mixed).astype(np.uint8))


def printed_rows(
    plan: LearnedPlan,
    stress_file: Path,
    cache: Path,
    *,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> tuple[CalibratedDetector, Rows, float]:
    """Train the press, print every design by every press and measure it: detector, rows, and minutes of one core."""
    stress = load_stress(stress_file)
    untrained = build_press(at_pitch(PressFile.preset(TWO_SENSORS), REDUCED_PITCH_MM), seed=SPECIMEN_SEED)
    facts = {
        "worlds": worlds_digest(),
        "algorithms": {name: ALGORITHMS[name] for name in RESTS_ON},
        "press": untrained.digest,
        "plan": (plan.seed, plan.teaching),
        "stress": stress.digest,
        "growth": GROWTH_UM,
    }
    path = cache / f"{digest_of(facts)[:16]}.press"
    if not path.is_file():
        progress(f"training a press by {plan.teaching} designs")
        seed = plan.seed + TRAINING_OFFSET
        corpus = Corpus(seed=seed, dpi=untrained.dpi)
        press = trained(untrained, corpus, designs=plan.teaching, seed=seed, processes=processes)
        path.parent.mkdir(parents=True, exist_ok=True)
        press.save(path)
    press = Press.load(path)
    assert press.ours is not None
    scene = Scene(
        press=path, pages=Corpus(seed=plan.seed, dpi=press.dpi), seed=plan.seed, number=SCENE, misprints=1
    )
    work = LearnedWork(scene=scene, scatter=press.ours.model.scatter, stress=stress)
    days = in_days("test", range(plan.designs), PER_DAY)
    digest = digest_of(facts)
    rows = run_pieces(
        work,
        days,
        cache / "learned",
        digest=digest,
        processes=processes,
        progress=lambda done, of: progress(f"printing and measuring: {done} of {of} press days"),
    )
    return press.ours, rows, minutes_spent(days, cache / "learned", digest=digest)
