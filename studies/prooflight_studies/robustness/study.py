"""Cost to each detector of a wrong model of the camera (paper, section 4.4); writes ``robustness.md``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.reporting.camera_pictures import COLOURS
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.harness.protocol import JUDGED, Plan, in_both_worlds
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.paper.study import QUICK_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight_studies.robustness.results import (
    CHI_SQUARE,
    PRINTED,
    TUNED,
    RobustnessPart,
    RobustnessResult,
    page_results,
    robustness_result,
)
from prooflight_studies.robustness.rows import (
    AXES,
    NOTHING,
    SIDES,
    SIZES,
    UNDISTURBED,
    LearnGood,
    WatchWrong,
    all_disturbances,
    learned,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight.simulation.corpus.corpus import Designs
    from prooflight_studies.robustness.results import Point, When
    from prooflight_studies.robustness.rows import Belief

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


# --- the picture: cost against the size of each error ---

SHOWN: Final = (CHI_SQUARE, PRINTED, TUNED, "difference, 5 x 5", "variation model")
_ROWS: Final[dict[When, str]] = {"kept": "thresholds kept", "relearned": "relearned"}
_COLUMNS: Final = 3
_LOGARITHMIC: Final = ("sigma factor", "swing", "swing, calibrated", "table noise")
_TOP: Final = 1.3
"""Upper limit of the axes: never stopping costs 1 at alpha = 1, and honest costs go a little beyond."""


def draw_robustness(path: Path, result: RobustnessResult) -> None:
    """Draw honest c at alpha = 1 against the size of each error, kept, and below it relearned; bars are 95 %."""
    beliefs = list(SIZES)
    blocks = -(-len(beliefs) // _COLUMNS)
    figure = new_figure(4.4 * _COLUMNS, 2.8 * len(_ROWS) * blocks + 0.9, dpi=100)
    panels = figure.subplots(len(_ROWS) * blocks, _COLUMNS, sharey=True)
    for place, belief in enumerate(beliefs):
        block, column = divmod(place, _COLUMNS)
        for row, (when, words) in enumerate(_ROWS.items()):
            axes = panels[block * len(_ROWS) + row][column]
            _panel(axes, result, belief, when)
            axes.set_title(f"{belief}: {words}", fontsize=11)
            axes.set_xlabel(AXES[belief] if row else "", fontsize=9)
            axes.set_ylabel("honest c at alpha = 1 [-]" if column == 0 else "", fontsize=9)
    legend_below(figure, panels[0][0], columns=len(SHOWN), size_pt=10)
    figure.suptitle(
        f"What a wrong belief costs, {result.plan.world} world; dashed: never stopping", fontsize=12
    )
    write_figure(figure, path)


def _panel(axes: Axes, result: RobustnessResult, belief: Belief, when: When) -> None:
    right = UNDISTURBED[belief]
    for place, (name, colour) in enumerate(zip(SHOWN, COLOURS, strict=False)):
        points = [point for point in result.points if point.detector == name]
        curve = {point.disturbance.size: point for point in points if point.disturbance.belief == belief}
        start = next(point for point in points if point.disturbance == NOTHING)
        if right is None:
            axes.axhline(getattr(start, when).cost.value, color=colour, lw=0.8, ls=":")
        else:
            curve[right] = start
        _curve(axes, curve, when, name, colour, place)
    plain_axes(axes)
    axes.set_ylim(-0.03, _TOP)
    axes.axhline(1, color="#888888", lw=0.8, ls="--")
    if belief in _LOGARITHMIC:
        axes.set_xscale("log")
        axes.set_xticks(list(SIZES[belief]), [f"{size:g}" for size in SIZES[belief]])
        axes.minorticks_off()
    if belief == "table noise":
        axes.invert_xaxis()
        axes.text(
            0.98,
            0.93,
            "dotted: exact tables",
            transform=axes.transAxes,
            ha="right",
            fontsize=8,
            color="#555555",
        )
    axes.tick_params(labelsize=8)
    if len(SIZES[belief]) > 4 and belief in _LOGARITHMIC:
        axes.tick_params(axis="x", labelrotation=45)


def _curve(axes: Axes, curve: dict[float, Point], when: When, name: str, colour: str, place: int) -> None:
    sizes = sorted(curve)
    costs = [getattr(curve[size], when).cost for size in sizes]
    value, low, high = (
        np.array([getattr(cost, part) for cost in costs]) for part in ("value", "low", "high")
    )
    drawn = np.array(sizes)
    axes.errorbar(
        drawn,
        value,
        yerr=np.maximum([value - low, high - value], 0),
        color=colour,
        marker="o",
        markersize=3,
        lw=1.4,
        elinewidth=0.7,
        capsize=1.5,
        label=name,
        zorder=3 + place / 10,
    )
