"""A contact sheet of the detections, misses and false detections of inspection against a golden scan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.files.atomic import whole_file
from prooflight_studies.golden.pairs import KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.golden.differences import GoldenDifference
    from prooflight_studies.golden.figures import Outcome
    from prooflight_studies.golden.pairs import Box, GoldenPair

PIECE_PIXELS: Final = 112
COLUMNS: Final = 8
MOST_OF_A_SORT: Final = 16
DARKER, LIGHTER = (214, 40, 40), (20, 140, 200)
MARKED, FOUND = "#15803d", "#f59e0b"


def draw_golden_sheet(
    path: Path,
    pairs: Sequence[GoldenPair],
    outcomes: Sequence[Outcome],
    seen: Mapping[str, GoldenDifference],
) -> None:
    """Draw pieces of the scans around misses, false detections, and detections of least overlap with their marks."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    by_name = {pair.name: pair for pair in pairs}
    sorts = _sorts(outcomes)
    rows = sum(-(-len(pieces) // COLUMNS) for _, pieces in sorts)
    figure = Figure(figsize=(COLUMNS * 1.55, rows * 1.85 + 0.45 * len(sorts) + 0.35), layout="constrained")
    parts = figure.subfigures(
        len(sorts), 1, squeeze=False, height_ratios=[-(-len(pieces) // COLUMNS) + 0.25 for _, pieces in sorts]
    )
    for part, (title, pieces) in zip(parts.ravel(), sorts, strict=True):
        part.suptitle(title, x=0.01, ha="left", fontsize=9, fontweight="bold")
        height = -(-len(pieces) // COLUMNS)
        cells = part.subplots(height, COLUMNS, squeeze=False).ravel()
        for axes in cells:
            axes.set_axis_off()
        for axes, (outcome, box, caption) in zip(cells, pieces, strict=False):
            pair = by_name[outcome.name]
            left, top = (int((box[side] + box[side + 2]) / 2 - PIECE_PIXELS / 2) for side in (0, 1))
            axes.imshow(_coloured(pair, seen[pair.name]), interpolation="nearest")
            for boxes, colour, width in ((pair.marked, MARKED, 2.0), (outcome.boxes, FOUND, 1.2)):
                for one in boxes:
                    corner = (one[0] - 0.5, one[1] - 0.5)
                    size = (one[2] - one[0], one[3] - one[1])
                    axes.add_patch(Rectangle(corner, *size, fill=False, edgecolor=colour, linewidth=width))
            axes.set_xlim(left, left + PIECE_PIXELS)
            axes.set_ylim(top + PIECE_PIXELS, top)
            axes.set_title(caption, fontsize=6.5, pad=2)
    figure.supxlabel(
        "red: darker than the golden, blue: lighter, beyond tolerance; green boxes: marked, amber: found",
        fontsize=8,
    )
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=130, format="png")


def _sorts(outcomes: Sequence[Outcome]) -> list[tuple[str, list[tuple[Outcome, Box, str]]]]:
    missed, false, found = [], [], []
    for one in outcomes:
        hit = dict(one.pairs.values())
        for at, (kind, box) in enumerate(zip(one.kinds, one.marked, strict=True)):
            if at in hit:
                found.append((hit[at], (one, box, f"{one.name} {KINDS[kind]} {hit[at]:.2f}")))
            else:
                missed.append((one, box, f"{one.name} {KINDS[kind]}"))
        false += [(one, box, one.name) for at, box in enumerate(one.boxes) if at not in one.pairs]
    found.sort(key=lambda each: each[0])
    least = [piece for _, piece in found[:MOST_OF_A_SORT]]
    typical = [piece for _, piece in found[:: max(1, len(found) // COLUMNS)]][:COLUMNS]
    sorts = [
        (f"Missed ({len(missed)})", missed[:MOST_OF_A_SORT]),
        (f"False ({len(false)})", false[:MOST_OF_A_SORT]),
        ("Found, least overlap", least),
        (f"Found, every {max(1, len(found) // COLUMNS)}th by overlap", typical),
    ]
    return [(title, pieces) for title, pieces in sorts if pieces]


def _coloured(pair: GoldenPair, difference: GoldenDifference) -> NDArray[np.uint8]:
    scan = pair.scan[0]
    grey = 150 + 95 * (scan - scan.min()) / max(float(np.ptp(scan)), 1.0)
    picture = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
    picture[(difference.weight > 0) & (difference.excess < 0)] = DARKER
    picture[(difference.weight > 0) & (difference.excess > 0)] = LIGHTER
    return picture
