"""Cost to each detector of a wrong model of the camera (paper, section 4.4); writes ``robustness.md``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.commissioning.build import build_press
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.protocol import JUDGED, Plan, in_both_worlds
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.paper.study import QUICK_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.robustness.disturbances import all_disturbances
from prooflight_studies.robustness.plots import draw_robustness
from prooflight_studies.robustness.results import (
    RobustnessPart,
    RobustnessResult,
    page_results,
    robustness_result,
)
from prooflight_studies.robustness.rows import SIDES, LearnGood, WatchWrong, learned

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight.simulation.corpus.corpus import Designs

PITCH_MM: Final = QUICK_PITCH_MM
"""Coarse pitch, since every scan is measured under 32 beliefs."""


def robustness_plans(*, seed: int, quick: bool, world: str | None = None) -> list[Plan]:
    """Return the plans of the ideal world, and of the press world with fewer designs, whose scans cost more.

    world: one alone. RequestError: there is no such world.
    """
    pilot, learn, tune, test = (1, 8, 4, 8) if quick else (6, 60, 40, 80)
    a_day = 4 if quick else 10
    ideal = Plan(
        seed=seed, world="ideal", pilot=pilot, learn=learn, tune=tune, test=test, designs_per_day=a_day
    )
    fewer = {"pilot": 4, "learn": 24, "tune": 16, "test": 32, "designs_per_day": 4}
    return in_both_worlds(ideal, world=world, **({} if quick else fewer))


def run_robustness_study(
    press_file: PressFile,
    results: Path,
    *,
    cache: Path,
    seed: int = 1,
    quick: bool = False,
    world: str | None = None,
    processes: Processes = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[RobustnessPart]:
    """Run every plan and write ``robustness.md`` with a picture for each world into ``results``.

    world: one alone; None: both. cache: folder of rows, so that an interrupted study resumes.
    """
    press = build_press(at_pitch(press_file, PITCH_MM), seed=SPECIMEN_SEED)
    designs = Corpus(seed=seed, dpi=press.dpi)
    parts = []
    for plan in robustness_plans(seed=seed, quick=quick, world=world):
        result = run_plan(press, designs, plan, cache, processes=processes, progress=progress)
        draw_robustness(results / f"robustness-{plan.world}.png", result)
        parts.append(RobustnessPart(press_digest=press.digest, pitch_mm=PITCH_MM, result=result))
    options = f" --world {world}" if world else ""
    options += " --quick" if quick else ""
    command = f"prooflight study robustness --seed {seed}{options}"
    write_page(results / "robustness.md", "robustness", page_results(parts, command=command))
    return parts


def run_plan(
    press: Press,
    designs: Designs,
    plan: Plan,
    cache: Path,
    *,
    processes: Processes = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> RobustnessResult:
    """Run one world: train on good copies, measure rows, and evaluate."""
    facts = plan.facts(press, repr(designs)) | {"disturbed": [str(one) for one in all_disturbances()]}
    digest = digest_of(facts | {"sides": list(SIDES)})

    def progress_of(what: str) -> Callable[[int, int], None]:
        return lambda done, of: progress(f"{plan.world} world: {what}, {done} of {of} press days")

    pilot = run_pieces(
        LearnGood(press=press, pages=designs, plan=plan),
        plan.days("pilot"),
        cache / "robustness-pilot",
        digest=digest,
        processes=processes,
        progress=progress_of("pilot"),
    )
    rows = run_pieces(
        WatchWrong(press=press, pages=designs, plan=plan, learned=learned(pilot)),
        plan.days(*JUDGED),
        cache / "robustness",
        digest=digest,
        processes=processes,
        progress=progress_of("scans under every assumption"),
    )
    progress(f"{plan.world} world: judging")
    return robustness_result(rows, plan)
