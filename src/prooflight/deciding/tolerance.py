"""Our detector: what good prints of a press do is taken out of a scan, and what is left is weighed family by family.

A page's statistics (``families``) are compared with what good pages of such content give, each family is calibrated
by itself on good pages that taught nothing else, and a ranking learned from misprints may come on top.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.acquiring.placement import IN_PLACE
from prooflight.comparing.binning import (
    binned_geometry,
    binned_prediction,
    binned_scan,
    binned_sensors,
    bins_of,
    thinned,
)
from prooflight.comparing.local_evidence import Scatter, summed
from prooflight.comparing.modes import Modes, moved, portrait, prepare_modes, sight
from prooflight.comparing.nuisance import (
    Spread,
    Tolerance,
    fit_nuisances,
    page_colours,
)
from prooflight.comparing.register import prepare, register
from prooflight.comparing.residuals import in_register, residual_images
from prooflight.comparing.shared import SharedPrediction, planes_taken
from prooflight.deciding.families import all_said
from prooflight.deciding.trees import Forest, Trees
from prooflight.predicting.predict import predict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.acquiring.geometry import ScanGeometry
    from prooflight.comparing.local_evidence import Sums
    from prooflight.comparing.nuisance import Colours, Fit
    from prooflight.comparing.register import Landmarks, Registration
    from prooflight.deciding.families import Said
    from prooflight.pages.raster import Page
    from prooflight.predicting.predict import Prediction
    from prooflight.predicting.tables import SensorModel

LEAST_P: Final = 1e-12
MOST: Final = 8
"""Families that say most, of which the score is made that no misprint taught; the k-th counts 1 / k."""
RANKS: Final = (0, 2, 5, 10, 20, 40)
"""Of the families by what they say, beside the families themselves in what the ranking looks at."""
FOREST: Final = 1.5
"""Weight of the forest's log odds, which are bounded, beside those of the boosted trees."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedPage:
    """A design ready for its scans."""

    page: Page
    landmarks: Landmarks
    images: NDArray[np.float32]
    """``Modes.stack`` of the page in its place, in binned pixels."""
    shared: SharedPrediction | None
    """What copies share; None: each is predicted where it lies, which takes longer and errs less on fine detail."""
    colours: Colours
    portrait: NDArray[np.float64]


