"""Accuracy of calibration by a chart's scans instead of data sheet and spectrometer; writes ``calibration.md``.

A 300 dpi colour line camera scans printed charts in both worlds (``simulation.fast``); the truth is known and not used
by the calibration. Two truths are distinguished: the average inks and paper of these prints, and the average of what
the session's press prints. A calibration can determine the first; the second only from many prints.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.commissioning.build import build_press
from prooflight.commissioning.camera.exploring import varied
from prooflight.commissioning.characterise import trial_recipes
from prooflight.commissioning.chart.calibrate import calibrate_from
from prooflight.commissioning.chart.patch_reading import read_scan
from prooflight.inks.chart_layout import Layout, PlacedRecipes, place_recipes
from prooflight.inks.chart_print import raster
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.kernels.prediction.lookup import NODE_STEP
from prooflight.kernels.simulation.inks import TRUE_NODES
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.scans.recorded import write_scan
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session, true_sensors
from prooflight.simulation.worlds import Amounts, worlds_digest
from prooflight_studies.harness.exact_tables import exact_lookup
from prooflight_studies.harness.page import write_page
from prooflight_studies.tables.study import job_colours

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.commissioning.chart.calibrate import Calibration
    from prooflight.commissioning.chart.patch_reading import ScanRead
    from prooflight.press.artefact import Press

DPI: Final = 300.0
PATCHES: Final = (100, 300, 600, 1200)
PRINTS: Final = (1, 2, 4)
QUICK: Final = ((60,), (1, 2), 150.0)
WORLDS: Final = ("ideal", "press")
GOAL_SIGMA: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationRow:
    """Errors of one calibration on one set of colours, in a pixel's temporal sigma, all sensors together."""

    world: str
    patches: int
    pages: int
    prints: int
    colours: str
    own_rms: float
    """Rms error relative to the average inks and paper of these prints."""
    own_max: float
    session_rms: float
    """Rms error relative to the session's inks on these prints' paper."""
    session_paper_rms: float
    """Rms error relative to the session's inks on the nominal paper."""
    left_out: float
    """Error that the calibration itself reports: patches predicted from all others."""
    sigma_percent: float
    """Rms error of sigma."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Printed:
    """One print of a page of a chart, its scan, and its true variations."""

    scan: ScanRead
    done: Print


def camera_at(dpi: float) -> PressFile:
    """Return the preset of a colour line camera, moved so that its pixel pitch on the page is 25.4 mm / dpi."""
    preset = PressFile.preset("rgb-line.toml")
    lens, sensor = preset.camera().lens, preset.camera().sensors[0]
    magnification = sensor.pixel_pitch_um * 1e-3 * dpi / MM_PER_INCH
    distance = lens.focal_length_mm * (1 + 1 / magnification)
    pixels = int(np.ceil(216.0 * dpi / MM_PER_INCH))
    return varied(preset, {"lens.object_distance_mm": distance, "sensor.pixels": pixels})


def calm(amounts: Amounts) -> Amounts:
    """Return the amounts of the ideal world: nothing varies."""
    blocks = {}
    for block in ("page", "register", "ink", "paper", "lamp", "camera"):
        values = getattr(amounts, block)
        zero: dict[str, object] = dict.fromkeys(values.__slots__, 0.0)
        zero |= {
            name: (1.0, 1.0) if name == "sigma_error" else (0.0, 0.0)
            for name in values.__slots__
            if isinstance(getattr(values, name), tuple)
        }
        if block == "paper":
            zero["specks_diameter_mm"] = values.specks_diameter_mm
        blocks[block] = replace(values, **zero)
    return Amounts(**blocks)


def print_charts(
    placed: PlacedRecipes,
    press: Press,
    session: Session,
    folder: Path,
    *,
    prints: int,
    rng: np.random.Generator,
    progress: Callable[[str], None],
) -> list[list[Printed]]:
    """Print, scan and read every page of a chart, ``prints`` times."""
    printed = []
    for number in range(prints):
        pages = []
        for page_number in range(1, placed.pages + 1):
            progress(f"{len(placed.cmyk)} patches, print {number + 1} of {prints}, page {page_number}")
            cmyk = raster(placed, page_number, dpi=press.dpi)
            page = Page(cmyk=cmyk, dpi=press.dpi, name=f"chart-{page_number}", number=page_number)
            done = Print.draw(session, press, page, rng)
            path = folder / f"print{number + 1}-page{page_number}.tif"
            write_scan(path, fast_scan(page, press, session, done, rng=rng), facts={})
            pages.append(Printed(scan=read_scan(path, placed), done=done))
            path.unlink()
        printed.append(pages)
    return printed


def true_dn(
    press: Press, session: Session, prints: Sequence[tuple[Print | None, float]], cmyk: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Return the mean signal of the sensors' columns for even colours, over prints with weights.

    The result is (sensors, n) above dark [DN]. None for a print: the session's mean, with nominal paper and lamp.
    """
    nominal = cmyk / 255
    seen = np.zeros((len(press.sensors), len(cmyk)))
    for index, sensor in enumerate(true_sensors(session, press)):
        table = sensor.nodes[:, 0].reshape((TRUE_NODES,) * 4)
        lit = []
        for done, weight in prints:
            gain = session.ink_gain + (0 if done is None else done.ink_gain)
            dots = 0 if done is None else 4 * done.dot_gain * nominal * (1 - nominal)
            area = (nominal * (1 + gain) + dots).clip(min=0)
            light = ndimage.map_coordinates(table, area.T * (255 / NODE_STEP), order=1, mode="nearest")
            seen[index] += weight * light
            lamp = 1.0 if done is None else done.lamp * done.white[index]
            lit.append((press.sensors[index].column_gain * sensor.columns * lamp)[_middle(press)].mean())
        seen[index] *= np.mean(lit)  # a sheet is a sheet, however few patches are on it
    return seen


