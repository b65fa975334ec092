"""Accuracy of the default tables relative to the exact model, on the colours of real pages; writes ``tables.md``."""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.characterise import signal_dn, trial_recipes, variance_dn2
from prooflight.pages.job import open_job
from prooflight.prediction.predict import expected_light
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel

DPI: Final = 100.0
"""Resolution of the pages. Without anti-aliasing, a coarse raster has the colours of a fine one, only fewer of them."""
FREQUENT, OTHERS = 5_000, 15_000
"""Numbers of colours taken from a page that has more.

They are its most frequent ones and as many of the others, drawn at random, which then stand for all others.
"""
QUICK_PAGES: Final = 5
WORST: Final = 6
_CHUNK: Final = 65_536
GOAL_RMS_SIGMA: Final = 0.10
"""Goal: a hundredth of the noise's variance, whose effect no detector could notice."""
GOAL_WHITE_SIGMA: Final = 0.03
GOAL_SIGMA_PERCENT: Final = 1.0
GOAL_BUILD_S: Final = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """One of the colours with the largest errors."""

    cmyk_percent: tuple[float, float, float, float]
    error_sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """Errors of one sensor's tables on one set of colours. Errors of the mean are in sigma of the temporal noise."""

    press: str
    inks: str
    sensor: str
    colours: str
    different: int
    rms_sigma: float
    """Rms over different colours."""
    rms_sigma_by_pixels: float
    worst_page_rms_sigma: float
    """Rms of the page where it is greatest, over its different colours."""
    worst_page_rms_sigma_by_pixels: float
    max_sigma: float
    white_sigma: float
    sigma_percent: float
    """Rms error of the temporal sigma, over different colours. [%]"""
    worst: tuple[Worst, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPress:
    """Identity of a measured press, and the time that it took to build."""

    press: str
    inks: str
    digest: str
    press_file_sha256: str
    chart_digest: str
    sensors: int
    build_s: float
    build_cpu_s: float
    load: float
    """Number of programs that were ready to run during the build, this one included (average of a minute). [-]"""
    cores: int
    pixels: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Colours:
    """Recipes of a set of pages; those of each page are counted separately."""

    name: str
    source: str
    """Origin of the colours, and its digest."""
    cmyk: NDArray[np.uint8]
    """Recipes. (n, 4)"""
    times: NDArray[np.float64]
    """Number of different colours of its page that each stands for. (n,)"""
    pixels: NDArray[np.float64]
    """Number of pixels that each stands for. (n,)"""
    page: NDArray[np.int64]
    """Index of the page of each. (n,)"""


def page_colours(
    page: Page, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Return a page's different colours (n, 4), and how many colours and pixels each stands for, (n,) each."""
    packed, pixels = np.unique(page.cmyk.reshape(-1, 4).view(np.uint32).ravel(), return_counts=True)
    times = np.ones(packed.size)
    if packed.size > FREQUENT + OTHERS:
        order = np.argsort(-pixels, kind="stable")
        drawn = np.sort(rng.choice(order[FREQUENT:], OTHERS, replace=False))
        chosen = np.concatenate([order[:FREQUENT], drawn])
        times[drawn] = (packed.size - FREQUENT) / OTHERS
        packed, pixels, times = packed[chosen], pixels[chosen], times[chosen]
    return packed.view(np.uint8).reshape(-1, 4), times, pixels * times


def job_colours(
    name: str, path: Path, *, seed: int, most: int | None = None, progress: Callable[[str], None]
) -> Colours:
    """Return the colours of the pages of a PDF, or of a folder of them.

    most: number of pages at most. JobError: see ``open_job``.
    """
    per_page = []
    with open_job(path, dpi=DPI) as job:
        count = len(job) if most is None else min(most, len(job))
        for number in range(1, count + 1):
            progress(f"colours of {name}, page {number} of {count}")
            per_page.append(page_colours(job.page(number), stream(seed, "table-colours", number)))
    files = sorted(path.glob("*.pdf")) if path.is_dir() else [path]
    sha = hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files))
    return Colours(
        name=name,
        source=f"{count} page{'s' if count > 1 else ''} at {DPI:g} dpi, SHA-256 `{sha.hexdigest()[:16]}`",
        cmyk=np.concatenate([cmyk for cmyk, _, _ in per_page]),
        times=np.concatenate([times for _, times, _ in per_page]),
        pixels=np.concatenate([pixels for _, _, pixels in per_page]),
        page=np.repeat(np.arange(count), [len(cmyk) for cmyk, _, _ in per_page]),
    )


def random_colours(seed: int) -> Colours:
    """Return the recipes on which ``press build`` evaluates its tables."""
    cmyk = trial_recipes(stream(seed, "trial-recipes"))
    ones = np.ones(len(cmyk))
    return Colours(
        name="random and ramps",
        source="20,000 evenly drawn recipes, ramps of one and of two inks",
        cmyk=cmyk,
        times=ones,
        pixels=ones,
        page=np.zeros(len(cmyk), np.int64),
    )


def with_chart(press_file: PressFile, chart: Path) -> PressFile:
    """Return the same press with inks fitted to a chart.

    Its path is in the chart's folder, so that its text names no folder.
    """
    text = f'{press_file.text.rstrip()}\n\n[inks]\nchart = "{chart.name}"\nmodel = "hybrid"\n'
    return PressFile(chart.parent / f"{press_file.name}-chart.toml", text)