def prepare_page(
    page: Page,
    expected: Prediction,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    sharing: bool = False,
) -> PreparedPage:
    """All that is known of a design ahead of its scans; expected: its prediction in its place.

    sharing: copies share that prediction, moved to where each lies, instead of one each.
    """
    bins = bins_of(geometry)
    at, taken_as = binned_geometry(geometry, bins), binned_sensors(sensors, bins, geometry.pixel_pitch_mm)
    modes = prepare_modes(thinned(page, bins), sensors=taken_as, geometry=at)
    inside = sight(page, at, IN_PLACE).inside
    shared = None
    if sharing:
        shared = SharedPrediction.of(page, expected, sensors=sensors, geometry=geometry, bins=bins)
    return PreparedPage(
        page=page,
        landmarks=prepare(page, expected, sensors=sensors, geometry=geometry),
        images=modes.stack(),
        shared=shared,
        colours=page_colours(modes.cover),
        portrait=portrait(modes, inside),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Looked:
    """What one scan says, before anything is decided."""

    found: Registration
    fit: Fit
    sums: Sums
    noise: NDArray[np.float64]
    """(sensors,) true temporal variance over the prediction's. [-]"""


def look(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    tolerance: Tolerance | None = None,
    spread: Spread | None = None,
) -> Looked:
    """Find the page in a scan (sensors, lines, pixels), take out what good prints do, sum up what is left."""
    page, spread = prepared.page, spread or Spread()
    bins = bins_of(geometry)
    at, taken_as = binned_geometry(geometry, bins), binned_sensors(sensors, bins, geometry.pixel_pitch_mm)
    found = register(prepared.landmarks, scan)
    where = sight(page, at, found.placement)
    if prepared.shared is None:
        printed, planes_mm = in_register(page, found.planes_mm)
        fine = predict(printed, sensors=sensors, geometry=geometry, placement=found.placement, threads=1)
        seen = binned_prediction(fine, bins)
    else:
        taken_mm, planes_mm = planes_taken(found.planes_mm)
        seen = prepared.shared.seen(where, taken_mm / at.pixel_pitch_mm, sensors=taken_as)
    modes = Modes.unstacked(moved(prepared.images, where), len(sensors))
    measured = binned_scan(scan, bins)
    fit = fit_nuisances(
        measured,
        seen,
        modes,
        where,
        sensors=taken_as,
        colours=prepared.colours,
        planes=planes_mm / at.pixel_pitch_mm,
        pixel_mm=at.pixel_pitch_mm,
        tolerance=tolerance or Tolerance(),
        spread=spread,
    )
    left, weight, of_edges, noise = residual_images(
        measured, seen, modes, where, fit, sensors=taken_as, colours=prepared.colours, spread=spread
    )
    sums = summed(
        left,
        weight,
        of_edges,
        seen,
        modes,
        where,
        sensors=taken_as,
        geometry=at,
        page_width_mm=page.width_mm,
    )
    return Looked(found=found, fit=fit, sums=sums, noise=noise)


WHOLE: Final = ("ghost", "echo", "double", "excess", "swap")
"""First words that name a family."""


def compressed(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Statistics of any size -> numbers of about 1: sign(v) log(1 + 3 |v|)."""
    known = np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=1e6, neginf=-1e6)
    return np.asarray(np.sign(known) * np.log1p(3 * np.abs(known)))


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
        elif first in ("fit", "place", "energy"):
            found.append(name)
        else:
            found.append(f"{first}/{rest[0]}")
    return found


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
    centre: NDArray[np.float64]
    """(2, PORTRAIT) mean and standard deviation of learning pages' portraits."""
    baseline: NDArray[np.float64]
    """(1 + PORTRAIT, statistics) what a good page of such content gives: linear in its portrait."""
    sd: NDArray[np.float64]
    """(statistics,) of good pages about it."""
    quantiles: NDArray[np.float64]
    """(families, n) of the family's greatest deviation on good pages, at probabilities 0 to ``tail_from``, evenly."""
    tail: NDArray[np.float64]
    """(families, 2) where the tail begins, and the scale of a generalised Pareto distribution beyond."""
    tail_from: float
    tail_shape: float
    """Of all families' tails."""
    trees: Trees | None
    """Ranking; None: no misprint was seen in learning."""
    family_trees: Trees | None
    """Ranking from family p-values alone."""
    forest: Forest | None
    """The same by a forest."""
    kinds: tuple[str, ...]
    """Kinds of misprints that were seen in learning."""
    kind_trees: tuple[Trees, ...]
    """For each: log odds against all other kinds, from family p-values."""
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
        return np.asarray((compressed(values) - x @ self.baseline) / self.sd)

    def family_evidence(self, deviations: NDArray[np.floating]) -> NDArray[np.float64]:
        """-log10 p of every family, (pages, families), from deviations (pages, statistics)."""
        evidence = np.empty((len(deviations), len(self.families)))
        steps = np.linspace(0, self.tail_from, self.quantiles.shape[1])
        for index in range(len(self.families)):
            greatest = deviations[:, self.family == index].max(axis=1)
            begin, excess = self.tail[index]
            p = 1 - np.interp(greatest, self.quantiles[index], steps)
            far = greatest > begin
            beyond = 1 + self.tail_shape * (greatest[far] - begin) / excess
            p[far] = (1 - self.tail_from) * beyond ** (-1 / self.tail_shape)
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
        if self.trees is None or self.family_trees is None or self.forest is None:
            return self.guard(evidence)
        families = family_columns(evidence)
        columns = ranked_columns(values, deviations, portraits, families)
        boosted = self.trees.score(columns) + self.family_trees.score(families)
        return boosted + FOREST * self.forest.score(families)

    def kinds_of(self, values: NDArray[np.floating], portraits: NDArray[np.floating]) -> list[str]:
        """The kind of misprint that each page looks like most; empty where none was seen in learning."""
        if not self.kind_trees:
            return [""] * len(values)
        families = family_columns(self.family_evidence(self.deviations(values, portraits)))
        said = np.stack([trees.score(families) for trees in self.kind_trees])
        return [self.kinds[index] for index in said.argmax(axis=0)]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What an artefact keeps as tensors."""
        found: dict[str, NDArray[Any]] = {
            name: getattr(self, name) for name in ("family", "centre", "baseline", "sd", "quantiles", "tail")
        }
        found |= {f"scatter.{name}": getattr(self.scatter, name) for name in SCATTER}
        for which in ("trees", "family_trees"):
            trees = getattr(self, which)
            if trees is not None:
                found |= {f"{which}.{name}": getattr(trees, name) for name in TREES}
        if self.forest is not None:
            found |= {f"forest.{name}": getattr(self.forest, name) for name in FOREST_PARTS}
        for name in TREES if self.kind_trees else ():
            found[f"kinds.{name}"] = np.stack([getattr(trees, name) for trees in self.kind_trees])
        return found

    def facts(self) -> dict[str, Any]:
        """The rest: what JSON can hold."""
        return {
            "names": list(self.names),
            "families": list(self.families),
            "spread": {
                "edge": self.spread.edge,
                "contrast": self.spread.contrast,
                "share": self.spread.share,
                "dark": self.spread.dark,
            },
            "tail_from": self.tail_from,
            "tail_shape": self.tail_shape,
            "kinds": list(self.kinds),
            "kind_starts": [trees.start for trees in self.kind_trees],
            "starts": [None if trees is None else trees.start for trees in (self.trees, self.family_trees)],
            "threshold": self.threshold,
            "good_designs": self.good_designs,
        }

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """``arrays`` and ``facts`` put together again."""

        def trees(which: str, start: float | None) -> Trees | None:
            if start is None:
                return None
            return Trees(start=start, **{name: arrays[f"{which}.{name}"] for name in TREES})

        forest = None
        if facts["starts"][0] is not None:
            forest = Forest(**{name: arrays[f"forest.{name}"] for name in FOREST_PARTS})
        kept = {name: arrays[name] for name in ("family", "centre", "baseline", "sd", "quantiles", "tail")}
        return cls(
            **kept,
            names=tuple(facts["names"]),
            families=tuple(facts["families"]),
            scatter=Scatter(**{name: arrays[f"scatter.{name}"] for name in SCATTER}),
            spread=Spread(**facts["spread"]),
            tail_from=facts["tail_from"],
            tail_shape=facts["tail_shape"],
            forest=forest,
            kinds=tuple(facts["kinds"]),
            kind_trees=tuple(
                Trees(start=start, **{name: arrays[f"kinds.{name}"][index] for name in TREES})
                for index, start in enumerate(facts["kind_starts"])
            ),
            trees=trees("trees", facts["starts"][0]),
            family_trees=trees("family_trees", facts["starts"][1]),
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


SCATTER: Final = ("boxes", "streaks", "bands", "ghosts")
TREES: Final = ("column", "cut", "leaf")
FOREST_PARTS: Final = ("column", "cut", "left", "right", "share", "root")


def family_columns(evidence: NDArray[np.floating]) -> NDArray[np.float64]:
    """What every family says, and how much the first, third, ... of them, whichever it is."""
    ranks = [rank for rank in RANKS if rank < evidence.shape[1]]
    return np.hstack([evidence, -np.sort(-evidence, axis=1)[:, ranks]])


def ranked_columns(
    values: NDArray[np.floating],
    deviations: NDArray[np.floating],
    portraits: NDArray[np.floating],
    families: NDArray[np.floating],
) -> NDArray[np.float64]:
    """What the ranking looks at: statistics as they are, over what such pages give, what the page is like, families."""
    return np.hstack([compressed(values), deviations, portraits, families])


def stated(said: Sequence[Said]) -> NDArray[np.float32]:
    """Values of statistics, (n,)."""
    return np.array([one.value for one in said], np.float32)


__all__ = ["Looked", "PreparedPage", "TolerancePress", "all_said", "look", "prepare_page", "stated"]
