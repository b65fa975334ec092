"""Cost of each detector under each wrong belief, kept and relearned, from the rows of the robustness study."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from scipy import special

from prooflight.detectors.paper.bayes import BayesianNetwork
from prooflight.detectors.paper.evidence import interval_edges, interval_shares
from prooflight.kernels.comparison.one_pass import CODE_STEPS
from prooflight.rng import stream
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.measures import LEAST_MAGNITUDE, MEAN, MEAN_OF_MAGNITUDES, MINIMUM
from prooflight_studies.harness.operating import (
    Interval,
    area_under_roc,
    at_threshold,
    bootstrap_cost,
    caught_at,
    least_cost,
)
from prooflight_studies.harness.paper_detectors import (
    MISPRINT_RATE,
    chosen_rows,
    goods_and_bads,
    scored,
    types_of,
)
from prooflight_studies.harness.protocol import JUDGED
from prooflight_studies.robustness.rows import (
    DIFFERENCE,
    NOTHING,
    SHARE_AS_PRINTED,
    SHARE_KEPT,
    SHARE_LEARNED,
    SIDES,
    SIZES,
    SSIM,
    VARIATION_KEPT,
    VARIATION_LEARNED,
    Disturbance,
    all_disturbances,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.paper.bayes import Binning, Reading
    from prooflight_studies.harness.protocol import Plan
    from prooflight_studies.harness.result_cache import Rows

ALPHA: Final = 1.0
FALSE_ALARM_RATE: Final = 0.01
HARMLESS: Final = 0.05
"""Greatest rise of a cost that the summary calls unmoved."""
CHI_SQUARE, TILE, PRINTED, TUNED = (
    "chi-square",
    "chi-square, worst tile",
    "Bayesian network, as printed",
    "Bayesian network, tuned",
)
OF_BASELINES: Final = {
    "difference, 5 x 5": (DIFFERENCE, DIFFERENCE),
    "SSIM, mean": (SSIM, SSIM),
    "variation model": (VARIATION_KEPT, VARIATION_LEARNED),
}
"""Columns of each baseline's scores, kept and relearned."""
Sets = dict[str, "Rows"]
When = Literal["kept", "relearned"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowReading:
    """One reading of the learned detector's three statistics."""

    side: int = 8
    reading: Reading = "signed"
    own_unit: bool = False
    """Whether the 0.675 is of a unit learned from good pages; else of sigma, as in the paper."""
    bins: int = 16
    binning: Binning = "quantile"

    def __str__(self) -> str:
        unit = "learned unit" if self.own_unit else "sigma as it is"
        return f"{self.side} x {self.side}, {self.reading}, {self.bins} {self.binning} bins, share of {unit}"

    def statistics(self, rows: Rows, place: int, when: When) -> NDArray[np.float64]:
        """Return the statistics (rows, 3 sensors) under the disturbance at ``place``."""
        signed = self.reading == "signed"
        share = (SHARE_KEPT if when == "kept" else SHARE_LEARNED) if self.own_unit else SHARE_AS_PRINTED
        which = [
            MEAN if signed else MEAN_OF_MAGNITUDES,
            MINIMUM if signed else LEAST_MAGNITUDE,
            share,
        ]
        numbers = rows["numbers"][:, place, SIDES.index(self.side)][..., which]
        return np.asarray(numbers.reshape(len(numbers), -1), np.float64)

    def network(self, learn: Rows, place: int, when: When) -> BayesianNetwork:
        """Train the network under the disturbance at ``place``."""
        return BayesianNetwork.learn(
            self.statistics(learn, place, when),
            types_of(learn["kind"], types=2),
            misprint_rate=MISPRINT_RATE,
            bins=self.bins,
            binning=self.binning,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Results of one detector on the test pages."""

    cost: Interval
    """Cost c at alpha = 1, the threshold chosen on the tuning pages."""
    false_alarms: int
    misses: float
    area: float
    """Area under the ROC curve, independent of thresholds. [-]"""
    caught: float
    """Share caught at 1 % false alarms, threshold from the test pages. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """Results of one detector under one disturbance."""

    detector: str
    disturbance: Disturbance
    kept: Outcome
    """Trained, and its threshold chosen, under the right tables."""
    relearned: Outcome
    """Trained, and its threshold chosen, under the wrong tables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SigmaCheck:
    """Comparison of equations 4 and 5 with measurements, for one factor of sigma."""

    factor: float
    predicted: float
    """Pearson's statistic over pixels and sensors on a good page, degrees of freedom included, in closed form."""
    measured: float
    """Mean of the measured statistic over good test pages."""
    score_change: dict[str, float]
    """Greatest change of any test page's log likelihood ratio, for each trained detector, relearned. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustnessResult:
    """Results in one world."""

    plan: Plan
    good: dict[str, int]
    bad: dict[str, int]
    reading: WindowReading
    """Reading of the tuned network, chosen on the tuning pages under the right tables."""
    points: tuple[Point, ...]
    checks: tuple[SigmaCheck, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustnessPart:
    """Results in one world, with the press and pitch of their measurement."""

    press_digest: str
    pitch_mm: float
    result: RobustnessResult


def page_results(parts: Sequence[RobustnessPart], *, command: str) -> dict[str, Any]:
    """Return all figures of the page; command: the one that regenerates it."""
    return {
        "command": command,
        "worlds": worlds_digest(),
        "harmless": HARMLESS,
        "beliefs": list(SIZES),
        "parts": [_of_part(part) for part in parts],
    }


def _of_part(part: RobustnessPart) -> dict[str, Any]:
    result = part.result
    detectors = list(dict.fromkeys(point.detector for point in result.points))
    disturbances = list(dict.fromkeys(point.disturbance for point in result.points))
    ordered = sorted(
        result.points,
        key=lambda point: (disturbances.index(point.disturbance), detectors.index(point.detector)),
    )
    checks = sorted(result.checks, key=lambda check: check.factor)
    return {
        "plan": result.plan,
        "days": len(result.plan.days("test")),
        "pitch_mm": part.pitch_mm,
        "press": part.press_digest,
        "good": result.good,
        "bad": result.bad,
        "reading": str(result.reading),
        "degrees": round(next(check.predicted for check in checks if check.factor == 1)),
        "checks": [
            {
                "factor": check.factor,
                "predicted": check.predicted,
                "measured": check.measured,
                "as_printed": check.score_change[PRINTED],
                "tuned": check.score_change[TUNED],
            }
            for check in checks
        ],
        "rises": [
            _rises(name, [point for point in result.points if point.detector == name]) for name in detectors
        ],
        "points": [
            {
                "belief": str(point.disturbance),
                "detector": point.detector,
                "kept": point.kept,
                "relearned": point.relearned,
            }
            for point in ordered
        ],
    }


def _rises(detector: str, points: Sequence[Point]) -> dict[str, Any]:
    """Return the greatest rise of c over all sizes of each error, relative to no error."""
    start = next(point for point in points if point.disturbance == NOTHING).kept.cost
    rises = []
    for belief in SIZES:
        of_belief = [point for point in points if point.disturbance.belief == belief]
        rises.append(
            {
                when: max(getattr(point, when).cost.value for point in of_belief) - start.value
                for when in ("kept", "relearned")
            }
        )
    return {"detector": detector, "start": start, "rises": rises}


def robustness_result(rows: Rows, plan: Plan) -> RobustnessResult:
    """Train, tune and test under every disturbance."""
    sets: Sets = {of: chosen_rows(rows, plan, of) for of in JUDGED}
    good, bad = goods_and_bads(sets)
    reading = chosen_reading(sets)
    points = tuple(_points(sets, reading, plan.seed))
    return RobustnessResult(
        plan=plan,
        good=good,
        bad=bad,
        reading=reading,
        points=points,
        checks=tuple(_checks(sets, reading)),
    )


def chosen_reading(sets: Sets) -> WindowReading:
    """Return the reading with the least cost on the tuning pages under the right tables, its unit learned."""
    costs = {}
    for side, way, bins, binning in itertools.product(
        SIDES, ("signed", "absolute"), (8, 16, 32), ("quantile", "equal-width")
    ):
        reading = WindowReading(side=side, reading=way, own_unit=True, bins=bins, binning=binning)  # type: ignore[arg-type]
        network = reading.network(sets["learn"], 0, "kept")
        pages = scored(sets["tune"], network.log_ratio(reading.statistics(sets["tune"], 0, "kept")))
        costs[reading] = least_cost(pages, ALPHA).cost(ALPHA)
    return min(costs, key=lambda reading: costs[reading])


def _scorers(
    sets: Sets, reading: WindowReading
) -> dict[str, Callable[[str, int, When], NDArray[np.float64]]]:
    """Return functions by detector: scores of a set of pages under the disturbance at a place, kept or relearned."""

    def column(name: str, nominal: int, own: int) -> Callable[[str, int, When], NDArray[np.float64]]:
        return lambda of, place, when: np.asarray(
            sets[of][name][:, place, nominal if when == "kept" else own], np.float64
        )

    def network(of_reading: WindowReading) -> Callable[[str, int, When], NDArray[np.float64]]:
        networks: dict[tuple[int, When], BayesianNetwork] = {}

        def score(of: str, place: int, when: When) -> NDArray[np.float64]:
            key: tuple[int, When] = (0 if when == "kept" else place, when)
            if key not in networks:
                networks[key] = of_reading.network(sets["learn"], *key)
            return networks[key].log_ratio(of_reading.statistics(sets[of], place, when))

        return score

    return {
        CHI_SQUARE: column("chi_squares", 0, 0),
        TILE: column("chi_squares", 1, 1),
        PRINTED: network(WindowReading()),
        TUNED: network(reading),
        **{name: column("peers", *columns) for name, columns in OF_BASELINES.items()},
    }


def _points(sets: Sets, reading: WindowReading, seed: int) -> Iterator[Point]:
    for name, score in _scorers(sets, reading).items():
        for place, disturbance in enumerate(all_disturbances()):
            outcomes = {}
            for when, tuned_at in (("kept", 0), ("relearned", place)):
                tune = scored(sets["tune"], score("tune", tuned_at, when))  # type: ignore[arg-type]
                threshold = least_cost(tune, ALPHA).threshold
                outcomes[when] = _outcome(sets["test"], score("test", place, when), threshold, seed)  # type: ignore[arg-type]
            yield Point(detector=name, disturbance=disturbance, **outcomes)


def _outcome(test: Rows, score: NDArray[np.float64], threshold: float, seed: int) -> Outcome:
    pages = scored(test, score)
    rates = at_threshold(pages, threshold)
    rng = stream(seed, "bootstrap")  # the same days are drawn for every detector and disturbance
    return Outcome(
        cost=bootstrap_cost(pages, ALPHA, threshold=threshold, rng=rng),
        false_alarms=round(rates.false_alarms * int((~pages.bad).sum())),
        misses=rates.misses,
        area=area_under_roc(pages),
        caught=caught_at(pages, FALSE_ALARM_RATE),
    )


def _checks(sets: Sets, reading: WindowReading) -> Iterator[SigmaCheck]:
    scorers = _scorers(sets, reading)
    test = sets["test"]
    good = test["kind"] == ""
    sensors = test["numbers"].shape[3]
    for place, disturbance in enumerate(all_disturbances()):
        if disturbance.belief not in ("nothing", "sigma factor"):
            continue
        yield SigmaCheck(
            factor=disturbance.size,
            predicted=float(pearson_under(disturbance.size, test["pixels"][good]).mean()) * sensors,
            measured=float(test["chi_squares"][good, place, 0].mean()),
            score_change={
                name: float(
                    np.abs(
                        scorers[name]("test", place, "relearned") - scorers[name]("test", 0, "relearned")
                    ).max()
                )
                for name in (PRINTED, TUNED)
            },
        )


def pearson_under(factor: float, pixels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of Pearson's statistic of one sensor's good pages, for a wrong sigma.

    pixels: of each page; factor: believed sigma over the true one. Then z ~ N(0, 1 / factor^2) falls into interval i
    with probability q_i instead of p_i, and the statistic's mean is sum(q (1 - q) / p) + n sum((q - p)^2 / p): with a
    right sigma the degrees of freedom, else growing with n.
    """
    shares = interval_shares()
    edges = interval_edges() / CODE_STEPS
    wrong = np.diff(special.ndtr(edges * factor), prepend=0.0, append=1.0)
    spread = (wrong * (1 - wrong) / shares).sum()
    return np.asarray(spread + pixels * ((wrong - shares) ** 2 / shares).sum(), np.float64)
