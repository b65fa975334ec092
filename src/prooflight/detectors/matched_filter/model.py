"""Model of one press's good prints and of misprints, which turns a page's statistics into one score.

A page's statistics are compared with those of good pages of such content on this press, and each family of
them is calibrated by itself. Forests trained on misprints rank pages by all of it; without such training the
score is how far the strongest families deviate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.ranking import ARRAYS as FIRST
from prooflight.detectors.matched_filter.ranking import (
    FOREST,
    Forest,
    Screen,
    deviation_at,
    every_column,
    evidence_of,
    family_columns,
    marks_of,
    ranked,
    scores_of,
    screened,
)
from prooflight.detectors.matched_filter.ranking import check as check_screen
from prooflight.detectors.matched_filter.statistics.local_evidence import SCATTER_SHAPES, SIZES, Scatter
from prooflight.detectors.matched_filter.statistics.statistic import Observed, Statistic, values_of
from prooflight.detectors.print_prior import PrintPrior
from prooflight.files.schema import (
    ArraySpec,
    Block,
    Chance,
    Count,
    Misfit,
    Name,
    NotNegative,
    Number,
    check_arrays,
    checked,
    part_of,
    rising,
)

MOST: Final = 8
"""Number of the strongest families that make up the score without training on misprints; the k-th counts 1 /
k."""
AGAINST_GOOD: Final = 0.5
"""Weight of a kind's odds against good pages, relative to its odds against other kinds, in naming it. Of 344
misprints of seed 31 that were not trained on, 75.0 % are named correctly with it, 73.5 % without and 73.5 %
with a weight of 1 (a ranking of 581 pages); by the shipped ranking 68, 65 and 68 of 76 of seed 7."""
IN_DEVIATIONS: Final = ("white", "lamp", "gain", "gain-all", "gain-rms", "tilt", "dot", "plane")
"""Amounts that the fit states in standard deviations of good prints, whatever the page's content."""
ARRAYS: Final = ("family", "centre", "baseline", "sd", "shift", "scale", "quantiles", "tail")
GOOD_EVIDENCE: Final = 2.0
"""-log10 of the share of good pages whose greatest deviation of a family is above the level of ``above_good``: 1 of
100."""
MOST_SHAPE: Final = 0.5
"""Limit of a tail's shape: beyond, its variance would be infinite."""
STATISTIC: Final = r"^[a-z]+(/[^/\s]+)+$"


