"""Presses as `press build` makes them, and their prints inspected as `inspect` does."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import trained
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.result_cache import digest_of
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.paper.study import SPECIMEN_SEED, at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page

BUILD_SEED: Final = 90_000
"""Seed of the designs that train a press; the judged designs have another."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A preset whose pixels lie so far apart on the page."""

    sensors: int
    pitch_mm: float

    @property
    def name(self) -> str:
        """Name of the camera in words."""
        return f"{'one sensor' if self.sensors == 1 else 'two sensors'}, {self.pitch_mm:g} mm"

    @property
    def number(self) -> int:
        """Number that seeds its prints."""
        return round(self.pitch_mm * 1e4) + self.sensors

    @property
    def press_file(self) -> PressFile:
        """The preset's, at this pitch."""
        preset = PressFile.prototype() if self.sensors == 1 else PressFile.preset(TWO_SENSORS)
        return at_pitch(preset, self.pitch_mm)


def built(
    camera: Camera,
    *,
    designs: int,
    seed: int,
    folder: Path,
    processes: int | None,
    progress: Callable[[str], None],
) -> Path:
    """Build the press as `press build` does from a camera's press file, once, and store it in ``folder``."""
    ranking = resources.files("prooflight.detectors.matched_filter").joinpath("ranking.safetensors")
    facts = {
        "press file": camera.press_file.text,
        "designs": designs,
        "seed": seed,
        "algorithms": dict(ALGORITHMS),
        "ranking": hashlib.sha256(ranking.read_bytes()).hexdigest(),
        "worlds": worlds_digest(),
    }
    path = folder / f"{digest_of(facts)[:16]}.press"
    if path.exists():
        return path
    progress(f"building the press of {camera.name} by {designs} designs")
    press = build_press(camera.press_file, seed=SPECIMEN_SEED)
    corpus = Corpus(seed=BUILD_SEED + seed, dpi=press.dpi)
    folder.mkdir(parents=True, exist_ok=True)
    trained(press, corpus, designs=designs, seed=seed, processes=processes).save(path)
    return path


@lru_cache(maxsize=2)
def _inspector(path: Path) -> Inspector:
    return Inspector(Press.load(path)).with_threads(1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bench:
    """A press with its detector, on one day."""

    inspector: Inspector
    day: SimulatedDay

    @classmethod
    def begin(cls, path: Path, rng: np.random.Generator) -> Bench:
        """Begin a press day of the press in a file."""
        inspector = _inspector(path)
        return cls(inspector=inspector, day=SimulatedDay.begin("press", inspector.press, rng))

    @property
    def press(self) -> Press:
        """The press that prints and inspects."""
        return self.inspector.press

    def another_day(self, rng: np.random.Generator) -> Bench:
        """Begin another day of the same press."""
        return Bench(inspector=self.inspector, day=SimulatedDay.begin("press", self.press, rng))

    def prepare(self, page: Page) -> Prepared:
        """See ``Inspector``."""
        return self.inspector.prepare(self.press.geometry.lay(page))

    def inspect(self, prepared: Prepared, printed: Page, rng: np.random.Generator) -> Inspection:
        """Print ``printed`` once and judge it as a print of the page prepared."""
        sheet = self.press.geometry.lay(printed)
        return self.inspector.inspect(prepared, self.day.recorded(self.day.seen_in_press(sheet, rng), rng))


def alarmed(inspection: Inspection) -> bool:
    """Return whether a print is called a misprint; one that is not inspected is not."""
    return inspection.verdict.verdict == "misprint"


def uninspected(inspection: Inspection) -> bool:
    """Return whether a print was not inspected."""
    return inspection.verdict.verdict == "not-inspected"
