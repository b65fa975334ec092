"""Training of the matched-filter detector of one press, from good pages (and misprints, where there are any)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.model import DetectorModel, compressed
from prooflight.detectors.matched_filter.ranking import (
    Forest,
    Screen,
    every_column,
    evidence_of,
    family_columns,
    rising_columns,
)
from prooflight.detectors.matched_filter.ranking import screened as of_screen
from prooflight.detectors.matched_filter.statistics.local_evidence import FLAT, MODES, Scatter, assumed_light
from prooflight.detectors.matched_filter.statistics.statistic import Statistic
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.statistics.forest import Examples, TreeNodes, grow
from prooflight.kernels.statistics.page_scale import ONE_SIGMA

RIDGE: Final = 3.0
"""Ridge of the baseline, as a number of pages that showed no influence of their content."""
FOLDS: Final = 3
"""Number of folds of the good designs; each is scored by a baseline that was trained on the others."""
LEAST_SD: Final = 0.02
TAIL_FROM: Final = 0.8
STEPS: Final = 81
LEAST_EXCESS: Final = 0.02
POOLED_EXCESS, POOLED_SHAPE = 5.0, 25.0
"""Numbers of exceedances by which all families pooled weigh on each, for its mean excess and its shape."""
LEAST_SQUARES: Final = 1.3
COLUMN_SHARE, KIND_SHARE = 0.3, 0.15
"""Share of columns among which a cut is chosen, in the forest of all misprints and in that of one kind."""
SHIFT_PAGES: Final = 1.0
"""Weight of the training pages' mean on a press's shift, as a number of pages."""
SCALE_PAGES: Final = 3.0
"""Weight of the training pages' variance on a press's scale, as a number of pages."""
LEAST_SCALE: Final = 1.0
"""Least scale: a smaller scatter than elsewhere is not taken as such, since few pages give little evidence.

(assumed)
"""
LEAST_SHAPE, MOST_SHAPE = 0.02, 0.45
CLASSES: Final = 8
LEAST_CLASSES: Final = 4
LEAST_NOISE: Final = 0.3
LEAST_PLACES: Final = 200
LEAST_ROWS: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pages:
    """Statistics of scans, one row each."""

    values: NDArray[np.float32]
    """Statistics (pages, statistics)."""
    page_features: NDArray[np.float64]
    """Page features (pages, PAGE_FEATURES)."""
    design: NDArray[np.int64]
    kind: NDArray[np.str_]
    """Kind of misprint; empty where good."""
    press: NDArray[np.int64]
    """Index of each page's press; statistics are compared with those of that press's good pages. One press that states
    several worlds counts as a press in each of them."""

    @property
    def bad(self) -> NDArray[np.bool_]:
        """Return which are misprints."""
        return self.kind != ""

    @classmethod
    def of(cls, rows: Mapping[str, NDArray[Any]], press: int = 0) -> Self:
        """Create from columns ``values``, ``portrait``, ``design`` and ``kind``, of one press."""
        return cls(
            values=rows["values"],
            page_features=rows["portrait"],
            design=rows["design"],
            kind=rows["kind"],
            press=np.full(len(rows["kind"]), press),
        )

    def joined(self, others: Pages) -> Pages:
        """Return these and others, one after the other."""
        return Pages(
            values=np.concatenate([self.values, others.values]),
            page_features=np.concatenate([self.page_features, others.page_features]),
            design=np.concatenate([self.design, others.design]),
            kind=np.concatenate([self.kind, others.kind]),
            press=np.concatenate([self.press, others.press]),
        )

    def rows(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> Pages:
        """Return some of the rows."""
        return Pages(
            values=self.values[which],
            page_features=self.page_features[which],
            design=self.design[which],
            kind=self.kind[which],
            press=self.press[which],
        )


def pooled(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Reshape draws (designs, ..., n, 3) -> (..., designs x n, 3), as ``learn_scatter`` needs them."""
    moved = np.moveaxis(values, 0, -3)
    return moved.reshape(*moved.shape[:-3], -1, 3)


def learn_scatter(samples: Mapping[str, NDArray[np.floating]], *, prior: PrintPrior | None = None) -> Scatter:
    """Fit noise and tolerance of every mode and size to draws (..., n, 3) of N', D' and edges on good prints.

    prior: variation of good prints, by default an office-class press's.
    """
    least = assumed_light(prior or PrintPrior())
    scatter = {"light": _light(samples["boxes"][MODES.index("light")], least)}
    for name, drawn in samples.items():
        shape = drawn.shape[:-2]
        out = np.empty((*shape, 3))
        for place in np.ndindex(*shape):
            out[place] = _scattered(drawn[place].astype(np.float64))
        scatter[name] = out
    return Scatter(**scatter)


