"""The paper's figures 3 to 8 for any press and page.

They show light and sensors, tables, noise, an error map, the statistics of many copies, and the costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.camera.sensor import FixedPattern, read_out
from prooflight.commissioning.build import build_press
from prooflight.commissioning.characterise import signal_dn, variance_dn2
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.pages.job import open_job
from prooflight.prediction.tables import node_fractions
from prooflight.reporting.pictures import page_frame, page_picture, signals
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight_studies.paper import page_plots, pictures
from prooflight_studies.paper.page_samples import Samples, judged_samples, page_samples
from prooflight_studies.paper.pictures import ErrorMap, Repeated, Slice
from prooflight_studies.paper.study import at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.camera.camera import Camera
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

EXPOSURES: Final = 20_000
"""Number of exposures of each colour in figure 5, with which bars are accurate to a few per cent."""
COLOURS: Final = {
    "paper": (0.0, 0.0, 0.0, 0.0),
    "half cyan": (0.5, 0.0, 0.0, 0.0),
    "full magenta": (0.0, 1.0, 0.0, 0.0),
    "grey of 70 % black": (0.0, 0.0, 0.0, 0.7),
    "red, 50 % black": (0.0, 1.0, 1.0, 0.5),
    "all four inks": (1.0, 1.0, 1.0, 1.0),
}
PICTURE_PX: Final = 1000
MISPRINT: Final = MisprintRequest(kind="missing-content", severity=0.6)
COARSEST_MM: Final = 0.254
"""Pixel pitch of figures 7 and 8, unless the camera's own is coarser: hundreds of copies are printed. [mm]"""
GOOD_COPIES: Final = 96
OF_EACH_KIND: Final = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Exhibit:
    """The page of figures 6 to 8, its misprint in figure 6, and its number of prints for 7 and 8."""

    job: Path
    page: int = 1
    misprint: MisprintRequest = MISPRINT
    good_copies: int = GOOD_COPIES
    of_each_kind: int = OF_EACH_KIND


def draw_figures(
    press_file: PressFile,
    exhibit: Exhibit,
    out: Path,
    *,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _text: None,
) -> list[Path]:
    """Write the figures (PNG) into ``out``; return their paths. JobError, RequestError: the page cannot be used."""
    camera, inks = press_file.camera(), press_file.inks()
    press = build_press(press_file, seed=seed, progress=progress)
    progress(f"scanning page {exhibit.page}")
    shown = error_map(press, exhibit, seed=seed)  # may refuse its page, so before anything is written
    samples = _samples(press_file, press, exhibit, seed, progress)
    progress("drawing")
    written = [out / "figure-3-light-and-sensors.png"]
    pictures.draw_curves(
        written[0],
        light=(camera.light.name, camera.light.relative_power),
        sensors={sensor.name: sensor.quantum_efficiency for sensor in camera.sensors},
    )
    for model in press.sensors:
        written.append(out / f"figure-4-tables-{model.name}.png")
        pictures.draw_slices(written[-1], model.name, slices(model))
    for index, model in enumerate(press.sensors):
        written.append(out / f"figure-5-noise-{model.name}.png")
        repeated = repeated_exposures(camera, inks, index, stream(seed, "figure-exposures", index))
        pictures.draw_histograms(written[-1], model.name, repeated)
    written.append(out / "figure-6-error-map.png")
    pictures.draw_error_map(written[-1], shown)
    written += [out / "figure-7-statistics.png", out / "figure-8-roc-and-cost.png"]
    page_plots.draw_statistics(written[-2], samples)
    page_plots.draw_operating(written[-1], judged_samples(samples))
    return written


def _samples(
    press_file: PressFile, press: Press, exhibit: Exhibit, seed: int, progress: Callable[[str], None]
) -> Samples:
    if press.geometry.pixel_pitch_mm < COARSEST_MM:
        progress("building the press with coarser pixels")
        press = build_press(at_pitch(press_file, COARSEST_MM), seed=seed)
    return page_samples(
        press,
        exhibit.job,
        exhibit.page,
        good=exhibit.good_copies,
        of_each_kind=exhibit.of_each_kind,
        seed=seed,
        progress=progress,
    )


def slices(model: SensorModel) -> list[Slice]:
    """Return mean and sigma of one sensor over cyan x magenta and over yellow x black, the other two inks absent."""
    percent = 100 * node_fractions()
    sigma = np.sqrt(model.variance_dn2)
    return [
        Slice(what=what, x_ink=x_ink, y_ink=y_ink, percent=percent, values=values)
        for what, table in (("mean above dark [DN]", model.mean_dn), ("temporal sigma [DN]", sigma))
        for x_ink, y_ink, values in (
            ("cyan", "magenta", table[:, :, 0, 0].T),
            ("yellow", "black", table[0, 0, :, :].T),
        )
    ]


def repeated_exposures(
    camera: Camera, inks: ReflectanceModel, sensor_index: int, rng: np.random.Generator
) -> list[Repeated]:
    """Expose each of ``COLOURS`` repeatedly in a column without a fixed pattern."""
    sensor = camera.sensors[sensor_index]
    recipes = np.array(list(COLOURS.values()))
    electrons = sensor.electrons(camera.irradiance_photons(inks.reflectance(recipes)))
    pattern = FixedPattern(gain=np.ones(len(recipes)), offset_e=np.zeros(len(recipes)))
    dn = read_out(sensor, np.broadcast_to(electrons, (EXPOSURES, len(recipes))), pattern=pattern, rng=rng)
    mean = signal_dn(sensor, electrons + sensor.dark_e) + sensor.black_level_dn
    sigma = np.sqrt(variance_dn2(sensor, electrons))
    return [
        Repeated(name=name, dn=dn[:, place], mean_dn=float(mean[place]), sigma_dn=float(sigma[place]))
        for place, name in enumerate(COLOURS)
    ]


def error_map(press: Press, exhibit: Exhibit, *, seed: int) -> ErrorMap:
    """Print a page with a misprint in the ideal world, scan and inspect it.

    RequestError: there is no such page, or the misprint changes nothing on it.
    """
    with open_job(exhibit.job, dpi=press.dpi) as job:
        others = tuple(number for number in range(1, len(job) + 1) if number != exhibit.page)

        def fetch(number: int) -> Page:
            return press.geometry.lay(job.page(number))

        page = fetch(exhibit.page)
        rng = stream(seed, "figure-misprint", exhibit.page)
        scan = scan_page(page, press=press, request=exhibit.misprint, others=others, fetch=fetch, rng=rng)
    if scan.misprint is None:
        raise RequestError("misprint", "none was drawn", remedy="ask for a kind of misprint")
    inspection = Inspector.of(press, "chi-square").inspect(
        page, scan.dn, scan_name="the simulated scan", seed=seed
    )
    _, measured = signals(inspection, press)
    return ErrorMap(
        page=np.asarray(page_picture(page, press, width_px=PICTURE_PX)),
        page_size_mm=(page.width_mm, page.height_mm),
        measured=measured,
        frame=page_frame(page, press),
        block_z=inspection.block_z[0],
        misprint=scan.misprint.detail,
        region_mm=scan.misprint.region_mm,
        verdict=inspection.verdict.verdict,
        sensor=press.sensors[0].name,
    )
