"""Overlap of the reported place of a misprint with its true extent, by kind, and how often its words are right.

``python -m prooflight_studies.extents.study PRESS --seeds 1-12`` prints each misprint and a table by kind. PRESS is
trained with the matched filter, as ``prooflight demo`` leaves it.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import Prediction, predict
from prooflight.press.artefact import Press
from prooflight.reporting.defect_text import describe, shown_kind
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.scans.scan import Scan
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.misprints.kinds import draw_misprint
from prooflight.simulation.prints import Print, composed
from prooflight.simulation.scans import TRIES, passes_gate
from prooflight.simulation.session import session_of
from prooflight.simulation.worlds import gate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page
    from prooflight.simulation.misprints.kinds import Drawn

Box = tuple[float, float, float, float]

KINDS: Final = (
    "streak", "local-blur", "ghost-smear", "missing-content", "spots-voids", "scum", "missing-plane", "banding",
    "wrong-page", "density",
)  # fmt: skip
"""Kind of the misprint on each design of a seed, in turn."""
SEVERITY: Final = (0.4, 1.0)
"""Range of severities, drawn uniformly: below, half of all misprints are not caught."""
CHANGED: Final = 0.25
"""Share of the greatest change of ink that counts as changed: edges are soft, and content differs."""
OTHER_DESIGN: Final = 99
"""Design that a wrong page shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One misprint and what was said of it."""

    seed: int
    kind: str
    detail: str
    """Description of the misprint."""
    true_mm: list[Box]
    """Its places."""
    verdict: Verdict
    size_mm: tuple[float, float]

    @property
    def overlap(self) -> float:
        """Intersection over union of the first region and the true place that it shares most with."""
        region = self.verdict.regions[0]
        box = region.x_mm, region.y_mm, region.width_mm, region.height_mm
        return max(overlap(box, true) for true in self.true_mm)

    @property
    def shown(self) -> str:
        """Kind in words."""
        return shown_kind(self.verdict.kind, self.verdict.regions[0], self.size_mm)


def overlap(one: Box, other: Box) -> float:
    """Return the intersection over union of two boxes (x, y, width, height).

    >>> overlap((0, 0, 2, 1), (1, 0, 2, 1)), overlap((0, 0, 1, 1), (5, 0, 1, 1))
    (0.3333333333333333, 0.0)
    """
    sides = [
        max(min(one[i] + one[i + 2], other[i] + other[i + 2]) - max(one[i], other[i]), 0.0) for i in (0, 1)
    ]
    shared = sides[0] * sides[1]
    return shared / (one[2] * one[3] + other[2] * other[3] - shared)


def rows(press: Press, seeds: range) -> Iterator[Row]:
    """Yield the misprints that are caught, of every kind on a design of its own for each seed."""
    inspector = Inspector.of(press, "matched_filter")
    for seed in seeds:
        corpus = Corpus(seed=seed, dpi=press.dpi)
        session = session_of(press, seed, "press")
        assert session is not None  # only the ideal world has none
        for index, kind in enumerate(KINDS):
            page, rng = press.geometry.lay(corpus.page(index)), stream(seed, "study-print", index, 0)
            severity = float(rng.uniform(*SEVERITY))
            print_ = Print.draw(session, press, page, rng)
            good = _predicted(page, IN_PLACE, press)
            for _ in range(TRIES):
                drawn = draw_misprint(
                    page,
                    kind,
                    severity,
                    others=(OTHER_DESIGN,),
                    fetch=lambda number, of=corpus: press.geometry.lay(of.page(number)),  # type: ignore[misc]
                    rng=rng,
                )
                if passes_gate(good, _predicted(drawn.page, drawn.placement, press), press, gate()):
                    break
            else:
                continue  # this kind shows nothing on this design
            moved = replace(print_, placement=composed(print_.placement, drawn.placement))
            dn = fast_scan(drawn.page, press, session, moved, rng=rng)
            verdict = inspector.inspect(page, Scan(dn=dn, name=page.name), seed=seed).verdict
            if verdict.verdict == "misprint" and verdict.regions:
                yield Row(
                    seed=seed,
                    kind=kind,
                    detail=drawn.misprint.detail,
                    true_mm=true_places(page, drawn),
                    verdict=verdict,
                    size_mm=(page.width_mm, page.height_mm),
                )


def _predicted(page: Page, placement: Placement, press: Press) -> Prediction:
    return predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement)


def true_places(page: Page, drawn: Drawn) -> list[Box]:
    """Return the boxes about the pixels of each place whose ink changed by ``CHANGED`` of the most or more; of a page
    that is off its place, the whole page.
    """
    change = np.abs(drawn.page.cmyk.astype(np.int16) - page.cmyk).sum(axis=2)
    places = []
    for x, y, width, height in drawn.misprint.regions_mm or (drawn.misprint.region_mm,):
        first, last = (
            [int(at / page.pixel_mm) + more for at in corner]
            for corner, more in (((y, x), 0), ((y + height, x + width), 2))
        )
        part = change[first[0] : last[0], first[1] : last[1]]
        if not part.any():
            continue
        on = part >= CHANGED * part.max()
        (top, bottom), (left, right) = (np.flatnonzero(on.any(axis=axis))[[0, -1]] for axis in (1, 0))
        corner = (first[1] + left) * page.pixel_mm, (first[0] + top) * page.pixel_mm
        places.append((*corner, (right - left + 1) * page.pixel_mm, (bottom - top + 1) * page.pixel_mm))
    return places or [(0.0, 0.0, page.width_mm, page.height_mm)]


def main() -> None:
    """Print all rows, and the means by kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("press", type=Path)
    parser.add_argument("--seeds", default="1-12")
    given = parser.parse_args()
    first, last = map(int, given.seeds.split("-"))
    by_kind = defaultdict(list)
    for row in rows(Press.load(given.press), range(first, last + 1)):
        by_kind[row.kind].append((row.overlap, row.shown == row.kind))
        sentence = describe(row.verdict, size_mm=row.size_mm).brief
        text = f"{row.seed} {row.kind}: {row.detail}\n    {sentence}\n    overlap {row.overlap:.2f}"
        print(text, flush=True)  # noqa: T201
    for kind, of_kind in by_kind.items():
        overlaps, right = (np.array(one, float) for one in zip(*of_kind, strict=True))
        print(f"{kind:16} {len(of_kind):3} overlap {np.median(overlaps):.2f} right {right.mean():.2f}")  # noqa: T201


if __name__ == "__main__":
    main()
