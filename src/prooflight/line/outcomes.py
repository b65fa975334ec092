"""What became of each sheet, put in the order of the run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Verdict
from prooflight.inspection.promise import PromiseWatch
from prooflight.journal.records import PageRecord
from prooflight.line.monitor.run import PageEvidence
from prooflight.line.notices import Notice
from prooflight.line.pace import Pace
from prooflight.pages.files import page_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.line.following import Adapting
    from prooflight.line.monitor.run import Announcement, RunMonitor
    from prooflight.line.sheets.records import Fault, MissingPage, SeenPage

SPOILT: Final = frozenset({"slip", "stretch", "lost-lines", "extra-lines", "blank", "splice", "unknown"})
"""Faults of a sheet whose scan says nothing of the run."""
LEFT_OUT: Final = "not a number that a page can have: {}; left out of the run"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One sheet, or one page that did not come."""

    record: PageRecord
    latency_s: float | None = None
    """From its last line to its verdict; None: it was not inspected."""
    evidence: PageEvidence
    """What it adds to its run."""
    came: bool = True
    """False: no sheet, but a page that did not come."""
    announcements: tuple[Announcement, ...] = ()
    """What the run says with it; known when it has been put in order."""
    notices: tuple[Notice, ...] = ()
    """What the run says then that is of no channel."""


def outcome(
    number: int,
    seen: SeenPage,
    verdict: Verdict,
    *,
    late: bool = False,
    latency_s: float | None = None,
    evidence: PageEvidence | None = None,
    kept: Mapping[str, NDArray[Any]] | None = None,
    asked: float | None = None,
) -> Outcome:
    """Of a sheet that was inspected."""
    kinds = kinds_of(seen.faults)
    told = evidence if evidence is not None and not SPOILT & set(kinds) else PageEvidence()
    left_out, told = told.unsound, told.sound()
    record = PageRecord(
        sheet=number,
        job_page=seen.job_page,
        verdict=verdict,
        late=late,
        first_line=seen.first_line,
        time_s=seen.last_line_time_s,
        faults=kinds,
        notes=(*lost_lines(seen), *((LEFT_OUT.format(", ".join(left_out)),) if left_out else ())),
        nuisance=dict(told.values),
        asked=asked,
        evidence=kept,
    )
    return Outcome(record=record, latency_s=latency_s, evidence=told)


def skipped(number: int, seen: SeenPage, why: str, *, name: str | None = None) -> Outcome:
    """Of a sheet that nobody inspected; why: in one line. name: of the page that it shows or is taken for."""
    if name is None:
        name = f"sheet {number}" if seen.job_page is None else page_name(seen.job_page + 1)
    return outcome(number, seen, Verdict.skipped(name, why))


def unknown_sheet(number: int, seen: SeenPage) -> Outcome:
    """Of a sheet that shows no page of the job: there is nothing to compare it with, and nothing right about it."""
    kinds = kinds_of(seen.faults)
    blank = "blank" in kinds
    reason = "; ".join(fault.detail for fault in seen.faults) or "the sheet shows no page of the job"
    kind = "missing-content" if blank else "wrong-page"
    return outcome(
        number,
        seen,
        Verdict(page=f"sheet {number}", verdict="misprint", kind=kind, reason=reason),
    )


def missing_page(number: int, page: MissingPage, time_s: float, *, name: str | None = None) -> Outcome:
    """Of a page of the job that did not come; name: its own."""
    reason = "; ".join(fault.detail for fault in page.faults)
    record = PageRecord(
        sheet=number,
        job_page=page.job_page,
        verdict=Verdict.skipped(name or page_name(page.job_page + 1), reason),
        late=False,
        first_line=page.faults[0].first_line if page.faults else 0,
        time_s=time_s,
        faults=kinds_of(page.faults) or ("missing",),
    )
    return Outcome(record=record, evidence=PageEvidence(), came=False)


def lost_lines(seen: SeenPage) -> tuple[str, ...]:
    """What is said of a sheet of which the camera lost lines: which, and why."""
    if not (seen.unseen or seen.torn):
        return ()
    return tuple(f"lines lost: {fault.detail}" for fault in seen.faults if fault.kind == "lost-lines")


def kinds_of(faults: Sequence[Fault]) -> tuple[str, ...]:
    """Kinds of faults, each once."""
    return tuple(dict.fromkeys(fault.kind for fault in faults))


class InOrder:
    """Gives outcomes on in the order of their sheets, whichever is decided first; every sheet has one."""

    def __init__(self) -> None:
        self._next = 0
        self._early: dict[int, Outcome] = {}

    def put(self, outcome: Outcome) -> list[Outcome]:
        """Add one; returns those whose turn has come."""
        self._early[outcome.record.sheet] = outcome
        ready = []
        while self._next in self._early:
            ready.append(self._early.pop(self._next))
            self._next += 1
        return ready


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunWatch:
    """What the run as a whole says, sheet after sheet."""

    monitor: RunMonitor
    adapting: Adapting | None
    sheets: int | None
    """In the run; None: nobody said."""
    promise: PromiseWatch = field(default_factory=PromiseWatch)
    pace: Pace = field(default_factory=Pace)

    def add(self, outcome: Outcome) -> Outcome:
        """The next sheet, in order; returns it with what the run says now."""
        number, evidence = outcome.record.sheet, outcome.evidence
        left = None if self.sheets is None else max(self.sheets - 1 - (outcome.record.job_page or number), 0)
        said = self.monitor.see(number, evidence, pages_left=left)
        if self.adapting is not None:
            for name, level in self.adapting.see(evidence.values):
                said += self.monitor.excursion(number, name, level, pages_left=left)
        news = []
        design = number if outcome.record.job_page is None else outcome.record.job_page
        if self.promise.add(outcome.record.verdict, evidence.summary, design):
            news.append(Notice(kind="promise-suspended", text=self.promise.suspended))
        if outcome.came and (said_of_pace := self.pace.add(outcome.record)) is not None:
            news.append(said_of_pace)
        verdict = self.promise.marked(outcome.record.verdict)
        if not (said or news) and verdict is outcome.record.verdict:
            return outcome
        notes = (*outcome.record.notes, *(one.text for one in said), *(one.text for one in news))
        record = replace(outcome.record, verdict=verdict, notes=notes)
        return replace(outcome, record=record, announcements=tuple(said), notices=tuple(news))
