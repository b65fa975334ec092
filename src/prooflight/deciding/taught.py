"""What one press's good prints taught our detector, and what misprints did: from statistics to one score.

A page's statistics are compared with what good pages of such content give, each family of them is calibrated by
itself, and families are weighed against each other by what misprints taught; or, where none were seen, by how far the
most telling ones are out.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.comparing.local_evidence import Scatter
from prooflight.comparing.nuisance import Spread, Tolerance
from prooflight.deciding.ranking import (
    Forest,
    Logit,
    Outright,
    every_column,
    family_columns,
    group_columns,
    mixed_columns,
    scores_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.deciding.said import Said

LEAST_P: Final = 1e-12
MOST: Final = 8
"""Families that say most, of which the score is made that no misprint taught; the k-th counts 1 / k."""
WHOLE: Final = ("ghost", "echo", "double", "excess", "swap")
"""First words that name a family."""
ALONE: Final = ("fit", "place", "energy")
"""First words of statistics that are families of their own."""
IN_DEVIATIONS: Final = ("white", "lamp", "gain", "tilt", "dot", "plane")
"""What the fit states in standard deviations of what good prints do, whatever the page is like."""
SCATTER: Final = ("boxes", "streaks", "bands", "ghosts")
FOREST_PARTS: Final = ("column", "cut", "left", "right", "share", "root")


def compressed(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Statistics of any size -> numbers of about 1: sign(v) log(1 + 3 |v|)."""
    known = _known(values)
    return np.asarray(np.sign(known) * np.log1p(3 * np.abs(known)))


def _known(values: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=1e6, neginf=-1e6)


def families_of(names: Sequence[str]) -> list[str]:
    """The family of each statistic: one cause with all its sizes, or a number that stands alone.

    >>> families_of(["box/gain-C+/8", "apart/void-/4", "streak/void/1/full", "ghost/C/0", "place/skew"])
    ['box/gain-C+', 'apart/void-', 'streak/void', 'ghost', 'place/skew']
    """
    found = []
    for name in names:
        first, *rest = name.split("/")
        if first in WHOLE:
            found.append(first)
        elif first in ALONE:
            found.append(name)
        else:
            found.append(f"{first}/{rest[0]}")
    return found


