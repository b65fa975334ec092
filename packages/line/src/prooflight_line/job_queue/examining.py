"""Examination of a job before it is queued: each page is checked as `job check` does, and prepared for a press."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import InputError, JobError, RequestError, sentence
from prooflight.inspection.prepared_store import MOST_BYTES, PreparedStore, clean
from prooflight.pages.check import checked_page
from prooflight.pages.files import page_name
from prooflight.pages.job import JobSource, opened
from prooflight.pages.layout.layout import Layout
from prooflight.pages.parallel import in_order
from prooflight.press.pages import job_source
from prooflight.press.print_condition import PrintCondition, condition_warnings
from prooflight.press.sheets import planned
from prooflight_line.run.sheet_inspector import SheetInspector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.job import Job
    from prooflight_line.job_queue.tickets.ticket import Ticket

ANY_DPI: Final = 75.0
"""Resolution without a press, as of `job check`."""
PROCESSES: Final = 2
"""Processes that check pages. They are never this one, which a page that ends its process must not end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageResult:
    """One page as it was examined."""

    warnings: int = 0
    refused: str = ""
    """Reason why the page cannot be printed and inspected; empty: it can be."""
    unprepared: str = ""
    """Reason why the page was not prepared, although it could have been; empty: it was, or could not be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """A job as it was examined."""

    pages: int
    warnings: int = 0
    refused: str = ""
    """Reason why the job is rejected, in one line; empty: it is queued."""
    prepared: bool = False
    """Whether every page is stored as it was prepared."""
    remark: str = ""
    """Why it is not prepared, although a press was given."""
    condition: str = ""
    """Printing condition of the file's output intent; empty: it states none."""
    records: str = ""
    """Records of a PDF/VT in a few words; empty: it has none."""
    notes: tuple[str, ...] = ()
    """Warnings of the whole job, which are among ``warnings``."""

    @property
    def facts(self) -> dict[str, Any]:
        """What was seen, in types that JSON can hold."""
        return {name: value for name, value in asdict(self).items() if name != "refused"}


@dataclass(frozen=True, slots=True, kw_only=True)
class _PageExaminer:
    """Examiner of one page, in a process of its own; small and picklable."""

    source: JobSource
    inspector: Inspector | None
    store: PreparedStore | None

    def __call__(self, number: int) -> PageResult:
        checked, page = checked_page(opened(self.source), number)
        if page is None or self.inspector is None:
            return PageResult(warnings=len(checked.warnings), refused=checked.refused)
        try:
            page = self.inspector.press.geometry.lay(page)
        except JobError as error:
            return PageResult(refused=f"{sentence(error.what)}; {sentence(error.remedy)}")
        unprepared = ""
        if self.store is not None:
            try:
                if self.store.load(number) is None:
                    self.store.save(number, SheetInspector(inspector=self.inspector).prepare(page))
            except OSError as error:  # `watch` prepares it: that is no reason to reject a job
                unprepared = sentence(error)
        return PageResult(warnings=len(checked.warnings), unprepared=unprepared)


def examine(
    path: Path,
    ticket: Ticket | None = None,
    *,
    inspector: Inspector | None = None,
    profile: Path | None = None,
    processes: int = PROCESSES,
    shown: Callable[[Iterator[PageResult], int], Iterator[PageResult]] = lambda results, _pages: results,
) -> Examined:
    """Check all pages of a job up to the first that cannot be used, and prepare them for a press.

    ticket: what was ordered; None: nothing is said. inspector: of the press; None: pages are checked without one.
    shown: shows the progress of results, of which there are so many. OSError: this machine failed, and the job must be
    examined again.
    """
    if inspector is None:
        source = JobSource(path=path, dpi=ANY_DPI, profile=profile)
    else:
        source = job_source(path, inspector.press, profile=profile)
    try:
        with source.open() as job:
            flaws = job.flaws()
            seen = _of_files(job, ticket, inspector)
    except InputError as error:
        return Examined(pages=0, refused=_named(path, error))
    if flaws:
        number, flaw = min(flaws.items())
        return replace(seen, refused=f"{page_name(number)}: {sentence(flaw.what)}")
    imposed = ticket is not None and bool(ticket.layout)
    # The pages of a sheet are laid and prepared together, by the run that knows how its press lays them.
    store = None if inspector is None or imposed else PreparedStore.of(inspector, source)
    work = _PageExaminer(source=source, inspector=None if imposed else inspector, store=store)
    warnings, remark = seen.warnings, ""
    results = in_order(work, range(1, seen.pages + 1), processes=processes, fewest=1, killed=_killed)
    for number, result in enumerate(shown(results, seen.pages), start=1):
        if result.refused:
            return replace(seen, warnings=warnings, refused=f"{page_name(number)}: {result.refused}")
        warnings += result.warnings
        remark = remark or result.unprepared
    if store is not None and store.folder.is_dir():
        clean(store.folder.parent, most_bytes=MOST_BYTES, keep=store.folder)
    if imposed and inspector is not None:
        remark = "its run prepares its sheets"
    elif inspector is not None and store is None:
        remark = "nothing can be stored for this press: each run prepares the job"
    return replace(seen, warnings=warnings, prepared=store is not None and not remark, remark=remark)


def _of_files(job: Job, ticket: Ticket | None, inspector: Inspector | None) -> Examined:
    """Return what is seen of a job before its pages; JobError, RequestError: its sheets cannot be as it is ordered."""
    if ticket is not None and ticket.layout:
        layout = Layout.parse(ticket.layout)
        if inspector is None:
            layout.of(len(job))
        else:
            planned(job, layout, inspector.press.geometry)
    facts = job.document_facts()
    notes = []
    if inspector is not None:
        paper = None if ticket is None else PrintCondition(brand=ticket.brand, weight_gsm=ticket.weight_gsm)
        notes = [
            warning.message
            for warning in condition_warnings(job, inspector.press.print_condition, wanted=paper)
        ]
    if facts is not None and sum(facts.record_pages) not in (0, len(job)):
        notes.append(f"its records have {sum(facts.record_pages)} pages, but the file has {len(job)}")
    return Examined(
        pages=len(job),
        warnings=sum(warning.page < 0 for warning in job.warnings) + len(notes),
        condition="" if facts is None else facts.condition,
        records="" if facts is None else facts.records_text,
        notes=tuple(notes),
    )


def _killed(_number: int) -> PageResult:
    return PageResult(refused="the process that checked it was ended by the system")


def _named(path: Path, error: InputError) -> str:
    """Return an error in one line, without the folder in which the job is only while it is checked."""
    if isinstance(error, RequestError):
        return str(error)
    return f"{sentence(error.what)}; {sentence(error.remedy)}".replace(f"{path.parent}/", "")
