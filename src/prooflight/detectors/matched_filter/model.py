"""What one press's good prints taught our detector, and what misprints did: from statistics to one score.

A page's statistics are compared with what good pages of such content give on this press, each family of them is
calibrated by itself, and forests that misprints taught rank pages by all of it; or, where none were seen, how far the
most telling families are out.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import Field

from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.fit.nuisance import PrintPrior, ResidualVariance
from prooflight.detectors.matched_filter.ranking import (
    FOREST,
    Forest,
    every_column,
    family_columns,
    ranked,
    scores_of,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import SCATTER_SHAPES, SIZES, Scatter
from prooflight.detectors.matched_filter.statistics.statistic import Statistic
from prooflight.files.schema import (
    Block,
    Chance,
    Count,
    Kept,
    Misfit,
    Name,
    NotNegative,
    Number,
    check_arrays,
    checked,
    part_of,
    rising,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.statistic import Observed

LEAST_P: Final = 1e-12
MOST: Final = 8
"""Families that say most, of which the score is made that no misprint taught; the k-th counts 1 / k."""
IN_DEVIATIONS: Final = ("white", "lamp", "gain", "gain-all", "gain-rms", "tilt", "dot", "plane")
"""What the fit states in standard deviations of what good prints do, whatever the page is like."""
ARRAYS: Final = ("family", "centre", "baseline", "sd", "shift", "scale", "quantiles", "tail")
MOST_SHAPE: Final = 0.5
"""Of a tail: beyond, its variance would be infinite."""
STATISTIC: Final = r"^[a-z]+(/[^/\s]+)+$"


def compressed(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Statistics of any size -> numbers of about 1: sign(v) log(1 + 3 |v|)."""
    known = _known(values)
    return np.asarray(np.sign(known) * np.log1p(3 * np.abs(known)))


def _known(values: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=1e6, neginf=-1e6)


