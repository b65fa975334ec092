"""What the running inspection asks of an inspector of sheets: make a design ready, inspect one scan of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np

from prooflight.detectors.base import MadeReadyInTwo
from prooflight.inspection.lost_lines import inspect_where_seen
from prooflight.inspection.redeciding import kept_evidence
from prooflight.line.asking import Asking
from prooflight.line.monitor.evidence import run_evidence
from prooflight.line.monitor.run import PageEvidence
from prooflight.line.sheets.thumbnails import thumbnail_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.line.sheets.thumbnails import Thumbnail
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.lines import Unseen

Keep = Literal["all", "misprints", "none"]
OFF_PLACE: Final = (2, 1)
"""Lines and pixels that a page of the warm-up lies off its place."""
HOLE_PART: Final = 16
"""Of a scan's length and width, gone from a page of the warm-up."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetResult:
    """One sheet's verdict, what it adds to its run, and what the journal keeps of it."""

    verdict: Verdict
    evidence: PageEvidence = field(default_factory=PageEvidence)
    kept: Mapping[str, NDArray[Any]] | None = None
    asked: float | None = None
    """``Asking.probability``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """A design ready for its sheets."""

    prepared: Prepared
    thumbnail: Thumbnail
    """By which its sheets are known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetInspector:
    """Inspects sheets; called from several threads at once."""

    inspector: Inspector
    keep: Keep = "none"
    """Of which sheets evidence is kept for the journal; of those that a person is asked about, always."""
    asking: Asking = field(default_factory=Asking)

    def prepare(self, page: Page) -> Known:
        """All that can be known of a design ahead of its sheets.

        It is made in this thread alone, for it must not hold up the sheets that come meanwhile.
        """
        planned = self.inspector.planned(page, threads=1)
        prepared = self.inspector.prepare(planned)
        return Known(prepared=prepared, thumbnail=thumbnail_of(page, planned.expected, self.inspector.press))

    def complete(self, ready: Known) -> None:
        """Make ready what few sheets of a design need, where it pays since many come of it."""
        if isinstance(ready.prepared.known, MadeReadyInTwo):
            ready.prepared.known.complete()

    def inspect(
        self,
        ready: Known,
        scan: NDArray[np.uint16],
        *,
        name: str,
        seed: int,
        unseen: Sequence[Unseen] = (),
        sheet: int = 0,
    ) -> SheetResult:
        """Inspect one scan (sensors, lines, pixels) [DN]; name: of the sheet, in errors; sheet: its number.

        unseen: lines of it that the camera lost. ScanError: the scan does not fit press or page.
        """
        prepared, press = ready.prepared, self.inspector.press
        inspection = inspect_where_seen(
            self.inspector, prepared, scan, unseen=unseen, scan_name=name, seed=seed
        )
        evidence = run_evidence(inspection, press, page_width_mm=prepared.page.width_mm)
        wrong = inspection.verdict.verdict == "misprint"
        asked = self.asking.probability(inspection.verdict, sheet)
        drawn = asked is not None and not wrong
        kept = self.keep == "all" or (self.keep == "misprints" and wrong) or drawn
        return SheetResult(
            verdict=inspection.verdict,
            evidence=evidence,
            kept=kept_evidence(inspection, prepared.page, press, whole=drawn) if kept else None,
            asked=asked,
        )

    def warm_up(self, ready: Known) -> None:
        """Do once what the first sheets will need, so that they need not wait for compilers, caches and memory.

        It is done on the scan expected, off its place and in it, with a hole: a misprint takes most.
        """
        seen = self.inspector.planned(ready.prepared.page).expected
        expected = np.rint(seen.expected_dn).clip(0).astype(np.uint16)
        lines, pixels = (slice(size // 2, size // 2 + size // HOLE_PART) for size in expected.shape[1:])
        for off, hole in ((OFF_PLACE, 0), ((0, 0), expected.max())):
            scan = np.roll(expected, off, axis=(1, 2))
            scan[:, lines, pixels] = hole
            self.inspect(ready, scan, name="warm-up", seed=0)
        self.prepare(ready.prepared.page)

    def following(self, press: Press) -> Self:
        """The same on a press whose light has changed a little."""
        return replace(self, inspector=self.inspector.under(press))

    def renewed(self, ready: Known) -> Known:
        """A design made ready before, under the press as it is now; next to no work where the detector can follow."""
        station = self.inspector.detector.station
        known = ready.prepared.known.under(station)
        if known is None:
            return self.prepare(ready.prepared.page)
        return replace(ready, prepared=replace(ready.prepared, known=known))
