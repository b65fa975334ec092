"""The calibrated detector: ``DetectorModel``, its false-alarm rate, and the good pages of its threshold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from prooflight.detectors.cost import FLOOR_AREA_MM2
from prooflight.detectors.false_alarm_rate import (
    GoodScores,
    Guarantee,
    Likeness,
    PressScores,
    ReferenceScores,
    posterior_bound,
)
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.glyphs.scoring import (
    GLYPH_SHARE,
    NONE,
    GlyphThreshold,
    ScoredGlyph,
    ScoredPage,
    combined_score,
)
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.detectors.verdict import Decision
from prooflight.detectors.weighted_conformal import LabelledPages
from prooflight.errors import PressError
from prooflight.files.schema import (
    ArraySpec,
    Block,
    Chance,
    Count,
    Misfit,
    check_arrays,
    checked,
    part_of,
    rising,
)

if TYPE_CHECKING:
    from prooflight.detectors.base import StoredArrays
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.detectors.print_prior import PrintPrior

PAGES: Final = ("values", "page_features", "glyphs", "variation")
"""Arrays of ``GoodPages``."""
LEAST_SCORES: Final = 2
"""Minimum number of scores, of which one is needed to begin a tail."""
MAX_RECALIBRATIONS: Final = 1000
"""Maximum number of times that one press may be recalibrated before it is built again."""
FLOOR_SHARE_OF_RATE: Final = 0.1
"""Share of the guaranteed rate that the floor has: fewer of the good pages by which the ranking is evaluated
reach it (docs/results/detector/ranking.md)."""
WRONG_PAGE: Final = 1000.0
"""Score of a scan that shows another page, or its own where no good print is: above that of any evidence."""
KINDS: Final = ("text", "mixed", "photo", "sparse")
SPARSE_BELOW: Final = 0.02
"""Share of the page with ink below which it is sparse. (assumed: a few lines of type)"""
PHOTO_FROM: Final = 0.35
"""Area of tints, summed over inks, from which a page is a photo. (assumed: a picture on half of a page)"""
TEXT_BELOW: Final = 0.12
"""Area of tints below which a page is text: type that the lens blurs counts as tint. (assumed)"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPages:
    """Data from scans of a press's own good pages, by which the model was adapted to the press."""

    values: NDArray[np.float32]
    """(pages, statistics)"""
    page_features: NDArray[np.float64]
    """(pages, PAGE_FEATURES)"""
    glyphs: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(pages,) ``ScoredPage.score`` of each; empty: the pages were learned from before glyphs were
    tested."""
    variation: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, len(AMOUNTS), 2), np.float32))
    """(real pages that determine it, AMOUNTS, 2) ``page_variation``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibratedDetector:
    """A ranking adapted to one press: the variation of its good prints, and their false-alarm rate."""

    model: DetectorModel
    own: GoodScores
    """Scores of its own good pages, each by a model adapted to the others."""
    references: ReferenceScores
    """Scores of good pages of other presses."""
    pages: GoodPages
    """The press's own pages, whose scores are ``own``."""
    real: int
    """Number of them that are real pages; 0: they are simulated."""
    guarantee: Guarantee
    threshold: float
    requested_rate: float
    """False-alarm rate that was requested in training. [-]"""
    trained_rate: float
    """False-alarm rate that was guaranteed then. [-]"""
    trained_threshold: float
    misprint_rate: float
    """Rate of misprints of the press, before a page is seen. [-]"""
    counted: bool = True
    """Whether real pages that simulated ones were told apart from decide alone.

    False: the press learned and was recalibrated before this was tested; its labelled scores rest on that threshold.
    """
    deciding: GoodScores | None = None
    """Scores that set the threshold: those of ``own`` in the world where they reach furthest, for a press of several
    worlds, so that its rate holds in each; None: all do."""
    recalibrations: tuple[LabelledPages, ...] = ()
    """Labelled pages of each recalibration, of which the last applies; empty: the detector was never
    recalibrated."""
    name: str = "matched_filter"

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
        counted: bool = True,
        deciding: GoodScores | None = None,
    ) -> Self:
        """Return the detector with a threshold for ``false_alarm_rate``, or the nearest rate with support.

        own: of the press's pages; references: of other presses. real: number of its own that are real; the
        others are simulated. counted, deciding: see the fields.
        """
        setting = own if deciding is None else deciding
        count = setting.worst.size
        scores = _scores(references, setting, real=real, counted=counted)
        share = _of_ranking(pages)
        rate = max(false_alarm_rate, scores.least_rate / share)
        threshold, by_count = scores.threshold(rate * share)
        alone = scores.alone(rate * share)
        guarantee = Guarantee(
            rate=rate,
            requested_rate=false_alarm_rate,
            simulated=count - real,
            real=real,
            reference=0 if alone else scores.reference.worst.size,
            conformal=by_count,
            likeness=Likeness.of(setting.worst, scores.reference.worst) if real else None,
            kinds=kinds_of(pages.page_features[:real]),
        )
        return cls(
            model=model,
            own=own,
            references=references,
            pages=pages,
            real=real,
            guarantee=guarantee,
            threshold=threshold,
            requested_rate=false_alarm_rate,
            trained_rate=rate,
            trained_threshold=threshold,
            misprint_rate=misprint_rate,
            counted=counted,
            deciding=deciding,
        )

    def recalibrated(self, labelled: LabelledPages) -> Self:
        """Return the detector with the threshold of labelled pages; RequestError: they are too few."""
        return replace(
            self,
            threshold=labelled.threshold,
            guarantee=Guarantee(
                rate=labelled.rate,
                simulated=0,
                real=int(labelled.passed.sum()),
                requested_rate=labelled.rate,
                label_source=str(labelled),
            ),
            recalibrations=(*self.recalibrations, labelled),
        )

    def before_recalibration(self) -> Self | None:
        """Return the detector that ``recalibrated`` was applied to; None: it never was."""
        if not self.recalibrations:
            return None
        detector = self.calibrated(
            self.model,
            self.own,
            references=self.references,
            pages=self.pages,
            false_alarm_rate=self.requested_rate,
            misprint_rate=self.misprint_rate,
            real=self.real,
            counted=self.counted,
            deciding=self.deciding,
        )
        for labelled in self.recalibrations[:-1]:
            detector = detector.recalibrated(labelled)
        return detector

    @property
    def print_prior(self) -> PrintPrior:
        """See ``StatesPrintPrior``."""
        return self.model.prior

    @property
    def trials(self) -> str:
        """See ``StatesTrials``: the share of trial misprints that the ranking caught at this threshold."""
        ranking = shipped_ranking()
        return (
            f"In its trials the ranking caught {ranking.caught(self.threshold):.0%} of {len(ranking.misprints):,} "
            "simulated misprints at this threshold, barely visible ones included; a press may catch less: "
            "docs/results/detector/stress.md."
        )

    @property
    def scores(self) -> PressScores:
        """Scores of good pages that set the threshold."""
        setting = self.own if self.deciding is None else self.deciding
        return _scores(self.references, setting, real=self.real, counted=self.counted)

    @property
    def glyphs(self) -> GlyphThreshold | None:
        """Test of glyphs; None: this press was trained before glyphs were tested."""
        if not self.pages.glyphs.size:
            return None
        return GlyphThreshold(own=self.pages.glyphs, rate=GLYPH_SHARE * self.trained_rate)

    def score_again(self, stored: StoredArrays) -> float:
        """Return a page's score as a whole from its evidence; RequestError: it is not of this detector."""
        model = self.model
        values = stored.array("values", "fiu", (len(model.statistics),))
        page_features = stored.array("page_features", "f", model.centre.shape[1:], finite=True)
        widening = 1.0  # of evidence from before there was any
        if "widening" in stored.stored_arrays:
            widening = max(float(stored.array("widening", "f", (), finite=True)), 1.0)
        return score_of(model.widened(widening), values, page_features, another=stored.wrong_page)

    def wrong_glyphs(self, page: ScoredPage) -> tuple[ScoredGlyph, ...]:
        """Return the glyphs that alarm by themselves, the worst first.

        There are none if the page does not alarm by its glyphs.
        """
        if self.glyphs is None:
            return ()
        threshold = self.glyphs.threshold + max(self.raised, 0.0)
        if page.score <= threshold:
            return ()
        return tuple(one for one in page.glyphs if one.ratio > threshold)

    @property
    def ranking_rate(self) -> float:
        """Share of ``trained_rate`` that the ranking has; the floor and the glyphs have the rest."""
        return _of_ranking(self.pages) * self.trained_rate

    @property
    def raised(self) -> float:
        """Increase of the threshold by labelled pages; negative: a decrease."""
        return self.threshold - self.trained_threshold

    def decide(self, score: float, glyphs: float = NONE, floor_mm2: float = 0.0) -> Decision:
        """Decide by one page's score, ``ScoredPage.score`` of its glyphs and ``FloorFinding.area_mm2``."""
        of_ranking = self.decision(
            score, self.trained_threshold, self.scores.p_value(score, self.ranking_rate)
        )
        return self.decided(of_ranking, glyphs, floor_mm2)

    def decided(self, of_ranking: Decision, glyphs: float, floor_mm2: float = 0.0) -> Decision:
        """Combine a decision at ``trained_threshold``, by ``ranking_rate``, with glyphs and floor.

        With labelled pages the combined score of all tests decides, as the press was trained to compute it:
        the greatest excess of any test over its threshold. Labels do not change that score, so that weighted
        split-conformal prediction (``weighted_conformal``) gives all tests together the labelled pages' rate,
        however they share it. Labels do not raise the floor: what reaches it is a misprint.
        """
        all_tests = self._with_floor(self._of_all_tests(of_ranking, glyphs), floor_mm2)
        if not self.recalibrations:
            return all_tests
        labelled = self.decision(
            all_tests.score, self.threshold, self.recalibrations[-1].p_value(all_tests.score)
        )
        return self._with_floor(labelled, floor_mm2)

    def _of_all_tests(self, decision: Decision, glyphs: float) -> Decision:
        """Return the decision with the p-value of three tests that share a rate (weighted Bonferroni)."""
        if decision.p_value is None:
            return decision
        p_value, score = decision.p_value / _of_ranking(self.pages), decision.score
        if self.glyphs is not None:
            p_value = min(p_value, self.glyphs.p_value(glyphs) / GLYPH_SHARE)
            score = combined_score(score, decision.threshold, glyphs, self.glyphs.threshold)
        return self.decision(score, decision.threshold, min(p_value, 1.0))

    def _with_floor(self, decision: Decision, floor_mm2: float) -> Decision:
        """Return the decision.

        If the floor is reached, its score is raised above its threshold, more for a larger area.
        """
        if floor_mm2 < FLOOR_AREA_MM2 or not np.isfinite(decision.score):
            return decision
        least = decision.threshold + 1 + float(np.log(floor_mm2 / FLOOR_AREA_MM2))
        p_value = 1.0 if decision.p_value is None else decision.p_value
        return self.decision(
            max(decision.score, least), decision.threshold, min(p_value, self.guarantee.rate)
        )

    def decision(self, score: float, threshold: float, p_value: float) -> Decision:
        """Return the decision by a score, which alarms above a threshold."""
        return Decision(
            misprint=bool(score > threshold),
            score=float(score),
            threshold=threshold,
            p_value=p_value,
            probability=posterior_bound(p_value, self.misprint_rate),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what an artefact stores as tensors."""
        scores: dict[str, NDArray[Any]] = {
            "reference": self.references.worst,
            "reference_pages": self.references.pages,
            "own": self.own.worst,
        }
        scores |= {"values": self.pages.values, "page_features": self.pages.page_features}
        if self.deciding is not None:  # absent from presses of one world
            scores["deciding"] = self.deciding.worst
        if len(self.pages.glyphs):  # absent from presses that were trained before glyphs were tested
            scores["glyphs"] = self.pages.glyphs
        if len(self.pages.variation):  # absent if no real page was learned from
            scores["variation"] = self.pages.variation
        for number, labelled in enumerate(self.recalibrations):
            scores |= {f"labelled{number}.{name}": array for name, array in labelled.arrays().items()}
        return scores | {f"tolerance.{name}": array for name, array in self.model.arrays().items()}

    def facts(self) -> dict[str, Any]:
        """Return the rest: what JSON can hold."""
        model = self.model.facts()
        if not np.isfinite(model["threshold"]):  # JSON has no infinity; the calibrated threshold is separate
            model["threshold"] = None
        facts = {
            "false_alarm_rate": self.requested_rate,
            "misprint_rate": self.misprint_rate,
            "real": self.real,
            "tolerance": model,
        }
        if self.recalibrations:  # a press without recalibration keeps its old format
            facts["labelled"] = [labelled.facts() for labelled in self.recalibrations]
            if self.real and self.counted:
                facts["counted"] = True
        return facts

    @staticmethod
    def check(
        arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, sensors: int = 1, under: str = ""
    ) -> None:
        """Check parts for ``from_parts``; its statistics are of any number of sensors.

        Misfit: this version cannot judge by them. under: prefix of their names.
        """
        stated = checked(CalibratedFacts, facts, under=under)
        mark = "tolerance."
        DetectorModel.check(part_of(arrays, mark), stated.tolerance, under=under + mark)
        marks = [f"labelled{number}." for number in range(len(stated.labelled))]
        for label_mark, pages in zip(marks, stated.labelled, strict=True):
            LabelledPages.check(part_of(arrays, label_mark), pages, under=under + label_mark)
        own = {name: a for name, a in arrays.items() if not name.startswith((mark, *marks))}
        sizes = {"statistics": len(stated.tolerance["names"]), "features": PAGE_FEATURES}
        check_arrays(own, TABLE, sizes, under=under)
        for name in ("reference", "own", "deciding"):
            if name in arrays and arrays[name].shape[-1] < LEAST_SCORES:
                raise Misfit(f"{under}{name}", f"holds fewer than {LEAST_SCORES} scores")
        if stated.real > arrays["own"].size:
            raise Misfit(f"{under}real", f"is {stated.real}, of {arrays['own'].size} pages")

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """Build a detector from ``arrays`` and ``facts`` that ``check`` has passed."""
        model_facts = dict(facts["tolerance"])
        model_facts["threshold"] = np.inf if model_facts["threshold"] is None else model_facts["threshold"]
        detector = cls.calibrated(
            DetectorModel.from_parts(part_of(arrays, "tolerance."), model_facts),
            GoodScores(worst=arrays["own"]),
            references=ReferenceScores(pages=arrays["reference_pages"], worst=arrays["reference"]),
            false_alarm_rate=facts["false_alarm_rate"],
            misprint_rate=facts["misprint_rate"],
            pages=GoodPages(**{name: arrays[name] for name in PAGES if name in arrays}),
            real=facts["real"],
            counted=facts.get("counted", not facts.get("labelled")),
            deciding=GoodScores(worst=arrays["deciding"]) if "deciding" in arrays else None,
        )
        for number, pages in enumerate(facts.get("labelled", ())):
            detector = detector.recalibrated(
                LabelledPages.from_parts(part_of(arrays, f"labelled{number}."), pages)
            )
        return detector


def _scores(references: ReferenceScores, own: GoodScores, *, real: int, counted: bool) -> PressScores:
    """Return the scores that set a threshold: real pages' alone where simulated pages were told apart from them."""
    reference = references.by(own.worst.size)
    is_distinct = counted and real > 0 and Likeness.of(own.worst, reference.worst).is_distinct
    return PressScores(reference=reference, own=own, own_only=is_distinct)


def _of_ranking(pages: GoodPages) -> float:
    """Return the share of the guaranteed rate that the ranking has, next to floor and glyphs."""
    return 1 - FLOOR_SHARE_OF_RATE - (GLYPH_SHARE if pages.glyphs.size else 0)


class CalibratedFacts(Block):
    """Schema of ``CalibratedDetector.facts``."""

    false_alarm_rate: Chance
    misprint_rate: Chance
    real: Count
    tolerance: dict[str, Any]
    counted: bool = False
    labelled: Annotated[tuple[dict[str, Any], ...], Field(max_length=MAX_RECALIBRATIONS)] = ()


TABLE: Final = {
    "reference": ArraySpec(dtype="float64", shape=("sizes", "designs"), rule=rising),
    "reference_pages": ArraySpec(dtype="int64", shape=("sizes",), low=1, rule=rising),
    "own": ArraySpec(dtype="float64", shape=("pages",), rule=rising),
    "deciding": ArraySpec(dtype="float64", shape=("deciding pages",), rule=rising, absent=True),
    "values": ArraySpec(dtype="float32", shape=("pages", "statistics")),
    "page_features": ArraySpec(dtype="float64", shape=("pages", "features")),
    "glyphs": ArraySpec(dtype="float64", shape=("pages",), absent=True),
    "variation": ArraySpec(dtype="float32", shape=("varied", len(AMOUNTS), 2), absent=True),
}


def statistics_vector(
    model: DetectorModel, statistics: Sequence[Observed], page_features: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return ``DetectorModel.laid_out``.

    PressError: the detector was trained by a version with other statistics or other page features.
    """
    if page_features.size == model.centre.shape[1]:
        with suppress(ValueError):
            return model.vector_of(statistics)
    what = "its detector was trained by another version"
    raise PressError("press", what, remedy="build it again with `prooflight press build`")


def score_of(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    *,
    another: bool,
) -> float:
    """Return one page's evidence for a misprint, from its statistics (n,); NaN if a needed one is not finite.

    another: whether the scan shows another page.
    """
    if not np.isfinite(page_features).all():
        return np.nan
    score = model.score(values[None], page_features[None])[0]
    return float(np.maximum(score, WRONG_PAGE) if another else score)


def page_kind(page_features: NDArray[np.floating]) -> str:
    """Return the kind, of ``KINDS``, of a page by its features (``fit.modes.page_features``).

    Tints are each ink's area without its solids.
    """
    printed = np.exp(page_features[8]) - 1e-3
    tints = (np.exp(page_features[:4]) - 1e-4 - page_features[4:8]).clip(min=0).sum()
    if printed < SPARSE_BELOW:
        return "sparse"
    if tints >= PHOTO_FROM:
        return "photo"
    return "text" if tints < TEXT_BELOW else "mixed"


def kinds_of(page_features: NDArray[np.floating]) -> tuple[tuple[str, int], ...]:
    """Return how many of these pages (pages, PAGE_FEATURES) are of each kind, in the order of ``KINDS``.

    Empty without pages, and where their features are of another version.
    """
    if not len(page_features) or page_features.shape[1] != PAGE_FEATURES:
        return ()
    counts = Counter(page_kind(row) for row in page_features)
    return tuple((kind, counts[kind]) for kind in KINDS)
