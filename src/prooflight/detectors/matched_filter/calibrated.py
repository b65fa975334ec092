"""Our detector with its promise: ``DetectorModel`` and the good pages by which its threshold was set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.detectors.false_alarm_rate import GoodScores, Promise, least_false_alarm_rate, posterior_bound
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.statistics.statistic import values_of
from prooflight.detectors.placing import shows_another
from prooflight.detectors.verdict import Decision
from prooflight.errors import PressError
from prooflight.files.schema import Block, Chance, Kept, Misfit, check_arrays, checked, part_of, rising

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.registration.register import Registration

ENOUGH_REAL: Final = 100
"""Real pages whose own tail is drawn on: 20 in it fix its mean excess to a quarter."""
UPPER: Final = 0.8
"""Quantile from which scores make a tail."""
LEAST_SCORES: Final = 2
"""Of which one begins a tail."""
WRONG_PAGE: Final = 1000.0
"""Score of a scan that shows another page, or its own where no good print lies: above that of any evidence."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibratedDetector:
    """What one press's good prints taught, and how rarely they alarm."""

    model: DetectorModel
    simulated: NDArray[np.float64]
    """(designs,) scores of simulated good pages, the worst of each design, rising."""
    real: NDArray[np.float64]
    """(pages,) scores of real good pages, one a page of a job, rising."""
    promise: Promise
    threshold: float
    misprint_rate: float
    """Of the press, before a page is seen. [-]"""
    name: str = "ours"

    @classmethod
    def calibrated(
        cls,
        model: DetectorModel,
        *,
        simulated: NDArray[np.float64],
        false_alarm_rate: float,
        misprint_rate: float,
        real: NDArray[np.float64] | None = None,
    ) -> Self:
        """The detector with the threshold that keeps ``false_alarm_rate``, or what comes nearest, on these good pages.

        Real pages are like those to come, simulated ones only as like as the press is modelled. So real pages alone
        promise what their number allows, and all else where they are ``ENOUGH_REAL``. Fewer are mixed with simulated
        ones, whose scores are raised and stretched first by as much as the real ones exceed them, never lowered.
        """
        real = np.zeros(0) if real is None else np.sort(real)
        simulated = np.sort(simulated)
        basis = _basis(simulated, real, false_alarm_rate)
        rate = max(false_alarm_rate, basis.least_rate)
        threshold, by_count = basis.threshold(rate)
        alone = _alone(real, false_alarm_rate)
        promise = Promise(
            rate=rate,
            asked=false_alarm_rate,
            simulated=0 if alone else simulated.size,
            real=real.size,
            conformal=by_count and (alone or not real.size),
        )
        return cls(
            model=model,
            simulated=simulated,
            real=real,
            promise=promise,
            threshold=threshold,
            misprint_rate=misprint_rate,
        )

    def decide(self, score: float) -> Decision:
        """Decide by one page's score."""
        p_value = _basis(self.simulated, self.real, self.promise.asked).p_value(score)
        return Decision(
            misprint=bool(score > self.threshold),
            score=float(score),
            threshold=self.threshold,
            p_value=p_value,
            probability=posterior_bound(p_value, self.misprint_rate),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What an artefact keeps as tensors."""
        return {"simulated": self.simulated, "real": self.real} | {
            f"tolerance.{name}": array for name, array in self.model.arrays().items()
        }

    def facts(self) -> dict[str, Any]:
        """The rest: what JSON can hold."""
        model = self.model.facts()
        if not np.isfinite(model["threshold"]):  # JSON knows no infinity; ours stands beside it
            model["threshold"] = None
        return {
            "false_alarm_rate": self.promise.asked,
            "misprint_rate": self.misprint_rate,
            "tolerance": model,
        }

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, under: str = "") -> None:
        """Misfit unless ``from_parts`` makes of them what this version can judge by. under: where they stand."""
        checked(CalibratedFacts, facts, under=under)
        mark = "tolerance."
        check_arrays(
            {name: a for name, a in arrays.items() if not name.startswith(mark)}, TABLE, {}, under=under
        )
        if arrays["simulated"].size < LEAST_SCORES:
            raise Misfit(f"{under}simulated", f"holds fewer than {LEAST_SCORES} scores")
        DetectorModel.check(part_of(arrays, mark), facts["tolerance"], under=under + mark)

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """``arrays`` and ``facts`` put together again, which ``check`` has passed."""
        told = dict(facts["tolerance"])
        told["threshold"] = np.inf if told["threshold"] is None else told["threshold"]
        return cls.calibrated(
            DetectorModel.from_parts(part_of(arrays, "tolerance."), told),
            simulated=arrays["simulated"],
            real=arrays["real"],
            false_alarm_rate=facts["false_alarm_rate"],
            misprint_rate=facts["misprint_rate"],
        )


class CalibratedFacts(Block):
    """``CalibratedDetector.facts``."""

    false_alarm_rate: Chance
    misprint_rate: Chance
    tolerance: dict[str, Any]


TABLE: Final = {
    "simulated": Kept(dtype="float64", shape=("designs",), rule=rising),
    "real": Kept(dtype="float64", shape=("pages",), rule=rising, empty=True),
}


def check_version(
    model: DetectorModel, statistics: Sequence[Observed], page_features: NDArray[np.floating]
) -> None:
    """PressError if a detector was taught by a version that looked at other statistics, or at pages otherwise."""
    same = tuple(one.statistic for one in statistics) == model.statistics
    if not same or page_features.size != model.centre.shape[1]:
        what = "its detector was taught by another version"
        raise PressError("press", what, remedy="build it again with `prooflight press build`")


def page_score(
    model: DetectorModel,
    statistics: Sequence[Observed],
    page_features: NDArray[np.floating],
    found: Registration,
) -> float:
    """Evidence for a misprint of one page, from all that its scan says.

    PressError: the detector was taught by a version that looked at other statistics.
    """
    check_version(model, statistics, page_features)
    return score_of(model, values_of(statistics), page_features, another=shows_another(found))


def score_of(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    *,
    another: bool,
) -> float:
    """The same from a page's statistics (n,), as they are kept; NaN if one of them is no finite number.

    another: the scan shows another page.
    """
    if not (np.isfinite(values).all() and np.isfinite(page_features).all()):
        return np.nan
    score = model.score(values[None], page_features[None])[0]
    return float(np.maximum(score, WRONG_PAGE) if another else score)


def _alone(real: NDArray[np.float64], false_alarm_rate: float) -> bool:
    """Whether real pages decide by themselves."""
    return bool(
        real.size >= ENOUGH_REAL or (real.size and false_alarm_rate >= least_false_alarm_rate(real.size))
    )


def _basis(simulated: NDArray[np.float64], real: NDArray[np.float64], false_alarm_rate: float) -> GoodScores:
    """The good pages that thresholds and p-values rest on."""
    if not real.size:
        return GoodScores(worst=simulated)
    if _alone(real, false_alarm_rate):
        return GoodScores(worst=real)
    begin, of_real = float(np.quantile(simulated, UPPER)), float(np.quantile(real, UPPER))
    excess, real_excess = (
        float((some[some >= at] - at).mean()) for some, at in ((simulated, begin), (real, of_real))
    )
    stretched = begin + (simulated - begin) * max(real_excess / max(excess, 1e-9), 1.0)
    raised = np.where(simulated > begin, stretched, simulated) + max(of_real - begin, 0.0)
    return GoodScores(worst=np.sort(np.concatenate([raised, real])))