def widest(scatters: Sequence[Scatter]) -> Scatter:
    """Return the scatter that covers all of these: of each parameter the greatest."""
    return Scatter(
        **{
            one.name: np.maximum.reduce([getattr(scatter, one.name) for scatter in scatters])
            for one in fields(Scatter)
        }
    )


def _light(drawn: NDArray[np.floating], least: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fit ``Scatter.light`` to draws (sizes, n, 3) of the light's own N', D' and edges, away from edges.

    Measured values scatter by noise as well, so that it is a little too large where light gives little
    evidence.
    """
    tolerance = least.copy()
    for size, one in enumerate(drawn.astype(np.float64)):
        own, power, edges = one[np.isfinite(one).all(axis=1) & (one[:, 1] > 1e-2)].T
        flat = edges <= FLAT * power
        if flat.sum() < LEAST_PLACES:
            continue
        weight = power[flat] / (power[flat] + 1 / tolerance[size] ** 2)
        amount = np.abs(own[flat] / power[flat])
        order = np.argsort(amount)
        middle = amount[order][np.searchsorted(np.cumsum(weight[order]), ONE_SIGMA * weight.sum())]
        tolerance[size] = max(tolerance[size], float(middle))
    return tolerance


def _scattered(drawn: NDArray[np.float64]) -> tuple[float, float, float]:
    """Fit the variance of N' as c F + c' G + t^2 D'^2: c, c', t^2.

    Each class's greatest half per cent is left out.
    """
    own, power, edges = drawn[np.isfinite(drawn).all(axis=1) & (drawn[:, 1] > 1e-2)].T
    if own.size < LEAST_PLACES:
        return 1.0, 1.0, 0.0
    share = np.clip(edges / power, 0, 1)
    place = _class(power, CLASSES) * CLASSES + np.minimum((share * CLASSES).astype(int), CLASSES - 1)
    model, seen = [], []
    for index in np.unique(place):
        here = place == index
        if here.sum() < LEAST_PLACES // 10:
            continue
        squares = own[here] ** 2 / power[here]
        of_edges = float(share[here].mean())
        model.append((1 - of_edges, of_edges, float(np.median(power[here]))))
        seen.append(float(squares[squares <= np.quantile(squares, 0.995)].mean()))
    if len(seen) < LEAST_CLASSES:
        return 1.0, 1.0, 0.0
    x, y = np.array(model), np.array(seen)
    coefficients = np.array([1.0, 1.0, 0.0])
    for _ in range(20):
        trusted = x @ coefficients
        coefficients = optimize.nnls(x / trusted[:, None], y / trusted)[0]
        coefficients[:2] = coefficients[:2].clip(min=LEAST_NOISE)
    return float(coefficients[0]), float(coefficients[1]), float(coefficients[2])


def _class(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the quantile class of each value, of ``count`` classes."""
    bounds = np.quantile(values, np.linspace(0, 1, count + 1))
    return np.clip(np.searchsorted(bounds, values) - 1, 0, count - 1)


def learn_model(
    pages: Pages,
    *,
    names: Sequence[str],
    scatter: Scatter,
    rng: np.random.Generator,
    ranked: bool = True,
    screened: bool = False,
    trees: int = 300,
) -> DetectorModel:
    """Train the detector, its threshold yet to be set. names: keys of statistics.

    ranked: misprints among the pages train a ranking as well; screened: of the statistics that every page is
    analysed for (``Screen``), instead of one of all.
    """
    statistics = tuple(map(Statistic.parse, names))
    families = [one.cause for one in statistics]
    kinds = tuple(sorted(set(families)))
    good = pages.rows(~pages.bad)
    blank = DetectorModel(
        statistics=statistics,
        families=kinds,
        family=np.array([kinds.index(one) for one in families], np.int32),
        scatter=scatter,
        residual_variance=ResidualVariance(),
        prior=PrintPrior(),
        **_baseline(good),
        shift=np.zeros(len(statistics)),
        scale=np.ones(len(statistics)),
        quantiles=np.zeros((len(kinds), STEPS)),
        tail=np.ones((len(kinds), 3)),
        tail_from=TAIL_FROM,
        forest=None,
        kinds=(),
        kind_forests=(),
        name_forests=(),
        threshold=np.inf,
        good_designs=0,
    )
    deviations = _out_of_fold(pages, blank)
    for one in np.unique(pages.press):
        here = pages.press == one
        shift, scale = shift_and_scale(deviations[here & ~pages.bad])
        deviations[here] = (deviations[here] - shift) / scale
    detector = replace(blank, **_tails(deviations[~pages.bad], blank.family))
    if not ranked or not pages.bad.any():
        return detector
    evidence = detector.family_evidence(deviations)
    columns = every_column(evidence, pages.page_features, deviations)
    kinds_of_misprint = tuple(np.unique(pages.kind[pages.bad]).tolist())
    if len(kinds_of_misprint) == 1:
        kinds_of_misprint = ()

    rising = rising_columns(
        columns.shape[1], features=pages.page_features.shape[1], statistics=len(statistics)
    )
    return replace(
        detector,
        forest=None if screened else _against_good(pages, columns, rising, rng, trees),
        kinds=kinds_of_misprint,
        kind_forests=_each_against_good(pages, kinds_of_misprint, columns, rising, rng, trees),
        name_forests=_names(pages, kinds_of_misprint, family_columns(evidence), rng, trees // 3),
        screen=_screen(pages, statistics, kinds_of_misprint, deviations, rng, trees) if screened else None,
    )


def _against_good(
    pages: Pages,
    columns: NDArray[np.float64],
    rising: NDArray[np.bool_],
    rng: np.random.Generator,
    trees: int,
    share: float = COLUMN_SHARE,
) -> Forest:
    """Train a forest to separate misprints from good pages by ``every_column``.

    The odds do not fall along rising columns.
    """
    return fitted_forest(
        columns, pages.bad, even(pages.bad), rng=rng, trees=trees, column_share=share, rising=rising
    )


def _each_against_good(
    pages: Pages,
    kinds: Sequence[str],
    columns: NDArray[np.float64],
    rising: NDArray[np.bool_],
    rng: np.random.Generator,
    trees: int,
) -> tuple[Forest, ...]:
    """Train a forest for each kind of misprint against good pages, likewise."""
    forests = []
    for kind in kinds:
        which = ~pages.bad | (pages.kind == kind)
        forests.append(_against_good(pages.rows(which), columns[which], rising, rng, trees // 4, KIND_SHARE))
    return tuple(forests)


def _screen(
    pages: Pages,
    statistics: Sequence[Statistic],
    kinds: Sequence[str],
    deviations: NDArray[np.float64],
    rng: np.random.Generator,
    trees: int,
) -> Screen:
    """Return the ranking that decides, from deviations (pages, statistics) of all statistics."""
    which, families, family = of_screen(statistics)
    own = deviations[:, which]
    tails = _tails(own[~pages.bad], family)
    evidence = evidence_of(own, family, tails["quantiles"], tails["tail"], TAIL_FROM)
    columns = every_column(evidence, pages.page_features, own)
    rising = rising_columns(columns.shape[1], features=pages.page_features.shape[1], statistics=own.shape[1])
    return Screen(
        statistic=which,
        families=families,
        family=family,
        **tails,
        tail_from=TAIL_FROM,
        forest=_against_good(pages, columns, rising, rng, trees),
        kind_forests=_each_against_good(pages, kinds, columns, rising, rng, trees),
    )


def shift_and_scale(
    good: NDArray[np.floating], *, least_scale: float = LEAST_SCALE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ``DetectorModel.shift`` and ``scale``, (statistics,) each, from deviations of good pages (pages, n).

    The mean is shrunk towards 0 by ``SHIFT_PAGES``, the variance towards 1 by ``SCALE_PAGES``, and widened by
    1 + 1 / n, for the mean is no better known (predictive variance of a normal sample).
    """
    n = len(good)
    shift = good.sum(axis=0) / (n + SHIFT_PAGES)
    squares = ((good - shift) ** 2).sum(axis=0)
    variance = (squares + SCALE_PAGES) / (n + SCALE_PAGES - 1) * (1 + 1 / max(n, 1))
    return shift, np.sqrt(variance).clip(min=least_scale)


def _names(
    pages: Pages, kinds: Sequence[str], columns: NDArray[np.float64], rng: np.random.Generator, trees: int
) -> tuple[Forest, ...]:
    """Train a forest for each kind of misprint against all others."""
    kind, columns = pages.kind[pages.bad], columns[pages.bad]
    return tuple(
        fitted_forest(columns, kind == one, even(kind == one), rng=rng, trees=trees, column_share=KIND_SHARE)
        for one in kinds
    )


def certain_score(detector: DetectorModel, pages: Pages, another: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the matched filter's score of pages (pages,); a scan that shows another page is certain."""
    score = detector.score(pages.values, pages.page_features)
    return np.where(another, np.maximum(score, WRONG_PAGE), score)


def _baseline(good: Pages) -> dict[str, Any]:
    """Fit good pages' statistics as a linear function of their page features, by ridge regression."""
    mean, sd = good.page_features.mean(axis=0), good.page_features.std(axis=0) + 1e-6
    x = np.column_stack([np.ones(len(good.design)), ((good.page_features - mean) / sd).clip(-3, 3)])
    y = compressed(good.values)
    ridge = np.eye(x.shape[1]) * RIDGE
    ridge[0, 0] = 0
    baseline = np.linalg.solve(x.T @ x + ridge, x.T @ y)
    left = y - x @ baseline
    free = max(len(x) - 0.7 * x.shape[1], 3.0)
    return {
        "centre": np.stack([mean, sd]),
        "baseline": baseline,
        "sd": np.sqrt((left**2).sum(axis=0) / free) + LEAST_SD,
    }


def _out_of_fold(pages: Pages, blank: DetectorModel) -> NDArray[np.float64]:
    """Return deviations (pages, statistics), each design's from a baseline that was trained on other designs."""
    deviations = np.zeros(pages.values.shape)
    fold = _folds(pages.design)
    for index in range(FOLDS):
        mine = fold == index
        others = replace(blank, **_baseline(pages.rows(~mine & ~pages.bad)))
        deviations[mine] = others.deviations(pages.values[mine], pages.page_features[mine])
    return deviations


def _folds(design: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the fold of each page's design."""
    return np.asarray(np.unique(design, return_inverse=True)[1] % FOLDS)


def _tails(deviations: NDArray[np.float64], family: NDArray[np.int32]) -> dict[str, Any]:
    """Fit quantiles of each family's greatest deviation on good pages, and generalised Pareto tails beyond.

    By the method of moments; a family's few exceedances give little evidence alone, so that its mean excess
    and its shape are shrunk towards the families' medians.
    """
    quantiles = np.empty((family.max() + 1, STEPS))
    beyond = []
    for index in range(len(quantiles)):
        greatest = deviations[:, family == index].max(axis=1)
        quantiles[index] = np.quantile(greatest, np.linspace(0, TAIL_FROM, STEPS))
        begin = quantiles[index, -1]
        above = greatest[greatest > begin] - begin
        beyond.append(above if above.size else np.zeros(1))
    count = np.array([above.size for above in beyond])
    excess = np.array([above.mean() for above in beyond])
    squares = np.array([(above**2).mean() for above in beyond]) / np.maximum(excess, LEAST_EXCESS) ** 2
    excess = (excess * count + POOLED_EXCESS * np.median(excess)) / (count + POOLED_EXCESS)
    squares = (squares * count + POOLED_SHAPE * np.median(squares)) / (count + POOLED_SHAPE)
    squares = np.maximum(squares, LEAST_SQUARES)
    # <x^2> / <x>^2 of a generalised Pareto distribution is 2 (1 - shape) / (1 - 2 shape).
    shape = ((squares - 2) / (2 * squares - 2)).clip(LEAST_SHAPE, MOST_SHAPE)
    scale = np.maximum(excess, LEAST_EXCESS) * (1 - shape)
    return {"quantiles": quantiles, "tail": np.stack([quantiles[:, -1], scale, shape], axis=1)}


def even(which: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights with which both classes count the same."""
    return np.where(which, 0.5 / which.mean(), 0.5 / (~which).mean())


def fitted_forest(
    columns: NDArray[np.floating],
    bad: NDArray[np.bool_],
    weight: NDArray[np.floating],
    *,
    rng: np.random.Generator,
    trees: int = 300,
    column_share: float = 0.2,
    rising: NDArray[np.bool_] | None = None,
) -> Forest:
    """Train extremely randomised trees (Geurts, Ernst, Wehenkel 2006): of cuts drawn in some columns the best counts.

    rising: (columns,) along which columns the share of ``bad`` never falls; None: along none.
    """
    pages, tries = len(columns), max(int(column_share * columns.shape[1]), 1)
    across = np.ascontiguousarray(columns.T, dtype=np.float32)
    rising = np.zeros(len(across), bool) if rising is None else rising
    examples = Examples(columns=across, bad=bad, weight=np.asarray(weight, np.float64), rising=rising)
    column, left, right = np.empty((3, 2 * pages), np.int32)
    cut, share = np.empty((2, 2 * pages), np.float32)
    day = TreeNodes(column=column, cut=cut, left=left, right=right, share=share)
    grown, root = [], [0]
    for _ in range(trees):
        nodes = grow(examples, tries, LEAST_ROWS, rng, day)
        ends = column[:nodes] < 0
        down = [np.where(ends, -1, side[:nodes] + root[-1]) for side in (left, right)]
        grown.append((column[:nodes].copy(), cut[:nodes].copy(), *down, share[:nodes].copy()))
        root.append(root[-1] + nodes)
    columns_, cuts, lefts, rights, shares = (np.concatenate(part) for part in zip(*grown, strict=True))
    return Forest(
        column=columns_,
        cut=cuts,
        left=lefts.astype(np.int32),
        right=rights.astype(np.int32),
        share=shares,
        root=np.array(root[:-1], np.int32),
    )