def table_results(
    rows: Sequence[TableRow], built: Sequence[BuiltPress], sources: Mapping[str, str]
) -> dict[str, Any]:
    """Return all figures of the page; sources: origin of each set of colours."""
    return {
        "goals": {
            "rms_sigma": GOAL_RMS_SIGMA,
            "white_sigma": GOAL_WHITE_SIGMA,
            "sigma_percent": GOAL_SIGMA_PERCENT,
            "build_s": GOAL_BUILD_S,
        },
        "rows": rows,
        "built": built,
        "colours": [{"name": name, "source": source} for name, source in sources.items()],
    }


def run_table_study(
    press_files: Sequence[PressFile],
    jobs: Mapping[str, Path],
    results: Path,
    *,
    seed: int = 1,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _text: None,
) -> list[TableRow]:
    """Build each press and evaluate its tables on random colours and on those of each job (name -> PDF or folder).

    Writes ``tables.md`` into ``results`` and returns its rows. ``quick``: the first 5 pages of each job.
    """
    most = QUICK_PAGES if quick else None
    sets = [random_colours(seed)]
    sets += [job_colours(name, path, seed=seed, most=most, progress=progress) for name, path in jobs.items()]
    rows, built = [], []
    for press_file in press_files:
        started, started_cpu = time.perf_counter(), time.process_time()
        press = build_press(press_file, seed=seed, progress=progress)
        build_s, build_cpu_s = time.perf_counter() - started, time.process_time() - started_cpu
        inks = press_file.inks()
        built.append(
            BuiltPress(
                press=press.name,
                inks=inks.name,
                digest=press.digest,
                press_file_sha256=press.origin["press_file_sha256"],
                chart_digest=press.origin["chart_digest"],
                sensors=len(press.sensors),
                build_s=build_s,
                build_cpu_s=build_cpu_s,
                load=os.getloadavg()[0],
                cores=os.cpu_count() or 1,
                pixels=press.geometry.pixels,
            )
        )
        for colours in sets:
            progress(f"exact model of {press.name} on {colours.name}")
            rows += judged(press.name, press_file.camera(), inks, press.sensors, colours)
    sources = {colours.name: colours.source for colours in sets}
    write_page(results / "tables.md", "tables", table_results(rows, built, sources))
    return rows


def judged(
    press_name: str,
    camera: Camera,
    inks: ReflectanceModel,
    models: Sequence[SensorModel],
    colours: Colours,
) -> list[TableRow]:
    """Return the errors of every sensor's tables on one set of colours, as prediction looks them up."""
    electrons = exact_electrons(camera, inks, np.concatenate([np.zeros((1, 4), np.uint8), colours.cmyk]))
    rows = []
    for sensor, model, of_sensor in zip(camera.sensors, models, electrons, strict=True):
        exact, sigma = signal_dn(sensor, of_sensor), np.sqrt(variance_dn2(sensor, of_sensor))
        recipes = np.concatenate([np.zeros((1, 4), np.uint8), colours.cmyk])
        mean, variance = expected_light(recipes, model)
        error = (mean - exact) / sigma
        of_sigma = np.sqrt(variance) / sigma - 1
        rows.append(
            TableRow(
                press=press_name,
                inks=inks.name,
                sensor=model.name,
                colours=colours.name,
                different=round(colours.times.sum()),
                rms_sigma=rms(error[1:], colours.times),
                rms_sigma_by_pixels=rms(error[1:], colours.pixels),
                worst_page_rms_sigma=_worst_page(error[1:], colours.times, colours.page),
                worst_page_rms_sigma_by_pixels=_worst_page(error[1:], colours.pixels, colours.page),
                max_sigma=float(np.abs(error).max()),
                white_sigma=float(abs(error[0])),
                sigma_percent=100 * rms(of_sigma[1:], colours.times),
                worst=_worst(error[1:], colours.cmyk),
            )
        )
    return rows


def exact_electrons(camera: Camera, inks: ReflectanceModel, cmyk: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the photo-electrons of recipes (n, 4) in every sensor by the full spectral path, (sensors, n) [e-]."""
    electrons = np.empty((len(camera.sensors), len(cmyk)))
    for start in range(0, len(cmyk), _CHUNK):
        part = slice(start, start + _CHUNK)
        irradiance = camera.irradiance_photons(inks.reflectance(cmyk[part] / 255))
        for index, sensor in enumerate(camera.sensors):
            electrons[index, part] = sensor.electrons(irradiance)
    return electrons


def rms(error: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Return the root of the weighted mean square, both (n,)."""
    return float(np.sqrt(np.average(error**2, weights=weight)))


def _worst_page(error: NDArray[np.float64], weight: NDArray[np.float64], page: NDArray[np.int64]) -> float:
    """Return the greatest weighted rms of any page, all (n,)."""
    return float(np.sqrt((np.bincount(page, weight * error**2) / np.bincount(page, weight)).max()))


def _worst(error: NDArray[np.float64], cmyk: NDArray[np.uint8]) -> tuple[Worst, ...]:
    """Return the colours with the largest errors, each once."""
    errors: dict[tuple[float, ...], float] = {}
    for place in np.argsort(-np.abs(error), kind="stable"):
        recipe = tuple(round(value / 2.55, 1) for value in cmyk[place].tolist())
        errors.setdefault(recipe, float(error[place]))
        if len(errors) == WORST:
            break
    return tuple(
        Worst(cmyk_percent=(c, m, y, k), error_sigma=error_sigma)
        for (c, m, y, k), error_sigma in errors.items()
    )
