"""Tickets in JDF 1.x (CIP4, JDF Specification 1.2 to 1.9 and its schema)."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

from prooflight_line.job_queue.tickets import values
from prooflight_line.job_queue.tickets.ticket import Ticket
from prooflight_line.job_queue.tickets.values import PREFIX
from prooflight_line.job_queue.tickets.xml import Rule

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.job_queue.tickets.xml import Document, Element

NAMESPACE: Final = "http://www.CIP4.org/JDFSchema_1_1"
RULES: Final = {
    "JDF": Rule(needs=("ID", "Type", "Status")),
    "GeneralID": Rule(needs=("IDUsage", "IDValue")),
}
IMPOSED: Final = ("StrippingParams", "BinderySignature", "ExternalImpositionTemplate", "Layout")
"""Resources that impose pages as ``--layout`` cannot say."""
SCHEMES: Final = ("Sequential", "")
"""Distribution schemes of ``LayoutPreparationParams`` that ``--layout`` can say."""


def read(document: Document, folder: Path) -> Ticket:
    """Return what a ticket says; JobError: its structure or a value is wrong."""
    root = document.root
    version = root.get("Version", "")
    if not version.startswith("1."):
        raise document.refusal(
            root, f"is of version {version or 'none'}", "send JDF 1.x, and state its Version"
        )
    document.check(RULES)
    _check_resources(document)
    ids = [(each, each.get("IDUsage"), each.get("IDValue")) for each in document.every("GeneralID")]
    settings = values.inspection(document, ids)
    if not settings.layout:
        _refuse_imposed(document)
    text = partial(values.plain_text, document)
    sided = document.stated("Sides", "LayoutIntent", "LayoutPreparationParams")
    stated = [
        *(values.sides(document, *each) for each in sided),
        *(values.number_up(document, *each) for each in _spans(document, "LayoutIntent", "NumberUp")),
        *(
            values.number_up(document, *each)
            for each in document.stated("NumberUp", "LayoutPreparationParams")
        ),
    ]
    for word in ("sides", "n-up"):
        distinct = dict.fromkeys(part for part in stated if part.startswith(f"{word}="))
        if len(distinct) > 1:
            raise document.refusal(root, f"states both {' and '.join(distinct)}", "state one of them")
    customer = [
        *document.stated("CustomerID", "CustomerInfo"),
        *document.stated("CustomerJobName", "CustomerInfo"),
    ]
    job_id = root.get("JobID") or root.get("ID")
    papers = [each for each in document.every("Media") if each.get("MediaType", "Paper") == "Paper"]
    brands = [(each, each.get("Brand")) for each in papers if each.get("Brand")]
    weights = [(each, each.get("Weight")) for each in papers if each.get("Weight") is not None]
    return Ticket(
        job_id=text(root, job_id),
        name=text(root, root.get("DescriptiveName", "")),
        customer=next((text(*each) for each in customer), ""),
        file=values.one(
            document, _urls(document), partial(values.adjacent_file, document, folder=folder), "file"
        )
        or "",
        copies=values.one(document, _amounts(document), partial(values.amount, document), "number of copies"),
        layout=values.layout_text(document, root, dict.fromkeys(stated), settings.layout),
        brand=values.one(document, brands or _spans(document, "MediaIntent", "StockBrand"), text, "brand")
        or "",
        weight_gsm=values.one(
            document,
            weights or _spans(document, "MediaIntent", "Weight"),
            partial(values.weight, document),
            "weight",
        ),
        keep=settings.keep,
        sample=settings.sample,
    )


def _check_resources(document: Document) -> None:
    """Check that resources state what CIP4 asks of them, and that links lead to one."""
    ids = {each.get("ID") for each in document.root.iter() if each.get("ID")}
    for pool in document.every("ResourcePool"):
        for resource in pool.iterchildren():
            if document.name(resource):
                for attribute in ("ID", "Class", "Status"):
                    if not resource.get(attribute):
                        what, remedy = f"has no {attribute}", f"state its {attribute}, as CIP4 requires"
                        raise document.refusal(resource, what, remedy)
    for pool in document.every("ResourceLinkPool"):
        for link in pool.iterchildren():
            if not document.name(link):
                continue
            if link.get("rRef") not in ids:
                what = f"refers to {link.get('rRef') or 'nothing'}, which does not exist"
                raise document.refusal(link, what, "give rRef the ID of a resource")
            if link.get("Usage") not in ("Input", "Output"):
                raise document.refusal(link, "has no Usage", "state Usage, Input or Output")


def _refuse_imposed(document: Document) -> None:
    remedy = f"send an imposed PDF, or state its {PREFIX}layout as GeneralID"
    for each in document.every(*IMPOSED):
        raise document.refusal(each, "imposes pages in a way that is not supported", remedy)
    for each, scheme in document.stated("PageDistributionScheme", "LayoutPreparationParams"):
        if scheme not in SCHEMES:
            raise document.refusal(each, f"distributes pages by {scheme}, which is not supported", remedy)


def _spans(document: Document, intent: str, name: str) -> list[tuple[Element, str]]:
    """Return what an intent states by an attribute, or by an element with an actual or a preferred value."""
    stated = list(document.stated(name, intent))
    for each in document.every(intent):
        for span in document.children(each, name):
            value = span.get("Actual") or span.get("Preferred")
            if value:
                stated.append((span, value))
    return stated


def _urls(document: Document) -> list[tuple[Element, str]]:
    """Return the addresses of files of run lists, except of those that the job makes."""
    outputs = {each.get("rRef") for each in document.every("RunListLink") if each.get("Usage") == "Output"}
    return [
        (each, each.get("URL"))
        for run_list in document.every("RunList")
        if run_list.get("ID") not in outputs
        for each in run_list.iter(f"{{{NAMESPACE}}}FileSpec")
        if each.get("URL") is not None
    ]


def _amounts(document: Document) -> list[tuple[Element, str]]:
    """Return the numbers of copies: of links to what is made, or where none states one of the final product."""
    links = [each for each in document.every("ComponentLink") if each.get("Usage") == "Output"]
    parts = [part for link in links for part in (link, *link.iter(f"{{{NAMESPACE}}}PartAmount"))]
    stated = [(part, part.get("Amount")) for part in parts if part.get("Amount") is not None]
    if stated:
        return stated
    final = [each for each in document.every("Component") if "FinalProduct" in each.get("ComponentType", "")]
    return [(each, each.get("Amount")) for each in final if each.get("Amount") is not None]
