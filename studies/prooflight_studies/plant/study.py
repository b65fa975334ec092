"""Causes of defects named from journal rows, in a blind test, and corrections in a closed loop; writes plant.md."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.press.artefact import Press
from prooflight_line.causes.marks import marks_of
from prooflight_line.causes.naming import named_causes
from prooflight_line.causes.nozzles import nozzles_at, streaks_of
from prooflight_studies.harness.page import write_page
from prooflight_studies.plant.defects import (
    BEYOND,
    CAUSES,
    HEADS,
    NEAR_MM,
    PARTS,
    ROLLERS_MM,
    SHEETS,
    Runs,
)
from prooflight_studies.plant.loop import SHEETS as LOOP_SHEETS
from prooflight_studies.plant.loop import Loop, loops
from prooflight_studies.plant.picture import draw_causes
from prooflight_studies.plant.places import Errors, errors_of
from prooflight_studies.plant.prints import defect_prints

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.causes.naming import Cause
    from prooflight_studies.plant.defects import Defect

FIRST_SHEETS: Final = 5
"""Sheets with a streak by which its nozzle must be named."""
NULL_MARKS: Final = 40
PICTURE: Final = "plant-causes.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class CausesPlan:
    """Numbers of prints, runs and repetitions."""

    seed: int
    designs: int = 16
    defects: int = 200
    unlisted: int = 50
    null: int = 500
    loops: int = 1000

    @classmethod
    def quick(cls, seed: int) -> CausesPlan:
        """Return a size that is enough to see that all of it works."""
        return cls(seed=seed, designs=6, defects=24, unlisted=4, null=20, loops=20)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantResults:
    """All figures of the page."""

    seed: int
    quick: bool
    designs: int
    press: str
    press_digest: str
    sheets: int
    errors: list[Errors]
    confusion: dict[str, dict[str, int]]
    """Number of runs by cause and by answer."""
    defects: int
    right: int
    unlisted: int
    unlisted_right: int
    unlisted_off_mm: float | None
    """Absolute error of the distance that 95 of 100 stay below."""
    misnamed: int
    nozzles: int
    nozzle_designs: int
    nozzle_within_one: int
    nozzle_exact: int
    nozzle_alone: int
    """Runs in which the failing head alone was named, and not another that has a nozzle there too."""
    density_inks: int
    """Number of runs with a density that drifts in which the right ink was named."""
    register_inks: int
    """Number of runs with a register that steps in which the right ink was named."""
    nozzle_off: list[float]
    """Error of the number, in nozzles, on the first sheets of each run."""
    null: int
    null_repeats: int
    null_marks: int
    loop_sheets: int
    response: tuple[float, float]
    """Mean share of a change of density and of register that the journal states."""
    loops: list[Loop]
    picture: str
    rollers_mm: dict[str, float]


def run_plant_study(
    out: Path,
    *,
    press: Path,
    plan: CausesPlan,
    cache: Path,
    processes: int | None = None,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> PlantResults:
    """Print with known defects, make runs of what was said of them, name their causes, and correct a press.

    press: the artefact that prints and inspects. cache: where its prints are stored. Writes plant.md, its JSON and its
    picture into ``out``.
    """
    loaded = Press.load(press)
    geometry = loaded.geometry
    prints = defect_prints(
        press, seed=plan.seed, designs=plan.designs, cache=cache, processes=processes, progress=progress
    )
    runs = Runs(prints, geometry, plan.seed)
    causes = [CAUSES[at % len(CAUSES)] for at in range(plan.defects)] + list(BEYOND) * plan.unlisted
    confusion: dict[str, Counter[str]] = {cause: Counter() for cause in (*CAUSES, *BEYOND)}
    off_mm, nozzle_off, alone = list[float](), list[float](), 0
    inks: Counter[str] = Counter()
    for number, cause in enumerate(causes):
        defect = runs.run(cause, number)
        named = named_causes(defect.records, geometry=geometry, parts=PARTS)
        confusion[cause][answer(named, defect)] += 1
        if cause in BEYOND and named and named[0].distance_mm:
            off_mm.append(abs(named[0].distance_mm - defect.distance_mm))
        inks[cause] += bool(named) and defect.name in named[0].names
        alone += cause == "nozzle" and bool(named) and named[0].names == (defect.name,)
        if cause == "nozzle" and (off := first_sheets_off(defect, geometry)) is not None:
            nozzle_off.append(off)
        if number % 25 == 0:
            progress(f"runs with one cause: {number} of {len(causes)}")
    repeats = 0
    for number in range(plan.null):
        named = named_causes(runs.null(number, NULL_MARKS), geometry=geometry, parts=PARTS)
        repeats += any(one.kind in ("roller", "page") for one in named)
        if number % 100 == 0:
            progress(f"runs without a cause: {number} of {plan.null}")
    response = (float(np.mean(runs.response["density"])), float(np.mean(runs.response["register"])))
    found = loops(plan.seed, plan.loops, response=response, progress=progress)
    draw_causes(out / PICTURE, confusion, CAUSES, plan.seed)
    unlisted = confusion[BEYOND[0]]
    within = np.rint(np.abs(nozzle_off)) if nozzle_off else np.zeros(0)
    results = PlantResults(
        seed=plan.seed,
        quick=quick,
        designs=plan.designs,
        press=loaded.name,
        press_digest=loaded.digest,
        sheets=SHEETS,
        errors=errors_of(prints, geometry),
        confusion={cause: dict(answers) for cause, answers in confusion.items()},
        defects=plan.defects,
        right=sum(confusion[cause][cause] for cause in CAUSES),
        unlisted=plan.unlisted,
        unlisted_right=unlisted["no roller of the press file"],
        unlisted_off_mm=float(np.quantile(off_mm, 0.95)) if off_mm else None,
        misnamed=sum(unlisted[name] for name in (*CAUSES, "another roller")),
        nozzles=len(nozzle_off),
        nozzle_designs=len(runs.nozzle_designs),
        nozzle_within_one=int((within <= 1).sum()),
        nozzle_exact=int((within == 0).sum()),
        nozzle_alone=alone,
        density_inks=inks["density"],
        register_inks=inks["register"],
        nozzle_off=[round(off, 2) for off in nozzle_off],
        null=plan.null,
        null_repeats=repeats,
        null_marks=NULL_MARKS,
        loop_sheets=LOOP_SHEETS,
        response=response,
        loops=found,
        picture=PICTURE,
        rollers_mm=dict(ROLLERS_MM),
    )
    write_page(out / "plant.md", "plant", results)
    return results


def answer(named: Sequence[Cause], defect: Defect) -> str:
    """Return which cause is said, of ``CAUSES`` or in other words: that of most sheets, which the command lists first.

    A part of the press must be the right one as well: the roller by its name, a
    streak by its head, or several heads where its ink is not known, of which one is right.
    """
    if not named:
        return "nothing"
    first = named[0]
    match first.kind:
        case "roller" if first.names:
            return first.names[0] if first.names[0] in CAUSES else "another roller"
        case "roller":
            return "no roller of the press file"
        case "streak":
            return "nozzle" if defect.name in first.names else "another part"
        case "density" | "register":
            return first.kind
        case "single":
            return "spot"
    return first.kind


def first_sheets_off(defect: Defect, geometry: ScanGeometry) -> float | None:
    """Return the error of the nozzle's number by the first sheets that show the streak; None: so few do not.

    The number is rounded to a whole one, as the command says it, and counted on the head that fails: which head it is
    counts in ``answer``.
    """
    marks = marks_of(defect.records, geometry)
    head = next(head for head in HEADS if head.name == defect.name)
    true_mm = head.first_nozzle_mm + (defect.nozzle - 1) * head.nozzle_pitch_um / 1000
    sheets = sorted(
        {mark.sheet for mark in marks if mark.kind == "streak" and abs(mark.x_mm - true_mm) < NEAR_MM}
    )
    if len(sheets) < FIRST_SHEETS:
        return None
    own = [mark for mark in marks if mark.sheet <= sheets[FIRST_SHEETS - 1]]
    streaks = [one for one in streaks_of(own) if abs(one.x_mm - true_mm) < NEAR_MM]
    nozzles = [one for streak in streaks[:1] for one in nozzles_at(replace(streak, ink=""), [head])]
    return float(nozzles[0].number - defect.nozzle) if nozzles else None
