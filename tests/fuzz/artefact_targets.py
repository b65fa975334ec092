"""Press artefacts, spoilt and digested anew."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tests.fuzz.harness import Target
from tests.fuzz.press_mutants import mutants

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

PIXELS = 400
STATISTICS = ("box/add-C+/8", "streak/void/1/full", "fit/white", "step/gain-K/across")


def press_samples() -> list[bytes]:
    """A press of 42 mm with the learned detectors; what they learned is noise, and of a few statistics."""
    from prooflight.commissioning.build import build_press
    from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
    from prooflight.press.press_file import PressFile

    statistics = np.random.default_rng(4).standard_normal((80, 3))
    network = BayesianNetwork.learn(statistics, ["correct", "misprint"] * 40, misprint_rate=0.01, bins=8)
    press = replace(
        build_press(PressFile.prototype(), seed=1, pixels=PIXELS),
        detectors={
            "bayes": BayesDetector(network=network, threshold=0.1, unit=np.ones(1)),
            "matched_filter": _matched_filter(),
        },
    )
    with tempfile.TemporaryDirectory() as folder:
        press.save(Path(folder) / "a.press")
        return [(Path(folder) / "a.press").read_bytes()]


def _matched_filter() -> CalibratedDetector:
    from prooflight.commissioning.training.adapting import fit_for
    from prooflight.commissioning.training.learn import Pages, learn_model
    from prooflight.detectors.false_alarm_rate import ReferenceScores
    from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter

    rng, count = np.random.default_rng(5), 40
    pages = Pages(
        values=rng.exponential(size=(count, len(STATISTICS))).astype(np.float32),
        page_features=rng.standard_normal((count, PAGE_FEATURES)),
        design=np.arange(count),
        kind=np.array(["", "streak", "", "scum"] * (count // 4)),
        press=np.zeros(count, np.int64),
    )
    model = learn_model(pages, names=STATISTICS, scatter=Scatter.white(), rng=rng, screened=True, trees=6)
    return fit_for(
        model,
        ReferenceScores(pages=np.array([20, 40]), worst=np.sort(rng.standard_normal((2, 50)))),
        pages.rows(~pages.bad),
        np.zeros(count // 2, bool),
        false_alarm_rate=0.1,
        misprint_rate=0.01,
    )


def read_press(path: Path) -> None:
    """Load it, and judge a page that nobody would take; what calls it good does so by finite numbers."""
    from prooflight.errors import ScanError
    from prooflight.inspection.inspector import Inspector
    from prooflight.press.artefact import Press

    press = Press.load(path)
    for name in ("chi-square", "bayes"):
        if name == "bayes" and "bayes" not in press.detectors:
            continue
        inspector = Inspector.of(press, name)
        with np.errstate(all="ignore"):
            try:
                verdict = inspector.inspect(
                    inspector.prepare(_page()), _ruined(press), scan_name=path.name
                ).verdict
            except ScanError:  # of another length than this press's scans: refused, as it should be
                continue
        if verdict.verdict == "good":
            assert verdict.score is not None
            assert np.isfinite([verdict.score, verdict.threshold or 0.0, verdict.probability or 0.0]).all()


def _page() -> Page:
    from prooflight.pages.raster import Page

    cmyk = np.zeros((284, 600, 4), np.uint8)
    cmyk[40:240:20, 50:550, 3] = 255
    return Page(cmyk=cmyk, dpi=481.8, name="p0001", number=1)


def _ruined(press: Press) -> np.ndarray:
    lines = press.geometry.lines(_page().height_mm)
    return np.full((len(press.sensors), min(lines, 4000), press.geometry.pixels), 1000, np.uint16)


TARGETS = (Target(name="press", suffix=".press", samples=press_samples, mutate=mutants, read=read_press),)
