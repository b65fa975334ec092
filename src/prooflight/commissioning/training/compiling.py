"""Compilation of the kernels for analysing prints, in a process of its own while the first prints are made.

Where nothing is compiled yet, a press's first prints take a minute of compiling, one kernel after the other
as they are called: pages are printed, located, compared, and residuals are scored. This process begins after
the location of pages, and a process that comes to a kernel that it has compiled, or is about to, takes it
over.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.training.simulated_days import fitted
from prooflight.detectors.matched_filter.analysis import analyse_registered, prepare_page
from prooflight.detectors.matched_filter.calibrated import score_of, statistics_vector
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.kernels.cache import is_cached
from prooflight.kernels.statistics.forest import shares_of
from prooflight.prediction.predict import predict
from prooflight.registration.register import Registration
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs

MOVED = Placement(shift_mm=(0.1, 0.1), skew_deg=0.01)
"""Placement of the scan: a moved page needs other kernels than one in its place."""


def compile_in_background(press: Press, pages: Designs) -> None:
    """Start the process, where the last kernel was never compiled and there is a processor for it; return at once.

    The process ends by itself, or with this one. It is given a page, so that the source of pages need not be
    picklable.
    """
    if is_cached(shares_of) or (os.cpu_count() or 1) < 2:
        return
    context = multiprocessing.get_context("spawn")
    context.Process(target=_compile, args=(press, fitted(pages.page(0), press.geometry)), daemon=True).start()


def _compile(press: Press, page: Page) -> None:
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C is for whoever started this process
        score_unlocated(press, page)


def score_unlocated(press: Press, page: Page) -> float:
    """Return the ranking's score of a page's own prediction as a scan in which the page was not located."""
    sensors, geometry, model = press.sensors, press.geometry, shipped_ranking().model
    expected = predict(page, sensors=sensors, geometry=geometry, threads=1)
    prepared = prepare_page(
        page, expected, sensors=sensors, geometry=geometry, fringes=press.fringes, glyphs=True
    )
    none = np.zeros((4, 2))
    unlocated = Registration(placement=MOVED, located=False, planes_mm=none, plane_parts=none.T)
    scan = np.rint(expected.expected_dn).clip(0).astype(np.uint16)
    analysis = analyse_registered(prepared, scan, unlocated, residual_variance=ResidualVariance())
    statistics = all_statistics(analysis.sums, analysis.marks, analysis.fit, unlocated, model.scatter)
    return score_of(
        model,
        statistics_vector(model, statistics, prepared.page_features),
        prepared.page_features,
        another=False,
    )
