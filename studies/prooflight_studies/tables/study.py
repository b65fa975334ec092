"""How well the default tables replace the exact model on the colours that pages really have; writes ``tables.md``."""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.accuracy import trial_recipes
from prooflight.commissioning.build import build_press
from prooflight.commissioning.characterise import signal_dn, variance_dn2
from prooflight.pages.job import open_job
from prooflight.prediction.predict import looked_up
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight_studies.tables.page import BuiltPress, TableRow, Worst, write_table_page

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel

DPI: Final = 100.0
"""Pages are ripped without anti-aliasing, so a coarse raster has the colours of a fine one, only fewer of them."""
FREQUENT, OTHERS = 5_000, 15_000
"""Of a page with more colours: its most frequent ones and as many of the others, drawn at random, which then stand for
all others."""
QUICK_PAGES: Final = 5
WORST: Final = 6
_CHUNK: Final = 65_536


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Colours:
    """Recipes of a set of pages; each page's count for themselves."""

    name: str
    source: str
    """What they are of, and its digest."""
    cmyk: NDArray[np.uint8]
    """(n, 4)"""
    times: NDArray[np.float64]
    """(n,) how many different colours of its page each stands for."""
    pixels: NDArray[np.float64]
    """(n,) how many pixels each stands for."""
    page: NDArray[np.int64]
    """(n,) index of its page."""


def page_colours(
    page: Page, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Different colours of a page (n, 4), how many colours and how many pixels each stands for, (n,) each."""
    packed, pixels = np.unique(page.cmyk.reshape(-1, 4).view(np.uint32).ravel(), return_counts=True)
    times = np.ones(packed.size)
    if packed.size > FREQUENT + OTHERS:
        order = np.argsort(-pixels, kind="stable")
        drawn = np.sort(rng.choice(order[FREQUENT:], OTHERS, replace=False))
        kept = np.concatenate([order[:FREQUENT], drawn])
        times[drawn] = (packed.size - FREQUENT) / OTHERS
        packed, pixels, times = packed[kept], pixels[kept], times[kept]
    return packed.view(np.uint8).reshape(-1, 4), times, pixels * times


def job_colours(
    name: str, path: Path, *, seed: int, most: int | None = None, progress: Callable[[str], None]
) -> Colours:
    """Colours of the pages of a PDF, or of a folder of them; ``most``: of so many pages. JobError: see ``open_job``."""
    found = []
    with open_job(path, dpi=DPI) as job:
        count = len(job) if most is None else min(most, len(job))
        for number in range(1, count + 1):
            progress(f"colours of {name}, page {number} of {count}")
            found.append(page_colours(job.page(number), stream(seed, "table-colours", number)))
    files = sorted(path.glob("*.pdf")) if path.is_dir() else [path]
    sha = hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files))
    return Colours(
        name=name,
        source=f"{count} page{'s' if count > 1 else ''} at {DPI:g} dpi, SHA-256 `{sha.hexdigest()[:16]}`",
        cmyk=np.concatenate([cmyk for cmyk, _, _ in found]),
        times=np.concatenate([times for _, times, _ in found]),
        pixels=np.concatenate([pixels for _, _, pixels in found]),
        page=np.repeat(np.arange(count), [len(cmyk) for cmyk, _, _ in found]),
    )


def random_colours(seed: int) -> Colours:
    """The recipes with which ``press build`` judges its tables."""
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


def with_chart(press_file: PressFile, chart: Path, *, model: str = "hybrid") -> PressFile:
    """The same press with inks that a chart teaches; its path is the chart's folder, so its text names no folder."""
    text = f'{press_file.text.rstrip()}\n\n[inks]\nchart = "{chart.name}"\nmodel = "{model}"\n'
    return PressFile(chart.parent / f"{press_file.name}-chart.toml", text)


def run_table_study(
    press_files: Sequence[PressFile],
    jobs: Mapping[str, Path],
    results: Path,
    *,
    seed: int = 1,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _text: None,
) -> list[TableRow]:
    """Build each press and judge its tables on random colours and on those of each job (name -> PDF or folder).

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
    write_table_page(results / "tables.md", rows, built, {colours.name: colours.source for colours in sets})
    return rows


def judged(
    press_name: str,
    camera: Camera,
    inks: ReflectanceModel,
    models: Sequence[SensorModel],
    colours: Colours,
) -> list[TableRow]:
    """Every sensor's tables on one set of colours, as prediction looks them up."""
    electrons = exact_electrons(camera, inks, np.concatenate([np.zeros((1, 4), np.uint8), colours.cmyk]))
    rows = []
    for sensor, model, of_sensor in zip(camera.sensors, models, electrons, strict=True):
        exact, sigma = signal_dn(sensor, of_sensor), np.sqrt(variance_dn2(sensor, of_sensor))
        recipes = np.concatenate([np.zeros((1, 4), np.uint8), colours.cmyk])
        mean, variance = looked_up(recipes, model)
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
    """Photo-electrons of recipes (n, 4) in every sensor by the full spectral path, (sensors, n) [e-]."""
    electrons = np.empty((len(camera.sensors), len(cmyk)))
    for start in range(0, len(cmyk), _CHUNK):
        part = slice(start, start + _CHUNK)
        irradiance = camera.irradiance_photons(inks.reflectance(cmyk[part] / 255))
        for index, sensor in enumerate(camera.sensors):
            electrons[index, part] = sensor.electrons(irradiance)
    return electrons


def rms(error: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Root of the weighted mean square, both (n,)."""
    return float(np.sqrt(np.average(error**2, weights=weight)))


def _worst_page(error: NDArray[np.float64], weight: NDArray[np.float64], page: NDArray[np.int64]) -> float:
    """Greatest weighted rms of any page, all (n,)."""
    return float(np.sqrt((np.bincount(page, weight * error**2) / np.bincount(page, weight)).max()))


def _worst(error: NDArray[np.float64], cmyk: NDArray[np.uint8]) -> tuple[Worst, ...]:
    """The colours farthest off, each once."""
    found: dict[tuple[float, ...], float] = {}
    for place in np.argsort(-np.abs(error), kind="stable"):
        recipe = tuple(round(value / 2.55, 1) for value in cmyk[place].tolist())
        found.setdefault(recipe, float(error[place]))
        if len(found) == WORST:
            break
    return tuple(
        Worst(cmyk_percent=(c, m, y, k), error_sigma=error_sigma)
        for (c, m, y, k), error_sigma in found.items()
    )
