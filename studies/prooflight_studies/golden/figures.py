"""Figures of inspection against a golden scan, with their intervals."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.stats import chi2

from prooflight_studies.golden.pairs import KINDS, LEAST_OVERLAP
from prooflight_studies.harness.operating import rate_below

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from prooflight_studies.golden.pairs import Box

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
