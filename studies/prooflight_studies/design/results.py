"""Errors of each design of a camera, their cost, and the efficient designs, from the rows of the study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.rng import stream
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.baselines import BASELINES
from prooflight_studies.harness.operating import (
    Interval,
    area_under_roc,
    at_threshold,
    bill,
    drawn_clusters,
    least_cost,
    resampled_costs,
)
from prooflight_studies.harness.paper_detectors import bayes_scores, chi_square_scores, chosen_reading, scored

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts
    from prooflight.simulation.worlds import World
    from prooflight_studies.design.choices import Prices
    from prooflight_studies.harness.protocol import Plan
    from prooflight_studies.harness.result_cache import Rows

PAGES: Final = 10_000
BAYES, CHI_SQUARE = "bayes", "chi-square"
OF_BASELINES: Final = {"difference": BASELINES[0], "ssim": BASELINES[3], "variation": BASELINES[5]}
DETECTORS: Final = (BAYES, CHI_SQUARE, *OF_BASELINES)


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateResult:
    """Results of one design in one world, before costs."""

    resampled: NDArray[np.float64]
    """Cost c with resampled press days, the same resamples for every camera, (resamples,). [-]"""
    cost: float
    """Cost c at the press's own alpha, threshold chosen on the tuning pages. [-]"""
    false_alarms: int
    good: int
    missed: int
    bad: int
    area: float
    how: str
    """Reading of the detector, as chosen on the tuning pages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignRow:
    """Costs of one design in one world; money per 10,000 pages."""

    design: str
    world: World
    sensors: int
    pixel_pitch_mm: float
    pages_per_s: float
    """Pages a second: A4, short edge first, without gaps. [1/s]"""
    white_snr: float
    """Signal-to-noise ratio of the first sensor on paper: signal above dark over temporal sigma. [-]"""
    cost: Interval
    """Cost c of equation 7 at the press's alpha. [-]"""
    false_alarms: int
    good: int
    missed: int
    bad: int
    area: float
    error_cents: Interval
    """Cost of false alarms and misses. [cent]"""
    saving_cents: Interval
    """Errors of the first design less those of this one, on the same pages. [cent]"""
    hardware_cents: float
    computing_cents: float
    efficient: bool
    """Whether no other design has both fewer errors and cheaper hardware and computing."""
    how: str

    @property
    def bought_cents(self) -> float:
        """Cost of hardware and computing. [cent]"""
        return self.hardware_cents + self.computing_cents

    @property
    def total_cents(self) -> float:
        """Cost of errors, hardware and computing. [cent]"""
        return self.error_cents.value + self.bought_cents


def design_results(
    rows: Sequence[DesignRow],
    plans: Sequence[Plan],
    *,
    costs: RunningCosts,
    prices: Prices,
    detector: str,
    coarser: float,
    command: str,
) -> dict[str, Any]:
    """Return all figures of the page; command: the one that regenerates it."""
    without = bill(costs, costs.alpha, pages=PAGES)
    return {
        "command": command,
        "worlds": worlds_digest(),
        "detector": detector,
        "coarser": coarser,
        "costs": costs,
        "alpha": costs.alpha,
        "pages": PAGES,
        "without_cents": without.without,
        "stopping_always_cents": without.stopping_always,
        "prices": prices,
        "in_worlds": [
            {
                "plan": plan,
                "days": len(plan.days("test")),
                "rows": [row for row in rows if row.world == plan.world],
            }
            for plan in plans
        ],
    }


def judged(
    sets: dict[str, Rows],
    *,
    frame: int,
    detector: str,
    costs: RunningCosts,
    days: NDArray[np.int64],
    seed: int,
) -> CandidateResult:
    """Train, tune and test one design.

    sets: rows to ``learn``, ``tune`` and ``test``; days: all to test on, rising.
    """
    (tune_score, test_score), how = _scores(sets, frame, detector)
    threshold = least_cost(scored(sets["tune"], tune_score), costs.alpha).threshold
    pages = scored(sets["test"], test_score)
    rates = at_threshold(pages, threshold)
    good, bad = int((~pages.bad).sum()), int(pages.bad.sum())
    # The same draws for every camera; days that left no pages count as drawn, so that differences between two cameras
    # are of the same pages.
    place, drawn = drawn_clusters(pages.day, stream(seed, "bootstrap"), clusters=days)
    return CandidateResult(
        resampled=resampled_costs(pages, costs.alpha, threshold=threshold, place=place, drawn=drawn),
        cost=rates.cost(costs.alpha),
        false_alarms=round(rates.false_alarms * good),
        good=good,
        missed=round(rates.misses * bad),
        bad=bad,
        area=area_under_roc(pages),
        how=how,
    )


def _scores(sets: dict[str, Rows], frame: int, detector: str) -> tuple[list[NDArray[np.float64]], str]:
    """Return the scores of the tuning and of the test pages."""
    others = [sets["tune"], sets["test"]]
    if detector == BAYES:
        reading, _ = chosen_reading(sets["learn"], sets["tune"], frame=frame)
        return bayes_scores(sets["learn"], others, reading, frame=frame), str(reading)
    if detector == CHI_SQUARE:
        return [chi_square_scores(rows, frame=frame) for rows in others], detector
    place = BASELINES.index(OF_BASELINES[detector])
    return [np.asarray(rows["peers"][:, frame, place], np.float64) for rows in others], BASELINES[place]


def cents_per_unit(costs: RunningCosts) -> float:
    """Return the cost of 10,000 pages for a normalised cost of 1. [cent]"""
    return bill(costs, 1.0, pages=PAGES).with_system


def efficient(points: Sequence[tuple[float, float]]) -> list[bool]:
    """Return for each (bought, errors) whether no other is at least as good in both and better in one.

    >>> efficient([(0, 9.0), (5, 4.0), (6, 5.0), (5, 4.0)])
    [True, True, False, True]
    """
    return [
        not any(other[0] <= point[0] and other[1] <= point[1] and other != point for other in points)
        for point in points
    ]
