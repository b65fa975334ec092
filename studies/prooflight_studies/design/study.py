"""Value of a camera's parts (paper, section 5.3): errors per 10,000 pages against hardware; writes ``design.md``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.camera.exploring import A4_LENGTH_MM
from prooflight.errors import RequestError
from prooflight.reporting.camera_pictures import COLOURS
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.design.results import (
    DETECTORS,
    CandidateResult,
    DesignRow,
    cents_per_unit,
    design_results,
    efficient,
    judged,
)
from prooflight_studies.harness.operating import interval_of
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.paper_detectors import chosen_rows
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.harness.protocol import FRAMES, JUDGED, Plan, in_both_worlds, watched_rows
from prooflight_studies.paper.study import SPECIMEN_SEED, at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight.camera.camera import Camera
    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.design.choices import Choice, Prices

COARSER: Final = 5.0
"""Factor on the pixel width of each design: the study takes minutes, and designs keep their proportions."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A design with its camera and press."""

    choice: Choice
    camera: Camera
    """Camera with its own pixels."""
    press: Press
    """Press with coarser pixels."""

    @property
    def pixels_per_page(self) -> float:
        """Pixels of all sensors over A4's length and the camera's field. [-]"""
        lines = A4_LENGTH_MM / self.camera.line_pitch_mm
        return lines * self.camera.sensors[0].pixels * len(self.camera.sensors)


def design_plans(*, seed: int, quick: bool, more: int = 1, world: str | None = None) -> list[Plan]:
    """Return the plans of the ideal and the press world.

    The latter has fewer page designs, as its scans cost five times as much. more: factor on the number of page designs.
    world: one alone. RequestError: there is no such world.
    """
    pilot, learn, tune, test = (2, 12, 8, 12) if quick else (4, 30 * more, 20 * more, 40 * more)
    a_day = 4 if quick else 10
    ideal = Plan(
        seed=seed, world="ideal", pilot=pilot, learn=learn, tune=tune, test=test, designs_per_day=a_day
    )
    fewer = {"learn": 16 * more, "tune": 10 * more, "test": 20 * more, "designs_per_day": 2}
    return in_both_worlds(ideal, world=world, **({} if quick else fewer))


