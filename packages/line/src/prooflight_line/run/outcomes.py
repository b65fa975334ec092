"""Outcomes of sheets, and their order in the run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Verdict
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight.pages.files import page_name
from prooflight_line.journal.records import PageRecord
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.notices import Notice
from prooflight_line.run.pace import Pace

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight_line.run.following import Adapting
    from prooflight_line.run.monitor.run import Announcement, RunMonitor
    from prooflight_line.run.sheets.records import Fault, MissingPage, SeenPage

CORRUPTED: Final = frozenset({"slip", "stretch", "lost-lines", "extra-lines", "blank", "splice", "unknown"})
"""Faults of a sheet whose scan is no evidence about the run."""
LEFT_OUT: Final = "not a number that a page can have: {}; left out of the run"


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetTimes:
    """Times of a sheet on its way to its verdict, by the clock of the run. [s]"""

    lines_s: float
    """Time that the sheet took to pass the camera."""
    last_line_s: float
    placed_s: float
    """Time at which it was cut from the lines, and its page identified."""
    begun_s: float
    """Time at which its inspection began."""
    decided_s: float
    """Time at which its verdict was known; a misprint is explained after that."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unexplained:
    """A misprint that is still being explained, for the gate."""

    outcome: Outcome


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """The outcome of one sheet, or of one page that did not come."""

    record: PageRecord
    latency_s: float | None = None
    """Time from its last line to its verdict; None: it was not inspected."""
    evidence: PageEvidence
    """Its contribution to the run monitor."""
    came: bool = True
    """Whether a sheet came; False: the outcome of a missing page."""
    announcements: tuple[Announcement, ...] = ()
    """Announcements of the run monitor at this sheet; set once the outcomes are in order."""
    notices: tuple[Notice, ...] = ()
    """Notices of the run at this sheet that belong to no channel."""
    times: SheetTimes | None = None
    """None: it was not inspected."""


def outcome(
    number: int,
    seen: SeenPage,
    verdict: Verdict,
    *,
    late: bool = False,
    latency_s: float | None = None,
    evidence: PageEvidence | None = None,
    stored_evidence: Mapping[str, NDArray[Any]] | None = None,
    asked: float | None = None,
    times: SheetTimes | None = None,
) -> Outcome:
    """Return the outcome of a sheet that was inspected."""
    kinds = kinds_of(seen.faults)
    usable = evidence if evidence is not None and not CORRUPTED & set(kinds) else PageEvidence()
    left_out, usable = usable.unsound, usable.sound()
    record = PageRecord(
        sheet=number,
        job_page=seen.job_page,
        verdict=verdict,
        late=late,
        first_line=seen.first_line,
        time_s=seen.last_line_time_s,
        faults=kinds,
        notes=(*lost_lines(seen), *((LEFT_OUT.format(", ".join(left_out)),) if left_out else ())),
        nuisance=dict(usable.values),
        asked=asked,
        evidence=stored_evidence,
    )
    return Outcome(record=record, latency_s=latency_s, evidence=usable, times=times)


def skipped(number: int, seen: SeenPage, why: str, *, name: str | None = None) -> Outcome:
    """Return the outcome of a sheet that was not inspected.

    why: the reason, in one line. name: of the page that it shows or is taken for.
    """
    if name is None:
        name = f"sheet {number}" if seen.job_page is None else page_name(seen.job_page + 1)
    return outcome(number, seen, Verdict.skipped(name, why))


def unknown_sheet(
    number: int, seen: SeenPage, *, stored_evidence: Mapping[str, NDArray[Any]] | None = None
) -> Outcome:
    """Return the outcome of a sheet that shows no page of the job: it is a misprint."""
    kinds = kinds_of(seen.faults)
    blank = "blank" in kinds
    reason = "; ".join(fault.detail for fault in seen.faults) or "the sheet shows no page of the job"
    kind = "missing-content" if blank else "wrong-page"
    return outcome(
        number,
        seen,
        Verdict(page=f"sheet {number}", verdict="misprint", kind=kind, reason=reason),
        stored_evidence=stored_evidence,
    )


def missing_page(number: int, page: MissingPage, time_s: float, *, name: str | None = None) -> Outcome:
    """Return the outcome of a page of the job that did not come, or that nothing watched; name: its own."""
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
    return Outcome(record=record, evidence=PageEvidence(), came=page.is_unwatched)


def lost_lines(seen: SeenPage) -> tuple[str, ...]:
    """Return the notes on a sheet of which the camera lost lines: which, and why."""
    if not (seen.unseen or seen.torn):
        return ()
    return tuple(f"lines lost: {fault.detail}" for fault in seen.faults if fault.kind == "lost-lines")


def kinds_of(faults: Sequence[Fault]) -> tuple[str, ...]:
    """Return the kinds of the faults, each once."""
    return tuple(dict.fromkeys(fault.kind for fault in faults))


class InOrder:
    """Reorder buffer: releases outcomes in the order of their sheets; every sheet has exactly one."""

    def __init__(self, first: int = 0) -> None:
        """Begin with the sheet ``first``."""
        self._next = first
        self._early: dict[int, Outcome] = {}

    @property
    def next(self) -> int:
        """Number of the sheet whose turn it is."""
        return self._next

    def put(self, outcome: Outcome) -> list[Outcome]:
        """Add an outcome; return those whose turn has come."""
        self._early[outcome.record.sheet] = outcome
        ready = []
        while self._next in self._early:
            ready.append(self._early.pop(self._next))
            self._next += 1
        return ready


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunWatch:
    """Monitors of the run as a whole, updated sheet by sheet."""

    monitor: RunMonitor
    adapting: Adapting | None
    sheets: int | None
    """Number of sheets in the run; None: unknown."""
    design: Callable[[int], Hashable] = int
    """Function that returns the key of the design on a page of the run (``PageStore.design``); ``int``: each is new."""
    guarantee: GuaranteeMonitor = field(default_factory=GuaranteeMonitor)
    pace: Pace = field(default_factory=Pace)

    def design_of(self, record: PageRecord) -> Hashable:
        """Return the key of a sheet's design; a sheet that shows no page of the job is one of its own."""
        return ("sheet", record.sheet) if record.job_page is None else self.design(record.job_page)

    def add(self, outcome: Outcome) -> Outcome:
        """Add the next sheet in order; return its outcome with what the monitors report at it."""
        number, evidence = outcome.record.sheet, outcome.evidence
        left = None if self.sheets is None else max(self.sheets - 1 - (outcome.record.job_page or number), 0)
        announcements = self.monitor.see(number, evidence, pages_left=left)
        if self.adapting is not None:
            for name, level in self.adapting.see(evidence.values):
                announcements += self.monitor.excursion(number, name, level, pages_left=left)
        news = []
        if self.guarantee.add(outcome.record.verdict, evidence.summary, self.design_of(outcome.record)):
            news.append(Notice(kind="promise-suspended", text=self.guarantee.suspended))
        if outcome.came and (said_of_pace := self.pace.add(outcome.record)) is not None:
            news.append(said_of_pace)
        verdict = self.guarantee.marked(outcome.record.verdict)
        if not (announcements or news) and verdict is outcome.record.verdict:
            return outcome
        notes = (*outcome.record.notes, *(one.text for one in announcements), *(one.text for one in news))
        record = replace(outcome.record, verdict=verdict, notes=notes)
        return replace(outcome, record=record, announcements=tuple(announcements), notices=tuple(news))
