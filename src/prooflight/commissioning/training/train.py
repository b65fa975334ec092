"""A press's detectors, taught on simulated prints before it has printed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.training.learn import (
    Pages,
    certain_score,
    learn_model,
    learn_scatter,
    pooled,
)
from prooflight.commissioning.training.simulated_days import (
    DESIGNS_A_DAY,
    ScatterWork,
    StatisticsWork,
    good_prior,
    good_residual_variance,
)
from prooflight.detectors.false_alarm_rate import GoodScores
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
from prooflight.detectors.paper.bayes import CORRECT, MISPRINT, BayesDetector, BayesianNetwork
from prooflight.errors import RequestError
from prooflight.pages.parallel import in_order
from prooflight.rng import stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from prooflight.commissioning.training.simulated_days import Rows
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs

    Shown = Callable[[Iterable[Rows], int, str], Iterator[Rows]]

LEAST_RANKED: Final = 200
"""Designs from which misprints teach a ranking: with 112 the score that none taught cost less, with 300 more."""
FEWEST: Final = 24
"""Designs below which nothing is worth learning: 6 for scatter, 9 to learn and 9 to calibrate."""
PILOT_SHARE: Final = 1 / 8
PILOT: Final = (6, 40)
BINS: Final = 8
"""Of the paper's network: a few hundred pages do not fill more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Numbers of designs that teach how statistics scatter, that teach all else, and that set the threshold."""

    pilot: range
    learn: range
    tune: range

    @classmethod
    def of(cls, designs: int) -> Plan:
        """So many altogether; RequestError: too few."""
        if designs < FEWEST:
            raise RequestError("designs", f"{designs} teach too little", remedy=f"ask for {FEWEST} or more")
        low, high = PILOT
        pilot = min(max(round(designs * PILOT_SHARE), low), high)
        half = pilot + (designs - pilot) // 2
        return cls(pilot=range(pilot), learn=range(pilot, half), tune=range(half, designs))


def trained(
    press: Press,
    pages: Designs,
    *,
    designs: int,
    seed: int,
    paper: bool = False,
    processes: int | None = None,
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Press:
    """The press with our detector; paper: also with the learned one of the paper.

    designs: how many page designs are printed, on days of their own; an eighth teach how statistics scatter, the rest
    half and half all else and the threshold. With the latter, misprints of half of the designs are printed as
    well, and teach a ranking if there are ``LEAST_RANKED`` designs of them. RequestError: too few designs.
    """
    plan = Plan.of(designs)

    def gathered(work: ScatterWork | StatisticsWork, which: range, what: str) -> Rows:
        days = [tuple(which[at : at + DESIGNS_A_DAY]) for at in range(0, len(which), DESIGNS_A_DAY)]
        rows = in_order(work, days, processes=processes)
        return _joined(shown(rows, len(days), f"learning {what}, {len(which)} designs"))

    drawn = gathered(ScatterWork(press=press, pages=pages, seed=seed), plan.pilot, "scatter")
    scatter = learn_scatter({name: pooled(values) for name, values in drawn.items()})
    good = StatisticsWork(press=press, pages=pages, seed=seed, scatter=scatter, misprints=False)
    if paper:
        both = replace(good, misprints=True, windows=True)
        learn = gathered(both, plan.learn, "good prints and misprints")
    else:
        learn = gathered(good, plan.learn, "good prints")
    tune = gathered(good, plan.tune, "false alarms")
    ours = _ours(press, learn, tune, scatter, stream(seed, "training-ranking"))
    return replace(press, ours=ours, bayes=_bayes(press, learn) if paper else None)


def _ours(
    press: Press, learn: Rows, tune: Rows, scatter: Scatter, rng: np.random.Generator
) -> CalibratedDetector:
    """Learned from the learning rows; what good pages of the tuning rows score sets the threshold."""
    model = learn_model(
        Pages.of(learn),
        names=learn["names"].tolist(),
        scatter=scatter,
        residual_variance=good_residual_variance(press),
        prior=good_prior(press),
        rng=rng,
        ranked=bool((learn["kind"] != "").any()) and np.unique(learn["design"]).size >= LEAST_RANKED,
    )
    return calibrated_for(press, model, tune)


def calibrated_for(press: Press, model: DetectorModel, good: Rows) -> CalibratedDetector:
    """The detector with the threshold that keeps what the press file asks for; good: rows that taught nothing."""
    pages = Pages.of(good)
    score = certain_score(model, pages, good["another"])
    return CalibratedDetector.calibrated(
        model,
        simulated=GoodScores.of(score, pages.design).worst,
        false_alarm_rate=1 / press.good_pages_per_false_alarm,
        misprint_rate=press.costs.misprint_rate,
    )


def _bayes(press: Press, learn: Rows) -> BayesDetector:
    """The paper's network, on all sensors' statistics; it alarms where stopping pays."""
    network = BayesianNetwork.learn(
        learn["windows"].astype(np.float64),
        [MISPRINT if kind else CORRECT for kind in learn["kind"].tolist()],
        misprint_rate=press.costs.misprint_rate,
        bins=BINS,
    )
    return BayesDetector(
        network=network,
        threshold=press.costs.stopping_probability,
        unit=np.ones(len(press.sensors)),
    )


def _joined(pieces: Iterable[Rows]) -> Rows:
    """Rows of all days, one after the other; names once."""
    every = list(pieces)
    return {
        name: every[0][name] if name == "names" else np.concatenate([piece[name] for piece in every])
        for name in every[0]
    }
