"""Inspection of the sheets of a run: preparation of a design, inspection of one scan of it, and the sample to label."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, Self

import numpy as np

from prooflight.inspection.lost_lines import inspect_where_seen
from prooflight.inspection.packed_design import PackedDesign
from prooflight.inspection.redeciding import evidence_to_store, scan_to_store
from prooflight.pages.job import opened
from prooflight.rng import stream
from prooflight_line.run.monitor.evidence import run_evidence
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.sheets.thumbnails import thumbnail_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.prepared_store import PreparedStore
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.lines import Unseen


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """Sampling design of one run: which of its sheets are reviewed by a person."""

    sample: float = 0.0
    """Probability that a sheet that passed is sampled for review. [-]"""
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.sample <= 1:
            message = f"sample must be 0 to 1, got {self.sample}"
            raise ValueError(message)

    def probability(self, verdict: Verdict, sheet: int) -> float | None:
        """Return the probability with which a sheet was sampled for review, or None if it was not.

        The draw depends only on the seed and the sheet's number, so that every process and every later call
        agree. A sheet that was not inspected has no verdict to review and is never sampled.
        """
        if verdict.verdict == "misprint":
            return 1.0
        if verdict.verdict != "good" or not self.sample:
            return None
        return self.sample if stream(self.seed, "asked-sheets", sheet).random() < self.sample else None


Keep = Literal["all", "misprints", "none"]
OFF_PLACE: Final = (2, 1)
"""Displacement of the warm-up's page, in lines and pixels."""
WARM_UP: Final = "warm-up"
"""Name of a rehearsal's sheet in errors."""
HOLE_PART: Final = 16
"""Divisor of a scan's length and width that gives the hole's size on the warm-up's page."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetResult:
    """One sheet's verdict, its contribution to its run, and its evidence for the journal."""

    verdict: Verdict
    evidence: PageEvidence = field(default_factory=PageEvidence)
    stored_evidence: Mapping[str, NDArray[Any]] | None = None
    asked: float | None = None
    """Probability with which it was sampled for review, by ``Asking.probability``."""


