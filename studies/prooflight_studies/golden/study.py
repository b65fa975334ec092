"""Inspection against a golden scan, on real pairs with marked defects: tuned on one half, judged on the other."""

from __future__ import annotations

import itertools
import time
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from scipy.special import ndtr

from prooflight.detectors.golden.detector import Mark, marks
from prooflight.detectors.golden.differences import GoldenDifference, Tolerance, compare, in_contrasts
from prooflight.detectors.golden.place import GoldenPlace, place
from prooflight.rng import stream
from prooflight_studies.golden.figures import (
    GoldenFigures,
    Outcome,
    Setting,
    figures,
    golden_results,
    mean_overlap,
)
from prooflight_studies.golden.pairs import GoldenPair, halves, matched, read_pairs, touching
from prooflight_studies.golden.transforms import TRANSFORMS, TUNED_ON, transformed_pairs
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

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
