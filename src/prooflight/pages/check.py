"""Check of a job before it is printed: the content of each page, and deviations of the print from its file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from prooflight.cmyk import INKS
from prooflight.errors import JobError, sentence
from prooflight.pages.files import page_name
from prooflight.pages.warnings import PageWarning

if TYPE_CHECKING:
    from prooflight.pages.job import Job
    from prooflight.pages.pdf.facts import PageFacts
    from prooflight.pages.raster import Page

EARLY_S: Final = 10.0
"""Time in which pages are drawn for their warnings before the first sheet, so that a run need not wait for
thousands of pages."""
WARNINGS_MAX: Final = 500
"""Largest number of a job's warnings that a run stores in its journal."""
REFUSED: Final = "page-refused"
"""Kind of the warning that a page cannot be used at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedPage:
    """One page of a job's files."""

    number: int
    """Number of the page, from 1."""
    name: str
    size_mm: tuple[float, float] | None
    """Width and height as printed; None: not known."""
    facts: PageFacts | None
    """Facts of a PDF page; None: the page is of no PDF, or cannot be read."""
    spots: Mapping[str, tuple[int, ...]]
    """CMYK values, 0 to 255, that are printed for each spot colour."""
    coverage: tuple[float, ...] | None
    """Mean of each process ink over the page, 0 to 1, including spot colours; None: the page cannot be drawn."""
    warnings: tuple[PageWarning, ...]
    refused: str = ""
    """Reason why the page will not be inspected; empty: it will be."""


def checked_page(job: Job, number: int) -> tuple[CheckedPage, Page | None]:
    """Check page ``number`` (from 1) of a job without a layout, and draw it; None: it cannot be drawn."""
    name = page_name(number)
    size: tuple[float, float] | None = None
    facts: PageFacts | None = None
    page: Page | None = None
    spots: Mapping[str, tuple[int, ...]] = {}
    refused = ""
    try:
        size = job.page_size_mm(number)
        page_facts = job.facts(number)
        if page_facts is not None:
            facts, spots = page_facts
        page = job.page(number)
    except JobError as error:
        refused = f"{sentence(error.what)}; {sentence(error.remedy)}"
    coverage = None
    if page is not None:
        coverage = tuple(float(page.cmyk[..., ink].mean()) / 255 for ink in range(INKS))
    checked = CheckedPage(
        number=number,
        name=name,
        size_mm=size,
        facts=facts,
        spots=spots,
        coverage=coverage,
        warnings=() if page is None else page.warnings,
        refused=refused,
    )
    return checked, page


@dataclass(frozen=True, slots=True, kw_only=True)
class EarlyWarnings:
    """Warnings of a job before its first sheet."""

    warnings: tuple[PageWarning, ...] = ()
    """Warnings of its files and of the checked pages, including those of refused pages."""
    pages: int = 0
    """Number of pages that were checked, from the first."""
    of: int = 0
    """Number of pages of the job."""
    at_start: frozenset[PageWarning] = field(default_factory=frozenset)
    """The same warnings as a set, to recognise later ones as new."""

    @property
    def remark(self) -> str:
        """Remark that some pages were not checked; empty: all were."""
        if self.pages == self.of:
            return ""
        return (
            f"the first {self.pages:,} of {self.of:,} pages were checked before the first sheet: "
            "warnings of the others come as they are drawn"
        )

    @property
    def plain(self) -> list[dict[str, Any]]:
        """The first ``WARNINGS_MAX`` warnings in the form of JSON."""
        return [plain(warning) for warning in self.warnings[:WARNINGS_MAX]]


def early_warnings(
    job: Job,
    *,
    shown: Callable[[Iterable[int], int], Iterable[int]] = lambda numbers, _total: numbers,
    seconds: float = EARLY_S,
    clock: Callable[[], float] = time.monotonic,
) -> EarlyWarnings:
    """Check a job's pages for warnings, from the first on, for about the given time.

    ``shown`` shows the progress of page numbers; its second argument is their count.
    """
    until, warnings, pages = clock() + seconds, dict[PageWarning, None](), 0
    for number in shown(range(1, job.own_pages + 1), job.own_pages):
        if pages and clock() >= until:
            break
        try:
            warnings |= dict.fromkeys(job.coarse_warnings(number))
        except JobError as error:
            what = sentence(error.what)
            message = f"cannot be used, its sheets will not be inspected: {what}"
            warnings[PageWarning(page=number - 1, kind=REFUSED, message=message)] = None
        pages = number
    of_files = dict.fromkeys(warning for warning in job.warnings if warning.page < 0)
    every = tuple(of_files | warnings)
    return EarlyWarnings(warnings=every, pages=pages, of=job.own_pages, at_start=frozenset(every))


def plain(warning: PageWarning) -> dict[str, Any]:
    """Return a warning in the form for programs: pages are numbered from 1, and a warning of no page has null."""
    return {
        "page": None if warning.page < 0 else warning.page + 1,
        "kind": warning.kind,
        "message": sentence(warning.message),
        "object": sentence(warning.object_name),
    }


def warning_text(warning: PageWarning) -> str:
    """Return a warning as one line for people, which names the page."""
    return in_line(plain(warning))


def in_line(warning: Mapping[str, Any]) -> str:
    """Return a warning as ``warning_text``, from the result of ``plain``."""
    page, message = warning["page"], warning["message"]
    return str(message) if page is None else f"{page_name(page)}: {message}"
