"""What the plant's management system is told of a run: its result as XJMF, and its reprint as an XJDF ticket.

Both follow CIP4's XJDF 2.1 and its schema. The unit is the sheet, which is one page unless the job's layout states
otherwise.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from lxml import etree  # type: ignore[import-untyped]

from prooflight.inspection.sheets import SheetVerdict, assembled, came
from prooflight.pages.layout.plan import facts_plan
from prooflight_line.plant.outlets.xjmf_messages import (
    NAMESPACE,
    VERSION,
    clean,
    element,
    header_of,
    name,
    root_of,
    tag_of,
    time_text,
    written,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from prooflight.detectors.disposition import Disposition
    from prooflight.detectors.verdict import VerdictName
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.plant.reprint_job import ReprintJob

GOOD: Final = "Good"
WASTE: Final = ("Misprint", "NotInspected", "NotAccepted")
"""``WasteDetails``, whose names CIP4 leaves open; the last is of sheets that were judged good and yet not accepted."""
ENDS: Final = {"finished": "Completed", "stopped": "Aborted", "fault": "Aborted", "interrupted": "Aborted"}
"""``JobPhase/@Status`` by the state of a run that has ended."""


def run_result(run: RunRow, pages: Iterable[PageRecord]) -> bytes:
    """Return the result of a run that has ended as one XJMF: the sum of its sheets, and each sheet of the job.

    A ``SignalStatus`` states the run with its times, and a ``SignalResource`` has a ``Component`` for each sheet of the
    job: ``Amount`` counts the copies that were judged good and accepted, ``Waste`` all others that were printed, with
    ``PartWaste`` by ``WASTE``. What was not inspected is never counted as good. Labels change no count.

    pages: rows of the journal in order.
    """
    counts: dict[str, Counter[str]] = {}
    for sheet, verdict, disposition in _sheets(run, pages):
        counts.setdefault(sheet, Counter())[_outcome(verdict, disposition)] += 1
    total = Counter[str]()
    for of_sheet in counts.values():
        total += of_sheet
    facts, ended_s = run.facts, run.facts.started_s if run.end is None else run.end.ended_s
    job, key = name(job_id(run)), f"run-{run.id}"
    root = root_of(facts.press, ended_s)
    status = element(root, "SignalStatus")
    header_of(status, facts.press, ended_s, identifier=f"S-{key}-status")
    phase = element(
        element(status, "DeviceInfo", Status="Idle"),
        "JobPhase",
        JobID=job,
        JobPartID=key,
        StartTime=time_text(facts.started_s),
        EndTime=time_text(ended_s),
        Status=ENDS[run.state],
        **_amounts(total),
    )
    plan = facts_plan(facts.settings)
    needed = facts.sheets if plan is None else plan.sheets
    if needed is not None:
        phase.set("TotalAmount", str(needed))
    signal = element(root, "SignalResource")
    header_of(signal, facts.press, ended_s, identifier=f"S-{key}-sheets")
    info = element(signal, "ResourceInfo", JobID=job, JobPartID=key, Scope="Job")
    components = element(info, "ResourceSet", Name="Component", Usage="Output", Unit="Countable")
    for sheet, of_sheet in counts.items():
        resource = element(components, "Resource", DescriptiveName=clean(sheet))
        amount = element(element(resource, "AmountPool"), "PartAmount", **_amounts(of_sheet))
        for details in WASTE:
            if of_sheet[details]:
                element(amount, "PartWaste", Waste=str(of_sheet[details]), WasteDetails=details)
        element(resource, "Part", SheetName=name(sheet))
        element(resource, "Component")
    return written(root)


def reprint_ticket(job: ReprintJob, run: RunRow, *, file: str, time_s: float) -> bytes:
    """Return a ticket in XJDF that orders the reprint of a run, for its PDF.

    It is a further part of the same job (``JobPartID``) and not a change of it: the queue entry that a
    ``CommandResubmitQueueEntry`` changes has ended with the run. Prooflight's own hot folder reads it.

    file: name of the PDF, which lies beside the ticket.
    """
    ticket: dict[str, Any] = run.facts.settings.get("ticket") or {}
    customer = ticket.get("customer") or run.facts.settings.get("customer") or ""
    first = job_id(run)
    root = etree.Element(
        tag_of("XJDF"),
        nsmap={None: NAMESPACE},
        Version=VERSION,
        JobID=name(first),
        JobPartID=f"reprint-of-run-{run.id}",
        Types="DigitalPrinting",
        DescriptiveName=clean(f"Reprint of {len(job.sheets)} sheets of {first}, run {run.id}"),
    )
    created = element(element(root, "AuditPool"), "AuditCreated")
    header_of(created, run.facts.press, time_s)
    plan = facts_plan(run.facts.settings)
    if plan is not None:
        element(root, "GeneralID", IDUsage="prooflight:layout", IDValue=plan.layout.text)
    element(element(root, "ProductList"), "Product", Amount="1", IsRoot="true")
    if customer:
        of_customer = element(_resource(root, "CustomerInfo"), "CustomerInfo", CustomerID=name(customer))
        of_customer.set("CustomerJobName", clean(str(ticket.get("name") or first)))
    run_list = element(_resource(root, "RunList"), "RunList", NPage=str(len(job.pages)))
    element(run_list, "FileSpec", MimeType="application/pdf", URL=quote(file))
    return written(root)


def job_id(run: RunRow) -> str:
    """Return the name by which the plant knows the job of a run: its ticket's, or that of its file."""
    return str((run.facts.settings.get("ticket") or {}).get("job_id") or run.facts.job)


def _sheets(run: RunRow, pages: Iterable[PageRecord]) -> Iterator[tuple[str, VerdictName, Disposition]]:
    """Yield name, verdict and disposition of each sheet that was printed."""
    plan = facts_plan(run.facts.settings)
    if plan is None:
        for page in pages:
            if came(page):
                yield page.verdict.page, page.verdict.verdict, page.disposition
        return
    for one in assembled(plan, pages):
        if isinstance(one, SheetVerdict) and not one.missing:
            yield plan.name(one.sheet), one.verdict, one.disposition


def _outcome(verdict: VerdictName, disposition: Disposition) -> str:
    if verdict == "good":
        return GOOD if disposition == "accept" else "NotAccepted"
    return "Misprint" if verdict == "misprint" else "NotInspected"


def _amounts(counts: Counter[str]) -> dict[str, str]:
    return {"Amount": str(counts[GOOD]), "Waste": str(sum(counts[details] for details in WASTE))}


def _resource(root: Any, of: str) -> Any:
    """Add a set of one resource, and return the resource."""
    return element(element(root, "ResourceSet", Name=of, Usage="Input"), "Resource")
