"""Verdicts on the rows of the press study.

Each fifth of the designs is judged by models that are trained and tuned on other fifths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.training.learn import (
    Pages,
    certain_score,
    even,
    fitted_forest,
    learn_model,
    with_threshold,
)
from prooflight.detectors.false_alarm_rate import conformal_threshold
from prooflight.detectors.matched_filter.ranking import every_column, family_columns
from prooflight.detectors.matched_filter.statistics.statistic import Statistic
from prooflight.pages.parallel import in_order
from prooflight.rng import stream
from prooflight_studies.harness.operating import Scored, area_under_roc, caught_at, least_cost

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight_studies.harness.result_cache import Rows

PARTS: Final = 5
"""Number of parts of the press days.

In turn one is judged, the next sets thresholds, and the other three are for training.
"""
EVERY: Final = -1
"""Part number of pages that set the thresholds of every part."""
ALPHAS: Final = (0.1, 1.0, 10.0)
FALSE_ALARM_RATE: Final = 0.01
MATCHED_FILTER: Final = "matched_filter"
FOREST_OF_FAMILIES: Final = "forest of families alone"
"""Method that the forests without some statistics are compared with."""
GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "places away from edges": ("flat", "calm", "swell", "double"),
    "the page's own scatter": ("apart", "line", "wave", "echo", "excess"),
    "boxes": ("box", "apart", "spread", "flat"),
    "streaks": ("streak", "line", "calm"),
    "waves": ("band", "wave", "swell"),
    "echoes": ("ghost", "echo", "double"),
    "nuisances found": ("fit", "swap"),
    "registration": ("place",),
    "planes far out of register": ("moved",),
}
"""First words of the statistics that are left out as a group."""
TREES: Final = 300


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodResult:
    """Results of one method on every page, each part by itself."""

    name: str
    scored: Scored
    part: NDArray[np.int64]
    alarms: NDArray[np.bool_]
    """Alarms at the thresholds that cost least on the tuning designs. (ALPHAS, pages)"""
    nominal_alarms: NDArray[np.bool_]
    """Alarms at the threshold that good pages of tuning designs exceed at ``FALSE_ALARM_RATE``. (pages,)"""

    @property
    def area(self) -> float:
        """Mean over parts of the area under the ROC curve."""
        return float(np.mean([area_under_roc(one) for one in self.parts()]))

    @property
    def caught(self) -> float:
        """Mean over parts of the share caught at ``FALSE_ALARM_RATE`` false alarms on these pages themselves."""
        return float(np.mean([caught_at(one, FALSE_ALARM_RATE) for one in self.parts()]))

    def parts(self) -> Iterator[Scored]:
        """Yield the pages of each part."""
        for index in np.unique(self.part):
            here = self.part == index
            yield self.scored.pages(here)

    def at(self, alarms: NDArray[np.bool_]) -> Scored:
        """Return the pages with their alarms, 0 or 1, as scores."""
        return replace(self.scored, score=alarms.astype(np.float64))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdicts:
    """Results of all methods on all pages, and the matched filter as trained for each part."""

    methods: dict[str, MethodResult]
    detectors: list[DetectorModel]
    """The models of the parts, with the threshold of the target false-alarm rate."""
    kinds: NDArray[np.str_]
    """Kind that the matched filter assigns to each page. (pages,)"""
    boxes: NDArray[np.float32]
    """Position that the matched filter reports for each page. (pages, 4) [mm]"""


def judged(
    rows: Rows,
    scatter: Scatter,
    *,
    seed: int,
    training: Pages | None = None,
    good: Rows | None = None,
    trees: int = TREES,
    ablations: bool = True,
    processes: int | None = 1,
    progress: Callable[[str], None] = lambda _step: None,
) -> Verdicts:
    """Judge every page of every part.

    training: pages of designs that are not judged and on which every part is trained. good: good pages of designs that
    are not judged and that set every part's thresholds, together with the part next to it.
    """
    pages, another = Pages.of(rows), rows["another"]
    part, day = parts_of(rows), rows["day"]
    if good is not None:
        pages, another = pages.joined(Pages.of(good)), np.concatenate([another, good["another"]])
        part = np.concatenate([part, np.full(len(good["another"]), EVERY)])
        day = np.concatenate([day, good["day"]])
    work = _PartWork(
        rows=rows,
        pages=pages,
        another=another,
        part=part,
        scatter=scatter,
        seed=seed,
        training=training,
        trees=trees,
        ablations=ablations,
    )
    scores: dict[str, NDArray[np.float64]] = {}
    detectors = []
    kinds = np.zeros(len(rows["kind"]), "U16")
    boxes = np.full((len(kinds), 4), np.nan, np.float32)
    progress(f"{PARTS} parts: learning and judging")
    for index, result in enumerate(in_order(work, range(PARTS), processes=processes, fewest=2)):
        progress(f"part {index + 1} of {PARTS} is judged")
        test, tune = work.test_and_tune(index)
        for name, score in result.scores.items():
            # Scores of the tuning part are needed again: a row of its own for each part that it sets thresholds for.
            scores.setdefault(name, np.full((PARTS, len(part)), np.nan))[index, test | tune] = score
        detectors.append(result.model)
        here = test[: len(kinds)]
        kinds[here], boxes[here] = result.kinds, result.boxes
    methods = {name: _judged(name, score, pages, part, day) for name, score in scores.items()}
    return Verdicts(methods=methods, detectors=detectors, kinds=kinds, boxes=boxes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PartResult:
    """Result of judging one part."""

    model: DetectorModel
    scores: dict[str, NDArray[np.float64]]
    """Scores of each method, on the pages of this part and of those that set its thresholds."""
    kinds: NDArray[np.str_]
    boxes: NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PartWork:
    """Judgement of one part, by its number; picklable, so that it can run in another process."""

    rows: Rows
    """Rows of the pages that are judged, the first of ``pages``."""
    pages: Pages
    another: NDArray[np.bool_]
    part: NDArray[np.int64]
    scatter: Scatter
    seed: int
    training: Pages | None
    trees: int
    ablations: bool

    def test_and_tune(self, index: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return masks of the pages that a part judges and of those that set its thresholds."""
        return self.part == index, (self.part == (index + 1) % PARTS) | (self.part == EVERY)

    def __call__(self, index: int) -> _PartResult:
        rows, pages = self.rows, self.pages
        names = rows["names"][: rows["values"].shape[1]].tolist()
        test, tune = self.test_and_tune(index)
        rng = stream(self.seed, "press-part", index)
        learn, other = pages.rows(~test & ~tune), pages.rows(test | tune)
        learn = learn if self.training is None else learn.joined(self.training)
        model = learn_model(learn, names=names, scatter=self.scatter, rng=rng, trees=self.trees)
        scores = {name: rank(other) for name, rank in _rankings(model, self.another[test | tune]).items()}
        if self.ablations:
            scores |= dict(_without(learn, other, names, self.scatter, rng, self.trees // 2))
        good, here = pages.rows(tune & ~pages.bad), test[: len(rows["kind"])]
        return _PartResult(
            model=with_threshold(
                model, good, false_alarm_rate=max(FALSE_ALARM_RATE, 1.01 / (len(good.bad) + 1))
            ),
            scores=scores,
            kinds=assigned_kinds(model, rows, here),
            boxes=reported_places(model, rows["values"][here], rows["portrait"][here], rows["boxes"][here]),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RateCheck:
    """A target false-alarm rate whose threshold separate designs set, and the observed alarms."""

    rate: float
    designs: int
    """Number of the designs that set the threshold: printed once, well; not used for training."""
    alarms: NDArray[np.bool_]
    """Alarms on the pages that each part judges, good and bad, or on further good pages, by one part in turn.
    (pages,)
    """


def parts_of(rows: Rows) -> NDArray[np.int64]:
    """Return the part that each row is in; days take turns."""
    return np.asarray(np.unique(rows["day"], return_inverse=True)[1] % PARTS)


def check_rates(
    verdicts: Verdicts, good: Rows, trial: Rows, *, calibration: Mapping[float, int]
) -> tuple[list[RateCheck], list[RateCheck]]:
    """Apply thresholds that good pages of further designs set to each part's detector, on what that part judges.

    The second list is for good pages of ``trial``, whose days the parts' detectors judge in turn. calibration: number
    of designs by target false-alarm rate; the first of ``good`` are taken.
    """
    pages, matched_filter = Pages.of(good), verdicts.methods[MATCHED_FILTER]
    scores = [certain_score(model, pages, good["another"]) for model in verdicts.detectors]
    tried, turn = Pages.of(trial), parts_of(trial)
    of_trial = np.choose(
        turn, [certain_score(model, tried, trial["another"]) for model in verdicts.detectors]
    )
    checks: tuple[list[RateCheck], list[RateCheck]] = [], []
    for rate, count in calibration.items():
        thresholds = np.array(
            [
                conformal_threshold(score[:count], pages.design[:count], false_alarm_rate=rate)
                for score in scores
            ]
        )
        for of_rate, score, part in zip(
            checks, (matched_filter.scored.score, of_trial), (matched_filter.part, turn), strict=True
        ):
            of_rate.append(RateCheck(rate=rate, designs=count, alarms=score > thresholds[part]))
    return checks


def alarms_by_others(scored: Scored, rate: float) -> NDArray[np.bool_]:
    """Return alarms (pages,) with each design's threshold set by the good pages of all other designs."""
    alarms = np.zeros(scored.bad.shape, bool)
    for design in np.unique(scored.design):
        here = scored.design == design
        good = ~here & ~scored.bad
        threshold = conformal_threshold(scored.score[good], scored.design[good], false_alarm_rate=rate)
        alarms[here] = scored.score[here] > threshold
    return alarms


def assigned_kinds(model: DetectorModel, rows: Rows, which: NDArray[np.bool_]) -> NDArray[np.str_]:
    """Return the kind that the matched filter assigns to each of some pages."""
    kinds = np.array(model.kinds_of(rows["values"][which], rows["portrait"][which]), "U16")
    return np.where(rows["another"][which], "wrong-page", kinds)


def reported_places(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    boxes: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the box of each page's most significant statistic that has one, (pages, 4) [mm]; NaN: there is none."""
    deviations = model.deviations(values, page_features)
    placed = np.isfinite(boxes[..., 0]) & np.isfinite(boxes[..., 2])
    best = np.where(placed, deviations, -np.inf).argmax(axis=1)
    return np.asarray(boxes[np.arange(len(boxes)), best])


def _rankings(
    model: DetectorModel, another: NDArray[np.bool_]
) -> dict[str, Callable[[Pages], NDArray[np.float64]]]:
    def evidence(pages: Pages) -> NDArray[np.float64]:
        return model.family_evidence(model.deviations(pages.values, pages.page_features))

    def every(pages: Pages) -> NDArray[np.float64]:
        deviations = model.deviations(pages.values, pages.page_features)
        return every_column(model.family_evidence(deviations), pages.page_features, deviations)

    def forest(pages: Pages) -> NDArray[np.float64]:
        assert model.forest is not None
        return model.forest.score(every(pages))

    return {
        MATCHED_FILTER: lambda pages: certain_score(model, pages, another),
        "matched_filter, wrong pages by evidence alone": lambda pages: model.score(
            pages.values, pages.page_features
        ),
        "no misprint seen in learning": lambda pages: model.guard(evidence(pages)),
        "forest of all statistics alone": forest,
        "forests of kinds alone, the most of them": lambda pages: model.of_kinds(every(pages)).max(axis=1),
    }


def _without(
    learn: Pages, other: Pages, names: list[str], scatter: Scatter, rng: np.random.Generator, trees: int
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield scores of the forest of families without some of the statistics, or without the page's content."""
    weight = even(learn.bad)
    firsts = [Statistic.parse(name).label for name in names]
    sets: dict[str, tuple[NDArray[np.bool_], float]] = {FOREST_OF_FAMILIES: (np.ones(len(names), bool), 1.0)}
    sets |= {
        f"forest without {group}": (np.array([first not in left for first in firsts]), 1.0)
        for group, left in GROUPS.items()
    }
    sets["forest without what the content foretells"] = (np.ones(len(names), bool), 0.0)
    for name, (kept, content) in sets.items():
        some = [one for one, keep in zip(names, kept, strict=True) if keep]
        fewer, judged_ = (
            replace(pages, values=pages.values[:, kept], page_features=pages.page_features * content)
            for pages in (learn, other)
        )
        model = learn_model(fewer, names=some, scatter=scatter, rng=rng, ranked=False)
        taught, said = (
            family_columns(model.family_evidence(model.deviations(pages.values, pages.page_features)))
            for pages in (fewer, judged_)
        )
        yield name, fitted_forest(taught, learn.bad, weight, rng=rng, trees=trees).score(said)


def _judged(
    name: str,
    scores: NDArray[np.float64],
    pages: Pages,
    part: NDArray[np.int64],
    day: NDArray[np.int64],
) -> MethodResult:
    judged_ = part != EVERY
    score = np.empty(len(part))
    alarms = np.zeros((len(ALPHAS), len(part)), bool)
    nominal = np.zeros(len(part), bool)
    for index in range(PARTS):
        test, tune = part == index, (part == (index + 1) % PARTS) | ~judged_
        of_tune = Scored(
            score=scores[index, tune], bad=pages.bad[tune], design=pages.design[tune], day=day[tune]
        )
        score[test] = scores[index, test]
        for row, alpha in enumerate(ALPHAS):
            alarms[row, test] = score[test] > least_cost(of_tune, alpha).threshold
        nominal[test] = score[test] > np.quantile(
            of_tune.score[~of_tune.bad], 1 - FALSE_ALARM_RATE, method="higher"
        )
    return MethodResult(
        name=name,
        scored=Scored(
            score=score[judged_], bad=pages.bad[judged_], design=pages.design[judged_], day=day[judged_]
        ),
        part=part[judged_],
        alarms=alarms[:, judged_],
        nominal_alarms=nominal[judged_],
    )