def compressed(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Compress statistics of any size to numbers of about 1: sign(v) log(1 + 3 |v|)."""
    finite = _finite(values)
    return np.asarray(np.sign(finite) * np.log1p(3 * np.abs(finite)))


def _finite(values: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=1e6, neginf=-1e6)


def in_deviations(statistics: Sequence[Statistic]) -> NDArray[np.bool_]:
    """Return which statistics need no comparison with pages of such content.

    Presses' variation is their scale.
    """
    return np.array([one.family == "fit" and one.mode in IN_DEVIATIONS for one in statistics])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectorModel:
    """Parameters learned from one press's good prints and from misprints.

    They are arrays, so that an artefact can store them.
    """

    statistics: tuple[Statistic, ...]
    """Statistics in the order of ``families.all_statistics``."""
    families: tuple[str, ...]
    """Causes of the statistics, sorted."""
    family: NDArray[np.int32]
    """(statistics,) index of each one's family."""
    scatter: Scatter
    residual_variance: ResidualVariance
    prior: PrintPrior
    """Prior of its good prints."""
    centre: NDArray[np.float64]
    """(2, PAGE_FEATURES) mean and standard deviation of training pages' features."""
    baseline: NDArray[np.float64]
    """(1 + PAGE_FEATURES, statistics) values on a good page of such content: linear in its features."""
    sd: NDArray[np.float64]
    """(statistics,) standard deviation of good pages about the baseline."""
    shift: NDArray[np.float64]
    """(statistics,) offset of this press's good pages from those of the baseline, in their ``sd``."""
    scale: NDArray[np.float64]
    """Ratio of the scatter of this press's good pages to that of the baseline; ``commissioning.training.adapting``."""
    quantiles: NDArray[np.float64]
    """(families, n) quantiles of the family's greatest deviation on good pages, at equidistant probabilities
    0 to ``tail_from``."""
    tail: NDArray[np.float64]
    """(families, 3) beginning of the tail, and scale and shape of a generalised Pareto distribution
    beyond."""
    tail_from: float
    forest: Forest | None
    """Forest on ``every_column`` of all statistics: log odds of misprints against good pages; None: they do
    not decide."""
    kinds: tuple[str, ...]
    """Kinds of misprints in the training data."""
    kind_forests: tuple[Forest, ...]
    """Forest of each kind on ``every_column``: log odds against good pages; kinds are named by it."""
    name_forests: tuple[Forest, ...]
    """Forest of each kind on ``family_columns``: log odds against all other kinds."""
    threshold: float
    """Threshold of ``score``; infinite until set."""
    good_designs: int
    """Number of good designs that calibrated the threshold; a rate below 1 / (n + 1) is an extrapolation."""
    screen: Screen | None = None
    """Ranking by the statistics that are computed for every page, which alone decides; the others explain
    what it calls a misprint. None: all statistics decide."""

    def deviations(
        self, values: NDArray[np.floating], page_features: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return deviations of statistics (pages, n) from this press's good pages of such content. [sd]"""
        mean, sd = self.centre
        x = np.column_stack([np.ones(len(page_features)), ((page_features - mean) / sd).clip(-3, 3)])
        compared = (compressed(values) - x @ self.baseline) / self.sd
        stated = np.where(in_deviations(self.statistics), _finite(values), compared)
        return np.asarray((stated - self.shift) / self.scale)

    def values_at(
        self, deviations: NDArray[np.floating], page_features: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the statistics (n,) of one page that deviate so far, (n,): ``deviations`` inverted."""
        mean, sd = self.centre
        x = np.concatenate([[1.0], ((page_features - mean) / sd).clip(-3, 3)])
        stated = deviations * self.scale + self.shift
        logarithm = stated * self.sd + x @ self.baseline
        return np.where(
            in_deviations(self.statistics), stated, np.sign(logarithm) * np.expm1(np.abs(logarithm)) / 3
        )

    def widened(self, times: float) -> DetectorModel:
        """Return the model with a factor by which good pages are taken to deviate more widely."""
        return self if times == 1 else replace(self, scale=self.scale * times)

    def family_evidence(self, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return -log10 p of every family, (pages, families), from deviations (pages, statistics)."""
        return evidence_of(deviations, self.family, self.quantiles, self.tail, self.tail_from)

    def guard(self, evidence: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the score without training on misprints, (pages,)."""
        most = -np.sort(-evidence, axis=1)[:, :MOST]
        return np.asarray(most @ (1 / np.arange(1, most.shape[1] + 1)))

    def score(self, values: NDArray[np.floating], page_features: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the evidence for a misprint, higher is worse: (pages,).

        With a screen only its own statistics are needed: others may be NaN. NaN if a needed one is not
        finite.
        """
        deviations = self.deviations(values, page_features)
        needed = values if self.screen is None else values[:, self.screen.statistic]
        finite = np.isfinite(needed).all(axis=1)
        score = np.full(len(values), np.nan)
        if not finite.any():
            return score
        if self.screen is not None:
            score[finite] = self.screen.score(deviations[finite], page_features[finite])
        else:
            evidence = self.family_evidence(deviations[finite])
            score[finite] = self._summed(evidence, page_features[finite], deviations[finite])
        return score

    def _summed(
        self,
        evidence: NDArray[np.float64],
        page_features: NDArray[np.floating],
        deviations: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        if self.forest is None:
            return self.guard(evidence)
        every = every_column(evidence, page_features, deviations)
        return ranked(self.forest.score(every), self.of_kinds(every), evidence, marks_of(self.families))

    def of_kinds(self, every: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return each kind's log odds against good pages, (pages, kinds), from rows of ``every_column``."""
        return scores_of(self.kind_forests, every)

    def kinds_of(self, values: NDArray[np.floating], page_features: NDArray[np.floating]) -> list[str]:
        """Return the kind of misprint that is most likely for each page; empty if there was none in training.

        It has the greatest sum of log odds against all other kinds and ``AGAINST_GOOD`` times those against
        good pages.
        """
        if not self.name_forests:
            return [""] * len(values)
        deviations = self.deviations(values, page_features)
        evidence = self.family_evidence(deviations)
        against_good = self.of_kinds(every_column(evidence, page_features, deviations))
        log_odds = scores_of(self.name_forests, family_columns(evidence)) + AGAINST_GOOD * against_good
        return [self.kinds[index] for index in log_odds.argmax(axis=1)]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what an artefact stores as tensors."""
        tensors: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in ARRAYS}
        tensors |= {f"scatter.{name}": getattr(self.scatter, name) for name in (*SCATTER_SHAPES, "light")}
        forests = {} if self.forest is None else {"forest": self.forest}
        of_kinds = [("kind", self.kind_forests), ("name", self.name_forests)]
        if self.screen is not None:
            tensors |= {f"first.{name}": getattr(self.screen, name) for name in FIRST}
            forests["screen"] = self.screen.forest
            of_kinds.append(("screenkind", self.screen.kind_forests))
        for of, those in of_kinds:
            forests |= {f"{of}{index}": forest for index, forest in enumerate(those)}
        for which, forest in forests.items():
            tensors |= {f"{which}.{name}": getattr(forest, name) for name in FOREST}
        return tensors

    def facts(self) -> dict[str, Any]:
        """Return the rest: what JSON can hold."""
        # The default prior is omitted, so that artefacts from before priors were stored stay the same.
        prior = {} if self.prior == PrintPrior() else {"prior": asdict(self.prior)}
        return prior | {
            "names": [one.key for one in self.statistics],
            "families": list(self.families),
            "spread": asdict(self.residual_variance),
            "tail_from": self.tail_from,
            "ranked": self.forest is not None,
            "kinds": list(self.kinds),
            "threshold": self.threshold,
            "good_designs": self.good_designs,
            "screened": self.screen is not None,
        }

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, under: str = "") -> None:
        """Check parts for ``from_parts``.

        Misfit: this version cannot judge by them. under: prefix of their names.
        """
        stated = checked(ModelFacts, facts, under=under)
        stated.check(under)
        forests = dict(_forests_of(stated))
        own = {name: array for name, array in arrays.items() if name.split(".")[0] not in forests}
        sizes = stated.sizes()
        table = TABLE | FIRST_TABLE if stated.screened else TABLE
        check_arrays(own, table, sizes, under=under)
        index_of = {name: at for at, name in enumerate(stated.families)}
        if arrays["family"].tolist() != [index_of[one.cause] for one in stated.statistics]:
            raise Misfit(f"{under}family", "must state the family of each statistic")
        if (arrays["tail"][:, 0] != arrays["quantiles"][:, -1]).any():
            raise Misfit(f"{under}tail", "must begin where quantiles end")
        if stated.screened:
            check_screen(part_of(arrays, "first."), stated.statistics, under=f"{under}first.")
        for which, columns in forests.items():
            Forest.check(part_of(arrays, f"{which}."), sizes[columns], under=f"{under}{which}.")

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """Build a model from ``arrays`` and ``facts`` that ``check`` has passed."""

        def forest(which: str) -> Forest:
            return Forest(**{name: arrays[f"{which}.{name}"] for name in FOREST})

        statistics = tuple(map(Statistic.parse, facts["names"]))
        screen = None
        if facts["screened"]:
            screen = Screen(
                **part_of(arrays, "first."),
                families=screened(statistics)[1],
                tail_from=facts["tail_from"],
                forest=forest("screen"),
                kind_forests=tuple(forest(f"screenkind{index}") for index in range(len(facts["kinds"]))),
            )
        return cls(
            **{name: arrays[name] for name in ARRAYS},
            statistics=statistics,
            families=tuple(facts["families"]),
            scatter=Scatter(**{name: arrays[f"scatter.{name}"] for name in (*SCATTER_SHAPES, "light")}),
            residual_variance=ResidualVariance(**facts["spread"]),
            prior=PrintPrior(**facts.get("prior", {})),
            tail_from=facts["tail_from"],
            forest=forest("forest") if facts["ranked"] else None,
            kinds=tuple(facts["kinds"]),
            kind_forests=tuple(forest(f"kind{index}") for index in range(len(facts["kinds"]))),
            name_forests=tuple(forest(f"name{index}") for index in range(len(facts["kinds"]))),
            threshold=facts["threshold"],
            good_designs=facts["good_designs"],
            screen=screen,
        )

    def strongest(
        self, statistics: Sequence[Observed], page_features: NDArray[np.floating], *, most: int = 3
    ) -> list[tuple[str, Observed]]:
        """Return the strongest families of one page, each with its strongest statistic and where that is.

        statistics: all of the model's, or those of its screen alone.
        """
        deviations = self.deviations(self.vector_of(statistics)[None], page_features[None])
        if self.screen is not None and len(statistics) < len(self.statistics):
            evidence, deviations = self.screen.evidence(deviations)[0], deviations[:, self.screen.statistic]
            families, family = self.screen.families, self.screen.family
        else:
            evidence, families, family = self.family_evidence(deviations)[0], self.families, self.family
        result = []
        # Stable, so that families of equal evidence keep their order.
        for index in np.argsort(-evidence, kind="stable")[:most]:
            members = np.flatnonzero(family == index)
            best = members[int(np.argmax(deviations[0, members]))]
            result.append((families[index], statistics[best]))
        return result

    def above_good(self, observed: Observed, page_features: NDArray[np.floating]) -> float | None:
        """Return by how much a statistic's deviation exceeds what its family shows on 99 of 100 good pages. [sd]

        None: the statistic is none of the model's.
        """
        if observed.statistic not in self.statistics:
            return None
        index = self.statistics.index(observed.statistic)
        values = np.zeros(len(self.statistics))
        values[index] = observed.value
        deviation = self.deviations(values[None], page_features[None])[0, index]
        level = deviation_at(GOOD_EVIDENCE, self.quantiles, self.tail, self.tail_from)[self.family[index]]
        return float(deviation - level)

    def vector_of(self, statistics: Sequence[Observed]) -> NDArray[np.float32]:
        """Return values (n,) of all the model's statistics, with NaN for those that were not computed.

        statistics: all of them, or those of its screen alone. ValueError: they are others.
        """
        which = tuple(one.statistic for one in statistics)
        if which == self.statistics:
            return values_of(statistics)
        if self.screen is None or which != tuple(self.statistics[index] for index in self.screen.statistic):
            raise ValueError("these are not the statistics that the model was trained with")
        values = np.full(len(self.statistics), np.nan, np.float32)
        values[self.screen.statistic] = values_of(statistics)
        return values


class ResidualVarianceFacts(Block):
    """Schema of ``ResidualVariance``; an omitted field of an older press has the value that applied then."""

    edge: NotNegative = 0
    contrast: NotNegative = 0
    share: NotNegative = 0
    dark: NotNegative = 0


Deviation = Annotated[float, Field(strict=True, ge=1e-9, le=1e3, allow_inf_nan=False)]


class PriorFacts(Block):
    """Schema of ``PrintPrior``."""

    white: Deviation = 1
    common: Deviation = 1
    lamp: Deviation = 1
    lamp_length: Deviation = 1
    shape: Deviation = 1
    gain: Deviation = 1
    tilt: Deviation = 1
    dot: Deviation = 1
    plane_mm: Deviation = 1
    most_plane_mm: Deviation = 1
    place: Deviation = 1
    place_near: Deviation = 1
    speck_share: NotNegative = 0
    speck_mm2: NotNegative = 0
    column: Deviation = 1
    flicker: Deviation = 1
    turn_deg: Deviation = 1
    stretch_percent: Deviation = 1
    warp_across_um: Deviation = 1
    warp_along_um: Deviation = 1


class ModelFacts(Block):
    """Schema of ``DetectorModel.facts``."""

    names: Annotated[
        tuple[Annotated[str, Field(max_length=64, pattern=STATISTIC)], ...],
        Field(min_length=1, max_length=10_000),
    ]
    families: tuple[Name, ...]
    spread: ResidualVarianceFacts
    prior: PriorFacts | None = None
    tail_from: Chance
    ranked: Annotated[bool, Field(strict=True)]
    """Whether there is a forest of all statistics."""
    screened: Annotated[bool, Field(strict=True)]
    """Whether there is a screen, which decides."""
    kinds: Annotated[tuple[Name, ...], Field(max_length=100)]
    threshold: Number | None
    """Null if infinite, that is not set, because JSON has no infinity."""
    good_designs: Count

    def check(self, under: str) -> None:
        """Raise Misfit unless its parts are consistent."""
        if len(set(self.names)) < len(self.names):
            raise Misfit(f"{under}names", "must differ from each other")
        if list(self.families) != sorted({one.cause for one in self.statistics}):
            raise Misfit(f"{under}families", "must be those of its statistics, sorted")
        if len(set(self.kinds)) < len(self.kinds):
            raise Misfit(f"{under}kinds", "must differ from each other")
        if self.kinds and not (self.ranked or self.screened):
            raise Misfit(f"{under}ranked", "must be true where there are kinds and no screen")

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Statistics that ``names`` identify."""
        return tuple(map(Statistic.parse, self.names))

    def sizes(self) -> dict[str, int]:
        """Return extents of arrays, and numbers of columns of the rankings, in this version."""
        nothing = np.zeros((1, len(self.families)))
        page_features, deviations = np.zeros((1, PAGE_FEATURES)), np.zeros((1, len(self.names)))
        which, families, _ = screened(self.statistics)
        of_first = every_column(np.zeros((1, len(families))), page_features, deviations[:, which])
        return {
            "statistics": len(self.names),
            "families": len(self.families),
            "every": every_column(nothing, page_features, deviations).shape[1],
            "of families": family_columns(nothing).shape[1],
            "first statistics": len(which),
            "first families": len(families),
            "of first": of_first.shape[1],
        }


def _forests_of(facts: ModelFacts) -> Iterator[tuple[str, Literal["every", "of families", "of first"]]]:
    """Yield the names of the forests, and which columns each one uses."""
    if facts.ranked:
        yield "forest", "every"
    for index in range(len(facts.kinds)):
        yield f"kind{index}", "every"
        yield f"name{index}", "of families"
    if facts.screened:
        yield "screen", "of first"
        for index in range(len(facts.kinds)):
            yield f"screenkind{index}", "of first"


def _wrong_centre(centre: NDArray[np.floating]) -> str:
    return "" if (centre[1] > 0).all() else "must have standard deviations above 0"


def _wrong_tail(tail: NDArray[np.floating]) -> str:
    sound = (tail[:, 1] > 0) & (tail[:, 2] > 0) & (tail[:, 2] < MOST_SHAPE)
    return "" if sound.all() else f"must have scales above 0 and shapes between 0 and {MOST_SHAPE}"


TABLE: Final = {
    "family": ArraySpec(dtype="int32", shape=("statistics",), low=0),
    "centre": ArraySpec(dtype="float64", shape=(2, PAGE_FEATURES), rule=_wrong_centre),
    "baseline": ArraySpec(dtype="float64", shape=(1 + PAGE_FEATURES, "statistics")),
    "sd": ArraySpec(dtype="float64", shape=("statistics",), above=0),
    "shift": ArraySpec(dtype="float64", shape=("statistics",)),
    "scale": ArraySpec(dtype="float64", shape=("statistics",), above=0),
    "quantiles": ArraySpec(dtype="float64", shape=("families", "quantiles"), rule=rising),
    "tail": ArraySpec(dtype="float64", shape=("families", 3), rule=_wrong_tail),
    **{
        f"scatter.{name}": ArraySpec(dtype="float64", shape=(*shape, 3), low=0)
        for name, shape in SCATTER_SHAPES.items()
    },
    "scatter.light": ArraySpec(dtype="float64", shape=(len(SIZES),), above=0),
}
FIRST_TABLE: Final = {
    "first.statistic": ArraySpec(dtype="int32", shape=("first statistics",), low=0),
    "first.family": ArraySpec(dtype="int32", shape=("first statistics",), low=0),
    "first.quantiles": ArraySpec(dtype="float64", shape=("first families", "quantiles"), rule=rising),
    "first.tail": ArraySpec(dtype="float64", shape=("first families", 3), rule=_wrong_tail),
}
