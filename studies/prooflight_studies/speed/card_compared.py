"""Prints of a job judged on the processor and on a graphics card, in as many processes as there are processors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector, MatchedFilterPage
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.pages.parallel import in_order
from prooflight.press.pages import open_job
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import session_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

A_PART: Final = 16
"""Prints of one page that are judged one after the other, once its design is prepared."""
OTHERS: Final = 3
"""Number of other pages that may come in a page's place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One scan, judged on the processor and on the card."""

    page: str
    misprint: str
    """Kind that was printed; "": a good print."""
    cpu: str
    """Verdict, and kind of misprint."""
    gpu: str
    cpu_score: float
    gpu_score: float
    statistics_off: float
    """Greatest difference of a statistic, in standard deviations of good prints."""

    @property
    def score_off(self) -> float:
        """Difference of the scores."""
        return abs(self.cpu_score - self.gpu_score)

    @property
    def differs(self) -> bool:
        """Whether one alarms and the other does not, or one is not inspected."""
        return self.cpu.partition(" ")[0] != self.gpu.partition(" ")[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgePart:
    """Prints of one page, each judged by both."""

    job: Path
    press: Press
    seed: int

    def __call__(self, part: tuple[int, int, int]) -> list[Compared]:
        """Return the judgements of a page's prints.

        part: number of the page, from 1; number of its first print; number of prints.
        """
        number, first, count = part
        inspector = Inspector.of(self.press, "matched_filter").with_threads(1)
        card, session = inspector.on("gpu"), session_of(self.press, self.seed)
        with open_job(self.job, self.press) as opened:

            def laid(number: int) -> Page:
                return self.press.geometry.lay(opened.page(number))

            others = tuple(1 + (number + step) % len(opened) for step in range(OTHERS))
            page = laid(number)
            design = inspector.prepare(page)
            on_card, compared = with_inspector(design, card), list[Compared]()
            for turn in range(first, first + count):
                # Every third print is a misprint, of another kind each.
                kind = KINDS[(number + turn // 3) % len(KINDS)] if turn % 3 == 2 else ""
                try:
                    scan = scan_page(
                        page,
                        press=self.press,
                        request=MisprintRequest(kind=kind) if kind else None,
                        others=others,
                        fetch=laid,
                        rng=stream(self.seed, "card-print", turn, number),
                        session=session,
                    ).dn
                except RequestError:  # a page without cyan cannot lack it
                    continue
                compared.append(_compared(kind, inspector, design, card, on_card, scan))
        return compared


def judged_by_both(
    job: Path,
    press: Press,
    *,
    pages: int,
    prints: int,
    seed: int,
    processes: int,
    say: Callable[[str], None],
) -> list[Compared]:
    """Return some ``prints`` of a job's pages judged on the processor and on the card."""
    each = -(-prints // pages)
    parts = [
        (number, first, min(A_PART, each - first))
        for first in range(0, each, A_PART)
        for number in range(1, pages + 1)
    ]
    work, compared = JudgePart(job=job, press=press, seed=seed), list[Compared]()
    for turn, done in enumerate(in_order(work, parts, processes=processes)):
        compared += done
        say(f"{len(compared)} of {prints} prints judged by both, {turn + 1} of {len(parts)} parts")
    return compared


def with_inspector(prepared: Prepared, inspector: Inspector) -> Prepared:
    """Return a prepared page for another inspector of the same press."""
    detector_page, detector = prepared.prepared_page, inspector.detector
    assert isinstance(detector_page, MatchedFilterPage)
    assert isinstance(detector, MatchedFilterDetector)
    return replace(prepared, prepared_page=replace(detector_page, detector=detector))


def _compared(
    kind: str,
    inspector: Inspector,
    prepared: Prepared,
    card: Inspector,
    on_card: Prepared,
    scan: NDArray[np.uint16],
) -> Compared:
    one, other = inspector.inspect(prepared, scan), card.inspect(on_card, scan)
    scores = [
        inspector.detector.decided_again(StoredArrays(each.stored_arrays, inspector.detector.name)).score
        for each in (one, other)
    ]
    detector_page: Any = prepared.prepared_page
    features = one.stored_arrays["page_features"][None]
    deviations = [
        detector_page.model.deviations(each.stored_arrays["values"][None], features)[0]
        for each in (one, other)
    ]
    off = np.abs(deviations[0] - deviations[1])
    return Compared(
        page=prepared.page.name,
        misprint=kind,
        cpu=_verdict(one),
        gpu=_verdict(other),
        cpu_score=float(scores[0]),
        gpu_score=float(scores[1]),
        statistics_off=float(off[np.isfinite(off)].max(initial=0.0)),
    )


def _verdict(inspection: Inspection) -> str:
    return f"{inspection.verdict.verdict} {inspection.verdict.kind or ''}".strip()
