"""The job of ``prooflight watch`` as it is read before the run: pages, layout, records, zones, plant and warnings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from prooflight.cli import imposition
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.check import EarlyWarnings
    from prooflight.pages.job import JobSource
    from prooflight.pages.pdf.facts import DocumentFacts
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight_line.cli.watch.options import WatchOptions
    from prooflight_line.cli.watch.plant import Plant
    from prooflight_line.job_queue.tickets.ticket import Ticket


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadJob:
    """The job as it was read before the run."""

    source: JobSource
    name: str
    pages: int
    flaws: Mapping[int, Exception]
    """Pages, from 1, that cannot be used, and why."""
    plan: SheetPlan | None
    """Imposition of the job on sheets; None: one page a sheet."""
    passings: int
    """Number of sheets that pass."""
    plant: Plant
    zones: JobZones | None
    early: EarlyWarnings
    ticket: Ticket | None

    @classmethod
    def of(cls, options: WatchOptions, inspector: Inspector, ticket: Ticket | None) -> Self:
        """Read the job, its layout, zones and warnings, and try the plant; the errors of all these.

        What ``ticket`` says of the layout and of the number of copies counts where the options say nothing else.
        """
        from prooflight.cli.jobs.check import checked_early
        from prooflight.cli.jobs.zones import zones_in_force
        from prooflight.press.pages import job_source
        from prooflight.press.print_condition import PrintCondition, condition_warnings
        from prooflight_line.cli.watch.plant import Plant
        from prooflight_line.job_queue.tickets.ticket import layout_with

        press, layout, sheets = inspector.press, options.repeats.layout, options.repeats.sheets
        source = job_source(options.job, press, profile=options.pages.profile)
        paper = None
        if ticket is not None:
            layout = layout_with(ticket.layout, layout)
            sheets = copied(source, layout, ticket.copies) if sheets is None else sheets
            paper = PrintCondition(brand=ticket.brand, weight_gsm=ticket.weight_gsm)
        source, plan = imposition.imposed(source, layout, press.geometry, sheets=sheets)
        with source.open() as opened:
            pages, name, flaws = len(opened), opened.name, opened.flaws()
            plant = Plant.tried(options.plant, opened, press)
            zones = zones_in_force(options.pages.zones, opened, inspector)
            records = opened.document_facts()
            more = condition_warnings(opened, press.print_condition, wanted=paper)
            early = checked_early(opened, json=options.json, more=more)
        plan = plant.with_sets(plan, pages=pages, sheets=sheets)
        plan = with_records(plan, records, pages=pages, sheets=sheets)
        return cls(
            source=source,
            name=name,
            pages=pages,
            flaws=flaws,
            plan=plan,
            passings=(sheets or pages) if plan is None else plan.passings,
            plant=plant,
            zones=zones,
            early=early,
            ticket=ticket,
        )

    @property
    def facts(self) -> dict[str, Any]:
        """Facts of the job that the journal records besides its name."""
        facts: dict[str, Any] = {"job_pages": self.pages}
        if self.plan is not None:
            facts["layout"] = self.plan.facts
        if self.ticket is not None:
            facts["ticket"] = self.ticket.facts
        if self.zones is not None:
            facts |= {"zones": self.zones.digest, "zones_alone": self.zones.zones_digest}
        if self.early.warnings:
            facts["warnings"] = self.early.plain
        if self.plant.file is not None:
            from prooflight.files.content import content_digest

            facts["press_file"] = content_digest(self.plant.file.path)
        return facts


# --- copies that a ticket states, and records of a PDF/VT ---


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
