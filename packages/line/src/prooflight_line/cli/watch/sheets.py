"""Sheets and sets of a run as the job's own files state them: copies of its ticket, records of a PDF/VT."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from prooflight.pages.job import JobSource
    from prooflight.pages.pdf.facts import DocumentFacts


def copied(source: JobSource, layout: str | None, copies: int | None) -> int | None:
    """Return the number of sheets of so many copies of a job; None: the job once.

    layout: words of ``--layout``; None: each page is a sheet. JobError: the job cannot be opened. RequestError: the
    layout is none.
    """
    if copies is None:
        return None
    of_job = Layout() if layout is None else Layout.parse(layout)
    with source.open() as job:
        return copies * (of_job.sides_of(len(job)) // of_job.sides)


def with_records(
    plan: SheetPlan | None, facts: DocumentFacts | None, *, pages: int, sheets: int | None
) -> SheetPlan | None:
    """Return the plan with the records of a PDF/VT as its sets, where neither layout nor gate states sets.

    Records that are not of one length, or that fill no whole sheets, cannot be sets, and leave the plan as it is.
    pages: of the job. sheets: of the run; None: the job once.
    """
    of_record = None if facts is None else facts.pages_a_record
    if facts is None or of_record in (None, 1) or sum(facts.record_pages) != _own_pages(plan, pages):
        return plan
    if plan is None:
        layout = Layout(pages_a_set=of_record)
        return SheetPlan(layout=layout, sides=pages, sheets=sheets or pages)
    if plan.layout.pages_a_set is not None or of_record % plan.layout.pages_a_sheet:
        return plan
    return replace(plan, layout=replace(plan.layout, pages_a_set=of_record))


def _own_pages(plan: SheetPlan | None, pages: int) -> int:
    """Return the number of pages of the job's file; ``pages`` counts its sides where it is imposed."""
    return pages if plan is None or plan.layout.job_pages is None else plan.layout.job_pages
