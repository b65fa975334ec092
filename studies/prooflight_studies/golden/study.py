"""Inspection against a golden scan, on real pairs with marked defects: tuned on one half, judged on the other."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from scipy.special import ndtr
from scipy.stats import chi2

from prooflight.detectors.golden.detector import Mark, marks
from prooflight.detectors.golden.differences import GoldenDifference, Tolerance, compare, in_contrasts
from prooflight.detectors.golden.place import GoldenPlace, place
from prooflight.rng import stream
from prooflight_studies.golden.pairs import (
    KINDS,
    LEAST_OVERLAP,
    TRANSFORMS,
    TUNED_ON,
    GoldenPair,
    halves,
    matched,
    read_pairs,
    touching,
    transformed_pairs,
)
from prooflight_studies.harness.operating import rate_below
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from prooflight_studies.golden.pairs import Box

EDGES_PIXELS: Final = (1.5, 2.0, 2.3)
"""Radii of discs of 9, 13 and 21 pixels."""
JOININGS_PIXELS: Final = (2, 4, 6, 8)
VOLUMES: Final = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 16.0, 20.0, 24.0, 28.0)
MARGINS_PIXELS: Final = tuple(range(6, 15))
VOLUME_SPREAD: Final = 0.5
"""Standard deviation of the logarithm of a place's volume in a repeated scan (assumed: a factor of 1.6).

Tuning takes it into account: a threshold just below the smallest defect of thirty images would be too high for the next
thirty.
"""
GOAL_MISSED: Final = 0.02
GOAL_FALSE: Final = 0.1
"""Goal for the number of false regions per image."""
TUNING: Final = 1
TEST: Final = 2
"""Offset of the transforms' seed, so that the test half is moved by other draws."""
QUICK: Final = ("all at once",)
METHODS: Final = ("difference, opened", "golden, not placed", "golden")


Seen = dict[tuple[float, int], tuple[Mark, ...] | None]
"""Places that differ in one pair for each edge tolerance and joining, down to small volumes.

None: the pair was not compared, since the scan does not fit or shows another page.
"""


