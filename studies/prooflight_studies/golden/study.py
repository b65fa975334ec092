"""Inspection against a golden scan, on real pairs with marked defects: tuned on one half, judged on the other."""

from __future__ import annotations

import itertools
import time
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from scipy.special import ndtr

from prooflight.detectors.golden.differences import GoldenDifference, Tolerance, compare, in_contrasts
from prooflight.detectors.golden.place import GoldenPlace, place
from prooflight.detectors.golden.regions import Mark, marks
from prooflight.rng import stream
from prooflight_studies.golden.figures import (
    GoldenFigures,
    Outcome,
    Setting,
    figures,
    golden_results,
    mean_overlap,
)
from prooflight_studies.golden.pairs import GoldenPair, halves, matched, read_pairs
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

EDGES_PIXELS: Final = (1.5, 2.0, 2.3, 2.9)
"""Radii of discs of 9, 13, 21 and 25 pixels."""
JOININGS_PIXELS: Final = (2, 3, 4, 5, 6, 8, 10)
VOLUMES: Final = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 16.0, 20.0, 24.0, 28.0)
MARGINS_PIXELS: Final = tuple(range(6, 15))
VOLUME_SPREAD: Final = 0.5
"""Standard deviation of the logarithm of a place's volume, were it met again (assumed: a factor of 1.6). Tuning counts
with it: a threshold just below the smallest defect of thirty images would be too high for the next thirty."""
GOAL_MISSED: Final = 0.02
GOAL_FALSE: Final = 0.2
"""For each image."""
METHODS: Final = ("difference, opened", "golden, not placed", "golden")