def in_deviations(statistics: Sequence[Statistic]) -> NDArray[np.bool_]:
    """Which statistics need no comparison with pages of such content: their scale is what presses do."""
    return np.array([one.family == "fit" and one.mode in IN_DEVIATIONS for one in statistics])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectorModel:
    """What one press's good prints taught, and what misprints did; all arrays, so that a press artefact can hold it."""

    statistics: tuple[Statistic, ...]
    """In the order of ``families.all_statistics``."""
    families: tuple[str, ...]
    """Their causes, sorted."""
    family: NDArray[np.int32]
    """(statistics,) which family each is of."""
    scatter: Scatter
    residual_variance: ResidualVariance
    prior: PrintPrior
    """What its good prints were taken to do before one was looked at."""
    centre: NDArray[np.float64]
    """(2, PAGE_FEATURES) mean and standard deviation of learning pages' features."""
    baseline: NDArray[np.float64]
    """(1 + PAGE_FEATURES, statistics) what a good page of such content gives: linear in its features."""
    sd: NDArray[np.float64]
    """(statistics,) of good pages about it."""
    shift: NDArray[np.float64]
    """(statistics,) how much further out this press's good pages are than those of the baseline, in their ``sd`` ..."""
    scale: NDArray[np.float64]
    """... and how many times as widely they scatter; ``commissioning.training.adapting``."""
    quantiles: NDArray[np.float64]
    """(families, n) of the family's greatest deviation on good pages, at probabilities 0 to ``tail_from``, evenly."""
    tail: NDArray[np.float64]
    """(families, 3) where the tail begins, and scale and shape of a generalised Pareto distribution beyond."""
    tail_from: float
    forest: Forest | None
    """Of ``every_column``: log odds of misprints against good pages; None: no misprint was seen in learning."""
    kinds: tuple[str, ...]
    """Kinds of misprints that were seen in learning."""
    kind_forests: tuple[Forest, ...]
    """For each: log odds against good pages, from ``every_column``."""
    name_forests: tuple[Forest, ...]
    """For each: log odds against all other kinds, from ``family_columns``."""
    threshold: float
    """Of ``score``; infinite until set."""
    good_designs: int
    """By which the threshold was calibrated; a rate below 1 / (n + 1) is an extrapolation."""

    def deviations(
        self, values: NDArray[np.floating], page_features: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Statistics (pages, n) over what this press's good pages of such content give, in standard deviations."""
        mean, sd = self.centre
        x = np.column_stack([np.ones(len(page_features)), ((page_features - mean) / sd).clip(-3, 3)])
        compared = (compressed(values) - x @ self.baseline) / self.sd
        told = np.where(in_deviations(self.statistics), _known(values), compared)
        return np.asarray((told - self.shift) / self.scale)

    def widened(self, times: float) -> DetectorModel:
        """That takes good pages to deviate so many times as widely."""
        return self if times == 1 else replace(self, scale=self.scale * times)

    def family_evidence(self, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
        """-log10 p of every family, (pages, families), from deviations (pages, statistics)."""
        evidence = np.empty((len(deviations), len(self.families)))
        steps = np.linspace(0, self.tail_from, self.quantiles.shape[1])
        for index in range(len(self.families)):
            greatest = deviations[:, self.family == index].max(axis=1)
            begin, scale, shape = self.tail[index]
            p = 1 - np.interp(greatest, self.quantiles[index], steps)
            far = greatest > begin
            beyond = 1 + shape * (greatest[far] - begin) / scale
            p[far] = (1 - self.tail_from) * beyond ** (-1 / shape)
            evidence[:, index] = -np.log10(np.maximum(p, LEAST_P))
        return evidence

    def guard(self, evidence: NDArray[np.floating]) -> NDArray[np.float64]:
        """The score that no misprint taught: (pages,)."""
        most = -np.sort(-evidence, axis=1)[:, :MOST]
        return np.asarray(most @ (1 / np.arange(1, most.shape[1] + 1)))

    def score(self, values: NDArray[np.floating], page_features: NDArray[np.floating]) -> NDArray[np.float64]:
        """Evidence for a misprint, higher is worse: (pages,); NaN where a family's is no finite number."""
        deviations = self.deviations(values, page_features)
        evidence = self.family_evidence(deviations)
        score = self._summed(evidence, page_features, deviations)
        return np.where(np.isfinite(evidence).all(axis=1), score, np.nan)

    def _summed(
        self,
        evidence: NDArray[np.float64],
        page_features: NDArray[np.floating],
        deviations: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        if self.forest is None:
            return self.guard(evidence)
        every = every_column(evidence, page_features, deviations)
        return ranked(self.forest.score(every), self.of_kinds(every), evidence)

    def of_kinds(self, every: NDArray[np.floating]) -> NDArray[np.float64]:
        """How much rows of ``every_column`` look like each kind rather than a good page: (pages, kinds) log odds."""
        return scores_of(self.kind_forests, every)

    def kinds_of(self, values: NDArray[np.floating], page_features: NDArray[np.floating]) -> list[str]:
        """The kind of misprint that each page looks like most; empty where none was seen in learning."""
        if not self.name_forests:
            return [""] * len(values)
        columns = family_columns(self.family_evidence(self.deviations(values, page_features)))
        return [self.kinds[index] for index in scores_of(self.name_forests, columns).argmax(axis=1)]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What an artefact keeps as tensors."""
        found: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in ARRAYS}
        found |= {f"scatter.{name}": getattr(self.scatter, name) for name in (*SCATTER_SHAPES, "light")}
        forests = {} if self.forest is None else {"forest": self.forest}
        for of, those in (("kind", self.kind_forests), ("name", self.name_forests)):
            forests |= {f"{of}{index}": forest for index, forest in enumerate(those)}
        for which, forest in forests.items():
            found |= {f"{which}.{name}": getattr(forest, name) for name in FOREST}
        return found

    def facts(self) -> dict[str, Any]:
        """The rest: what JSON can hold."""
        # A press that is as others is what it was before there was this.
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
        }

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, under: str = "") -> None:
        """Misfit unless ``from_parts`` makes of them what this version can judge by. under: where they stand."""
        told = checked(ModelFacts, facts, under=under)
        told.check(under)
        forests = dict(_forests_of(told))
        own = {name: array for name, array in arrays.items() if name.split(".")[0] not in forests}
        sizes = told.sizes()
        check_arrays(own, TABLE, sizes, under=under)
        known = {name: at for at, name in enumerate(told.families)}
        if arrays["family"].tolist() != [known[one.cause] for one in told.statistics]:
            raise Misfit(f"{under}family", "must say of which family each statistic is")
        if (arrays["tail"][:, 0] != arrays["quantiles"][:, -1]).any():
            raise Misfit(f"{under}tail", "must begin where quantiles end")
        for which, columns in forests.items():
            Forest.check(part_of(arrays, f"{which}."), sizes[columns], under=f"{under}{which}.")

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """``arrays`` and ``facts`` put together again, which ``check`` has passed."""

        def forest(which: str) -> Forest:
            return Forest(**{name: arrays[f"{which}.{name}"] for name in FOREST})

        return cls(
            **{name: arrays[name] for name in ARRAYS},
            statistics=tuple(map(Statistic.parse, facts["names"])),
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
        )

    def strongest(
        self, statistics: Sequence[Observed], page_features: NDArray[np.floating], *, most: int = 3
    ) -> list[tuple[str, Observed]]:
        """The families that say most of one page, each with its most telling statistic and where that is."""
        values = np.array([[one.value for one in statistics]])
        deviations = self.deviations(values, page_features[None])
        evidence = self.family_evidence(deviations)[0]
        found = []
        for index in np.argsort(-evidence)[:most]:
            members = np.flatnonzero(self.family == index)
            best = members[int(np.argmax(deviations[0, members]))]
            found.append((self.families[index], statistics[best]))
        return found


class ResidualVarianceFacts(Block):
    """``ResidualVariance``; what an older press does not state is as it was then."""

    edge: NotNegative = 0
    contrast: NotNegative = 0
    share: NotNegative = 0
    dark: NotNegative = 0


Deviation = Annotated[float, Field(strict=True, ge=1e-9, le=1e3, allow_inf_nan=False)]


class PriorFacts(Block):
    """``PrintPrior``, likewise."""

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
    column: Deviation = 1
    flicker: Deviation = 1
    turn_deg: Deviation = 1
    stretch_percent: Deviation = 1
    warp_across_um: Deviation = 1
    warp_along_um: Deviation = 1


class ModelFacts(Block):
    """``DetectorModel.facts``."""

    names: Annotated[
        tuple[Annotated[str, Field(max_length=64, pattern=STATISTIC)], ...],
        Field(min_length=1, max_length=10_000),
    ]
    families: tuple[Name, ...]
    spread: ResidualVarianceFacts
    prior: PriorFacts | None = None
    tail_from: Chance
    ranked: Annotated[bool, Field(strict=True)]
    """Whether misprints were seen in learning."""
    kinds: Annotated[tuple[Name, ...], Field(max_length=100)]
    threshold: Number | None
    """None: infinite, not set; JSON knows no infinity."""
    good_designs: Count

    def check(self, under: str) -> None:
        """Misfit unless its parts fit each other."""
        if len(set(self.names)) < len(self.names):
            raise Misfit(f"{under}names", "must differ from each other")
        if list(self.families) != sorted({one.cause for one in self.statistics}):
            raise Misfit(f"{under}families", "must be those of its statistics, sorted")
        if len(set(self.kinds)) < len(self.kinds):
            raise Misfit(f"{under}kinds", "must differ from each other")
        if self.kinds and not self.ranked:
            raise Misfit(f"{under}ranked", "must be true where there are kinds")

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """By their names."""
        return tuple(map(Statistic.parse, self.names))

    def sizes(self) -> dict[str, int]:
        """Extents of arrays, and columns of what rankings look at: as this version counts them."""
        nothing = np.zeros((1, len(self.families)))
        page_features, deviations = np.zeros((1, PAGE_FEATURES)), np.zeros((1, len(self.names)))
        return {
            "statistics": len(self.names),
            "families": len(self.families),
            "every": every_column(nothing, page_features, deviations).shape[1],
            "of families": family_columns(nothing).shape[1],
        }


def _forests_of(facts: ModelFacts) -> Iterator[tuple[str, Literal["every", "of families"]]]:
    """Names of the forests, and which columns each looks at."""
    if not facts.ranked:
        return
    yield "forest", "every"
    for index in range(len(facts.kinds)):
        yield f"kind{index}", "every"
        yield f"name{index}", "of families"


def _wrong_centre(centre: NDArray[np.floating]) -> str:
    return "" if (centre[1] > 0).all() else "must have standard deviations above 0"


def _wrong_tail(tail: NDArray[np.floating]) -> str:
    sound = (tail[:, 1] > 0) & (tail[:, 2] > 0) & (tail[:, 2] < MOST_SHAPE)
    return "" if sound.all() else f"must have scales above 0 and shapes between 0 and {MOST_SHAPE}"


TABLE: Final = {
    "family": Kept(dtype="int32", shape=("statistics",), low=0),
    "centre": Kept(dtype="float64", shape=(2, PAGE_FEATURES), rule=_wrong_centre),
    "baseline": Kept(dtype="float64", shape=(1 + PAGE_FEATURES, "statistics")),
    "sd": Kept(dtype="float64", shape=("statistics",), above=0),
    "shift": Kept(dtype="float64", shape=("statistics",)),
    "scale": Kept(dtype="float64", shape=("statistics",), above=0),
    "quantiles": Kept(dtype="float64", shape=("families", "quantiles"), rule=rising),
    "tail": Kept(dtype="float64", shape=("families", 3), rule=_wrong_tail),
    **{
        f"scatter.{name}": Kept(dtype="float64", shape=(*shape, 3), low=0)
        for name, shape in SCATTER_SHAPES.items()
    },
    "scatter.light": Kept(dtype="float64", shape=(len(SIZES),), above=0),
}
