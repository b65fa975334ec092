"""Our detector with its promise: ``DetectorModel`` and the good pages by which its threshold was set."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.detectors.false_alarm_rate import (
    GoodScores,
    PressScores,
    Promise,
    ReferenceScores,
    posterior_bound,
)
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.detectors.verdict import Decision
from prooflight.errors import PressError
from prooflight.files.schema import Block, Chance, Count, Kept, Misfit, check_arrays, checked, part_of, rising

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.statistic import Observed

LEAST_SCORES: Final = 2
"""Of which one begins a tail."""
WRONG_PAGE: Final = 1000.0
"""Score of a scan that shows another page, or its own where no good print lies: above that of any evidence."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPages:
    """What scans of a press's own good pages said: by it the model was adapted to the press."""

    values: NDArray[np.float32]
    """(pages, statistics)"""
    page_features: NDArray[np.float64]
    """(pages, PAGE_FEATURES)"""
    variation: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, len(AMOUNTS), 2), np.float32))
    """(real pages that tell it, AMOUNTS, 2) ``page_variation``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScannedPage:
    """What one page of a job said to our detector."""

    name: str
    score: float
    values: NDArray[np.float32]
    """(statistics,)"""
    page_features: NDArray[np.float64]
    """(PAGE_FEATURES,)"""
    another: bool
    """Whether the scan shows another page."""
    digest: str
    """Of its scan."""
    variation: NDArray[np.float32]
    """(AMOUNTS, 2) ``page_variation``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibratedDetector:
    """A ranking made fit for one press: what its good prints do, and how rarely they alarm."""

    model: DetectorModel
    own: GoodScores
    """Scores of its own good pages, each by what the others of them made fit."""
    references: ReferenceScores
    """Scores of good pages of other presses."""
    pages: GoodPages
    """The press's own, whose scores are ``own``."""
    real: int
    """How many of them are real pages; 0: they are simulated."""
    promise: Promise
    threshold: float
    misprint_rate: float
    """Of the press, before a page is seen. [-]"""
    name: str = "ours"

    @classmethod
    def calibrated(
        cls,
        model: DetectorModel,
        own: GoodScores,
        *,
        references: ReferenceScores,
        pages: GoodPages,
        false_alarm_rate: float,
        misprint_rate: float,
        real: int = 0,
    ) -> Self:
        """The detector with the threshold that keeps ``false_alarm_rate``, or what comes nearest, on these good pages.

        own: of the press's pages; references: of other presses. real: how many of its own are real; the others are
        simulated.
        """
        count = own.worst.size
        scores = PressScores(reference=references.by(count), own=own)
        rate = max(false_alarm_rate, scores.least_rate)
        threshold, by_count = scores.threshold(rate)
        alone = scores.alone(rate)
        promise = Promise(
            rate=rate,
            asked=false_alarm_rate,
            simulated=count - real,
            real=real,
            reference=0 if alone else scores.reference.worst.size,
            conformal=by_count,
        )
        return cls(
            model=model,
            own=own,
            references=references,
            pages=pages,
            real=real,
            promise=promise,
            threshold=threshold,
            misprint_rate=misprint_rate,
        )

    @property
    def scores(self) -> PressScores:
        """Of good pages, by which the threshold was set."""
        return PressScores(reference=self.references.by(self.own.worst.size), own=self.own)

    def decide(self, score: float) -> Decision:
        """Decide by one page's score."""
        p_value = self.scores.p_value(score, self.promise.rate)
        return Decision(
            misprint=bool(score > self.threshold),
            score=float(score),
            threshold=self.threshold,
            p_value=p_value,
            probability=posterior_bound(p_value, self.misprint_rate),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What an artefact keeps as tensors."""
        scores: dict[str, NDArray[Any]] = {
            "reference": self.references.worst,
            "reference_pages": self.references.pages,
            "own": self.own.worst,
        }
        scores |= {"values": self.pages.values, "page_features": self.pages.page_features}
        if len(self.pages.variation):  # absent where no real page was learned from
            scores["variation"] = self.pages.variation
        return scores | {f"tolerance.{name}": array for name, array in self.model.arrays().items()}

    def facts(self) -> dict[str, Any]:
        """The rest: what JSON can hold."""
        model = self.model.facts()
        if not np.isfinite(model["threshold"]):  # JSON knows no infinity; ours stands beside it
            model["threshold"] = None
        return {
            "false_alarm_rate": self.promise.asked,
            "misprint_rate": self.misprint_rate,
            "real": self.real,
            "tolerance": model,
        }

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, under: str = "") -> None:
        """Misfit unless ``from_parts`` makes of them what this version can judge by. under: where they stand."""
        told = checked(CalibratedFacts, facts, under=under)
        mark = "tolerance."
        DetectorModel.check(part_of(arrays, mark), told.tolerance, under=under + mark)
        own = {name: a for name, a in arrays.items() if not name.startswith(mark)}
        sizes = {"statistics": len(told.tolerance["names"]), "features": PAGE_FEATURES}
        check_arrays(own, TABLE, sizes, under=under)
        for name in ("reference", "own"):
            if arrays[name].shape[-1] < LEAST_SCORES:
                raise Misfit(f"{under}{name}", f"holds fewer than {LEAST_SCORES} scores")
        if told.real > arrays["own"].size:
            raise Misfit(f"{under}real", f"is {told.real}, of {arrays['own'].size} pages")

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """``arrays`` and ``facts`` put together again, which ``check`` has passed."""
        told = dict(facts["tolerance"])
        told["threshold"] = np.inf if told["threshold"] is None else told["threshold"]
        return cls.calibrated(
            DetectorModel.from_parts(part_of(arrays, "tolerance."), told),
            GoodScores(worst=arrays["own"]),
            references=ReferenceScores(pages=arrays["reference_pages"], worst=arrays["reference"]),
            false_alarm_rate=facts["false_alarm_rate"],
            misprint_rate=facts["misprint_rate"],
            pages=GoodPages(
                **{name: arrays[name] for name in ("values", "page_features", "variation") if name in arrays}
            ),
            real=facts["real"],
        )


class CalibratedFacts(Block):
    """``CalibratedDetector.facts``."""

    false_alarm_rate: Chance
    misprint_rate: Chance
    real: Count
    tolerance: dict[str, Any]


TABLE: Final = {
    "reference": Kept(dtype="float64", shape=("sizes", "designs"), rule=rising),
    "reference_pages": Kept(dtype="int64", shape=("sizes",), low=1, rule=rising),
    "own": Kept(dtype="float64", shape=("pages",), rule=rising),
    "values": Kept(dtype="float32", shape=("pages", "statistics")),
    "page_features": Kept(dtype="float64", shape=("pages", "features")),
    "variation": Kept(dtype="float32", shape=("told", len(AMOUNTS), 2), absent=True),
}


def looked_up(
    model: DetectorModel, statistics: Sequence[Observed], page_features: NDArray[np.floating]
) -> NDArray[np.float32]:
    """``DetectorModel.laid_out``; PressError if a detector was taught by a version that looked at other statistics, or
    at pages otherwise.
    """
    if page_features.size == model.centre.shape[1]:
        with suppress(ValueError):
            return model.laid_out(statistics)
    what = "its detector was taught by another version"
    raise PressError("press", what, remedy="build it again with `prooflight press build`")


def score_of(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    *,
    another: bool,
) -> float:
    """Evidence for a misprint of one page, from its statistics (n,); NaN if one that is needed is no finite number.

    another: the scan shows another page.
    """
    if not np.isfinite(page_features).all():
        return np.nan
    score = model.score(values[None], page_features[None])[0]
    return float(np.maximum(score, WRONG_PAGE) if another else score)
