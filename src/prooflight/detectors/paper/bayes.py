"""The paper's learned detector: a Bayesian network on three statistics of window means (section 4.4).

The window means are the error map's. M (misprint or not) <- Mt (correct, or a type of misprint) -> each
statistic. Statistics are independent given Mt; each is cut into bins, and P(bin | Mt) is counted with
Laplace's smoothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import special

from prooflight.detectors.paper.evidence import Evidence, only
from prooflight.detectors.verdict import Decision
from prooflight.files.schema import ArraySpec, Block, Chance, Misfit, Name, check_arrays, checked, rising

if TYPE_CHECKING:
    from prooflight.detectors.base import StoredArrays
    from prooflight.detectors.cost import RunningCosts

Binning = Literal["quantile", "equal-width"]
Reading = Literal["signed", "absolute"]
"""Whether "mean" and "minimum" are of the window means or of their magnitudes. The paper's text allows both
readings."""
SHARE_SIGMAS: Final = 0.675
"""The paper's limit, below which half of the errors of a good page are. [-]"""
MEDIAN_SIGMAS: Final = 0.6745
"""Half of a Gaussian is within this many standard deviations."""
STATISTICS: Final = ("mean", "minimum", "share")
ARRAYS: Final = ("edges", "log_likelihood", "log_type_share")
CORRECT: Final = "correct"
MISPRINT: Final = "misprint"
"""The only type of misprint where types are not distinguished (paper, table 3)."""


def window_statistics(
    means: NDArray[np.float32], *, reading: Reading = "signed", unit: float | NDArray[np.float64] = 1.0
) -> NDArray[np.float64]:
    """Return mean, minimum and share below 0.675 of window means (..., rows, columns): (..., 3).

    The share is of magnitudes in either reading: signed errors below 0.675 would be three quarters of a good
    page, not the half that the number stands for. unit: one standard deviation, (...) or one for all; the
    paper's is 1. With a unit learned from good pages all three are invariant to an error of sigma by any one
    factor (paper, equation 4); with 1, the share is not.
    """
    scaled = means / np.asarray(unit, np.float64)[..., None, None]
    magnitude = np.abs(scaled)
    counted = scaled if reading == "signed" else magnitude
    place = (-2, -1)
    return np.stack(
        [counted.mean(axis=place), counted.min(axis=place), (magnitude < SHARE_SIGMAS).mean(axis=place)],
        axis=-1,
    )


