"""Scores of every detector from the rows of a study: the paper's two in their readings, and the baselines."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.paper.bayes import CORRECT, MISPRINT, BayesianNetwork
from prooflight.simulation.misprints.kinds import scope_of
from prooflight_studies.harness.measures import (
    FIRST_SHARE,
    LEAST_MAGNITUDE,
    MEAN,
    MEAN_OF_MAGNITUDES,
    MINIMUM,
    UNITS,
    WINDOWS,
    Windows,
)
from prooflight_studies.harness.operating import Scored, least_cost

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.paper.bayes import Binning, Reading
    from prooflight_studies.harness.protocol import Plan
    from prooflight_studies.harness.result_cache import Rows

THIRDS: Final = ("mild", "middle", "severe")
"""Names of the thirds of the severity range."""
TUNING_ALPHA: Final = 1.0
"""Relative cost of a miss at which readings are compared."""
MISPRINT_RATE: Final = 0.01
"""Assumed share of misprints. It shifts every log odds by the same amount, so that no cost depends on it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkReading:
    """One reading of the paper's learned detector: its windows, statistics and bins."""

    windows: Windows = WINDOWS[1]
    reading: Reading = "signed"
    unit: float = 1.0
    """Unit of the share's limit, which is 0.675 of it."""
    bins: int = 16
    binning: Binning = "quantile"

    def __str__(self) -> str:
        share = "" if self.unit == 1 else f", share below {0.675 * self.unit:g}"
        return f"{self.windows}, {self.reading}, {self.bins} {self.binning} bins{share}"

    def statistics(self, rows: Rows, *, frame: int, sensors: int) -> NDArray[np.float64]:
        """Return the three statistics of the first ``sensors`` sensors, (rows, 3 sensors)."""
        signed = self.reading == "signed"
        which = [
            MEAN if signed else MEAN_OF_MAGNITUDES,
            MINIMUM if signed else LEAST_MAGNITUDE,
            FIRST_SHARE + UNITS.index(self.unit),
        ]
        numbers = rows["windows"][:, frame, :sensors, WINDOWS.index(self.windows)][..., which]
        return np.asarray(numbers.reshape(len(numbers), -1), np.float64)


AS_PRINTED: Final = NetworkReading()
"""The reading of the paper's text, with our choice of 8 x 8 windows and 16 quantile bins where it is silent."""


def all_readings() -> Iterator[NetworkReading]:
    """Yield every reading that is compared."""
    for windows, reading, unit, bins, binning in itertools.product(
        WINDOWS, ("signed", "absolute"), UNITS, (8, 16, 32), ("quantile", "equal-width")
    ):
        yield NetworkReading(windows=windows, reading=reading, unit=unit, bins=bins, binning=binning)  # type: ignore[arg-type]


def types_of(kinds: NDArray[np.str_], *, types: int) -> list[str]:
    """Return the training labels: ``correct``, and one type of misprint or the two scopes of ``worlds.toml``."""
    return [(MISPRINT if types == 1 else scope_of(kind)) if kind else CORRECT for kind in kinds.tolist()]


def learned(learn: Rows, reading: NetworkReading, *, frame: int, sensors: int, types: int) -> BayesianNetwork:
    """Return the network that is trained on the learning rows."""
    return BayesianNetwork.learn(
        reading.statistics(learn, frame=frame, sensors=sensors),
        types_of(learn["kind"], types=types),
        misprint_rate=MISPRINT_RATE,
        bins=reading.bins,
        binning=reading.binning,
    )


def chosen_reading(
    learn: Rows, tune: Rows, *, frame: int
) -> tuple[NetworkReading, dict[NetworkReading, float]]:
    """Return the reading with the least cost on the tuning rows, and the costs of all.

    Costs are those at alpha = 1, with two sensors and two types.
    """
    costs = {}
    for reading in all_readings():
        network = learned(learn, reading, frame=frame, sensors=2, types=2)
        pages = scored(tune, network.log_ratio(reading.statistics(tune, frame=frame, sensors=2)))
        costs[reading] = least_cost(pages, TUNING_ALPHA).cost(TUNING_ALPHA)
    return min(costs, key=lambda reading: costs[reading]), costs


def bayes_scores(
    learn: Rows,
    others: Sequence[Rows],
    reading: NetworkReading,
    *,
    frame: int,
    sensors: int = 2,
    types: int = 2,
) -> list[NDArray[np.float64]]:
    """Return the log likelihood ratio of misprint and correct for each of the other sets of rows."""
    network = learned(learn, reading, frame=frame, sensors=sensors, types=types)
    return [network.log_ratio(reading.statistics(rows, frame=frame, sensors=sensors)) for rows in others]


def chi_square_scores(rows: Rows, *, frame: int, column: str = "chi_square") -> NDArray[np.float64]:
    """Return Pearson's statistic summed over two sensors; p-values would underflow."""
    return np.asarray(rows[column][:, frame, :2].sum(axis=1), np.float64)


def scored(rows: Rows, score: NDArray[np.float64]) -> Scored:
    """Return scores with their labels; rows: with their ``day``, as ``chosen_rows`` returns them."""
    return Scored(score=score, bad=rows["kind"] != "", design=rows["design"], day=rows["day"])


def goods_and_bads(sets: Mapping[str, Rows]) -> tuple[dict[str, int], dict[str, int]]:
    """Return the number of scans of good prints and of misprints in each set."""
    bad = {of: rows["kind"] != "" for of, rows in sets.items()}
    return {of: int((~each).sum()) for of, each in bad.items()}, {
        of: int(each.sum()) for of, each in bad.items()
    }


def thirds(severity: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return the index in ``THIRDS`` of each severity, 0..1."""
    return np.minimum((severity * len(THIRDS)).astype(np.int64), len(THIRDS) - 1)


def chosen_rows(rows: Rows, plan: Plan, of: str, *, noise: float | None = None) -> Rows:
    """Return the rows of a set's designs, with the ``day`` on which each was printed.

    noise: return rows of this noise only.
    """
    designs = plan.designs(of)
    mask = (rows["design"] >= designs.start) & (rows["design"] < designs.stop)
    if noise is not None:
        mask &= rows["noise"] == noise
    chosen = {name: column[mask] for name, column in rows.items() if name != "unmade_kind"}
    return chosen | {"day": plan.day_of(of, chosen["design"])}