class SheetWorkers(Protocol):
    """Processes that inspect (``inspection_workers``)."""

    def inspect(
        self,
        inspector: SheetInspector,
        ready: PackedDesign,
        scan: NDArray[np.uint16],
        *,
        decided: Callable[[Verdict], None] | None,
        **arguments: Any,
    ) -> SheetResult:
        """Inspect a scan in one of them."""
        ...

    def rehearse(
        self, inspector: SheetInspector, ready: PackedDesign, scan: NDArray[np.uint16], **arguments: Any
    ) -> None:
        """Inspect a scan in every one of them at once."""
        ...

    def provide(self, inspector: SheetInspector, ready: PackedDesign) -> object:
        """Let them read a design."""
        ...

    def load(self, inspector: SheetInspector, ready: PackedDesign) -> None:
        """Let every one of them read a design before its first sheet."""
        ...

    def close(self) -> None:
        """End them."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class SheetInspector:
    """Inspector of sheets; safe to call from several threads at once."""

    inspector: Inspector
    keep: Keep = "none"
    """Sheets whose evidence is kept for the journal; that of sheets sampled for review always is."""
    sampling: Sampling = field(default_factory=Sampling)
    workers: SheetWorkers | None = None
    """Processes that inspect; None: the calling thread does."""

    def prepare(self, page: Page) -> PackedDesign:
        """Prepare a design ahead of its sheets.

        It runs in this thread alone, since it must not delay the sheets that come meanwhile.
        """
        return self._provided(self._packed(page))

    def _packed(self, page: Page) -> PackedDesign:
        planned = self.inspector.planned(page, threads=1)
        prepared = self.inspector.prepare(planned)
        thumbnail = thumbnail_of(page, planned.expected, self.inspector.press)
        return PackedDesign.of(prepared, thumbnail.arrays)

    def inspect(
        self,
        ready: PackedDesign,
        scan: NDArray[np.uint16],
        *,
        name: str,
        seed: int,
        unseen: Sequence[Unseen] = (),
        sheet: int = 0,
        decided: Callable[[Verdict], None] | None = None,
    ) -> SheetResult:
        """Inspect one scan of a sheet.

        Parameters
        ----------
        ready
            Prepared design that the sheet shows.
        scan
            (sensors, lines, pixels) [DN].
        name
            Name of the sheet in errors.
        seed
            Seed of the inspection's randomised values.
        unseen
            Lines of the scan that the camera lost.
        sheet
            Number of the sheet in the run.
        decided
            Called with the verdict on a misprint before it is explained, as ``Inspector.inspect`` does.

        Raises
        ------
        ScanError
            The scan does not fit the press or the page.
        """
        if self.workers is not None:
            arguments = {"name": name, "seed": seed, "unseen": unseen, "sheet": sheet}
            return self.workers.inspect(self, ready, scan, decided=decided, **arguments)
        threads = self.inspector.detector.press_context.threads or os.cpu_count() or 1
        prepared, press = ready.unpacked(threads=threads), self.inspector.press
        inspection = inspect_where_seen(
            self.inspector, prepared, scan, unseen=unseen, scan_name=name, seed=seed, decided=decided
        )
        evidence = run_evidence(inspection, press, page_width_mm=prepared.page.width_mm)
        misprint = inspection.verdict.verdict == "misprint"
        asked = self.sampling.probability(inspection.verdict, sheet)
        drawn = asked is not None and not misprint
        is_stored = self.keep == "all" or (self.keep == "misprints" and misprint) or drawn
        return SheetResult(
            verdict=inspection.verdict,
            evidence=evidence,
            stored_evidence=evidence_to_store(inspection, prepared.page, press, whole=drawn)
            if is_stored
            else None,
            asked=asked,
        )

    def picture_to_store(self, scan: NDArray[np.uint16]) -> dict[str, NDArray[Any]] | None:
        """Return the picture of a sheet that shows no page of the job; None: no evidence of misprints is kept.

        scan: (sensors, lines, pixels) [DN].
        """
        return None if self.keep == "none" else scan_to_store(scan, self.inspector.press)

    def rehearsal_scans(self, ready: PackedDesign) -> list[NDArray[np.uint16]]:
        """Return scans (sensors, lines, pixels) [DN] after whose inspection none waits for compiler, cache or memory.

        The scan is the expected one, displaced and in place, with a hole: a misprint takes most time and memory.
        """
        expected = self.inspector.planned(ready.unpacked().page).expected.expected_dn
        plain = np.rint(expected).clip(0).astype(np.uint16)
        scans = [np.roll(plain, off, axis=(1, 2)) for off in (OFF_PLACE, (0, 0))]
        lines, pixels = (slice(size // 2, size // 2 + size // HOLE_PART) for size in plain.shape[1:])
        for scan, hole in zip(scans, (0, plain.max()), strict=True):
            scan[:, lines, pixels] = hole
        return scans

    def rehearse_preparation(self, ready: PackedDesign) -> None:
        """Prepare a design again, for the sake of those that are prepared while sheets pass."""
        self._packed(ready.unpacked().page)

    def rehearse(self, ready: PackedDesign, scans: Iterable[NDArray[np.uint16]], *, threads: int = 1) -> None:
        """Inspect ``rehearsal_scans`` of a design, in so many threads at once, or in every process that inspects."""
        for scan in scans:
            if self.workers is not None:
                self.workers.rehearse(self, ready, scan, name=WARM_UP, seed=0)
                continue
            with ThreadPoolExecutor(threads) as pool:
                turns = [pool.submit(self.inspect, ready, scan, name=WARM_UP, seed=0) for _ in range(threads)]
            for turn in turns:
                turn.result()

    def load(self, ready: PackedDesign) -> None:
        """Let the processes that inspect read a design, so that its first sheet need not wait for that."""
        if self.workers is not None:
            self.workers.load(self, ready)

    def close(self) -> None:
        """End the processes that inspect."""
        if self.workers is not None:
            self.workers.close()

    def following(self, press: Press) -> Self:
        """Return the same inspector for a press whose light has changed a little."""
        return replace(self, inspector=self.inspector.under(press))

    def renewed(self, ready: PackedDesign) -> PackedDesign:
        """Return a prepared design under the press as it is now; cheap if the detector can adapt it."""
        context = self.inspector.detector.press_context
        adapted = ready.bare.prepared_page.under(context)
        if adapted is None:
            return self.prepare(ready.unpacked().page)
        bare = replace(ready.bare, prepared_page=adapted)
        return self._provided(replace(ready, bare=bare, origin=ready.origin or ready))

    def _provided(self, ready: PackedDesign) -> PackedDesign:
        """Return a design that the workers can read, so that its first sheet need not wait for that."""
        if self.workers is not None:
            self.workers.provide(self, ready)
        return ready


# --- preparation of a job's designs before any run, by any process ---


@dataclass(frozen=True, slots=True, kw_only=True)
class PrepareDesign:
    """Preparation of one page of a job; it stores nothing, and can be sent to workers on other machines."""

    source: JobSource
    store: PreparedStore

    def __call__(self, number: int) -> bytes:
        """Return the file of page ``number``, from 1, for ``PreparedStore.put``.

        JobError: the page cannot be used, or does not fit the press.
        """
        inspector = self.store.inspector
        page = inspector.press.geometry.lay(opened(self.source).page(number))
        return self.store.content(SheetInspector(inspector=inspector).prepare(page))
