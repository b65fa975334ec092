"""Figures of the paper's tables from scores, with error bars: one world, one resolution at a time."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.cost import RunningCosts
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.baselines import BASELINES
from prooflight_studies.harness.operating import (
    Interval,
    Scored,
    area_under_roc,
    at_threshold,
    bill,
    bootstrap_cost,
    bootstrap_oracle,
    caught_at,
    least_cost,
    roc,
)
from prooflight_studies.harness.paper_detectors import (
    AS_PRINTED,
    THIRDS,
    bayes_scores,
    chi_square_scores,
    chosen_reading,
    chosen_rows,
    goods_and_bads,
    scored,
    thirds,
)
from prooflight_studies.harness.protocol import FRAMES, JUDGED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight_studies.harness.paper_detectors import NetworkReading
    from prooflight_studies.harness.protocol import Plan
    from prooflight_studies.harness.result_cache import Rows

ALPHAS: Final = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0)
PAPER_PAGES: Final = 300
"""Number of test pages of the paper, on which it also chose its thresholds."""
REPEATS: Final = 200
DEVELOPED_ON: Final = 7
"""Seed of the page designs on which the noise of table 4 was chosen."""
FALSE_ALARM_RATE: Final = 0.01
_AT_TENTH: Final = ALPHAS.index(0.1)
_SHOWN_READINGS: Final = 6
PRINTED: Final = {
    "1 sensor": ("T1, T2", ("3.4e-4", "0.0034", "0.0338", "0.1366", "0.3821", "1.0000")),
    "2 sensors": ("T2", ("2e-5", "0.0002", "0.0020", "0.0204", "0.1562", "0.7809")),
    "2 sensors, one misprint type": ("T3", ("6.7e-5", "6.7e-4", "0.0067", "0.0404", "0.3025", "1.0000")),
    "2 sensors, noise 100%": ("T4", ("7.2e-5", "7.2e-4", "0.0072", "0.0545", "0.1802", "0.7760")),
    "2 sensors, noise 200%": ("T4", ("1.1e-4", "0.0011", "0.0112", "0.0939", "0.4711", "0.8403")),
    "2 sensors, noise 300%": ("T4", ("1.4e-4", "0.0014", "0.0137", "0.0869", "0.6157", "1.0000")),
    "2 sensors, noise 400%": ("T4", ("3.3e-4", "0.0033", "0.0326", "0.2811", "0.9730", "1.0000")),
}
"""The paper's tables 1 to 4: c at each of ``ALPHAS``, as printed."""
BOTH: Final = "2 sensors"
AS_IT_IS, TUNED = "as printed", "tuned"
"""Readings of the learned detector: ``paper_detectors.AS_PRINTED``, or the one that costs least on the tuning pages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectorRow:
    """Results of one detector on the test pages."""

    name: str
    frame: str
    network: str
    """Reading in tables 1 to 4, ``AS_IT_IS`` or ``TUNED``; else ""."""
    oracle: tuple[Interval, ...]
    """Cost c at each of ``ALPHAS``, the threshold chosen on the test pages themselves."""
    honest: tuple[Interval, ...]
    """Cost c at each of ``ALPHAS``, the threshold chosen on the tuning pages."""
    papers: tuple[float, ...]
    """The oracle's c on 300 test pages, as in the paper: mean over 200 draws of 300."""
    area: float
    caught: float
    """Share of misprints caught at 1 % false alarms (oracle)."""
    alarms: tuple[int, ...]
    """False alarms at the honest thresholds."""
    missed: tuple[int, ...]
    """Misprints missed at the honest thresholds."""
    misses_by_kind: dict[str, tuple[float, ...]]
    """Share missed at alpha = 1, by kind and third of severity; NaN where there was none."""
    roc: tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldResult:
    """Results of one plan's rows."""

    plan: Plan
    good: dict[str, int]
    """Number of good scans of each set, at one noise; ``bad``: of misprints."""
    bad: dict[str, int]
    made: dict[str, tuple[int, ...]]
    """Number of test misprints of each kind and third of severity."""
    unmade: dict[str, int]
    """Number of misprints of each kind of which nine draws did not reach the least effect that counts."""
    readings: dict[str, tuple[NetworkReading, ...]]
    """Readings of the tuned detector by frame, chosen on the tuning pages of each noise."""
    tuning: dict[str, dict[NetworkReading, float]]
    """Costs of all readings by frame, on the tuning pages of the first noise, alpha = 1."""
    tables: dict[str, tuple[DetectorRow, ...]]
    """Rows of the paper's tables 1 to 4, by frame."""
    detectors: tuple[DetectorRow, ...]
    """All detectors with two sensors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """One plan at one resolution."""

    pitch_mm: float
    """Pitch of camera pixels on the page. [mm]"""
    press: Press
    result: WorldResult
    seconds: float
    """Wall-clock time, without cached results. [s]"""
    made: int
    """Number of scans made in that time."""


def paper_results(parts: Sequence[Part], *, seed: int, quick: bool) -> dict[str, Any]:
    """Return all figures of the page."""
    costs = RunningCosts()
    nothing = bill(costs, costs.alpha)
    return {
        "seed": seed,
        "developed_on": DEVELOPED_ON,
        "quick": quick,
        "as_printed": str(AS_PRINTED),
        "worlds": worlds_digest(),
        "cores": os.cpu_count(),
        "alphas": ALPHAS,
        "thirds": THIRDS,
        "printed": [
            {"title": title, "table": table, "costs": cells} for title, (table, cells) in PRINTED.items()
        ],
        "costs": costs,
        "alpha": costs.alpha,
        "cents": {
            "without": nothing.without,
            "stopping_always": nothing.stopping_always,
            "papers_one_sensor": bill(costs, 0.0338).with_system,
        },
        "parts": [_of_part(part) for part in parts],
    }


def _of_part(part: Part) -> dict[str, Any]:
    result = part.result
    return {
        "pitch_mm": part.pitch_mm,
        "plan": result.plan,
        "days": len(result.plan.days("test")),
        "press": part.press.digest,
        "seconds": part.seconds,
        "scans": part.made,
        "good": result.good,
        "bad": result.bad,
        "kinds": [
            {"kind": kind, "made": made, "unmade": result.unmade.get(kind, 0)}
            for kind, made in result.made.items()
        ],
        "frames": [
            {
                "frame": frame,
                "readings_of_noises": [str(reading) for reading in result.readings[frame]],
                "rows": [_of_judged(row) for row in rows],
                "less_noise": [
                    noise_title(n, result.plan) for n in result.plan.noises if n < result.plan.noises[0]
                ],
                "orders": _orders(rows, result.plan),
                "readings": [
                    {"reading": str(reading), "cost": cost} for reading, cost in _shown(result.tuning[frame])
                ],
            }
            for frame, rows in result.tables.items()
        ],
        "detectors": [_of_judged(row) for row in result.detectors],
    }


def noise_title(noise: float, plan: Plan) -> str:
    """Return the title of table 4's row of a noise; the plan's first is its 100 %, and lower ones have their own."""
    times = noise / plan.noises[0]
    if times < 1:
        return f"{BOTH}, {noise:g} x our camera's noise"
    return f"{BOTH}, noise {times:.0%}"


def _orders(rows: Sequence[DetectorRow], plan: Plan) -> list[dict[str, Any]]:
    """Return, for each network and choice of thresholds, the alphas at which c rises with noise.

    every: at each step; ends: from 100 % to the most. Noise below 100 % is left out.
    """
    first, others = plan.noises[0], plan.noises[1:]
    titles = [BOTH, *(noise_title(noise, plan) for noise in others if noise > first)]
    if len(titles) == 1:
        return []
    orders = []
    for network in (AS_IT_IS, TUNED):
        of_network = {row.name: row for row in rows if row.network == network}
        for way in ("oracle", "honest"):
            costs = np.array([[c.value for c in getattr(of_network[title], way)] for title in titles])
            rises = {"every": (np.diff(costs, axis=0) > 0).all(axis=0), "ends": costs[-1] > costs[0]}
            orders.append(
                {"network": network, "way": way}
                | {name: np.array(ALPHAS)[where].tolist() for name, where in rises.items()}
            )
    return orders


def _of_judged(row: DetectorRow) -> dict[str, Any]:
    """Return the results of one detector without its curve, with its cents per 10,000 pages at alpha = 0.1."""
    costs = RunningCosts()
    figures = {field.name: getattr(row, field.name) for field in fields(row) if field.name != "roc"}
    return figures | {
        "oracle_cents": bill(costs, row.oracle[_AT_TENTH].value).with_system,
        "honest_cents": bill(costs, row.honest[_AT_TENTH].value).with_system,
    }


def _shown(costs: dict[NetworkReading, float]) -> list[tuple[NetworkReading, float]]:
    """Return the best readings, the best of each kind of windows, reading and binning, and the worst."""
    ranked = sorted(costs, key=lambda reading: costs[reading])
    shown = ranked[:_SHOWN_READINGS]
    for field in ("windows", "reading", "binning", "unit"):
        for value in dict.fromkeys(getattr(reading, field) for reading in costs):
            shown.append(next(reading for reading in ranked if getattr(reading, field) == value))
    unique = dict.fromkeys([*shown, ranked[-1]])
    return [(reading, costs[reading]) for reading in sorted(unique, key=lambda reading: costs[reading])]


def world_result(
    rows: Rows, plan: Plan, *, progress: Callable[[str], None] = lambda _step: None
) -> WorldResult:
    """Train, tune and test on a plan's rows."""
    sets = {of: chosen_rows(rows, plan, of, noise=plan.noises[0]) for of in JUDGED}
    good, bad = goods_and_bads(sets)
    judge = _Comparison(plan=plan, rows=rows, sets=sets)
    readings, tuning, tables, detectors = {}, {}, {}, []
    for frame, name in enumerate(FRAMES[plan.world]):
        progress(f"{plan.world} world, {name}: choosing readings")
        of_noises = [judge.chosen(noise, frame) for noise in plan.noises]
        readings[name], tuning[name] = tuple(reading for reading, _ in of_noises), of_noises[0][1]
        progress(f"{plan.world} world, {name}: judging")
        tables[name] = tuple(judge.paper_rows(frame, name, readings[name]))
        detectors += list(judge.side_by_side(frame, name, readings[name][0]))
    return WorldResult(
        plan=plan,
        good=good,
        bad=bad,
        made=_by_kind(sets["test"], sets["test"]["kind"], len),
        unmade=dict(Counter(rows["unmade_kind"].tolist())),
        readings=readings,
        tuning=tuning,
        tables=tables,
        detectors=tuple(detectors),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Comparison:
    plan: Plan
    rows: Rows
    sets: dict[str, Rows]

    def at(self, noise: float) -> dict[str, Rows]:
        """Return the sets' rows at a noise."""
        return {of: chosen_rows(self.rows, self.plan, of, noise=noise) for of in self.sets}

    def chosen(self, noise: float, frame: int) -> tuple[NetworkReading, dict[NetworkReading, float]]:
        """Return ``chosen_reading`` at a noise."""
        sets = self.at(noise)
        return chosen_reading(sets["learn"], sets["tune"], frame=frame)

    def paper_rows(self, frame: int, name: str, readings: Sequence[NetworkReading]) -> Iterator[DetectorRow]:
        """Yield tables 1 to 4: sensors, types of misprint, noise; readings: of each noise."""
        first, others = self.plan.noises[0], self.plan.noises[1:]
        for title, sensors, types, noise in (
            ("1 sensor", 1, 2, first),
            (BOTH, 2, 2, first),
            (f"{BOTH}, one misprint type", 2, 1, first),
            *((noise_title(noise, self.plan), 2, 2, noise) for noise in others),
        ):
            sets, tuned = self.at(noise), readings[self.plan.noises.index(noise)]
            for network, reading in ((AS_IT_IS, AS_PRINTED), (TUNED, tuned)):
                yield self._bayes(
                    *(title, frame, name, reading), sensors=sensors, types=types, sets=sets, network=network
                )

    def side_by_side(self, frame: int, name: str, reading: NetworkReading) -> Iterator[DetectorRow]:
        """Yield the results of every detector with two sensors."""
        for title, column in (
            ("chi-square", "chi_square"),
            ("chi-square, naive", "chi_square_naive"),
            ("chi-square, worst tile", "chi_square_tile"),
        ):
            scores = [chi_square_scores(self.sets[of], frame=frame, column=column) for of in ("tune", "test")]
            yield self._judged(title, name, self.sets, scores[0], scores[1])
        yield self._bayes("Bayesian network, as printed", frame, name, AS_PRINTED)
        yield self._bayes("Bayesian network, tuned", frame, name, reading)
        for number, peer in enumerate(BASELINES):
            of_peer = [self.sets[of]["peers"][:, frame, number] for of in ("tune", "test")]
            yield self._judged(peer, name, self.sets, of_peer[0], of_peer[1])

    def _bayes(
        self,
        title: str,
        frame: int,
        name: str,
        reading: NetworkReading,
        *,
        sensors: int = 2,
        types: int = 2,
        sets: dict[str, Rows] | None = None,
        network: str = "",
    ) -> DetectorRow:
        sets = sets or self.sets
        tune, test = bayes_scores(
            sets["learn"], (sets["tune"], sets["test"]), reading, frame=frame, sensors=sensors, types=types
        )
        return self._judged(title, name, sets, tune, test, network=network)

    def _judged(
        self,
        title: str,
        frame: str,
        sets: dict[str, Rows],
        tune_score: NDArray[np.float64],
        test_score: NDArray[np.float64],
        *,
        network: str = "",
    ) -> DetectorRow:
        tune, test = scored(sets["tune"], tune_score), scored(sets["test"], test_score)
        rng = stream(self.plan.seed, "bootstrap")  # the same days are drawn for every detector
        chosen = [least_cost(tune, alpha).threshold for alpha in ALPHAS]
        operating = [at_threshold(test, threshold) for threshold in chosen]
        missed = ~(test.score > chosen[ALPHAS.index(1.0)])
        return DetectorRow(
            name=title,
            frame=frame,
            network=network,
            oracle=tuple(bootstrap_oracle(test, ALPHAS, rng=rng)),
            honest=tuple(
                bootstrap_cost(test, alpha, threshold=threshold, rng=rng)
                for alpha, threshold in zip(ALPHAS, chosen, strict=True)
            ),
            papers=_papers_protocol(test, rng),
            area=area_under_roc(test),
            caught=caught_at(test, FALSE_ALARM_RATE),
            alarms=tuple(round(rates.false_alarms * int((~test.bad).sum())) for rates in operating),
            missed=tuple(round(rates.misses * int(test.bad.sum())) for rates in operating),
            misses_by_kind=_by_kind(sets["test"], missed, _share),
            roc=roc(test),
        )


def _papers_protocol(test: Scored, rng: np.random.Generator) -> tuple[float, ...]:
    """Return the least c on 300 pages, half of them misprints, of as many designs as there are; mean over 200 draws."""
    half = min(PAPER_PAGES // 2, int(test.bad.sum()), int((~test.bad).sum()))
    costs = np.empty((REPEATS, len(ALPHAS)))
    for repeat in range(REPEATS):
        drawn = np.concatenate(
            [rng.choice(np.flatnonzero(side), half, replace=False) for side in (test.bad, ~test.bad)]
        )
        pages = test.pages(drawn)
        costs[repeat] = [least_cost(pages, alpha).cost(alpha) for alpha in ALPHAS]
    return tuple(costs.mean(axis=0).tolist())


def _by_kind(
    test: Rows, values: NDArray[Any], of_cell: Callable[[NDArray[Any]], Any]
) -> dict[str, tuple[Any, ...]]:
    """Return ``of_cell`` of the values of each kind's misprints, by thirds of severity."""
    third = thirds(test["severity"])
    return {
        kind: tuple(
            of_cell(values[(test["kind"] == kind) & (third == place)]) for place in range(len(THIRDS))
        )
        for kind in KINDS
    }


def _share(cell: NDArray[np.bool_]) -> float:
    return float(cell.mean()) if cell.size else float("nan")
