"""Combination of sides into sheets for the gate: a sheet is decided when its last side was seen."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from prooflight.detectors.verdict import Verdict
from prooflight.inspection.sheets import OPEN_SHEETS, sheet_verdict, side_verdict

if TYPE_CHECKING:
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight_line.journal.records import PageRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRecord:
    """Record of a sheet for the gate's decision."""

    record: PageRecord
    """Record of its last side, in which ``job_page`` is the sheet of the run and the verdict is that of
    the sheet."""
    rows: tuple[int, ...]
    """Numbers of its sides in the run."""
    came: bool = True
    """Whether its last side came. False: no sheet is due at the gate."""


@dataclass(slots=True)
class SheetSides:
    """Store of first sides until the last one comes; those of a sheet whose last side never comes are dropped
    in the end.
    """

    plan: SheetPlan
    _first: OrderedDict[int, list[PageRecord]] = field(default_factory=OrderedDict)

    def is_due(self, job_page: int | None) -> bool:
        """Return whether a sheet goes on to the gate with this side.

        A side without a known position may be any side, and its sheet is due.
        """
        return job_page is None or self.plan.sheet_at(job_page)[1] == self.plan.layout.sides - 1

    def add(self, record: PageRecord, *, came: bool) -> SheetRecord | None:
        """Add the next side, and return the sheet to be decided with it.

        None: the sheet comes again for its other side.
        """
        if record.job_page is None or self.plan.layout.sides == 1:
            return SheetRecord(record=record, rows=(record.sheet,), came=came)
        sheet, back = self.plan.sheet_at(record.job_page)
        if not back:
            self._first.setdefault(sheet, []).append(record)
            while len(self._first) > OPEN_SHEETS:
                self._first.popitem(last=False)
            return None
        fronts = self._first.get(sheet, []) if came else self._first.pop(sheet, [])
        sides = [side_verdict(self.plan, sheet, at, records) for at, records in enumerate((fronts, [record]))]
        combined = sheet_verdict(self.plan, sheet, sides)
        decisive = min((*fronts, record), key=lambda one: one.verdict.verdict != combined.verdict)
        verdict = Verdict(
            page=combined.name,
            verdict=combined.verdict,
            kind=decisive.verdict.kind,
            reason="; ".join(combined.why),
        )
        faults = dict.fromkeys(fault for side in sides for fault in side.faults)
        return SheetRecord(
            record=replace(record, job_page=sheet, verdict=verdict, faults=tuple(faults)),
            rows=tuple(one.sheet for one in (*fronts, record)),
            came=came,
        )
