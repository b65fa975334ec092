"""The frozen cases: small presses, pages and scans whose figures must not change, and how each is put into figures.

Everything of Prooflight that the frozen figures rest on is imported here.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import tifffile
from tests.stand_ins import SHARED
from tests.two_sensors import BLUE_SENSOR

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import trained
from prooflight.detectors.disposition import without_gate
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.inspection.golden import GoldenInspector, golden_pages
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import decided_again, evidence_to_store
from prooflight.pages.job import open_job
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight.registration.register import prepare, register
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job
from prooflight.simulation.prints import Print
from prooflight.simulation.scans import MisprintRequest, SimulatedScan, scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_studies.exact.scans import Specimen, exact_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Figures = dict[str, Any]
SIGNS = 6
"""Sums of an array with signs drawn at random, that stand for all its numbers."""
SHAKEN = 1e-5
"""Standard deviation by which the gain of a column is moved, a hundred times what single precision rounds to."""


def digest(values: NDArray[Any]) -> Figures:
    """An array in a few numbers that last bits do not move: its shape, mean, norm, and sums with random signs.

    counts: whether they are whole numbers. What is not known (NaN) counts as 0, and how many these are is a number
    more.
    """
    flat = np.asarray(values, np.float64).ravel()
    unknown = int(np.isnan(flat).sum())
    flat = np.nan_to_num(flat)
    rng = np.random.default_rng(1)
    sums = [float((flat * rng.choice([-1.0, 1.0], flat.size)).sum()) for _ in range(SIGNS)]
    norm = float(np.linalg.norm(flat))
    counts = values.dtype.kind in "iub"
    found = {
        "shape": list(values.shape),
        "counts": counts,
        "mean": float(flat.mean()),
        "norm": norm,
        "sums": sums,
    }
    return found | ({"unknown": unknown} if unknown else {})


def sha(raster: NDArray[np.uint8]) -> str:
    """Of an integer raster, which no processor may change."""
    return hashlib.sha256(repr(raster.shape).encode() + np.ascontiguousarray(raster).tobytes()).hexdigest()


def design(seed: int, *, width_mm: float = 36.0, height_mm: float = 44.0, dpi: float = 481.8) -> Page:
    """Bars like text, tints, a noisy picture."""
    rng = np.random.default_rng([2100, seed])
    rows, columns = (round(extent * dpi / 25.4) for extent in (height_mm, width_mm))
    cmyk = np.zeros((rows, columns, 4), np.uint8)
    for top in range(8, rows // 3 - 32, 48):
        cmyk[top : top + 32, :, 3] = np.repeat(rng.random(-(-columns // 8)) < 0.4, 8)[:columns] * 255
    for patch in range(6):
        left, right = patch * columns // 6, (patch + 1) * columns // 6
        cmyk[rows // 3 : 2 * rows // 3, left:right, patch % 3] = rng.integers(60, 230)
    coarse = rng.integers(0, 200, (6, 8, 4)).astype(np.float32)
    smooth = cv2.resize(coarse, (columns, rows - 2 * rows // 3), interpolation=cv2.INTER_LINEAR)
    cmyk[2 * rows // 3 :] = np.clip(smooth + rng.normal(0, 12, smooth.shape), 0, 255)[: rows - 2 * rows // 3]
    return Page(cmyk=cmyk, dpi=dpi, name=f"p{seed:04}", number=seed)


@dataclass(frozen=True)
class Designs:
    """To teach by; ``page`` counts from 0."""

    def page(self, index: int) -> Page:
        """Small, for speed."""
        return replace(design(index + 1, height_mm=30.0), number=index + 1)


class Presses:
    """Built once each. shaken: a seed by which every column's gain is moved by ``SHAKEN``; 0: none is moved."""

    shaken = 0

    @cached_property
    def one(self) -> Press:
        """The prototype with a line of 400 pixels."""
        return self._moved(build_press(PressFile.prototype(), seed=1, pixels=400))

    @cached_property
    def two(self) -> Press:
        """With a second sensor, of 10 bits."""
        text = PressFile.prototype().text.replace("[costs]", BLUE_SENSOR)
        return self._moved(build_press(PressFile(Path("two.toml"), text), seed=2, pixels=400))

    def _moved(self, press: Press) -> Press:
        if not self.shaken:
            return press
        rng = np.random.default_rng(self.shaken)
        gains = [sensor.column_gain for sensor in press.sensors]
        moved = [gain * (1 + SHAKEN * rng.standard_normal(gain.shape)).astype(np.float32) for gain in gains]
        sensors = [
            replace(sensor, column_gain=gain) for sensor, gain in zip(press.sensors, moved, strict=True)
        ]
        return replace(press, sensors=tuple(sensors))

    @cached_property
    def trained(self) -> Press:
        """One sensor; the matched-filter detector, and a Bayesian network taught on made-up statistics."""
        rng = np.random.default_rng(3)
        good = rng.normal([0, -4, 0.5], [0.02, 0.3, 0.005], (200, 3))
        bad = good + rng.normal(0, [0.3, 4.0, 0.05], good.shape)
        labels = ["correct"] * 200 + ["local"] * 100 + ["global"] * 100
        network = BayesianNetwork.learn(np.vstack([good, bad]), labels, misprint_rate=0.01)
        press = replace(self.one, good_pages_per_false_alarm=10.0)
        press = trained(press, Designs(), designs=24, seed=1, processes=1)
        return press.with_detector("bayes", BayesDetector(network=network, threshold=0.5, unit=np.ones(1)))


