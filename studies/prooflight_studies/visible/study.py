"""Share of visible marks that is caught: a table of named marks, false alarms by difficulty, curves by place.

It measures the detector that a user has: the press is what `press build` makes, and a print is caught where `inspect`
says misprint.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.training import DESIGNS
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.result_cache import digest_of, minutes_spent, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.visible.findings import (
    CHANCES,
    Caught,
    Curves,
    GoodPrints,
    caught_of,
    curves_of,
    draw_curves,
    good_prints,
)
from prooflight_studies.visible.marks import HEADLINE, KINDS
from prooflight_studies.visible.rig import Camera, built
from prooflight_studies.visible.rows import (
    FINE,
    GOOD_FROM,
    TABLE,
    CurvePiece,
    CurveWork,
    MarksWork,
    PlacesWork,
    Prints,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.visible.rows import PlacedMark

PARTS: Final = ("marks", "one-sensor", "curves", "fine-curves")
"""The table of named marks and false alarms: two sensors, and one; curves by place: before the presets, and before
cameras of finer pixels, whose presses take longest to build."""
COARSE_MM: Final = 0.254
"""Pixel pitch of the presets."""
PAGES_PER_PIECE: Final = 2
DESIGNS_PER_PIECE: Final = 20
PICTURE: Final = "visible.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class VisiblePlan:
    """Numbers of prints.

    One page of all places with 30 good prints to learn from, 30 to judge and eight levels of every kind on every place
    is 380 prints.
    """

    seed: int
    designs: int = DESIGNS
    """Page designs that a press is built by."""
    coarse: tuple[Camera, Camera] = (Camera(sensors=2, pitch_mm=0.254), Camera(sensors=1, pitch_mm=0.254))
    """Before which named marks are printed: the two presets."""
    fine: Camera = field(default_factory=lambda: Camera(sensors=2, pitch_mm=0.127))
    """Before which the smallest mark is printed."""
    prints: int = 100
    """Number of prints of every mark of ``HEADLINE`` on every place."""
    others: int = 40
    """Number of prints of each other mark on every place."""
    copies: int = 4
    """Prints of one mark on one design: composing and preparing a design takes as long as printing it so often."""
    screened: int = 400
    """Designs that are searched for places."""
    good: int = 200
    """Further designs, printed once, well."""
    blank: int = 40
    """Nearly blank pages, printed once, well."""
    curves: tuple[tuple[Camera, int], ...] = (
        (Camera(sensors=2, pitch_mm=0.085), 1),
        (Camera(sensors=2, pitch_mm=0.127), 2),
        (Camera(sensors=2, pitch_mm=0.254), 3),
        (Camera(sensors=1, pitch_mm=0.254), 3),
    )
    """Cameras and how many pages of all places are printed before each; those that take longest first."""
    levels: int = 8
    learned: int = 30
    judged: int = 30
    """Good prints of a page of all places: those that the variation model learns from, and those that are judged."""

    @classmethod
    def quick(cls, seed: int) -> VisiblePlan:
        """Return a size that is enough to see that all of it works."""
        camera = Camera(sensors=2, pitch_mm=0.508)
        return cls(
            seed=seed,
            designs=24,
            coarse=(camera, Camera(sensors=1, pitch_mm=0.508)),
            fine=camera,
            prints=2,
            others=2,
            screened=20,
            good=6,
            blank=3,
            curves=((camera, 1),),
            levels=2,
            learned=3,
            judged=3,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MarksTable:
    """Named marks before one camera."""

    camera: str
    guarantee: str
    caught: list[Caught]
    good: list[GoodPrints]
    """Empty: none were printed for this table."""
    unmade: int
    """Prints for which a page had no place after all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibleResults:
    """All figures of the page."""

    seed: int
    quick: bool
    parts: list[str]
    build_designs: int
    copies: int
    minutes: float
    """Minutes of one process, for printing and judging, without building presses."""
    marks: list[MarksTable]
    curves: list[Curves]
    chances: tuple[float, ...]
    levels: int
    kinds: list[dict[str, Any]]
    picture: str