def _middle(press: Press) -> slice:
    """Return the columns that see every page."""
    pixels = press.geometry.pixels
    return slice(pixels // 8, -(pixels // 8))


def judged(
    calibration: Calibration,
    press: Press,
    session: Session,
    done: Sequence[Printed],
    colours: Mapping[str, NDArray[np.uint8]],
) -> list[dict[str, float | str]]:
    """Return the errors of a calibrated press on sets of colours against both truths, in sigma.

    The errors of all sensors are taken together.
    """
    patches = np.array([printed.scan.patches.recipe.size for printed in done], dtype=np.float64)
    own = [(printed.done, weight) for printed, weight in zip(done, patches / patches.sum(), strict=True)]
    results: list[dict[str, float | str]] = []
    for name, cmyk in colours.items():
        truths = true_dn(press, session, own, cmyk), true_dn(press, session, [(None, 1.0)], cmyk)
        error = np.empty((3, len(press.sensors), len(cmyk)))
        sigma_error = np.empty((len(press.sensors), len(cmyk)))
        for index, (model, known) in enumerate(zip(calibration.press.sensors, press.sensors, strict=True)):
            mean, variance = exact_lookup(cmyk, model)
            columns = _middle(press)
            dark = float((model.column_offset_dn - known.column_offset_dn)[columns].mean())
            seen = dark + model.column_gain[columns].mean() * mean.astype(np.float64)
            temporal = np.interp(truths[0][index], *_noise_curve(press, session, index)) + 1 / 12
            sigma = np.sqrt(temporal)
            paper = [truth[index][cmyk.sum(axis=1).argmin()] for truth in truths]
            error[0, index] = (seen - truths[0][index]) / sigma
            error[1, index] = (seen - truths[1][index] * paper[0] / paper[1]) / sigma
            error[2, index] = (seen - truths[1][index]) / sigma
            sigma_error[index] = np.sqrt(variance * model.column_gain[columns].mean()) / sigma - 1
        rms = np.sqrt((error**2).mean(axis=(1, 2)))
        results.append(
            {
                "colours": name,
                "own_rms": float(rms[0]),
                "own_max": float(np.abs(error[0]).max()),
                "session_rms": float(rms[1]),
                "session_paper_rms": float(rms[2]),
                "sigma_percent": float(100 * np.sqrt((sigma_error**2).mean())),
            }
        )
    return results


def _noise_curve(
    press: Press, session: Session, index: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return light and true temporal variance before rounding of one sensor."""
    sensor = true_sensors(session, press)[index]
    return np.linspace(0, sensor.noise_top_dn, sensor.noise_dn2.size), sensor.noise_dn2.astype(np.float64)


def run_calibration_study(
    jobs: Mapping[str, Path],
    results: Path,
    *,
    seed: int = 1,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _text: None,
) -> list[CalibrationRow]:
    """Print, scan and calibrate with more and more patches and prints; writes ``calibration.md`` into ``results``.

    jobs: name -> PDF or folder whose pages' colours are used, in addition to random colours. quick: one small chart.
    """
    patches, prints, dpi = QUICK if quick else (PATCHES, PRINTS, DPI)
    most = 3 if quick else None
    colours = {"random and ramps": trial_recipes(stream(seed, "trial-recipes"))}
    for name, path in jobs.items():
        colours[name] = job_colours(name, path, seed=seed, most=most, progress=progress).cmyk
    progress("building the press that scans")
    press = build_press(camera_at(dpi), seed=seed, progress=progress)
    candidates = printable_recipes()
    rows = []
    for world in WORLDS:
        amounts = Amounts.stated() if world == "press" else calm(Amounts.stated())
        session = Session.draw(amounts, press, stream(seed, "calibration-session"))
        for count in patches:
            rng = stream(seed, "calibration-chart", count)
            placed = place_recipes(candidates[choose_recipes(candidates, count)], Layout(), rng)
            with tempfile.TemporaryDirectory() as folder:
                done = print_charts(
                    placed, press, session, Path(folder), prints=max(prints), rng=rng, progress=progress
                )
            for number in prints:
                used = [printed for pages in done[:number] for printed in pages]
                progress(f"{world} world, {count} patches, {number} prints: calibrating")
                calibration = calibrate_from(
                    [printed.scan for printed in used], placed, name="study", origin={}
                )
                for errors in judged(calibration, press, session, used, colours):
                    rows.append(
                        CalibrationRow(
                            world=world,
                            patches=count,
                            pages=placed.pages,
                            prints=number,
                            left_out=float(np.sqrt(np.mean(np.square(calibration.left_out_sigma)))),
                            **errors,  # type: ignore[arg-type]
                        )
                    )
    figures = {"seed": seed, "dpi": dpi, "worlds": worlds_digest(), "goal_sigma": GOAL_SIGMA, "rows": rows}
    write_page(results / "calibration.md", "calibration", figures)
    return rows