PRESSES = Presses()


def scanned(press: Press, page: Page, world: str, kind: str = "", seed: int = 1) -> SimulatedScan:
    """A print of a page; kind: of the misprint, of severity 0.9; empty: a good print; "wrong-page": another page."""
    rng = np.random.default_rng([seed, page.number])
    session = (
        None if world == "ideal" else Session.draw(amounts_of(press), press, np.random.default_rng(seed))
    )
    request = MisprintRequest(kind=kind, severity=0.9) if kind else None
    return scan_page(
        page, press=press, request=request, others=(9,), fetch=lambda _: design(9), rng=rng, session=session
    )


def of_verdict(verdict: Any) -> Figures:
    """Words, places and numbers of a verdict, none of them rounded further."""
    return {
        "words": {name: getattr(verdict, name) for name in ("verdict", "kind", "family")}
        | {"disposition": without_gate(verdict)[0]},
        "score": verdict.score,
        "threshold": verdict.threshold,
        "p_value": verdict.p_value,
        "probability": verdict.probability,
        "shift_mm": verdict.shift_mm,
        "regions": [
            {"kind": region.kind, "box_mm": [region.x_mm, region.y_mm, region.width_mm, region.height_mm]}
            for region in verdict.regions
        ],
        "inks": {
            letter: {"gain_percent": ink.gain_percent, "dot_gain_percent": ink.dot_gain_percent}
            for letter, ink in verdict.inks.items()
        },
    }


def inspected(press: Press, detector: str, world: str, *kinds: str) -> Figures:
    """Verdicts of prints of one page, what is kept of each, and the same judged again."""
    inspector, page = Inspector.of(press, detector), design(3)
    prepared, found = inspector.prepare(page), {}
    for kind in kinds:
        scan = scanned(press, page, world, kind).dn
        if kind == "":
            kind = "good"
        done = inspector.inspect(prepared, scan, scan_name="scan")
        kept = {
            name: array for name, array in evidence_to_store(done, page, press).items() if "cut" not in name
        }
        again = decided_again(kept, press, inspector.detector.name)
        assert again.misprint == (done.verdict.verdict == "misprint")
        found[kind] = {
            "verdict": of_verdict(done.verdict),
            "again": again.score,
            "block_z": digest(done.block_z),
            "area": [[part.start, part.stop] for part in done.area],
            "kept": {name: digest(array) for name, array in sorted(kept.items())},
        }
    return found


# --- cases ---


def press_one() -> Figures:
    """What tables of the prototype hold."""
    return _of_press(PRESSES.one)


def press_two() -> Figures:
    """What tables of two sensors hold."""
    return _of_press(PRESSES.two)


