"""``prooflight study running``: all published figures of the running press, measured part by part.

Each part's figures are cached as soon as they are measured, and running.md is written again with them, so that an
interrupted study resumes.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.train import trained
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job
from prooflight_line.run.settings import DEADLINE_S
from prooflight_studies.harness.page import measure_parts, stored_results, write_page
from prooflight_studies.running.drift import CreepRun, drift_row, streak_row
from prooflight_studies.running.live import live_row
from prooflight_studies.running.rig import DESIGN_SEED, A4Designs, Pieces, Ring, ring
from prooflight_studies.running.started import StartedRun

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PARTS: Final = ("started_one", "started_two", "started_pages", "matched_filter", "drift", "streak")
SMALL_PIXELS: Final = 400
PAGES_PER_S: Final = 5.0
TWO_SENSORS_PER_S: Final = 4.0
"""Required rate of the sample job under two sensors, as a user starts it."""
MATCHED_FILTER_PER_S: Final = 3.0
"""Required rate of the matched filter where all pages differ, or there are two sensors."""
MATCHED_FILTER_SHARE: Final = 0.8
"""Share of the matched filter's highest sustained rate at which it runs in real time.

It is used where that is below the required rate.
"""
WRONG_EVERY: Final = 11
"""One in this many of the matched filter's prints is a misprint; of all of the ten designs in turn."""
FEW_WRONG: Final = 100
"""One in about this many, where misprints are rare."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Size of each part of the study."""

    training_pages: int
    """Number of designs that train the presses, as by `press build`."""
    prints: int
    """Number of prints of each row in real time, misprints among them."""
    designs: int
    different_designs: int
    """Number of designs of the row whose pages are all different."""
    live_sheets: int
    trial_s: float
    """Duration of each run that looks for the highest sustained rate of `watch`."""
    days: int
    """Number of days of runs that drift."""

    @classmethod
    def of(cls, *, quick: bool) -> Plan:
        """Return the plan of the whole study, or of a version of some minutes."""
        if quick:
            return cls(
                training_pages=24,
                prints=12,
                designs=4,
                different_designs=12,
                live_sheets=40,
                trial_s=6,
                days=2,
            )
        return cls(
            training_pages=DESIGNS,
            prints=200,
            designs=10,
            different_designs=100,
            live_sheets=2000,
            trial_s=80,
            days=6,
        )


