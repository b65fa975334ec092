"""The paper's tables 1 to 4 reproduced and audited, in the ideal and in the press world; writes ``paper.md``."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.camera.exploring import varied
from prooflight.reporting.camera_pictures import COLOURS
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.harness.protocol import JUDGED, Plan, watched_rows
from prooflight_studies.paper.results import ALPHAS, PRINTED, Part, paper_results, world_result

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.paper.results import DetectorRow, WorldResult

REDUCED_PITCH_MM: Final = 0.254
"""Pixel pitch of 100 pixels an inch on the page, at which worlds.toml's texture is stated."""
REDUCED_DPI: Final = 25.4 / REDUCED_PITCH_MM * 2
"""Resolution of rasters: two pixels to one of the camera's, across and along."""
QUICK_PITCH_MM: Final = 0.508
SPECIMEN_SEED: Final = 1
TABLE_4: Final = (12.0, 24.0, 36.0, 48.0)
"""Noise of table 4's 100 to 400 %, relative to our camera's.

The paper's value is lost. At 100 % the tuned network is to cost about what the paper's did at alpha = 1, 0.0545: on 90
designs of seed 7 the oracle's c was 0.000 at 1 and at 4 times our camera's noise, 0.040 at 8, 0.068 at 16 and 0.118 at
32.
"""
OUR_NOISE: Final = (1.0, 4.0)
"""Our own camera's 100 and 400 %, for comparison."""


def paper_plans(*, seed: int, quick: bool, own_pitch_mm: float) -> list[tuple[float, Plan]]:
    """Return the pairs of camera pitch and plan that ``run_paper_study`` works through. [mm]

    In the ideal world there are 1000 designs for training, as in the paper; fewer where scans cost more. On one core a
    print with its measures took 0.2 s (ideal) and 0.45 s (press) at the reduced resolution, 1.2 and 1.9 s at the
    camera's own, and 0.05 and 0.2 s more at each further noise: all in all about 75 minutes of a core.
    """
    if quick:
        ideal = Plan(seed=seed, world="ideal", pilot=4, learn=40, tune=20, test=40)
        press = replace(ideal, world="press")
        return [(QUICK_PITCH_MM, plan) for plan in (ideal, press, replace(ideal, noises=TABLE_4))]
    ideal = Plan(seed=seed, world="ideal", pilot=40, learn=1000, tune=250, test=750)
    # Smaller days where designs are few: intervals are over days.
    press = replace(ideal, world="press", pilot=20, learn=120, tune=60, test=240, designs_per_day=5)
    noisy = replace(ideal, pilot=20, learn=200, tune=100, test=200, noises=(*TABLE_4, *OUR_NOISE))
    full = replace(ideal, pilot=20, learn=60, tune=30, test=70, designs_per_day=5)
    noisy_press = replace(press, pilot=10, learn=60, tune=30, test=60, noises=TABLE_4)
    return [
        (REDUCED_PITCH_MM, ideal),
        (REDUCED_PITCH_MM, press),
        (REDUCED_PITCH_MM, noisy),
        (own_pitch_mm, full),
        (REDUCED_PITCH_MM, noisy_press),
        (own_pitch_mm, replace(full, world="press", pilot=10, learn=30, tune=20, test=50)),
    ]


