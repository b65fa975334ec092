"""Prints with one known defect, inspected as ``inspect`` does: what a journal says of a defect whose place is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.misprints.drawing import ALL_INKS, INKED, Box
from prooflight.simulation.misprints.marks import lay
from prooflight_studies.visible.marks import NO_INK, spot
from prooflight_studies.visible.rig import Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page

NOZZLE_MM: Final = 25.4 / 600
"""Width of the line that a nozzle of 600 to the inch leaves out."""
SCRATCH_MM: Final = 0.4
"""Width of the line that a scratched drum or a dirty wire leaves out. assumed."""
SPOTS_MM: Final = (0.8, 3.0)
"""Diameters of marks of rollers and of spots. assumed: clearly visible, and not yet a patch."""
CLOUDS: Final = 12.0
"""Factor on the clouds of good paper (``worlds.toml``) for paper of bad formation. assumed."""
INKED_SHARE: Final = 0.5
"""Share of a column that must be inked for a missing line to be drawn there."""
COPIES: Final = {"spot": 3, "nozzle": 3, "scratch": 2, "paper": 1, "good": 2}
"""Prints of each design."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPrint:
    """A print, what was wrong with it, and the verdict on it."""

    what: str
    design: int
    x_mm: float
    """Place of the defect; 0: it has none."""
    y_mm: float
    size_mm: tuple[float, float]
    """Width and height of the page."""
    verdict: Verdict


def known_prints(
    path: Path, *, seed: int, designs: int, progress: Callable[[str], None] = lambda _step: None
) -> list[KnownPrint]:
    """Print designs with defects at known places, on a press day each, and inspect them.

    path: of the press artefact. Designs without an inked column have no missing lines.
    """
    inspector = Inspector(Press.load(path)).with_threads(1)
    corpus = Corpus(seed=seed, dpi=inspector.press.dpi)
    prints: list[KnownPrint] = []
    for design in range(designs):
        rng = stream(seed, "plant-prints", design)
        bench = Bench(inspector=inspector, day=SimulatedDay.begin("press", inspector.press, rng))
        page = inspector.press.geometry.lay(corpus.page(design))
        prepared = bench.prepare(page)
        for what, (x, y), printed in _printed(page, rng):
            own = _cloudy(bench) if what == "paper" else bench
            verdict = own.inspect(prepared, printed, rng).verdict
            size = page.width_mm, page.height_mm
            prints.append(KnownPrint(what=what, design=design, x_mm=x, y_mm=y, size_mm=size, verdict=verdict))
        progress(f"prints with known defects: design {design + 1} of {designs}")
    return prints


def _printed(page: Page, rng: np.random.Generator) -> Iterator[tuple[str, tuple[float, float], Page]]:
    inked = np.flatnonzero((page.cmyk.max(axis=2) >= INKED).mean(axis=0) > INKED_SHARE)
    for what, copies in COPIES.items():
        if what in ("nozzle", "scratch") and not inked.size:
            continue
        x = (float(rng.choice(inked)) + rng.random()) * page.pixel_mm if inked.size else 0.0
        for _ in range(copies):
            if what == "spot":
                diameter = float(rng.uniform(*SPOTS_MM))
                at = float(rng.uniform(5, page.width_mm - 5)), float(rng.uniform(5, page.height_mm - 5))
                yield what, at, spot(page, at, diameter_mm=diameter, rng=rng)
            elif what in ("nozzle", "scratch"):
                width = NOZZLE_MM if what == "nozzle" else SCRATCH_MM
                yield what, (x, 0.0), without_line(page, x, width_mm=width, rng=rng)
            else:
                yield what, (0.0, 0.0), page


def without_line(page: Page, x_mm: float, *, width_mm: float, rng: np.random.Generator) -> Page:
    """Take all ink from a line along the travel; a raster pixel loses the share of it that the line covers."""
    columns = np.arange(page.cmyk.shape[1])
    left, right = ((x_mm + side * width_mm / 2) / page.pixel_mm for side in (-1, 1))
    cover = (np.minimum(columns + 1, right) - np.maximum(columns, left)).clip(0, 1)
    at = np.flatnonzero(cover)
    cmyk = page.cmyk.copy()
    box = Box(top=0, left=int(at[0]), bottom=cmyk.shape[0], right=int(at[-1]) + 1)
    weight = np.broadcast_to(cover[at], box.shape).astype(np.float32)
    lay(cmyk, box, ALL_INKS, weight, NO_INK, rng)
    return replace(page, cmyk=cmyk)


def _cloudy(bench: Bench) -> Bench:
    """Return the same day on paper of bad formation."""
    session = bench.day.session
    assert session is not None
    paper = session.amounts.paper
    clouds = replace(paper, cloudiness_percent=CLOUDS * paper.cloudiness_percent)
    changed = replace(session, amounts=replace(session.amounts, paper=clouds))
    return replace(bench, day=replace(bench.day, session=changed))