def running_results(
    measured: dict[str, Any], stored: dict[str, Any], *, cores: int, seed: int
) -> dict[str, Any]:
    """Return all figures of the page, None for unmeasured parts.

    measured: figures of parts that were measured with this seed. stored: the page's, of which other parts stay.
    """
    parts = {part: {"seed": seed} for part, rows in measured.items() if rows}
    facts = {"cores": cores, "deadline_ms": round(1000 * DEADLINE_S)}
    return {**dict.fromkeys(PARTS), **stored, **measured, **facts} | {
        "parts": stored.get("parts", {}) | parts
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Paths and plan of the study."""

    out: Path
    cache: Path
    plan: Plan
    seed: int
    one: Path | None
    """A trained press with one sensor; None: the prototype, untrained."""
    inspectors: int
    progress: Callable[[str], None]
    pages: Path | None = None
    """Job whose pages are all different, for the part ``started_pages``; None: that part has no rows."""

    def run(self, parts: tuple[str, ...], *, again: bool = False) -> dict[str, Any]:
        """Measure the parts that are not in the cache yet; again: all parts named."""
        return measure_parts(
            parts,
            lambda part: getattr(self, f"_{part}")(),
            self.cache / "running" / f"results-of-{self.plan.prints}-{self.seed}.json",
            again=again,
            progress=self.progress,
            write=self._write_page,
        )

    # --- parts ---

    def _started_one(self) -> list[dict[str, Any]]:
        """Return rows of `prooflight watch` as a user starts it, with the sample job, on a press of one sensor."""
        return self._started_sample(self._trained("one", self.one, "prototype.toml"), PAGES_PER_S)

    def _started_two(self) -> list[dict[str, Any]]:
        """Return the same rows of a press of two sensors."""
        return self._started_sample(self._trained("two", None, TWO_SENSORS), TWO_SENSORS_PER_S)

    def _started_pages(self) -> list[dict[str, Any]]:
        """Return the same rows of a prepared job whose pages are all different, on a press of one sensor."""
        if self.pages is None:
            self.progress("all pages different: left out, since no job was given by --pages")
            return []
        press = self._trained("one", self.one, "prototype.toml")
        with job_source(self.pages, Press.load(press)).open() as opened:
            pages = len(opened)
        return self._started(
            "all pages different", self.pages, pages, press, MATCHED_FILTER_PER_S, most=pages, prepared=True
        )

    def _started_sample(self, press: Path, rate: float) -> list[dict[str, Any]]:
        sample = make_sample_job(self.cache / "running" / "sample-job.pdf")
        most = self.plan.live_sheets
        return self._started("sample job", sample.path, sample.page_count, press, rate, most=most)

    def _started(
        self, name: str, job: Path, pages: int, press: Path, rate: float, *, most: int, prepared: bool = False
    ) -> list[dict[str, Any]]:
        """Return rows of a job of some pages at a rate, of ``most`` sheets at most."""
        started = StartedRun(
            name=name,
            job=job,
            press=press,
            sensors=len(Press.load(press).sensors),
            pages=pages,
            pages_per_s=rate,
            prepared=prepared,
        )
        folder = self.cache / "running"
        folder.mkdir(parents=True, exist_ok=True)
        return started.rows(
            folder,
            sheets=min(self.plan.live_sheets, most),
            trial_s=self.plan.trial_s,
            seed=self.seed,
            progress=self.progress,
        )

    def _matched_filter(self) -> list[dict[str, Any]]:
        """Return rows of the matched filter as `press build` makes it, misprints among the prints.

        They are measured at full speed, in real time at the required rate, and where that is too fast, at a rate that
        it sustains.
        """
        one = Press.load(self._trained("one", self.one, "prototype.toml"))
        two = Press.load(self._trained("two", None, TWO_SENSORS))
        prints, sheets = self.plan.prints, self.plan.live_sheets
        often = self._shown(one, self.plan.designs, prints, repeated=True)
        rare = often.with_fewer_wrong(max(prints // FEW_WRONG, 1))
        each = self._shown(one, self.plan.different_designs, self.plan.different_designs, repeated=False)
        both = self._shown(two, self.plan.designs, prints // 2, repeated=True)
        some = max(sheets // 10, 1)
        rows = []
        for name, press, shown, asked, count in (
            ("repeated designs, misprints rare", one, rare, PAGES_PER_S, sheets),
            ("repeated designs", one, often, PAGES_PER_S, 2 * some),
            ("all pages different", one, each, MATCHED_FILTER_PER_S, some),
            ("repeated designs", two, both, MATCHED_FILTER_PER_S, some),
        ):
            fast = self._row(name, press, shown, None, max(some // 2, 1))
            rows.append(self._row(name, press, shown, asked, count))
            sustained = float(np.floor(10 * MATCHED_FILTER_SHARE * fast["pages_per_s"]) / 10)
            if rows[-1]["late"] or rows[-1]["not_inspected"]:
                rows.append(self._row(name, press, shown, max(min(sustained, asked), 0.1), some))
            rows.append(fast)
        return rows

    def _row(self, name: str, press: Press, prints: Ring, rate: float | None, sheets: int) -> dict[str, Any]:
        row = live_row(
            name,
            Inspector.of(press),
            replace(prints, sheets=sheets),
            pages_per_s=rate,
            inspectors=self.inspectors,
            progress=self._counted(f"{name} at {rate or 'full'} speed", sheets),
        )
        self.progress(json.dumps(row))
        return row

    def _drift(self) -> list[dict[str, Any]]:
        rows, days = [], range(self.seed, self.seed + self.plan.days)
        for press, ink in ((self._untrained("prototype.toml"), 3), (self._untrained("rgb-line.toml"), 1)):
            pieces = Pieces(seed=DESIGN_SEED + 2, dpi=press.dpi)
            run = CreepRun.of(press, (press.geometry.lay(pieces.page(i)) for i in range(120)), ink=ink)
            for good_pages in (0, 100):
                rows.append(
                    drift_row(run, ink=ink, seeds=days, good_pages=good_pages, progress=self.progress)
                )
        return rows

    def _streak(self) -> dict[str, Any]:
        press = self._untrained("prototype.toml")
        pieces = Pieces(seed=DESIGN_SEED + 2, dpi=press.dpi)
        run = CreepRun.of(press, (press.geometry.lay(pieces.page(index)) for index in range(6)))
        days = range(self.seed + 100, self.seed + 100 + self.plan.days)
        return streak_row(run, seeds=days, progress=self.progress)

    # --- what they need ---

    def _untrained(self, preset: str) -> Press:
        """Build a preset with a line of 400 pixels."""
        return build_press(PressFile.preset(preset), seed=1, pixels=SMALL_PIXELS)

    def _shown(self, press: Press, count: int, prints: int, *, repeated: bool) -> Ring:
        """Return prints of ``count`` designs, misprints among them, rendered once."""
        return ring(
            press,
            A4Designs(seed=DESIGN_SEED, dpi=press.dpi),
            self.cache / "running" / f"ring-{len(press.sensors)}-{count}-of-{prints}-{WRONG_EVERY}",
            count=count,
            prints=prints,
            repeated=repeated,
            seed=self.seed,
            shown=self._rendering,
            wrong_every=WRONG_EVERY,
        )

    def _rendering(self, items: Iterator[None], total: int) -> Iterator[None]:
        for number, item in enumerate(items, start=1):
            if number % 10 == 0 or number == total:
                self.progress(f"rendered {number} of {total}")
            yield item

    def _trained(self, name: str, given: Path | None, preset: str) -> Path:
        """Return the file of a press trained as by `press build`, once, unless it was given trained."""
        press = None if given is None else Press.load(given)
        if given is not None and press is not None and "matched_filter" in press.detectors:
            return given
        path = self.cache / "running" / f"{name}-taught-{self.plan.training_pages}.press"
        if not path.exists():
            self.progress(f"training a press on {self.plan.training_pages} designs")
            press = press or build_press(PressFile.preset(preset), seed=1)
            designs = Corpus(seed=self.seed, dpi=press.dpi)
            trained(press, designs, designs=self.plan.training_pages, seed=self.seed).save(path)
        return path

    def _counted(self, what: str, total: int) -> Callable[[int], None]:
        step = max(total // 10, 1)

        def count(number: int) -> None:
            if number % step == 0:
                self.progress(f"{what}: {number} of {total}")

        return count

    # --- results ---

    def _write_page(self, measured: dict[str, Any]) -> None:
        page = self.out / "running.md"
        cores = os.cpu_count() or 1
        write_page(
            page, "running", running_results(measured, stored_results(page), cores=cores, seed=self.seed)
        )
