"""Rows of stress: good prints under every nuisance, and every misprint, each with the same good print without."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.rng import stream
from prooflight.simulation.captures import Printed
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.print_statistics import scan_row
from prooflight_studies.harness.protocol import OTHERS
from prooflight_studies.stress.marks import MARKS, draw_mark
from prooflight_studies.stress.stressed import stressed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.commissioning.training.simulated_days import PressDay
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.press.press_file import PressFile
    from prooflight_studies.harness.print_statistics import Scene
    from prooflight_studies.harness.protocol import Day
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.stress.given import Stress
    from prooflight_studies.stress.marks import Compose

COPY = 0
"""Copy number: every row of a design is of the same print."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressWork:
    """Measurement of a day's designs: a good copy, the same under nuisances, and the same with misprints, a row each.

    All designs of a day are in memory at once: 0.16 GB each at a pitch of 0.254 mm and two sensors.

    Columns: design, kind (of the misprint, with its variant; "" where good), severity, nuisance ("" where none), day,
    values (statistics,), portrait (the page features), another, glyphs. Columns ``unmade_kind`` and
    ``unmade_design`` have an entry for each misprint that cannot be on its page, and ``names`` has those of the
    statistics.
    """

    scene: Scene
    """Scene in the press world."""
    scatter: Scatter
    stress: Stress
    nuisances: tuple[str, ...]
    marks: tuple[str, ...]
    wrong_under: tuple[str, ...] = ()
    """Nuisances, "" for none, under each of which every design is printed once wrong, of the scene's kind in turn."""
    press_file: PressFile | None = None
    """Press file that the scene's press was built from, for the effect of a lamp."""

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        bench, table = self.scene.day(day), _Table(day=day)
        designs = {index: bench.design(index) for index in day.designs}
        for name in ("", *self.nuisances):
            under = self._under(bench, name, day) if name else bench
            for index, (good, prepared) in designs.items():
                self._add(table, under, good, prepared, index, nuisance=name)
        for kind in self.marks:
            mark = self.stress.mark(kind)
            for index, (good, prepared) in designs.items():
                number = list(MARKS).index(kind)
                rng = stream(self.scene.seed, "stress-mark", self.scene.number, index, number)
                drawn = draw_mark(good.page, mark, rng=rng, compose=self._composing(bench, index))
                if drawn is None:
                    table.unmade.append((kind, index))
                    continue
                wrong = Printed(page=drawn.page, expected=bench.day.expected(drawn.page))
                label = f"{kind} {drawn.variant}".strip()
                self._add(table, bench, wrong, prepared, index, kind=label)
        for name in self.wrong_under:
            self._add_wrong(table, bench, self._under(bench, name, day) if name else bench, designs, name)
        return table.rows()

    def _composing(self, bench: PressDay, index: int) -> Compose | None:
        """Return a function that composes a design as the press takes it; None: designs here are not composed."""
        pages = self.scene.pages
        if not isinstance(pages, Corpus):
            return None
        return lambda sheet: bench.day.press.geometry.lay(pages.page(index, sheet=sheet))

    def _add_wrong(
        self,
        table: _Table,
        bench: PressDay,
        under: PressDay,
        designs: Mapping[int, tuple[Printed, PreparedPage]],
        name: str,
    ) -> None:
        """Add one misprint of each design, the same whatever the nuisance."""
        for index, (good, prepared) in designs.items():
            rng, kind = self.scene.rng(index, 1), self.scene.kind(index, 1)
            others = rng.permutation([other for other in designs if other != index])[:OTHERS].tolist()
            wrong = bench.wrong(good, kind, others, rng)
            if wrong is None:
                table.unmade.append((kind, index))
                continue
            self._add(table, under, wrong, prepared, index, nuisance=name, kind=kind, rng=rng)

    def _under(self, bench: PressDay, name: str, day: Day) -> PressDay:
        under = stressed(
            bench.day,
            self.stress.nuisance(name),
            rng=stream(self.scene.seed, "stress-day", self.scene.number, day.designs[0]),
            others=day.designs,
            fetch=bench.page,
            press_file=self.press_file,
        )
        return replace(bench, day=under)

    def _add(
        self,
        table: _Table,
        bench: PressDay,
        printed: Printed,
        prepared: PreparedPage,
        index: int,
        *,
        nuisance: str = "",
        kind: str = "",
        rng: np.random.Generator | None = None,
    ) -> None:
        scan = bench.scan(printed, self.scene.rng(index, COPY) if rng is None else rng)
        row, table.names = scan_row(bench, prepared, scan, self.scatter)
        facts = {
            "design": index,
            "kind": kind,
            "nuisance": nuisance,
            "day": table.day.designs[0],
            "severity": printed.severity,
        }
        for name, value in {**facts, **row}.items():
            table.columns[name].append(value)


@dataclass(slots=True, kw_only=True, eq=False)
class _Table:
    """Rows while they are collected."""

    day: Day
    columns: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    unmade: list[tuple[str, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def rows(self) -> Rows:
        rows = {name: np.array(values) for name, values in self.columns.items()}
        labels = {name: rows[name].astype("U24") for name in ("kind", "nuisance")}
        extra = {
            "unmade_kind": np.array([kind for kind, _ in self.unmade], "U24"),
            "unmade_design": np.array([index for _, index in self.unmade], np.int64),
            "names": np.array(self.names, "U48"),
        }
        return rows | labels | extra
