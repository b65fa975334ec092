"""Prints with one known defect, inspected as ``inspect`` does: what a journal says of a defect whose place is known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from pydantic import TypeAdapter

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.verdict import Verdict
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.misprints.drawing import ALL_INKS, INKED, Box
from prooflight.simulation.misprints.marks import lay
from prooflight_line.run.monitor.evidence import run_evidence
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.visible.marks import NO_INK, spot
from prooflight_studies.visible.rig import Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.pages.raster import Page
    from prooflight_studies.harness.result_cache import Rows

NOZZLE_MM: Final = 25.4 / 600
"""Width of the line that a nozzle of 600 to the inch leaves out."""
SCRATCH_MM: Final = 0.4
"""Width of the line that a scratched drum or a dirty wire leaves out. assumed."""
SPOTS_MM: Final = (0.8, 3.0)
"""Diameters of marks of rollers and of spots. assumed: clearly visible, and not yet a patch."""
CLOUDS: Final = 12.0
"""Factor on the clouds of good paper (``worlds.toml``) for paper of bad formation. assumed."""
LEAST_SECOND: Final = 0.001
"""Share of a page that a second ink must print for its planes to have a register."""
INKED_SHARE: Final = 0.3
"""Share of a column that must have a quarter of full ink for its nozzle to fail there."""
COPIES: Final = {"spot": 3, "nozzle": 5, "scratch": 1, "density": 1, "register": 1, "paper": 1, "good": 2}
"""Prints of each design."""
WEAKER: Final = 0.85
"""Ink that is left of the ink that prints most, where density is changed."""
AMOUNTS: Final = ("gain-", "register-")
"""First words of the channels of density and register."""
REGISTER_MM: Final = 0.3
"""Shift of its plane to the right, where register is changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DefectPrint:
    """A print, what was wrong with it, and the verdict on it."""

    what: str
    design: int
    x_mm: float
    """Place of the defect; 0: it has none."""
    y_mm: float
    verdict: Verdict
    amounts: dict[str, float] = field(default_factory=dict)
    """Densities and registers that a run records of it in the journal, by channel."""
    ink: str = ""
    """Letter of the ink that is off; empty: all are, or none."""


_JSON: Final = TypeAdapter(DefectPrint)


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintsWork:
    """A design -> its prints with known defects; column ``print``, each as JSON."""

    press: Path
    seed: int

    def __call__(self, design: int, /) -> Rows:
        """``Work``."""
        inspector = _inspector(self.press)
        rng = stream(self.seed, "plant-prints", design)
        bench = Bench(inspector=inspector, day=SimulatedDay.begin("press", inspector.press, rng))
        page = inspector.press.geometry.lay(Corpus(seed=self.seed, dpi=inspector.press.dpi).page(design))
        prepared = bench.prepare(page)
        prints = []
        for what, ink, (x, y), printed in _printed(page, rng):
            own = _cloudy(bench) if what == "paper" else bench
            inspection = own.inspect(prepared, printed, rng)
            values = run_evidence(inspection, inspector.press, page_width_mm=page.width_mm).sound().values
            one = DefectPrint(
                what=what,
                design=design,
                ink=ink,
                x_mm=x,
                y_mm=y,
                verdict=inspection.verdict,
                amounts={name: value for name, value in values.items() if name.startswith(AMOUNTS)},
            )
            prints.append(_JSON.dump_json(one).decode())
        return {"print": np.array(prints)}


@lru_cache(maxsize=1)
def _inspector(path: Path) -> Inspector:
    return Inspector(Press.load(path)).with_threads(1)