def _of_press(press: Press) -> Figures:
    return {
        sensor.name: {
            "mean": digest(sensor.mean_dn),
            "variance": digest(sensor.variance_dn2),
            "columns": digest(np.stack([sensor.column_gain, sensor.column_offset_dn])),
            "footprint": digest(np.stack([sensor.footprint.across, sensor.footprint.along])),
            "white": float(sensor.white_dn),
        }
        for sensor in press.sensors
    }


def press_taught(folder: Path) -> Figures:
    """The taught press, saved and loaded again."""
    digest_saved = PRESSES.trained.save(folder / "x.press")
    press = Press.load(folder / "x.press")
    assert press.digest == digest_saved
    matched_filter = model_of(press)
    assert matched_filter is not None
    page = design(4)
    scan = scanned(press, page, "press").dn
    one, other = (
        Inspector.of(which, "matched_filter")
        .inspect(Inspector.of(which, "matched_filter").prepare(page), scan, scan_name="s")
        .verdict
        for which in (PRESSES.trained, press)
    )
    assert replace(one, milliseconds=0.0) == replace(other, milliseconds=0.0)
    return {"tables": _of_press(press), "threshold": matched_filter.threshold, "verdict": of_verdict(one)}


def chi_square_ideal() -> Figures:
    """The paper's first detector in the paper's world."""
    return inspected(PRESSES.one, "chi-square", "ideal", "", "streak", "missing-plane", "wrong-page")


def chi_square_press() -> Figures:
    """The same where presses drift: it calls good prints misprints."""
    return inspected(PRESSES.one, "chi-square", "press", "", "spots-voids")


def chi_square_two() -> Figures:
    """Two sensors."""
    return inspected(PRESSES.two, "chi-square", "ideal", "", "spots-voids")


def bayes_ideal() -> Figures:
    """The paper's second detector."""
    return inspected(PRESSES.trained, "bayes", "ideal", "", "streak", "scum")


def matched_filter_press() -> Figures:
    """The matched filter in the press world."""
    return inspected(
        PRESSES.trained,
        "matched_filter",
        "press",
        "",
        "streak",
        "density",
        "plane-register",
        "missing-content",
        "wrong-page",
    )


def matched_filter_ideal() -> Figures:
    """The matched filter in the ideal world."""
    return inspected(PRESSES.trained, "matched_filter", "ideal", "", "spots-voids")


def wrong_light() -> Figures:
    """Half the light: not inspected."""
    inspector, page = Inspector.of(PRESSES.trained, "matched_filter"), design(5)
    scan = scanned(PRESSES.trained, page, "press").dn
    done = inspector.inspect(inspector.prepare(page), (scan * 0.5).astype(np.uint16), scan_name="scan")
    return {"verdict": of_verdict(done.verdict), "reason": done.verdict.reason}


def scans() -> Figures:
    """Prints of both worlds and of two sensors, by the fast path."""
    found = {}
    for name, press in (("one", PRESSES.one), ("two", PRESSES.two)):
        for world in ("ideal", "press"):
            for kind in ("", "streak", "ghost-smear"):
                made = scanned(press, design(6), world, kind)
                found[f"{name} {world} {kind or 'good'}"] = digest(made.dn) | {"draws": made.draws}
    return found


def exact_path() -> Figures:
    """A print through every wavelength."""
    file, press = PressFile.prototype(), PRESSES.one
    page = design(7, width_mm=12.0, height_mm=10.0, dpi=2 * press.dpi)
    session = Session.draw(amounts_of(press), press, np.random.default_rng(2))
    print_ = Print.draw(session, press, page, np.random.default_rng(3))
    specimen = Specimen(press=press, camera=file.camera(), inks=file.inks(), backing_reflectance=0.05)
    return digest(exact_scan(page, specimen, session, print_, rng=np.random.default_rng(4)))


def prediction() -> Figures:
    """A page in its place, of two sensors."""
    seen = predict(design(8), sensors=PRESSES.two.sensors, geometry=PRESSES.two.geometry)
    return {"expected": digest(seen.expected_dn), "variance": digest(seen.variance_dn2)}


