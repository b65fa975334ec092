"""Kernels that looking at prints needs, compiled beside the first prints by a process of its own.

Where nothing is compiled yet, a press's first prints take a minute of compiling, one kernel after the other as they are
called: they are printed, found, compared, and what is left is weighed. This process begins behind where pages are
found, and whoever comes to a kernel that it has compiled, or is about to, takes it over.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.training.simulated_days import fitted
from prooflight.detectors.matched_filter.analysis import analyse_found, prepare_page
from prooflight.detectors.matched_filter.calibrated import looked_up, score_of
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.kernels.cache import is_kept
from prooflight.kernels.statistics.forest import shares_of
from prooflight.prediction.predict import predict
from prooflight.registration.register import Registration
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs

MOVED = Placement(shift_mm=(0.1, 0.1), skew_deg=0.01)
"""Of the scan: what is moved needs other kernels than what lies in its place."""


def compile_beside(press: Press, pages: Designs) -> None:
    """Begin, where the last kernel of them was never compiled and there is a processor for it; returns at once.

    The process ends by itself, or with this one. It is given a page: whoever makes the pages need not be picklable.
    """
    if is_kept(shares_of) or (os.cpu_count() or 1) < 2:
        return
    context = multiprocessing.get_context("spawn")
    context.Process(target=_compile, args=(press, fitted(pages.page(0), press.geometry)), daemon=True).start()


def _compile(press: Press, page: Page) -> None:
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C is for whoever started this process
        weigh_unfound(press, page)


def weigh_unfound(press: Press, page: Page) -> float:
    """The ranking's score of a page's own prediction for a scan, as if nobody had found the page in it."""
    sensors, geometry, model = press.sensors, press.geometry, shipped_ranking().model
    expected = predict(page, sensors=sensors, geometry=geometry, threads=1)
    known = prepare_page(
        page, expected, sensors=sensors, geometry=geometry, fringes=press.fringes, glyphs=True
    )
    none = np.zeros((4, 2))
    unfound = Registration(placement=MOVED, found=False, planes_mm=none, plane_parts=none.T)
    scan = np.rint(expected.expected_dn).clip(0).astype(np.uint16)
    analysis = analyse_found(known, scan, unfound, residual_variance=ResidualVariance())
    statistics = all_statistics(analysis.sums, analysis.marks, analysis.fit, unfound, model.scatter)
    return score_of(
        model, looked_up(model, statistics, known.page_features), known.page_features, another=False
    )
