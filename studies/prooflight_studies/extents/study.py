"""Overlap of the reported place of a misprint with its true extent, by kind, and how often its words are right.

``python -m prooflight_studies.extents.study PRESS --seeds 1-12`` prints each misprint and a table by kind. PRESS is
trained with the matched filter, as ``prooflight demo`` leaves it.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press
from prooflight.reporting.defect_text import describe, shown_kind
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import session_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.detectors.verdict import Verdict
    from prooflight.simulation.misprints.kinds import Misprint

Box = tuple[float, float, float, float]

KINDS: Final = (
    "streak", "local-blur", "ghost-smear", "missing-content", "spots-voids", "scum", "missing-plane", "banding",
    "wrong-page", "density",
)  # fmt: skip
"""Kind of the misprint on each design of a seed, in turn."""
SEVERITY: Final = (0.4, 1.0)
"""Range of severities, drawn uniformly: below, half of all misprints are not caught."""
OTHER_DESIGN: Final = 99
"""Design that a wrong page shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One misprint and what was said of it."""

    kind: str
    truth: Misprint
    verdict: Verdict
    size_mm: tuple[float, float]

    @property
    def overlap(self) -> float:
        """Intersection over union of the first region and the true place that it shares most with."""
        region = self.verdict.regions[0]
        box = region.x_mm, region.y_mm, region.width_mm, region.height_mm
        return max(overlap(box, true) for true in self.truth.regions_mm or (self.truth.region_mm,))

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
        for index, kind in enumerate(KINDS):
            page, rng = press.geometry.lay(corpus.page(index)), stream(seed, "study-print", index, 0)
            request = MisprintRequest(kind=kind, severity=float(rng.uniform(*SEVERITY)))
            try:
                scan = scan_page(
                    page,
                    press=press,
                    request=request,
                    others=(OTHER_DESIGN,),
                    fetch=lambda number, of=corpus: press.geometry.lay(of.page(number)),  # type: ignore[misc]
                    rng=rng,
                    session=session,
                )
            except RequestError:
                continue  # this kind shows nothing on this design
            verdict = inspector.inspect(page, Scan(dn=scan.dn, name=page.name), seed=seed).verdict
            if scan.misprint is not None and verdict.verdict == "misprint" and verdict.regions:
                yield Row(
                    kind=kind, truth=scan.misprint, verdict=verdict, size_mm=(page.width_mm, page.height_mm)
                )


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
        said = describe(row.verdict, size_mm=row.size_mm).brief
        print(f"{row.kind}: {row.truth.detail}\n    {said}\n    overlap {row.overlap:.2f}", flush=True)  # noqa: T201
    for kind, found in by_kind.items():
        overlaps, right = (np.array(one, float) for one in zip(*found, strict=True))
        print(f"{kind:16} {len(found):3} overlap {np.median(overlaps):.2f} right {right.mean():.2f}")  # noqa: T201


if __name__ == "__main__":
    main()