def run_visible_study(
    out: Path,
    *,
    cache: Path,
    plan: VisiblePlan,
    parts: Sequence[str] = PARTS,
    quick: bool = False,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> VisibleResults:
    """Build presses, print, judge; writes visible.md, its JSON, and its picture where there are curves.

    cache: where presses and rows are kept. parts: of ``PARTS``.
    """
    out.mkdir(parents=True, exist_ok=True)
    bench = _Bench(plan=plan, cache=cache, processes=processes, progress=progress)
    marks, curves = [], list[Curves]()
    if "marks" in parts:
        marks += [bench.table(plan.coarse[0], TABLE, good=True), bench.table(plan.fine, FINE, good=False)]
    if "one-sensor" in parts:
        marks.append(bench.table(plan.coarse[1], TABLE, good=True))
    cameras = [
        (camera, pages)
        for camera, pages in plan.curves
        if ("fine-curves" if camera.pitch_mm < COARSE_MM else "curves") in parts
    ]
    if cameras:
        curves = bench.curves(cameras)
        draw_curves(out / PICTURE, curves)
    results = VisibleResults(
        seed=plan.seed,
        quick=quick,
        parts=[part for part in PARTS if part in parts],
        build_designs=plan.designs,
        copies=plan.copies,
        minutes=bench.minutes,
        marks=marks,
        curves=curves,
        chances=CHANCES,
        levels=plan.levels,
        kinds=[
            {"kind": name, "what": kind.what, "unit": kind.unit, "levels": kind.levels}
            for name, kind in KINDS.items()
        ],
        picture=PICTURE if curves else "",
    )
    write_page(out / "visible.md", "visible", results)
    return results


@dataclass(slots=True, kw_only=True)
class _Bench:
    """Builds presses and rows, and stores them."""

    plan: VisiblePlan
    cache: Path
    processes: int | None
    progress: Callable[[str], None]
    minutes: float = 0.0

    def table(self, camera: Camera, table: tuple[PlacedMark, ...], *, good: bool) -> MarksTable:
        """Named marks before a camera; good: with good prints of further designs and of nearly blank pages."""
        plan, path = self.plan, self._press(camera)
        screened = [
            tuple(range(start, min(start + DESIGNS_PER_PIECE, plan.screened)))
            for start in range(0, plan.screened, DESIGNS_PER_PIECE)
        ]
        places = self._rows_of(PlacesWork(seed=plan.seed), screened, "places", {"seed": plan.seed})
        counts = {placed.name: plan.prints if placed.mark in HEADLINE else plan.others for placed in table}
        pages = scheduled(places, counts, copies=plan.copies)
        if good:
            pages += [Prints(source="design", index=GOOD_FROM + at) for at in range(plan.good)]
            pages += [Prints(source="blank", index=at) for at in range(plan.blank)]
        pieces = [
            tuple(pages[start : start + PAGES_PER_PIECE]) for start in range(0, len(pages), PAGES_PER_PIECE)
        ]
        rows = self._rows_of(
            MarksWork(press=path, camera=camera, seed=plan.seed),
            pieces,
            f"marks, {camera.name}",
            {"seed": plan.seed, "press": path.stem, "camera": camera.number},
        )
        return MarksTable(
            camera=camera.name,
            guarantee=Inspector(Press.load(path)).guarantee,
            caught=caught_of(rows, table),
            good=good_prints(rows) if good else [],
            unmade=len(rows["unmade"]),
        )

    def curves(self, cameras: Sequence[tuple[Camera, int]]) -> list[Curves]:
        """All kinds on all places before cameras, each with so many pages."""
        plan = self.plan
        presses = {camera.number: self._press(camera) for camera, _ in cameras}
        work = CurveWork(
            presses=presses, seed=plan.seed, levels=plan.levels, learned=plan.learned, good=plan.judged
        )
        pieces = [CurvePiece(camera=camera, page=page) for camera, pages in cameras for page in range(pages)]
        facts = {
            "seed": plan.seed,
            "presses": {str(number): path.stem for number, path in presses.items()},
            "prints": [plan.levels, plan.learned, plan.judged],
        }
        rows = self._rows_of(work, pieces, "curves", facts)
        by_number = {camera.number: camera for camera, _ in cameras}
        return list(curves_of(rows, by_number, learned=plan.learned))

    def _press(self, camera: Camera) -> Path:
        return built(
            camera,
            designs=self.plan.designs,
            seed=self.plan.seed,
            folder=self.cache / "presses",
            processes=self.processes,
            progress=self.progress,
        )

    def _rows_of(self, work: Any, pieces: Sequence[Any], what: str, facts: dict[str, Any]) -> Rows:
        digest = digest_of(facts | {"algorithms": dict(ALGORITHMS)})
        folder = self.cache / what.split(",")[0]
        rows = run_pieces(
            work,
            pieces,
            folder,
            digest=digest,
            processes=self.processes,
            progress=lambda done, of: self.progress(f"{what}: {done} of {of}"),
        )
        self.minutes += minutes_spent(pieces, folder, digest=digest)
        return rows


def scheduled(places: Rows, counts: Mapping[str, int], *, copies: int) -> list[Prints]:
    """Return the pages on which marks are printed: of each mark the first designs that have a place for it.

    counts: how many prints are wanted of each ``PlacedMark``, by its name. copies: most prints of one mark on one
    design.
    """
    wanted: dict[int, list[tuple[str, int]]] = defaultdict(list)
    for name, prints in counts.items():
        designs: NDArray[np.int64] = np.unique(places["design"][places["name"] == name])
        for at, index in enumerate(designs[: -(-prints // copies)].tolist()):
            wanted[index].append((name, min(copies, prints - at * copies)))
    return [Prints(source="design", index=index, marks=tuple(wanted[index])) for index in sorted(wanted)]
