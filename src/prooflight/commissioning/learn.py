"""Good pages (and misprints, where there are any) -> ``TolerancePress``: the detector of one press."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy import optimize

from prooflight.commissioning.boosting import boosted
from prooflight.comparing.local_evidence import Scatter
from prooflight.comparing.nuisance import Spread
from prooflight.deciding.operating import conformal_threshold
from prooflight.deciding.tolerance import TolerancePress, compressed, families_of, ranked_columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

RIDGE: Final = 3.0
"""Of the baseline: as if so many more pages had shown no influence of their content."""
FOLDS: Final = 3
"""Parts of the good designs that are judged by a baseline that the others taught."""
TAIL_FROM: Final = 0.8
STEPS: Final = 81
LEAST_EXCESS: Final = 0.02
CLASSES: Final = 8
LEAST_CLASSES: Final = 4
LEAST_NOISE: Final = 0.3
LEAST_PLACES: Final = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pages:
    """What scans said: a row each."""

    values: NDArray[np.float32]
    """(pages, statistics)"""
    portraits: NDArray[np.float64]
    """(pages, PORTRAIT)"""
    design: NDArray[np.int64]
    bad: NDArray[np.bool_]

    def rows(self, which: NDArray[np.bool_]) -> Pages:
        """Some of them."""
        return Pages(
            values=self.values[which],
            portraits=self.portraits[which],
            design=self.design[which],
            bad=self.bad[which],
        )


def learn_scatter(samples: Mapping[str, NDArray[np.floating]]) -> Scatter:
    """Noise and tolerance of every mode and size from draws (..., n, 3) of N', D' and edges on good prints."""
    found = {}
    for name, drawn in samples.items():
        shape = drawn.shape[:-2]
        out = np.empty((*shape, 3))
        for place in np.ndindex(*shape):
            out[place] = _scattered(drawn[place].astype(np.float64))
        found[name] = out
    return Scatter(**found)


def _scattered(drawn: NDArray[np.float64]) -> tuple[float, float, float]:
    """Of the variance of N' as c F + c' G + t^2 D'^2: c, c', t^2; each class's greatest half per cent is left out."""
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
    found = np.array([1.0, 1.0, 0.0])
    for _ in range(20):
        trusted = x @ found
        found = optimize.nnls(x / trusted[:, None], y / trusted)[0]
        found[:2] = found[:2].clip(min=LEAST_NOISE)
    return float(found[0]), float(found[1]), float(found[2])


def _class(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Which of so many quantile classes each value is in."""
    bounds = np.quantile(values, np.linspace(0, 1, count + 1))
    return np.clip(np.searchsorted(bounds, values) - 1, 0, count - 1)


def learn_tolerance(
    pages: Pages,
    *,
    names: Sequence[str],
    scatter: Scatter,
    spread: Spread | None = None,
    rng: np.random.Generator,
    ranked: bool = True,
    trees: int = 300,
) -> TolerancePress:
    """The detector, its threshold yet to be set. ranked: misprints among the pages teach a ranking as well."""
    families = families_of(names)
    kinds = tuple(sorted(set(families)))
    good = pages.rows(~pages.bad)
    blank = TolerancePress(
        names=tuple(names),
        families=kinds,
        family=np.array([kinds.index(one) for one in families], np.int32),
        scatter=scatter,
        spread=spread or Spread(),
        **_baseline(good),
        quantiles=np.zeros((len(kinds), STEPS)),
        tail=np.ones((len(kinds), 2)),
        tail_from=TAIL_FROM,
        trees=None,
        family_trees=None,
        threshold=np.inf,
        good_designs=0,
    )
    deviations = _out_of_fold(pages, blank)
    found = replace(blank, **_tails(deviations[~pages.bad], blank))
    if not ranked or not pages.bad.any():
        return found
    evidence = found.family_evidence(deviations)
    columns = ranked_columns(pages.values, deviations, pages.portraits)
    weight = np.where(pages.bad, 0.5 / pages.bad.mean(), 0.5 / (~pages.bad).mean())
    return replace(
        found,
        trees=boosted(columns, pages.bad, weight, rng=rng, trees=trees, column_share=0.15),
        family_trees=boosted(evidence, pages.bad, weight, rng=rng, trees=trees, column_share=0.5),
    )


def promised(found: TolerancePress, good: Pages, *, false_alarm_rate: float) -> TolerancePress:
    """The detector with a threshold that a new design's good page exceeds at most so often (split conformal).

    good: pages of designs that taught nothing. ValueError: so few designs cannot promise that.
    """
    score = found.score(good.values, good.portraits)
    threshold = conformal_threshold(score, good.design, false_alarm_rate=false_alarm_rate)
    return replace(found, threshold=threshold, good_designs=int(np.unique(good.design).size))


def _baseline(good: Pages) -> dict[str, Any]:
    """What good pages give as a linear function of what they are like, by ridge regression."""
    mean, sd = good.portraits.mean(axis=0), good.portraits.std(axis=0) + 1e-6
    x = np.column_stack([np.ones(len(good.design)), ((good.portraits - mean) / sd).clip(-3, 3)])
    y = compressed(good.values)
    ridge = np.eye(x.shape[1]) * RIDGE
    ridge[0, 0] = 0
    baseline = np.linalg.solve(x.T @ x + ridge, x.T @ y)
    left = y - x @ baseline
    free = max(len(x) - 0.7 * x.shape[1], 3.0)
    return {
        "centre": np.stack([mean, sd]),
        "baseline": baseline,
        "sd": np.sqrt((left**2).sum(axis=0) / free) + 0.02,
    }


def _out_of_fold(pages: Pages, blank: TolerancePress) -> NDArray[np.float64]:
    """Deviations (pages, statistics), each design's from a baseline that other designs taught."""
    found = np.zeros(pages.values.shape)
    fold = np.unique(pages.design, return_inverse=True)[1] % FOLDS
    for index in range(FOLDS):
        mine = fold == index
        others = replace(blank, **_baseline(pages.rows(~mine & ~pages.bad)))
        found[mine] = others.deviations(pages.values[mine], pages.portraits[mine])
    return found


def _tails(deviations: NDArray[np.float64], blank: TolerancePress) -> dict[str, Any]:
    """Quantiles of each family's greatest deviation on good pages, and an exponential tail beyond."""
    quantiles = np.empty_like(blank.quantiles)
    tail = np.empty_like(blank.tail)
    for index in range(len(blank.families)):
        greatest = deviations[:, blank.family == index].max(axis=1)
        quantiles[index] = np.quantile(greatest, np.linspace(0, TAIL_FROM, STEPS))
        begin = quantiles[index, -1]
        above = greatest[greatest > begin] - begin
        tail[index] = begin, max(float(above.mean()) if above.size else 0.0, LEAST_EXCESS)
    return {"quantiles": quantiles, "tail": tail}