def run_paper_study(
    press_file: PressFile,
    results: Path,
    *,
    cache: Path,
    seed: int = 1,
    quick: bool = False,
    processes: Processes = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[Part]:
    """Run every plan and write ``paper.md`` with its pictures into ``results``.

    press_file: of two sensors, the first of which is the one-sensor camera. cache: folder of rows, so that an
    interrupted study resumes. ValueError: a camera of one sensor.
    """
    own = press_file.camera()
    if len(own.sensors) < 2:
        message = f"the study compares one sensor with two, {press_file.path} has one"
        raise ValueError(message)
    parts = []
    for pitch_mm, plan in paper_plans(seed=seed, quick=quick, own_pitch_mm=own.pixel_pitch_mm):
        press = build_press(at_pitch(press_file, pitch_mm), seed=SPECIMEN_SEED)
        parts.append(
            run_part(
                press,
                plan,
                cache,
                pitch_mm=pitch_mm,
                processes=processes,
                progress=progress,
            )
        )
    main = [parts[0], next(part for part in parts if part.result.plan.world == "press")]
    draw_roc(results / "paper-roc.png", [part.result for part in main])
    draw_costs(results / "paper-cost.png", [part.result for part in main])
    write_page(results / "paper.md", "paper", paper_results(parts, seed=seed, quick=quick))
    return parts


def run_part(
    press: Press,
    plan: Plan,
    cache: Path,
    *,
    pitch_mm: float,
    processes: Processes = None,
    progress: Callable[[str], None],
) -> Part:
    """Run one plan: pilot, rows, tables."""
    started = time.perf_counter()
    where = f"{plan.world} world, {pitch_mm:.3f} mm"
    designs = Corpus(seed=plan.seed, dpi=press.dpi)
    begun_with: list[int] = []  # how many days each step began with

    def progress_of(what: str) -> Callable[[int, int], None]:
        started_with = len(begun_with)

        def tell(done: int, of: int) -> None:
            if len(begun_with) == started_with:
                begun_with.append(done)
            progress(f"{where}: {what}, {done} of {of} press days")

        return tell

    rows = watched_rows(press, designs, plan, cache, processes=processes, progress_of=progress_of)
    share = 1 - begun_with[-1] / len(plan.days(*JUDGED))
    return Part(
        pitch_mm=pitch_mm,
        press=press,
        result=world_result(rows, plan, progress=progress),
        seconds=time.perf_counter() - started,
        made=round(share * len(rows["kind"])),
    )


def at_pitch(press_file: PressFile, pitch_mm: float) -> PressFile:
    """Return the same camera at the distance at which its pixel pitch on the page is ``pitch_mm``.

    It has as many pixels as the field needs. Every length on the page scales, and with it line pitch and blur; light at
    the sensor hardly changes.
    """
    camera = press_file.camera()
    if abs(camera.pixel_pitch_mm - pitch_mm) < 1e-6:
        return press_file
    pixel_mm = camera.sensors[0].pixel_pitch_um / 1000
    field_mm = camera.sensors[0].pixels * camera.pixel_pitch_mm
    distance_mm = camera.lens.focal_length_mm * (1 + pitch_mm / pixel_mm)
    return varied(
        press_file,
        {"lens.object_distance_mm": distance_mm, "sensor.pixels": round(field_mm / pitch_mm)},
    )


# --- pictures of ROC and cost ---

_SHOWN: Final = (
    "chi-square",
    "Bayesian network, as printed",
    "Bayesian network, tuned",
    "difference, 5 x 5",
    "SSIM, mean",
    "variation model",
)
_BANDED: Final = "Bayesian network, tuned"
"""Name of the row whose 95 % interval is drawn; seven overlapping bands could not be distinguished."""
_LEAST_SHOWN: Final = 0.005
_MARKED: Final = {"1 sensor": "s", "2 sensors": "o"}


def draw_roc(path: Path, results: Sequence[WorldResult]) -> None:
    """Draw misprints caught against false alarms on a log scale, one panel for each world and frame."""
    panels = [(result, frame) for result in results for frame in result.tables]
    figure, axes = _figure(len(panels))
    for axis, (result, frame) in zip(axes, panels, strict=True):
        least = 0.5 / result.good["test"]
        for row, colour in _of_frame(result, frame):
            false_alarms, caught = row.roc
            axis.step(
                np.maximum(false_alarms, least), caught, where="post", color=colour, label=row.name, lw=1.6
            )
        axis.axvline(0.01, color="#999999", lw=0.8, ls=":")
        axis.set(
            title=f"{result.plan.world} world, {frame}",
            xlabel="false alarms F [-]",
            ylabel="misprints caught, 1 - M [-]",
            xscale="log",
            xlim=(least, 1),
            ylim=(0, 1.02),
        )
    legend_below(figure, axes[0], columns=4, size_pt=9)
    write_figure(figure, path)


def draw_costs(path: Path, results: Sequence[WorldResult]) -> None:
    """Draw honest c over the cost of never or always stopping, against alpha, and the paper's own points.

    Values below the axis's range are drawn at its end.
    """
    panels = [(result, frame) for result in results for frame in result.tables]
    figure, axes = _figure(len(panels))
    alphas = np.array(ALPHAS)
    idle = np.minimum(1, alphas)
    for axis, (result, frame) in zip(axes, panels, strict=True):
        for row, colour in _of_frame(result, frame):
            values, low, high = (
                np.array([getattr(interval, part) for interval in row.honest]) / idle
                for part in ("value", "low", "high")
            )
            axis.plot(alphas, values.clip(_LEAST_SHOWN), color=colour, marker=".", lw=1.6, label=row.name)
            if row.name == _BANDED:
                axis.fill_between(alphas, low.clip(_LEAST_SHOWN), high, color=colour, alpha=0.18, lw=0)
        for name, marker in _MARKED.items():
            printed = _printed(name) / idle
            axis.plot(
                alphas, printed, marker, color="black", mfc="none", ls="", label=f"paper, {name} (oracle)"
            )
        axis.axhline(1, color="#555555", lw=1, ls=":")
        axis.annotate(
            "never or always stopping",
            (0.55, 1.08),
            xycoords=("axes fraction", "data"),
            ha="center",
            fontsize=8,
            color="#555555",
        )
        axis.set(
            title=f"{result.plan.world} world, {frame}",
            xlabel="relative cost of a miss, alpha [-]",
            ylabel="honest c over min(1, alpha) [-]",
            xscale="log",
            yscale="log",
            ylim=(_LEAST_SHOWN * 0.9, 20),
        )
    legend_below(figure, axes[0], columns=4, size_pt=9)
    write_figure(figure, path)


def _of_frame(result: WorldResult, frame: str) -> list[tuple[DetectorRow, str]]:
    rows = {row.name: row for row in result.detectors if row.frame == frame}
    return [(rows[name], colour) for name, colour in zip(_SHOWN, COLOURS, strict=False)]


def _printed(name: str) -> NDArray[np.float64]:
    return np.array([float(text) for text in PRINTED[name][1]])


def _figure(count: int) -> tuple[Figure, list[Axes]]:
    figure = new_figure(4.6 * count, 4.9)
    panels = [figure.add_subplot(1, count, place + 1) for place in range(count)]
    for axes in panels:
        plain_axes(axes)
    return figure, panels