def window_unit(means: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the scatter of window means (..., rows, columns): median magnitude over a Gaussian's, (...).

    It is 1 if sigma is right; a sigma that is wrong by a factor gives its inverse.
    """
    return np.asarray(np.median(np.abs(means), axis=(-2, -1)) / MEDIAN_SIGMAS, np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BayesianNetwork:
    """Counted probabilities; statistics are (..., n) arrays, with n as in training."""

    types: tuple[str, ...]
    """``correct`` first, then the types of misprint."""
    edges: NDArray[np.float64]
    """(n, bins - 1) inner edges of each statistic's bins, rising; a value on an edge is in the bin above."""
    log_likelihood: NDArray[np.float64]
    """(types, n, bins) log P(bin | type)."""
    log_type_share: NDArray[np.float64]
    """(types - 1,) log P(type | misprint), as in learning."""
    misprint_rate: float
    """P(misprint) before the page is seen. [-]"""
    binning: Binning

    @classmethod
    def learn(
        cls,
        statistics: NDArray[np.float64],
        labels: Sequence[str],
        *,
        misprint_rate: float,
        bins: int = 16,
        binning: Binning = "quantile",
        smoothing: float = 1.0,
    ) -> Self:
        """Count the bins of pages in each class.

        Parameters
        ----------
        statistics : (pages, n) statistics of the pages.
        labels : ``correct`` or a type of misprint, one for each page.
        misprint_rate : prior probability of a misprint.
        bins : number of bins of each statistic.
        binning : quantile bins contain equally many training pages each; equal-width ones extend from the least to the
            greatest value in training.
        smoothing : pages added to every bin (Laplace: 1).

        Raises
        ------
        ValueError
            There is no correct page, no misprint, a statistic that is not finite, fewer than 2 bins, or a misprint_rate
            that is no probability.
        """
        _check(statistics, labels, misprint_rate, bins)
        kinds = np.asarray(labels)
        types = (CORRECT, *sorted(set(kinds.tolist()) - {CORRECT}))
        edges = _edges(statistics, bins, binning)
        place = _bins_of(statistics, edges)
        counts = np.stack(
            [[np.bincount(column, minlength=bins) for column in place[kinds == kind].T] for kind in types]
        )
        smooth = counts + smoothing
        of_type = np.array([(kinds == kind).sum() for kind in types[1:]], np.float64)
        return cls(
            types=types,
            edges=edges,
            log_likelihood=np.log(smooth / smooth.sum(axis=-1, keepdims=True)),
            log_type_share=np.log(of_type / of_type.sum()),
            misprint_rate=misprint_rate,
            binning=binning,
        )

    def log_ratio(self, statistics: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return log P(statistics | misprint) / P(statistics | correct) of (..., n): (...); higher is worse.

        NaN where a statistic is not finite, because it is in no bin.
        """
        place = _bins_of(statistics, self.edges)
        of_type = np.moveaxis(self.log_likelihood[:, np.arange(len(self.edges)), place].sum(axis=-1), 0, -1)
        of_misprint = special.logsumexp(of_type[..., 1:] + self.log_type_share, axis=-1)
        finite = np.isfinite(statistics).all(axis=-1)
        return np.where(finite, of_misprint - of_type[..., 0], np.nan)

    def posterior(self, statistics: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probability of a misprint given statistics (..., n): (...)."""
        return np.asarray(special.expit(self.log_ratio(statistics) + special.logit(self.misprint_rate)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BayesDetector:
    """The network as a detector of pages, on the disjoint 8 x 8 windows of the evidence."""

    network: BayesianNetwork
    """Network that was trained on the statistics of all sensors, concatenated."""
    threshold: float
    """Probability of a misprint above which a page alarms; ``cost.RunningCosts`` gives the most economical
    one. [-]"""
    unit: NDArray[np.float64]
    """(sensors,) see ``window_statistics``."""
    reading: Reading = "signed"
    name: str = "bayes"

    @property
    def false_alarm_rate(self) -> None:
        """See ``EvidenceDetector``."""

    @property
    def guarantee(self) -> str:
        """See ``EvidenceDetector``."""
        return "none: a page alarms where stopping costs less than letting pass"

    def stored_arrays(self, evidence: Evidence) -> dict[str, NDArray[Any]]:
        """See ``EvidenceDetector``."""
        return {"block_z": evidence.block_z}

    def evidence_of(self, stored: StoredArrays, *, sensors: int) -> Evidence:
        """See ``EvidenceDetector``."""
        return only(block_z=stored.array("block_z", "f", (sensors, None, None), finite=True))

    def decide(self, evidence: Evidence) -> Decision:
        """Decide on one page; score and threshold are log odds, which do not saturate as probabilities do."""
        statistics = window_statistics(evidence.block_z, reading=self.reading, unit=self.unit).ravel()
        score = float(self.network.log_ratio(statistics) + special.logit(self.network.misprint_rate))
        threshold = float(special.logit(self.threshold))
        return Decision(
            misprint=score > threshold,
            score=score,
            threshold=threshold,
            p_value=None,
            probability=float(special.expit(score)),
        )

    def at_costs(self, costs: RunningCosts) -> Self:
        """Return the detector with the most economical threshold of these costs."""
        return replace(self, threshold=costs.stopping_probability)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return what an artefact stores as tensors."""
        tables = {name: np.ascontiguousarray(getattr(self.network, name)) for name in ARRAYS}
        return tables | {"unit": np.ascontiguousarray(self.unit, np.float64)}

    def facts(self) -> dict[str, Any]:
        """Return the rest: what JSON can hold."""
        return {
            "types": list(self.network.types),
            "misprint_rate": self.network.misprint_rate,
            "binning": self.network.binning,
            "threshold": self.threshold,
            "reading": self.reading,
        }

    @staticmethod
    def check(
        arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, sensors: int, under: str = ""
    ) -> None:
        """Check parts for ``from_parts``.

        Misfit: they cannot judge so many sensors. under: prefix of their names.
        """
        stated = checked(BayesFacts, facts, under=under)
        if stated.types[0] != CORRECT or len(set(stated.types)) < len(stated.types):
            raise Misfit(f"{under}types", f"must be {CORRECT} and kinds of misprints, each once")
        sizes = {"sensors": sensors, "statistics": sensors * len(STATISTICS), "types": len(stated.types)}
        if arrays.get("edges", np.zeros(0)).ndim == 2:
            sizes["bins"] = arrays["edges"].shape[1] + 1
        check_arrays(arrays, TABLE, sizes | {"misprints": sizes["types"] - 1}, under=under)

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[np.float64]], facts: Mapping[str, Any]) -> Self:
        """Build a detector from ``arrays`` and ``facts`` that ``check`` has passed."""
        return cls(
            network=BayesianNetwork(
                types=tuple(facts["types"]),
                misprint_rate=float(facts["misprint_rate"]),
                binning=facts["binning"],
                **{name: arrays[name] for name in ARRAYS},
            ),
            threshold=float(facts["threshold"]),
            unit=arrays["unit"],
            reading=facts["reading"],
        )


class BayesFacts(Block):
    """Schema of ``BayesDetector.facts``."""

    types: Annotated[tuple[Name, ...], Field(min_length=2, max_length=100)]
    misprint_rate: Chance
    binning: Binning
    threshold: Chance
    reading: Reading


def _no_distribution(logarithms: NDArray[np.floating]) -> str:
    sums = np.exp(logarithms).sum(axis=-1)
    return (
        "" if np.allclose(sums, 1, rtol=0, atol=1e-6) else "must be logarithms of probabilities that sum to 1"
    )


TABLE: Final = {
    "edges": ArraySpec(dtype="float64", shape=("statistics", "edges"), rule=rising),
    "log_likelihood": ArraySpec(
        dtype="float64", shape=("types", "statistics", "bins"), high=0, rule=_no_distribution
    ),
    "log_type_share": ArraySpec(dtype="float64", shape=("misprints",), high=0, rule=_no_distribution),
    "unit": ArraySpec(dtype="float64", shape=("sensors",), above=0),
}


def _check(statistics: NDArray[np.float64], labels: Sequence[str], misprint_rate: float, bins: int) -> None:
    message = ""
    if statistics.ndim != 2 or len(statistics) != len(labels):
        message = (
            f"statistics must be (pages, n) with a label a page, got {statistics.shape} and {len(labels)}"
        )
    elif CORRECT not in labels or set(labels) == {CORRECT}:
        message = "needs correct pages and misprints to learn from"
    elif not np.isfinite(statistics).all():
        message = "statistics hold values that are not finite"
    elif bins < 2:
        message = f"bins must be at least 2, got {bins}"
    elif not 0 < misprint_rate < 1:
        message = f"misprint_rate must be between 0 and 1, got {misprint_rate}"
    if message:
        raise ValueError(message)


def _edges(statistics: NDArray[np.float64], bins: int, binning: Binning) -> NDArray[np.float64]:
    shares = np.linspace(0, 1, bins + 1)[1:-1]
    if binning == "quantile":
        # Edges are values of the data, not interpolated, so that bins are invariant to monotonic scaling.
        return np.ascontiguousarray(np.quantile(statistics, shares, axis=0, method="higher").T)
    low, high = statistics.min(axis=0), statistics.max(axis=0)
    return np.ascontiguousarray(low[:, None] + (high - low)[:, None] * shares)


def _bins_of(statistics: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the bin of each value, (..., n)."""
    if statistics.shape[-1] != len(edges):
        message = f"learned from {len(edges)} statistics, got {statistics.shape[-1]}"
        raise ValueError(message)
    columns = np.moveaxis(statistics, -1, 0)
    return np.stack(
        [
            np.searchsorted(of_one, column, side="right")
            for of_one, column in zip(edges, columns, strict=True)
        ],
        axis=-1,
    )