def candidates(
    base: PressFile,
    chosen: Sequence[Choice],
    *,
    coarser: float = COARSER,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[Candidate]:
    """Build every design, before any is studied. PressFileError, RequestError: one of them cannot be built."""
    if not coarser > 0:
        raise RequestError("--coarser", f"{coarser:g} is not a factor", remedy="give 1 or more")
    files = [choice.press_file(base) for choice in chosen]
    cameras = [file.camera() for file in files]
    built = []
    for choice, file, camera in zip(chosen, files, cameras, strict=True):
        progress(f"building {choice}")
        coarse = at_pitch(file, camera.pixel_pitch_mm * coarser)
        built.append(Candidate(choice=choice, camera=camera, press=build_press(coarse, seed=SPECIMEN_SEED)))
    return built


def run_design_study(
    base: PressFile,
    chosen: Sequence[Choice],
    prices: Prices,
    results: Path,
    *,
    cache: Path,
    detector: str = DETECTORS[0],
    coarser: float = COARSER,
    seed: int = 1,
    quick: bool = False,
    more: int = 1,
    world: str | None = None,
    command: str = "",
    processes: Processes = None,
    plans: Sequence[Plan] | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[DesignRow]:
    """Study every design in every plan's world and write ``design.md`` and its picture into ``results``.

    All designs see the same page designs, misprints and press days, and are judged at the press file's costs. cache:
    folder of rows, from which results are reused. RequestError: there is no such detector.
    """
    if detector not in DETECTORS:
        remedy = f"choose one of {', '.join(DETECTORS)}"
        raise RequestError("--detector", f"there is no {detector!r}", remedy=remedy)
    used = list(plans or design_plans(seed=seed, quick=quick, more=more, world=world))
    of = candidates(base, chosen, coarser=coarser, progress=progress)
    costs = base.costs()
    rows: list[DesignRow] = []
    for plan in used:
        judgements = []
        for candidate in of:
            what = f"{plan.world} world, {candidate.choice}"
            scans = watched_rows(
                candidate.press,
                Corpus(seed=plan.seed, dpi=candidate.press.dpi),
                plan,
                cache,
                processes=processes,
                progress_of=partial(_progress_of, progress, what),
            )
            sets = {of_set: chosen_rows(scans, plan, of_set, noise=1.0) for of_set in JUDGED}
            frame = len(FRAMES[plan.world]) - 1  # where registration found the page, if the world moves it
            judgements.append(
                judged(
                    sets,
                    frame=frame,
                    detector=detector,
                    costs=candidate.press.costs,
                    days=np.array([day.designs[0] for day in plan.days("test")]),
                    seed=plan.seed,
                )
            )
        rows += _with_money(of, judgements, plan, prices)
    draw_designs(results / "design.png", rows, detector=detector)
    shown = design_results(
        rows, used, costs=costs, prices=prices, detector=detector, coarser=coarser, command=command
    )
    write_page(results / "design.md", "design", shown)
    return rows


def _progress_of(progress: Callable[[str], None], what: str, step: str) -> Callable[[int, int], None]:
    """Return a progress callback for the days of scans; the pilot's few days are not reported."""

    def tell(done: int, days: int) -> None:
        if step == "scans":
            progress(f"{what}: {done} of {days} press days")

    return tell


def _with_money(
    of: Sequence[Candidate], judgements: Sequence[CandidateResult], plan: Plan, prices: Prices
) -> list[DesignRow]:
    first, of_file = judgements[0], of[0]
    per_sensor = of_file.pixels_per_page / len(of_file.camera.sensors)
    rows = []
    for candidate, one in zip(of, judgements, strict=True):
        costs, camera = candidate.press.costs, candidate.camera
        share = candidate.pixels_per_page / per_sensor
        sensor = candidate.press.sensors[0]
        cost = interval_of(one.cost, one.resampled)
        unit, first_unit = cents_per_unit(costs), cents_per_unit(of_file.press.costs)
        rows.append(
            DesignRow(
                design=str(candidate.choice),
                world=plan.world,
                sensors=len(camera.sensors),
                pixel_pitch_mm=camera.pixel_pitch_mm,
                pages_per_s=camera.line_travel_mm * camera.sensors[0].line_rate_hz / A4_LENGTH_MM,
                white_snr=float(sensor.white_dn / np.sqrt(sensor.variance_dn2[0, 0, 0, 0])),
                cost=cost,
                false_alarms=one.false_alarms,
                good=one.good,
                missed=one.missed,
                bad=one.bad,
                area=one.area,
                error_cents=interval_of(one.cost * unit, one.resampled * unit),
                saving_cents=interval_of(
                    first.cost * first_unit - one.cost * unit,
                    first.resampled * first_unit - one.resampled * unit,
                ),
                hardware_cents=prices.hardware_cents(candidate.choice, len(camera.sensors)),
                computing_cents=prices.computing_cents * share,
                efficient=False,
                how=one.how,
            )
        )
    best = efficient([(row.bought_cents, row.error_cents.value) for row in rows])
    return [replace(row, efficient=flag) for row, flag in zip(rows, best, strict=True)]


# --- the picture: cost of errors against cost of hardware and computing ---

_ROOM = 0.25


def draw_designs(path: Path, rows: Sequence[DesignRow], *, detector: str) -> None:
    """Draw one panel a world: designs with 95 % intervals, efficient ones filled and joined, the least total dotted."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    figure = new_figure(6.2 * len(worlds), 4.8, pads_inch=(0.1, 0.08))
    designs = list(dict.fromkeys(row.design for row in rows))
    colours = {design: COLOURS[place % len(COLOURS)] for place, design in enumerate(designs)}
    for place, world in enumerate(worlds):
        axes = figure.add_subplot(1, len(worlds), place + 1)
        _panel(axes, [row for row in rows if row.world == world], colours)
        axes.set_title(f"{world} world")
    legend_below(figure, figure.axes[0], columns=2, size_pt=8.5)
    figure.suptitle(f"What each design costs, detector {detector}; filled: efficient", fontsize=11)
    write_figure(figure, path)


def _panel(axes: Axes, rows: Sequence[DesignRow], colours: dict[str, str]) -> None:
    bought = np.array([row.bought_cents for row in rows])
    left, right = bought.min(), bought.max()
    margin = _ROOM * (right - left) if right > left else 1.0
    for row in rows:
        errors, colour = row.error_cents, colours[row.design]
        axes.errorbar(
            row.bought_cents,
            errors.value,
            yerr=[[max(errors.value - errors.low, 0)], [max(errors.high - errors.value, 0)]],
            color=colour,
            marker="o",
            markersize=8,
            markerfacecolor=colour if row.efficient else "white",
            markeredgewidth=1.6,
            elinewidth=1.0,
            capsize=3,
            linestyle="none",
            label=row.design,
            zorder=3,
        )
    front = sorted((row.bought_cents, row.error_cents.value) for row in rows if row.efficient)
    axes.plot(*zip(*front, strict=True), color="#777777", lw=1.2, zorder=1)
    least = min(row.total_cents for row in rows)
    x = np.array([left - margin, right + margin])
    axes.plot(x, least - x, ":", color="#777777", lw=1.0, zorder=1)
    top = np.nanmax([(row.error_cents.value, row.error_cents.high) for row in rows])
    axes.set(
        xlabel="hardware and computing [cents per 10,000 pages]",
        ylabel="false alarms and misses [cents per 10,000 pages]",
        xlim=(left - margin, right + margin),
        ylim=(0, 1.08 * top if top > 0 else 1),
    )
    axes.text(
        0.98,
        0.98,
        f"dotted: {least:.3g} cents in all, the least",
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=8,
        color="#666666",
    )
    plain_axes(axes)
