"""Statistics of simulated prints: days, good prints and misprints of page designs, and a row for each scan."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.commissioning.training.simulated_days import PressDay, good_prior, good_residual_variance
from prooflight.detectors.matched_filter.statistics.statistic import keys_of, values_of
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.protocol import OTHERS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.pages.raster import Page
    from prooflight.simulation.corpus.corpus import Designs
    from prooflight_studies.harness.protocol import Day
    from prooflight_studies.harness.result_cache import Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Press and page designs of one set of prints in the press world; small, and sent to worker processes."""

    press: Path
    pages: Designs
    seed: int
    number: int
    """Number of the scene: no two scenes share a day."""
    times: float = 1.0
    """Factor on the variation of good prints, relative to what the press is made for."""
    misprints: int = 2
    """Copies of each design with a misprint; one more is good. Kinds take turns."""

    def day(self, day: Day) -> PressDay:
        """Begin a press day; its scans are evaluated with the assumptions of the unmodified press."""
        taken_for = press = _press(self.press)
        if self.times != 1:
            press = replace(press, variation=dict(press.variation) | {"all_times": self.times})
        rng = stream(self.seed, "scene-session", self.number, day.designs[0])

        def page(index: int) -> Page:
            return press.geometry.lay(self.pages.page(index))

        begun = SimulatedDay.begin("press", press, rng)
        return PressDay(
            day=begun,
            page=page,
            residual_variance=good_residual_variance(taken_for),
            prior=good_prior(taken_for),
        )

    def rng(self, index: int, copy: int) -> np.random.Generator:
        """Return the random generator of one copy of a design."""
        return stream(self.seed, "scene-print", self.number, index, copy)

    def kind(self, index: int, copy: int) -> str:
        """Return the kind of misprint of a copy; the first copy is good.

        Every round of kinds begins one further on, so that a design's number does not determine its kinds.
        """
        turn = index * self.misprints + copy - 1
        return KINDS[(turn + turn // len(KINDS)) % len(KINDS)] if copy else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Measurement of good copies of a day's designs, from which ``learn_scatter`` learns."""

    scene: Scene

    def __call__(self, day: Day, /) -> Rows:
        """Return the draws of a day: ``PressDay.scatter_draws``."""
        designs = ((index, self.scene.rng(index, 0)) for index in day.designs)
        return self.scene.day(day).scatter_draws(designs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatisticsWork:
    """Measurement of a good copy and misprints of a day's designs, with a row for each scan.

    Columns: design, kind ("" where good), severity, values (statistics,), portrait (the page features), another
    (whether the scan shows another page), glyphs (``ScoredPage.score``), floor_mm2, widening (factor on the width of
    its page's distributions), day. Column ``unmade_kind`` has an entry for each misprint of which nine draws did not
    reach the least effect that counts, and ``names`` has those of the statistics.
    """

    scene: Scene
    scatter: Scatter

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        bench = self.scene.day(day)
        columns: dict[str, list[Any]] = defaultdict(list)
        unmade: list[str] = []
        names: list[str] = []
        for index in day.designs:
            good, prepared = bench.design(index)
            for copy in range(1 + self.scene.misprints):
                rng, kind = self.scene.rng(index, copy), self.scene.kind(index, copy)
                printed = good
                if kind:
                    others = [other for other in day.designs if other != index]
                    wrong = bench.wrong(good, kind, rng.permutation(others)[:OTHERS].tolist(), rng)
                    if wrong is None:
                        unmade.append(kind)
                        continue
                    printed = wrong
                row, names = scan_row(bench, prepared, bench.scan(printed, rng), self.scatter)
                for name, value in {
                    **row,
                    "design": index,
                    "kind": printed.kind,
                    "severity": printed.severity,
                    "day": day.designs[0],
                }.items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        labels = {"unmade_kind": np.array(unmade, "U16"), "names": np.array(names, "U48")}
        return rows | {"kind": rows["kind"].astype("U16")} | labels


def scan_row(
    bench: PressDay, prepared: PreparedPage, scan: NDArray[np.uint16], scatter: Scatter
) -> tuple[dict[str, Any], list[str]]:
    """Return values, portrait, another, glyphs, floor and widening of a scan's row; and the names of the statistics."""
    evidence = bench.evidence(prepared, scan, scatter)
    row = {
        "values": values_of(evidence.statistics),
        "portrait": prepared.page_features,
        "another": evidence.another,
        "glyphs": evidence.glyphs,
        "floor_mm2": evidence.floor_mm2,
        "widening": prepared.colours.widening,
    }
    return row, keys_of(evidence.statistics)


@lru_cache(maxsize=2)
def _press(path: Path) -> Press:
    return Press.load(path)
