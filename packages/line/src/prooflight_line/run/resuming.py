"""What a run that broke off has recorded, from which it is resumed: its position, its counts and its monitors.

The journal's rows suffice: each has the page that came, the verdict, and the amounts that the monitors follow. The
evidence of columns and the summaries for the test of the run are not stored, so their tests begin anew.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from prooflight.detectors.disposition import without_gate
from prooflight.inspection.sheets import came
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome
from prooflight_line.run.pace import out_of_time
from prooflight_line.run.sheets.readings import UNWATCHED, Reading, Readings
from prooflight_line.run.status import VERDICTS

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.outcomes import RunWatch

OUT_OF_TURN = frozenset({"repeated", "out-of-order"})
"""Faults of a sheet that does not move the run's position in its job."""


@dataclass(slots=True, kw_only=True)
class Past:
    """The recorded part of a run; ``add`` takes its rows in their order."""

    first_sheet: int = 0
    """Number of the next sheet."""
    due: int = 0
    """The page that should come next, if no sheet has passed since."""
    last: int | None = None
    """The page that came last."""
    missing: set[int] = field(default_factory=set)
    """Pages reported missing that have not come since."""
    time_s: float | None = None
    """Time of the last recorded sheet, by the source's clock; None: none was recorded."""
    first_not_inspected: str = ""
    """The first sheet that was not inspected, and why; empty: there was none."""
    promise_suspended: str = ""
    """Why the false-alarm rate does not hold; empty: nothing shows it."""
    counts: Counter[str] = field(default_factory=Counter)
    """Counts by the names of ``Status``."""
    faults: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, records: Iterable[PageRecord], watch: RunWatch | None = None) -> Past:
        """Return the past of a run from all its rows, in their order.

        Each row is added to the monitors of ``watch``; what they announce was announced before.
        """
        past = cls()
        designs: set[Hashable] = set()
        for record in records:
            past.add(record)
            if watch is None:
                continue
            evidence = PageEvidence(values=record.nuisance)
            finished = watch.add(Outcome(record=record, evidence=evidence, came=came(record)))
            past.counts["announcements"] += len(finished.announcements)
            past.counts["overloads"] += sum(one.kind == "overloaded" for one in finished.notices)
            if record.verdict.detector:
                designs.add(watch.design_of(record))
        if watch is not None:
            watch.guarantee.resume(designs, past.promise_suspended)
        return past

    def add(self, record: PageRecord) -> None:
        """Add the next row."""
        self.first_sheet, self.time_s = record.sheet + 1, record.time_s
        self._move(record)
        self._count(record)
        if record.verdict.promise_suspended and not self.promise_suspended:
            messages = (note for note in record.notes if "promise" in note)
            self.promise_suspended = next(messages, "the promised false-alarm rate does not hold")

    def readings(self, pages: int) -> Readings:
        """Return the hypotheses about the run's position; an unknown number of its ``pages`` has passed since."""
        return Readings(
            pages=pages,
            hypotheses=(Reading(due=min(self.due, pages)),),
            last=self.last,
            missing=set(self.missing),
            reported=set(self.missing),
            blind=True,
            unseen=UNWATCHED,
        )

    def _move(self, record: PageRecord) -> None:
        if not came(record):
            assert record.job_page is not None
            self.missing.add(record.job_page)
            return
        if record.job_page is None:
            self.due += 1
            return
        self.last = record.job_page
        self.missing.discard(record.job_page)
        if not OUT_OF_TURN & set(record.faults):
            self.due = record.job_page + 1
            self.missing = {page for page in self.missing if page < self.due}

    def _count(self, record: PageRecord) -> None:
        verdict, counts = record.verdict, self.counts
        if not came(record):
            counts["missing"] += 1
            return
        counts["pages_seen"] += "unwatched" not in record.faults
        counts[VERDICTS[verdict.verdict]] += 1
        if verdict.verdict == "not-inspected" and not self.first_not_inspected:
            self.first_not_inspected = f"{verdict.page}: {verdict.reason}"
        counts["late"] += record.late
        counts["out_of_time"] += out_of_time(record)
        counts["promise_suspended"] += verdict.promise_suspended
        unvouched = verdict.verdict == "good" and without_gate(verdict, record.faults)[0] == "hold"
        counts["unvouched"] += unvouched
        self.faults.update(record.faults)