def registration() -> Figures:
    """Where a press-world print lies, and its planes."""
    press, page = PRESSES.two, design(2)
    expected = predict(page, sensors=press.sensors, geometry=press.geometry)
    landmarks = prepare(page, expected, sensors=press.sensors, geometry=press.geometry)
    found = register(landmarks, scanned(press, page, "press", seed=8).dn)
    return {
        "found": found.located,
        "shift_mm": list(found.placement.shift_mm),
        "skew_deg": found.placement.skew_deg,
        "planes_mm": found.planes_mm.ravel().tolist(),
        "sd_mm": list(found.shift_sd_mm),
    }


def golden(folder: Path) -> Figures:
    """A scan with a spot and a hole against a golden one."""
    rng = np.random.default_rng(4)
    drawn = np.full((300, 260), 230, np.uint8)
    for _ in range(30):
        x, y = int(rng.integers(10, 200)), int(rng.integers(10, 270))
        cv2.rectangle(drawn, (x, y), (x + int(rng.integers(8, 50)), y + 8), 20, -1)
    spoilt = drawn.copy()
    spoilt[250:260, 200:212], spoilt[100:110, 30:42] = 10, 240
    resolution = {"resolution": (254.0, 254.0), "resolutionunit": "inch"}
    found = {}
    for name, image in (("golden", drawn), ("good", np.roll(drawn, 1, axis=1)), ("spoilt", spoilt)):
        tifffile.imwrite(folder / f"{name}.tif", image, **resolution)  # type: ignore[arg-type]
        (page,) = golden_pages(folder / "golden.tif", folder / f"{name}.tif")
        found[name] = of_verdict(GoldenInspector.of(None, page.goldens[0])(page))
    return found


def composed_designs() -> Figures:
    """Pages that teach presses."""
    corpus = Corpus(seed=5, dpi=100.0)
    return {str(index): sha(corpus.page(index).cmyk) for index in range(6)}


def sample_job(folder: Path) -> Figures:
    """The job of the demonstration, ripped at a low resolution."""
    make_sample_job(folder / "job.pdf")
    with open_job(folder / "job.pdf", dpi=60) as job:
        return {str(number): digest(job.page(number).cmyk) for number in range(1, len(job) + 1)}


def inks() -> Figures:
    """The built-in inks."""
    recipes = np.random.default_rng(6).random((40, 4))
    return digest(PressFile.prototype().inks().reflectance(recipes))


def real_pages() -> Figures:
    """Pages of the press room's own documents: ripped, predicted; needs ``shared``."""
    found = {}
    for name in ("d001", "d007"):
        with open_job(SHARED / "data" / "pages" / f"{name}.pdf", dpi=100) as job:
            page = job.page(1)
        press = PRESSES.one
        cut = replace(page, cmyk=np.ascontiguousarray(page.cmyk[300:460, 250:390]), dpi=100.0)
        seen = predict(cut, sensors=press.sensors, geometry=press.geometry)
        found[name] = {"raster": sha(page.cmyk), "expected": digest(seen.expected_dn)}
    return found


CASES: tuple[Callable[..., Figures], ...] = (
    press_one,
    press_two,
    press_taught,
    chi_square_ideal,
    chi_square_press,
    chi_square_two,
    bayes_ideal,
    matched_filter_press,
    matched_filter_ideal,
    wrong_light,
    scans,
    exact_path,
    prediction,
    registration,
    golden,
    composed_designs,
    sample_job,
    inks,
    real_pages,
)


def figures_of(case: Callable[..., Figures], folder: Path) -> Figures:
    """The figures of a case; folder: empty, for its files."""
    return case(folder) if case.__code__.co_argcount else case()


def needs_shared(case: Callable[..., Figures]) -> bool:
    """Whether a case reads documents that lie beside the repository."""
    return case is real_pages


def learns(case: Callable[..., Figures]) -> bool:
    """Whether a case asks what a detector says that was taught on this processor."""
    return case in (press_taught, matched_filter_press, matched_filter_ideal)
