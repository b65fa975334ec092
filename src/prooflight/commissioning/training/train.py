"""Training of a press's detectors on simulated prints before it has printed.

Where nothing is compiled yet, a press's first prints take a minute of compiling, one kernel after the other as they
are called: pages are prepared, printed, located, compared, and residuals are scored. All processes that print come to
each kernel at the same time, so that one compiles and the others wait. A process of its own (``compile_in_background``)
prints a page first, and then begins after the location of pages; a process that comes to a kernel that it has compiled,
or is about to, takes it over.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.commissioning.training.adapting import fit_for
from prooflight.commissioning.training.learn import Pages, learn_scatter, pooled, widest
from prooflight.commissioning.training.simulated_days import (
    Rows,
    ScatterWork,
    StatisticsWork,
    UnitWork,
    days_of,
    fitted,
    good_prior,
    good_residual_variance,
    worlds_of,
)
from prooflight.detectors.matched_filter.analysis import analyse_registered
from prooflight.detectors.matched_filter.calibrated import score_of, statistics_vector
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.paper.bayes import CORRECT, BayesDetector, BayesianNetwork
from prooflight.errors import RequestError
from prooflight.kernels.cache import is_cached
from prooflight.kernels.statistics.forest import shares_of
from prooflight.pages.parallel import Processes, in_order, worker_processes
from prooflight.prediction.predict import predict
from prooflight.registration.register import Registration
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.misprints.kinds import scope_of
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import stated_amounts

if TYPE_CHECKING:
    from prooflight.detectors.entry import TrainedModel
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs

Shown = Callable[[Iterable[Rows], int, str], Iterator[Rows]]

FEWEST: Final = 24
"""Least number of designs for training: 6 for scatter, 18 to calibrate."""
FEWEST_DAYS: Final = 2
"""Least number of days that are distributed to worker processes."""
PILOT_SHARE: Final = 1 / 8
PILOT: Final = (6, 40)
DEFAULT_RATE: Final = 0.01
"""False-alarm rate where the press file states none: as low as the counts support, and no lower."""
BINS: Final = 8
"""Number of bins of the paper's network: a few hundred pages do not fill more."""
MOVED = Placement(shift_mm=(0.1, 0.1), skew_deg=0.01)
"""Placement of the scan: a moved page needs other kernels than one in its place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Numbers of designs that measure the scatter of statistics, and that calibrate on the press's good pages."""

    pilot: range
    calibrate: range

    @classmethod
    def of(cls, designs: int, worlds: int = 1) -> Plan:
        """Divide the designs of each of so many worlds; RequestError: too few."""
        if designs < FEWEST:
            raise RequestError(
                "designs", f"{designs} designs are too few for training", remedy=f"give {FEWEST} or more"
            )
        low, high = PILOT
        pilot = min(max(round(designs * PILOT_SHARE), low), high) * worlds
        return cls(pilot=range(pilot), calibrate=range(pilot, designs * worlds))


def trained(
    press: Press,
    pages: Designs,
    *,
    designs: int,
    seed: int,
    false_alarm_rate: float = DEFAULT_RATE,
    paper: bool = False,
    processes: Processes = None,
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Press:
    """Train a press with the matched-filter detector, the shipped ranking adapted to it.

    paper: also train the paper's learned detector. designs: number of page designs to print in each world that
    the press states, on days of their own; an eighth measure the scatter of statistics, the rest the press's good
    pages, which set the threshold. With ``paper`` the eighth also measure the unit of the paper's statistics, and
    misprints of the rest are printed, which train its network alone. RequestError: too few designs.
    """
    plan = Plan.of(designs, len(stated_amounts(press)))
    if processes != 1:
        compile_in_background(press, pages)
    local = processes if isinstance(processes, int) else None
    with worker_processes(local) as pool:  # for all steps: a process takes seconds to load what it needs

        def gathered(work: ScatterWork | StatisticsWork | UnitWork, which: range, what: str) -> Rows:
            days = days_of(which)
            rows = in_order(work, days, processes=processes, fewest=FEWEST_DAYS, pool=pool)
            return _joined(shown(rows, len(days), f"learning {what}, {len(which)} designs"))

        return _trained(press, pages, plan, gathered, seed=seed, rate=false_alarm_rate, paper=paper)


def _trained(
    press: Press,
    pages: Designs,
    plan: Plan,
    gathered: Callable[[ScatterWork | StatisticsWork | UnitWork, range, str], Rows],
    *,
    seed: int,
    rate: float,
    paper: bool,
) -> Press:
    """Return ``trained``; gathered: the rows of a work for designs, and what is measured."""
    ranking = shipped_ranking()
    drawn = gathered(ScatterWork(press=press, pages=pages, seed=seed), plan.pilot, "scatter")
    scatter = _scatter_of(drawn, plan.pilot, press)
    unit = None
    if paper:
        units = gathered(UnitWork(press=press, pages=pages, seed=seed), plan.pilot, "the paper's unit")
        unit = units["unit"].mean(axis=0)
    work = StatisticsWork(press=press, pages=pages, seed=seed, scatter=scatter, misprints=paper, unit=unit)
    rows = gathered(work, plan.calibrate, "good prints and misprints" if paper else "good prints")
    model = replace(
        ranking.model,
        scatter=scatter,
        residual_variance=good_residual_variance(press),
        prior=good_prior(press),
    )
    good = rows["kind"] == ""
    detector = fit_for(
        model,
        ranking.references,
        replace(Pages.of(rows).rows(good), press=worlds_of(plan.calibrate, len(stated_amounts(press)))),
        rows["another"][good],
        false_alarm_rate=rate,
        misprint_rate=press.costs.misprint_rate,
        glyphs=rows["glyphs"][good],
    )
    models: dict[str, TrainedModel] = {detector.name: detector}
    if unit is not None:
        models["bayes"] = _bayes(press, rows, unit)
    return replace(press, detectors=models)


def _scatter_of(drawn: Rows, designs: range, press: Press) -> Scatter:
    """Return the scatter of the designs' draws, that of each world which the press states at least.

    Together they would have a mean scatter, and prints of the world with more would alarm too often.
    """
    prior, worlds = good_prior(press), len(stated_amounts(press))
    turns = worlds_of(designs, worlds)
    return widest(
        [
            learn_scatter(
                {name: pooled(values[turns == turn]) for name, values in drawn.items()}, prior=prior
            )
            for turn in range(worlds)
        ]
    )


def _bayes(press: Press, learn: Rows, unit: NDArray[np.float64]) -> BayesDetector:
    """Train the paper's network of two types of misprint, on all sensors' statistics; it alarms where stopping pays.

    unit: (sensors,) of the statistics, measured on good pages (errata, equation 4).
    """
    network = BayesianNetwork.learn(
        learn["windows"].astype(np.float64),
        [scope_of(kind) if kind else CORRECT for kind in learn["kind"].tolist()],
        misprint_rate=press.costs.misprint_rate,
        bins=BINS,
    )
    return BayesDetector(network=network, threshold=press.costs.stopping_probability, unit=unit)


def _joined(pieces: Iterable[Rows]) -> Rows:
    """Join the rows of all days, one after the other; names once."""
    every = list(pieces)
    return {
        name: every[0][name] if name == "names" else np.concatenate([piece[name] for piece in every])
        for name in every[0]
    }


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
        # Printing, while those that train are still preparing their first page.
        rng = stream(0, "training-session", 0)
        day = SimulatedDay(press=press, session=Session.draw(stated_amounts(press)[0], press, rng))
        day.recorded(day.seen_in_press(page, rng), rng)
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