def run_golden_study(
    folder: Path,
    results: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    picture: Path | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[GoldenFigures]:
    """Tune on every second pair of ``folder``, judge on the rest, for each method; write ``golden.md``.

    The last row has the halves exchanged. picture: where a contact sheet of the test half is drawn; it shows pieces of
    the pairs. quick: a few pairs, our method alone. RequestError, ScanError: see ``read_pairs``.
    """
    pairs = read_pairs(folder)[: 8 if quick else None]
    tuning, test = halves(pairs)
    rng = stream(seed, "golden-bootstrap")
    rows, outcomes, seconds = [], [], 0.0
    for method in METHODS[-1:] if quick else METHODS:
        progress(f"{method}: {len(pairs)} pairs")
        started = time.process_time()
        seen = {pair.name: differences(pair, method) for pair in pairs}
        seconds = time.process_time() - started
        chosen = tuned(tuning, seen)
        outcomes = [judged(pair, seen[pair.name], chosen) for pair in test]
        rows.append(figures(outcomes, chosen, method=method, tuned_on="even", rng=rng))
        own = [judged(pair, seen[pair.name], chosen) for pair in tuning]
        hits, false = sum(one.hits for one in own), sum(one.false for one in own)
        progress(
            f"{method}: {hits} of {sum(len(one.kinds) for one in own)} and {false} false on the tuning half itself"
        )
    exchanged = tuned(test, seen)
    swapped = [judged(pair, seen[pair.name], exchanged) for pair in tuning]
    rows.append(figures(swapped, exchanged, method=METHODS[-1], tuned_on="odd", rng=rng))
    mpx = sum(pair.scan[0].size for pair in pairs) * len(EDGES_PIXELS) / 1e6
    write_page(results / "golden.md", "golden", golden_results(rows, outcomes, mpx_per_s=mpx / seconds))
    if picture is not None:
        from prooflight_studies.golden.sheet import draw_golden_sheet

        differences_of_test = {pair.name: seen[pair.name][chosen.edge_pixels] for pair in test}
        draw_golden_sheet(picture, test, outcomes, differences_of_test)
    return rows


def differences(pair: GoldenPair, method: str) -> dict[float, GoldenDifference]:
    """The pair compared with each edge tolerance."""
    if method == "difference, opened":
        return {edge: _opened(pair, edge) for edge in EDGES_PIXELS}
    where = GoldenPlace.same(pair.scan.shape)
    if method == "golden":
        golden, scan = in_contrasts(pair.golden, pair.scan)
        where = place(golden.mean(axis=0), scan.mean(axis=0))
    return {
        edge: compare(pair.golden, pair.scan, tolerance=replace(Tolerance(), edge_pixels=edge), where=where)
        for edge in EDGES_PIXELS
    }


def _opened(pair: GoldenPair, edge: float) -> GoldenDifference:
    """What is done otherwise: absolute difference, a threshold, and strips narrower than the tolerance opened away."""
    golden, scan = in_contrasts(pair.golden, pair.scan)
    difference = (scan - golden)[0]
    side = 2 * int(np.ceil(edge)) - 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    kept = cv2.morphologyEx((np.abs(difference) > 0.5).astype(np.uint8), cv2.MORPH_OPEN, disc)
    weight = np.where(kept > 0, np.abs(difference), 0).astype(np.float32)
    return GoldenDifference(excess=difference, weight=weight, place=GoldenPlace.same(difference.shape))


def judged(pair: GoldenPair, seen: dict[float, GoldenDifference], setting: Setting) -> Outcome:
    """What ``setting`` finds in a pair."""
    found = marks(
        seen[setting.edge_pixels], joining_pixels=setting.joining_pixels, least_volume=setting.least_volume
    )
    return _outcome(pair, found, setting)


def _outcome(pair: GoldenPair, found: Iterable[Mark], setting: Setting) -> Outcome:
    lines, pixels = pair.scan.shape[1:]
    boxes = tuple(
        (max(left, 0), max(top, 0), min(right, pixels), min(bottom, lines))
        for left, top, right, bottom in (
            mark.grown(setting.margin_pixels) for mark in found if mark.volume >= setting.least_volume
        )
    )
    return Outcome(
        name=pair.name,
        found=boxes,
        pairs=matched(boxes, pair.marked),
        marked=pair.marked,
        kinds=pair.kinds,
    )


def tuned(pairs: Sequence[GoldenPair], seen: dict[str, dict[float, GoldenDifference]]) -> Setting:
    """The setting with the least sum of missed share and false regions an image, each by its goal.

    Both are counted with ``VOLUME_SPREAD``. Of equals to a hundredth, the one with the greatest mean overlap.
    """
    tried: list[tuple[float, float, Setting]] = []
    for edge, joining in itertools.product(EDGES_PIXELS, JOININGS_PIXELS):
        found = [
            marks(seen[pair.name][edge], joining_pixels=joining, least_volume=VOLUMES[0] / 4)
            for pair in pairs
        ]
        for margin in MARGINS_PIXELS:
            every = Setting(edge_pixels=edge, joining_pixels=joining, least_volume=0.0, margin_pixels=margin)
            outcomes = [_outcome(pair, places, every) for pair, places in zip(pairs, found, strict=True)]
            costs = _costs(outcomes, found)
            overlap = mean_overlap(outcomes)
            tried += [
                (cost, overlap, replace(every, least_volume=volume))
                for volume, cost in zip(VOLUMES, costs, strict=True)
            ]
    least = min(cost for cost, _, _ in tried)
    return max((one for one in tried if one[0] <= least + 0.01), key=lambda one: (one[1], -one[0]))[2]


def _costs(outcomes: Sequence[Outcome], found: Sequence[Sequence[Mark]]) -> list[float]:
    """For each of ``VOLUMES``: missed share and false regions an image, expected and each by its goal."""
    marked = sum(len(outcome.kinds) for outcome in outcomes)
    hits = [places[at].volume for one, places in zip(outcomes, found, strict=True) for at in one.pairs]
    false = [
        place.volume
        for one, places in zip(outcomes, found, strict=True)
        for at, place in enumerate(places)
        if at not in one.pairs
    ]
    costs = []
    for volume in VOLUMES:
        kept, wrong = (
            float(ndtr(np.log(np.array(some) / volume) / VOLUME_SPREAD).sum()) for some in (hits, false)
        )
        costs.append((marked - kept) / marked / GOAL_MISSED + wrong / len(outcomes) / GOAL_FALSE)
    return costs


def plain(rows: Sequence[GoldenFigures]) -> list[dict[str, Any]]:
    """Rows as JSON has them."""
    return [asdict(row) for row in rows]