def run_golden_study(
    folder: Path,
    results: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[GoldenFigures]:
    """Tune on every second pair of ``folder`` and its transforms, judge on the rest; write ``golden.md``.

    Rows: each method; ours with the halves exchanged, tuned without transforms; ours on each transform of the rest.
    quick: a few pairs, our method and one transform alone. RequestError, ScanError: see ``read_pairs``.
    """
    pairs = read_pairs(folder)[: 8 if quick else None]
    tuning, test = halves(pairs)
    rng = stream(seed, "golden-bootstrap")
    names = QUICK if quick else tuple(TRANSFORMS)
    moved: list[tuple[GoldenPair, Seen]] = []
    for name in QUICK if quick else TUNED_ON:
        progress(f"tuning half, {name}: {len(tuning)} pairs")
        moved += analysed(transformed_pairs(tuning, name, seed=seed + TUNING))
    rows, outcomes = [], []
    for method in METHODS[-1:] if quick else METHODS:
        progress(f"{method}: {len(pairs)} pairs")
        even, odd = analysed(tuning, method), analysed(test, method)
        own = even + moved if method == METHODS[-1] else even
        chosen = tuned(own)
        outcomes = [judged(*one, chosen) for one in odd]
        rows.append(figures(outcomes, chosen, method=method, tuned_on="even", rng=rng))
        again = [judged(*one, chosen) for one in own]
        hits, false = sum(one.hits for one in again), sum(one.false for one in again)
        progress(
            f"{method}: {hits} of {sum(len(one.kinds) for one in again)} and {false} false on {len(own)} images of "
            "the tuning half itself"
        )
    exchanged = tuned(odd)
    swapped = [judged(*one, exchanged) for one in even]
    rows.append(figures(swapped, exchanged, method=METHODS[-1], tuned_on="odd", rng=rng))
    by_transform = []
    for name in names:
        progress(f"test half, {name}: {len(test)} pairs")
        others = transformed_pairs(test, name, seed=seed + TEST)
        judgements = [judged(pair, seen_by(pair, chosen), chosen) for pair in others]
        by_transform.append(figures(judgements, chosen, method=name, tuned_on="even", rng=rng))
    findings = golden_results(
        rows,
        by_transform,
        outcomes,
        tuned_on=QUICK if quick else TUNED_ON,
        ms_per_pair=_ms_per_pair(test),
    )
    write_page(results / "golden.md", "golden", findings)
    return rows + by_transform


def _ms_per_pair(pairs: Sequence[GoldenPair]) -> float:
    """Return the median time of registering and comparing one pair. [ms]"""
    times = []
    for pair in pairs[:10]:
        started = time.process_time()
        compare(pair.golden, pair.scan)
        times.append(1e3 * (time.process_time() - started))
    return float(np.median(times))


def analysed(pairs: Sequence[GoldenPair], method: str = METHODS[-1]) -> list[tuple[GoldenPair, Seen]]:
    """Return each pair with the places that differ by ``method``."""
    return [(pair, places_of(differences(pair, method))) for pair in pairs]


def seen_by(pair: GoldenPair, setting: Setting) -> Seen:
    """Return the places that differ in a pair by our method with one setting."""
    differing = differences(pair, METHODS[-1], [setting.edge_pixels])
    return places_of(differing, [setting.joining_pixels])


def places_of(differing: Mapping[float, GoldenDifference], joinings: Sequence[int] = JOININGS_PIXELS) -> Seen:
    """Return the places that differ for each edge tolerance and joining."""
    seen: Seen = {}
    for (edge, one), joining in itertools.product(differing.items(), joinings):
        compared = one.fits and one.place.located
        places = marks(one, joining_pixels=joining, least_volume=VOLUMES[0] / 4) if compared else None
        seen[edge, joining] = places
    return seen


def differences(
    pair: GoldenPair, method: str, edges_pixels: Sequence[float] = EDGES_PIXELS
) -> dict[float, GoldenDifference]:
    """Compare the pair with each edge tolerance."""
    if method == "difference, opened":
        return {edge: _opened(pair, edge) for edge in edges_pixels}
    where = GoldenPlace.same(pair.scan.shape)
    if method == "golden":
        golden, scan = in_contrasts(pair.golden, pair.scan)
        where = place(golden.mean(axis=0), scan.mean(axis=0))
    return {
        edge: compare(pair.golden, pair.scan, tolerance=replace(Tolerance(), edge_pixels=edge), where=where)
        for edge in edges_pixels
    }


def _opened(pair: GoldenPair, edge: float) -> GoldenDifference:
    """Apply the common method: absolute difference, a threshold, and an opening of the tolerance's width."""
    golden, scan = in_contrasts(pair.golden, pair.scan)
    difference = (scan - golden)[0]
    side = 2 * int(np.ceil(edge)) - 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    opened = cv2.morphologyEx((np.abs(difference) > 0.5).astype(np.uint8), cv2.MORPH_OPEN, disc)
    weight = np.where(opened > 0, np.abs(difference), 0).astype(np.float32)
    return GoldenDifference(excess=difference, weight=weight, place=GoldenPlace.same(difference.shape))


def judged(pair: GoldenPair, seen: Seen, setting: Setting) -> Outcome:
    """Return the result of ``setting`` on a pair."""
    places = seen[setting.edge_pixels, setting.joining_pixels]
    lines, pixels = pair.scan.shape[1:]
    strong = [mark for mark in places or () if mark.volume >= setting.least_volume]
    boxes = [
        (max(left, 0), max(top, 0), min(right, pixels), min(bottom, lines))
        for left, top, right, bottom in (mark.grown(setting.margin_pixels) for mark in strong)
    ]
    hits = matched(boxes, pair.marked)
    counted = [
        at for at, box in enumerate(boxes) if at in hits or not any(touching(box, one) for one in pair.cut)
    ]
    return Outcome(
        name=pair.name,
        boxes=tuple(boxes[at] for at in counted),
        pairs={now: hits[at] for now, at in enumerate(counted) if at in hits},
        marked=pair.marked,
        kinds=pair.kinds,
        volumes=tuple(strong[at].volume for at in counted),
        unfit=places is None,
    )


def tuned(pairs: Sequence[tuple[GoldenPair, Seen]]) -> Setting:
    """Return the setting with the least sum of missed share and false regions an image, each divided by its goal.

    Both are counted with ``VOLUME_SPREAD``. Of settings equal to a hundredth, the one with the greatest mean overlap is
    taken.
    """
    tried: list[tuple[float, float, Setting]] = []
    for edge, joining, margin in itertools.product(EDGES_PIXELS, JOININGS_PIXELS, MARGINS_PIXELS):
        every = Setting(edge_pixels=edge, joining_pixels=joining, least_volume=0.0, margin_pixels=margin)
        outcomes = [judged(*one, every) for one in pairs]
        overlap = mean_overlap(outcomes)
        tried += [
            (cost, overlap, replace(every, least_volume=volume))
            for volume, cost in zip(VOLUMES, _costs(outcomes), strict=True)
        ]
    least = min(cost for cost, _, _ in tried)
    return max((one for one in tried if one[0] <= least + 0.01), key=lambda one: (one[1], -one[0]))[2]


def _costs(outcomes: Sequence[Outcome]) -> list[float]:
    """Return the expected missed share plus false regions an image, each by its goal, for each of ``VOLUMES``."""
    marked = sum(len(outcome.kinds) for outcome in outcomes)
    hits = [one.volumes[at] for one in outcomes for at in one.pairs]
    false = [volume for one in outcomes for at, volume in enumerate(one.volumes) if at not in one.pairs]
    costs = []
    for volume in VOLUMES:
        caught, wrong = (
            float(ndtr(np.log(np.array(some) / volume) / VOLUME_SPREAD).sum()) for some in (hits, false)
        )
        costs.append((marked - caught) / marked / GOAL_MISSED + wrong / len(outcomes) / GOAL_FALSE)
    return costs


def plain(rows: Sequence[GoldenFigures]) -> list[dict[str, Any]]:
    """Convert rows to JSON types."""
    return [asdict(row) for row in rows]


# --- figures with their intervals ---

DRAWS: Final = 10_000
"""Number of bootstrap resamples."""
GOAL_DETECTED_PERCENT: Final = 98.0
GOAL_FALSE_PER_IMAGE: Final = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Parameters that are tuned."""

    edge_pixels: float
    joining_pixels: int
    least_volume: float
    margin_pixels: int
    """Margin that the annotators of the defects left around them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of one setting on one pair."""

    name: str
    boxes: tuple[Box, ...]
    pairs: dict[int, tuple[int, float]]
    """Marked box that each detected one matches, and their overlap."""
    marked: tuple[Box, ...]
    kinds: tuple[int, ...]
    """Kinds of the marked boxes."""
    volumes: tuple[float, ...] = ()
    """Volumes of the detected boxes."""
    unfit: bool = False
    """Whether the scan does not fit its golden, or shows another page, so that there are no detections."""

    @property
    def hits(self) -> int:
        """Number of marked boxes that were detected."""
        return len(self.pairs)

    @property
    def false(self) -> int:
        """Number of detected boxes that are not marked."""
        return len(self.boxes) - len(self.pairs)


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenFigures:
    """Figures over the images of one half."""

    method: str
    tuned_on: str
    images: int
    marked: int
    missed: int
    found_percent: float
    found_95_percent: tuple[float, float]
    """Bootstrap interval over images."""
    found_least_percent: float
    """95 % lower bound, by count."""
    false: int
    false_per_image: float
    false_95_per_image: tuple[float, float]
    false_most_per_image: float
    """95 % upper bound, by count: 0.10 for no region in 30 images."""
    unfit: int
    """Number of images that were not compared; what is marked on them counts as missed."""
    mean_overlap: float
    setting: Setting
    by_kind: dict[int, tuple[int, int, float]] = field(default_factory=dict)
    """Number marked, number detected and mean overlap, by kind."""


def figures(
    outcomes: Sequence[Outcome], setting: Setting, *, method: str, tuned_on: str, rng: np.random.Generator
) -> GoldenFigures:
    """Return shares with their 95 % intervals, from a bootstrap over images."""
    counts = np.array([(len(one.kinds), one.hits, one.false) for one in outcomes], np.float64)
    drawn = counts[rng.integers(0, len(counts), (DRAWS, len(counts)))].sum(axis=1)
    share, false = 100 * drawn[:, 1] / drawn[:, 0], drawn[:, 2] / len(counts)
    marked, hits, extra = counts.sum(axis=0)
    return GoldenFigures(
        method=method,
        tuned_on=tuned_on,
        images=len(outcomes),
        marked=int(marked),
        missed=int(marked - hits),
        found_percent=float(100 * hits / marked),
        found_95_percent=_interval(share),
        found_least_percent=100 * (1 - rate_below(int(marked - hits), int(marked))),
        false=int(extra),
        false_per_image=float(extra / len(counts)),
        false_most_per_image=float(chi2.ppf(0.95, 2 * (extra + 1)) / 2 / len(counts)),
        unfit=sum(one.unfit for one in outcomes),
        false_95_per_image=_interval(false),
        mean_overlap=mean_overlap(outcomes),
        setting=setting,
        by_kind=_by_kind(outcomes),
    )


def _interval(drawn: np.ndarray[Any, Any]) -> tuple[float, float]:
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


def _by_kind(outcomes: Sequence[Outcome]) -> dict[int, tuple[int, int, float]]:
    marked = Counter(kind for one in outcomes for kind in one.kinds)
    overlaps: dict[int, list[float]] = {kind: [] for kind in marked}
    for one in outcomes:
        for to, much in one.pairs.values():
            overlaps[one.kinds[to]].append(much)
    return {
        kind: (count, len(overlaps[kind]), float(np.mean(overlaps[kind] or [0.0])))
        for kind, count in sorted(marked.items())
    }


def mean_overlap(outcomes: Sequence[Outcome]) -> float:
    """Return the mean overlap of all boxes that were detected and marked; 0 if there is none."""
    overlaps = [much for outcome in outcomes for _, much in outcome.pairs.values()]
    return float(np.mean(overlaps)) if overlaps else 0.0


def golden_results(
    rows: Sequence[GoldenFigures],
    moved: Sequence[GoldenFigures],
    outcomes: Sequence[Outcome],
    *,
    tuned_on: Sequence[str],
    ms_per_pair: float,
) -> dict[str, Any]:
    """Return all figures of the page.

    rows: by method, the last with the halves exchanged; moved: of the test half, by transform; outcomes: of
    ``rows[-2]``; tuned_on: transforms.
    """
    shown = [field.name for field in fields(GoldenFigures) if field.name != "by_kind"]
    return {
        "least_overlap": LEAST_OVERLAP,
        "goal": {"found_percent": GOAL_DETECTED_PERCENT, "false_per_image": GOAL_FALSE_PER_IMAGE},
        "rows": [{name: getattr(row, name) for name in shown} for row in rows],
        "moved": [{name: getattr(row, name) for name in shown} for row in moved],
        "kinds": [
            {"kind": KINDS[kind], "marked": marked, "found": found, "mean_overlap": much}
            for kind, (marked, found, much) in rows[-2].by_kind.items()
        ],
        "wrong": [wrong for one in outcomes for wrong in _wrong(one)],
        "tuned_on": list(tuned_on),
        "ms_per_pair": ms_per_pair,
    }


def _wrong(one: Outcome) -> Iterator[dict[str, Any]]:
    hit = {to for to, _ in one.pairs.values()}
    for at, (kind, box) in enumerate(zip(one.kinds, one.marked, strict=True)):
        if at not in hit:
            yield {"image": one.name, "what": f"missed, {KINDS[kind]}", "box": box}
    for at, box in enumerate(one.boxes):
        if at not in one.pairs:
            yield {"image": one.name, "what": "false", "box": box}