def defect_prints(
    press: Path,
    *,
    seed: int,
    designs: int,
    cache: Path,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[DefectPrint]:
    """Print designs with defects at known places, on a press day each, and inspect them.

    press: of the press artefact. cache: where the prints of each design are stored. Designs without a column of much
    ink have no missing lines, and those of one ink no register.
    """
    facts = {
        "press": Press.load(press).digest,
        "seed": seed,
        "prints": dict(COPIES),
        "amounts": list(AMOUNTS),
        "algorithms": dict(ALGORITHMS),
    }
    rows = run_pieces(
        PrintsWork(press=press, seed=seed),
        range(designs),
        cache,
        digest=digest_of(facts),
        processes=processes,
        progress=lambda done, of: progress(f"designs printed with known defects: {done} of {of}"),
    )
    return [_JSON.validate_json(text) for text in rows["print"].tolist()]


def _printed(page: Page, rng: np.random.Generator) -> Iterator[tuple[str, str, tuple[float, float], Page]]:
    """Yield what is wrong, the letter of the ink that is, its place, and the page as it is printed."""
    inked = (page.cmyk >= INKED).mean(axis=0)
    places = np.argwhere(inked > INKED_SHARE)
    column, ink = places[int(rng.integers(len(places)))] if len(places) else (0, 0)
    x, most = (float(column) + rng.random()) * page.pixel_mm, int(inked.mean(axis=0).argmax())
    for what, copies in COPIES.items():
        if what in ("nozzle", "scratch") and not len(places):
            continue
        if what == "register" and (inked.mean(axis=0) > LEAST_SECOND).sum() < 2:
            continue
        for _ in range(copies):
            at, letter, printed = (0.0, 0.0), "", page
            if what == "spot":
                diameter = float(rng.uniform(*SPOTS_MM))
                at = float(rng.uniform(5, page.width_mm - 5)), float(rng.uniform(5, page.height_mm - 5))
                printed = spot(page, at, diameter_mm=diameter, rng=rng)
            elif what == "nozzle":
                at, letter, inks = (x, 0.0), INK_LETTERS[ink], slice(ink, ink + 1)
                printed = without_line(page, x, width_mm=NOZZLE_MM, inks=inks, rng=rng)
            elif what == "scratch":
                at, printed = (x, 0.0), without_line(page, x, width_mm=SCRATCH_MM, inks=ALL_INKS, rng=rng)
            elif what == "density":
                letter, printed = INK_LETTERS[most], _weaker(page, most)
            elif what == "register":
                letter, printed = INK_LETTERS[most], _displaced(page, most)
            yield what, letter, at, printed


def _weaker(page: Page, ink: int) -> Page:
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = np.rint(cmyk[..., ink] * WEAKER).astype(np.uint8)
    return replace(page, cmyk=cmyk)


def _displaced(page: Page, ink: int) -> Page:
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = np.roll(cmyk[..., ink], round(REGISTER_MM / page.pixel_mm), axis=1)
    return replace(page, cmyk=cmyk)


def without_line(page: Page, x_mm: float, *, width_mm: float, inks: slice, rng: np.random.Generator) -> Page:
    """Take inks from a line along the travel; a raster pixel loses the share of it that the line covers."""
    columns = np.arange(page.cmyk.shape[1])
    left, right = ((x_mm + side * width_mm / 2) / page.pixel_mm for side in (-1, 1))
    cover = (np.minimum(columns + 1, right) - np.maximum(columns, left)).clip(0, 1)
    at = np.flatnonzero(cover)
    cmyk = page.cmyk.copy()
    box = Box(top=0, left=int(at[0]), bottom=cmyk.shape[0], right=int(at[-1]) + 1)
    weight = np.broadcast_to(cover[at], box.shape).astype(np.float32)
    lay(cmyk, box, inks, weight, NO_INK, rng)
    return replace(page, cmyk=cmyk)


def _cloudy(bench: Bench) -> Bench:
    """Return the same day on paper of bad formation."""
    session = bench.day.session
    assert session is not None
    paper = session.amounts.paper
    clouds = replace(paper, cloudiness_percent=CLOUDS * paper.cloudiness_percent)
    changed = replace(session, amounts=replace(session.amounts, paper=clouds))
    return replace(bench, day=replace(bench.day, session=changed))