@lru_cache(maxsize=8)
def in_deviations(names: tuple[str, ...]) -> NDArray[np.bool_]:
    """Which statistics need no comparison with pages of such content: their scale is what presses do.

    >>> in_deviations(("fit/gain-C", "fit/shape", "fit/white", "box/gain-C+/8")).tolist()
    [True, False, True, False]
    """
    parts = [name.replace("-", "/").split("/") for name in names]
    return np.array([first == "fit" and rest[0] in IN_DEVIATIONS for first, *rest in parts])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TolerancePress:
    """What one press's good prints taught, and what misprints did; all arrays, so that a press artefact can hold it."""

    names: tuple[str, ...]
    """Of the statistics, in the order of ``families.all_said``."""
    families: tuple[str, ...]
    """Their families' names, sorted."""
    family: NDArray[np.int32]
    """(statistics,) which family each is of."""
    scatter: Scatter
    spread: Spread
    prior: Tolerance
    """What its good prints were taken to do before one was looked at."""
    centre: NDArray[np.float64]
    """(2, PORTRAIT) mean and standard deviation of learning pages' portraits."""
    baseline: NDArray[np.float64]
    """(1 + PORTRAIT, statistics) what a good page of such content gives: linear in its portrait."""
    sd: NDArray[np.float64]
    """(statistics,) of good pages about it."""
    quantiles: NDArray[np.float64]
    """(families, n) of the family's greatest deviation on good pages, at probabilities 0 to ``tail_from``, evenly."""
    tail: NDArray[np.float64]
    """(families, 3) where the tail begins, and scale and shape of a generalised Pareto distribution beyond."""
    tail_from: float
    logit: Logit | None
    """Of ``group_columns``; None: no misprint was seen in learning."""
    forest: Forest | None
    """Of ``every_column``."""
    mix: Logit | None
    """Of ``mixed_columns``."""
    outright: Outright | None
    """Of the mix and ``guard``."""
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
        self, values: NDArray[np.floating], portraits: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Statistics (pages, n) over what good pages of such content give, in standard deviations."""
        mean, sd = self.centre
        x = np.column_stack([np.ones(len(portraits)), ((portraits - mean) / sd).clip(-3, 3)])
        compared = (compressed(values) - x @ self.baseline) / self.sd
        return np.where(in_deviations(self.names), _known(values), compared)

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

    def score(self, values: NDArray[np.floating], portraits: NDArray[np.floating]) -> NDArray[np.float64]:
        """Evidence for a misprint, higher is worse: (pages,)."""
        deviations = self.deviations(values, portraits)
        evidence = self.family_evidence(deviations)
        guard = self.guard(evidence)
        if self.logit is None or self.forest is None or self.mix is None or self.outright is None:
            return guard
        every = every_column(evidence, portraits, deviations)
        summed = self.logit.score(group_columns(evidence, self.families))
        mixed = self.mix.score(mixed_columns(summed, self.forest.score(every), self.of_kinds(every)))
        return self.outright.lifted(mixed, guard)

    def of_kinds(self, every: NDArray[np.floating]) -> NDArray[np.float64]:
        """How much rows of ``every_column`` look like each kind rather than a good page: (pages, kinds) log odds."""
        return scores_of(self.kind_forests, every)

    def kinds_of(self, values: NDArray[np.floating], portraits: NDArray[np.floating]) -> list[str]:
        """The kind of misprint that each page looks like most; empty where none was seen in learning."""
        if not self.name_forests:
            return [""] * len(values)
        columns = family_columns(self.family_evidence(self.deviations(values, portraits)))
        return [self.kinds[index] for index in scores_of(self.name_forests, columns).argmax(axis=1)]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What an artefact keeps as tensors."""
        found: dict[str, NDArray[Any]] = {
            name: getattr(self, name) for name in ("family", "centre", "baseline", "sd", "quantiles", "tail")
        }
        found |= {f"scatter.{name}": getattr(self.scatter, name) for name in SCATTER}
        if self.logit is not None and self.mix is not None:
            found |= {"logit.weights": self.logit.weights, "mix.weights": self.mix.weights}
        forests = {} if self.forest is None else {"forest": self.forest}
        for of, those in (("kind", self.kind_forests), ("name", self.name_forests)):
            forests |= {f"{of}{index}": forest for index, forest in enumerate(those)}
        for which, forest in forests.items():
            found |= {f"{which}.{name}": getattr(forest, name) for name in FOREST_PARTS}
        return found

    def facts(self) -> dict[str, Any]:
        """The rest: what JSON can hold."""
        # A press that is as others is what it was before there was this.
        prior = {} if self.prior == Tolerance() else {"prior": asdict(self.prior)}
        return prior | {
            "names": list(self.names),
            "families": list(self.families),
            "spread": asdict(self.spread),
            "tail_from": self.tail_from,
            "starts": [None if one is None else one.start for one in (self.logit, self.mix)],
            "outright": None if self.outright is None else asdict(self.outright),
            "kinds": list(self.kinds),
            "threshold": self.threshold,
            "good_designs": self.good_designs,
        }

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """``arrays`` and ``facts`` put together again."""

        def forest(which: str) -> Forest:
            return Forest(**{name: arrays[f"{which}.{name}"] for name in FOREST_PARTS})

        def weights(which: str, start: float | None) -> Logit | None:
            return None if start is None else Logit(weights=arrays[f"{which}.weights"], start=start)

        kept = {name: arrays[name] for name in ("family", "centre", "baseline", "sd", "quantiles", "tail")}
        ranked = facts["starts"][0] is not None
        return cls(
            **kept,
            names=tuple(facts["names"]),
            families=tuple(facts["families"]),
            scatter=Scatter(**{name: arrays[f"scatter.{name}"] for name in SCATTER}),
            spread=Spread(**facts["spread"]),
            prior=Tolerance(**facts.get("prior", {})),
            tail_from=facts["tail_from"],
            logit=weights("logit", facts["starts"][0]),
            forest=forest("forest") if ranked else None,
            mix=weights("mix", facts["starts"][1]),
            outright=Outright(**facts["outright"]) if ranked else None,
            kinds=tuple(facts["kinds"]),
            kind_forests=tuple(forest(f"kind{index}") for index in range(len(facts["kinds"]))),
            name_forests=tuple(forest(f"name{index}") for index in range(len(facts["kinds"]))),
            threshold=facts["threshold"],
            good_designs=facts["good_designs"],
        )

    def strongest(
        self, said: Sequence[Said], portrait_: NDArray[np.floating], *, most: int = 3
    ) -> list[tuple[str, Said]]:
        """The families that say most of one page, each with its most telling statistic and where that is."""
        values = np.array([[one.value for one in said]])
        deviations = self.deviations(values, portrait_[None])
        evidence = self.family_evidence(deviations)[0]
        found = []
        for index in np.argsort(-evidence)[:most]:
            members = np.flatnonzero(self.family == index)
            best = members[int(np.argmax(deviations[0, members]))]
            found.append((self.families[index], said[best]))
        return found
