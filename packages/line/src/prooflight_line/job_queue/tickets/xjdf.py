"""Tickets in XJDF 2.x (CIP4, XJDF Specification 2.1 and its schema)."""

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

NAMESPACE: Final = "http://www.CIP4.org/JDFSchema_2_0"
RULES: Final = {
    "XJDF": Rule(
        needs=("JobID", "Types"),
        order=("AuditPool", "Comment", "GeneralID", "ProductList", "ResourceSet"),
        once=("AuditPool", "ProductList"),
    ),
    "ProductList": Rule(order=("Product",)),
    "Product": Rule(order=("Comment", "GeneralID", "Intent")),
    "Intent": Rule(needs=("Name",)),
    "ResourceSet": Rule(needs=("Name",), order=("Comment", "Dependent", "GeneralID", "Resource")),
    "RunList": Rule(order=("ByteMap", "FileSpec", "MetadataMap"), once=("ByteMap", "FileSpec")),
    "GeneralID": Rule(needs=("IDUsage", "IDValue")),
    "AmountPool": Rule(order=("PartAmount",)),
    "MediaIntent": Rule(needs=("MediaType",)),
}
IMPOSED: Final = ("Layout", "BinderySignature", "StrippingParams", "CutBlock")
"""Resources that impose pages as ``--layout`` cannot say."""


def read(document: Document, folder: Path) -> Ticket:
    """Return what a ticket says; JobError: its structure or a value is wrong."""
    root = document.root
    version = root.get("Version", "2.0")
    if not version.startswith("2."):
        raise document.refusal(root, f"is of version {version}", "send XJDF 2.x")
    document.check(RULES)
    _check_names(document)
    ids = [(each, each.get("IDUsage"), each.get("IDValue")) for each in document.every("GeneralID")]
    settings = values.inspection(document, ids)
    if not settings.layout:
        _refuse_imposed(document)
    text = partial(values.plain_text, document)
    stated = (
        *(values.sides(document, *each) for each in document.stated("Sides", "LayoutIntent")),
        *(values.sides(document, *each) for each in document.stated("Sides", "DigitalPrintingParams")),
        *(values.number_up(document, *each) for each in document.stated("NumberUp", "LayoutIntent")),
    )
    _refuse_disagreeing(document, stated)
    customer = [
        *document.stated("CustomerID", "CustomerInfo"),
        *document.stated("CustomerJobName", "CustomerInfo"),
    ]
    products = [each for each in _products(document) if each.get("DescriptiveName")]
    name = root.get("DescriptiveName") or next((each.get("DescriptiveName") for each in products), "")
    urls = [
        (each, url)
        for run_list in _input(document, "RunList")
        for each in document.children(run_list, "FileSpec")
        if (url := each.get("URL")) is not None
    ]
    return Ticket(
        job_id=text(root, root.get("JobID")),
        name=text(root, name),
        customer=next((text(*each) for each in customer), ""),
        file=values.one(document, urls, partial(values.adjacent_file, document, folder=folder), "file") or "",
        copies=values.one(document, _amounts(document), partial(values.amount, document), "number of copies"),
        layout=values.layout_text(document, root, dict.fromkeys(stated), settings.layout),
        brand=values.one(document, _brands(document), text, "brand") or "",
        weight_gsm=values.one(document, _weights(document), partial(values.weight, document), "weight"),
        keep=settings.keep,
        sample=settings.sample,
    )


def _check_names(document: Document) -> None:
    """Check that what stands in an intent or a resource is what its ``Name`` says."""
    for holder in document.every("Intent", "Resource"):
        set_name = holder.get("Name") if document.name(holder) == "Intent" else holder.getparent().get("Name")
        for child in holder.iterchildren():
            name = document.name(child)
            if name and name not in ("AmountPool", "Comment", "GeneralID", "Part", set_name):
                what = f"is in {document.shown(holder)} of {set_name}"
                raise document.refusal(child, what, "give both the same name")


def _refuse_imposed(document: Document) -> None:
    for resources in document.every("ResourceSet"):
        if resources.get("Name") in IMPOSED:
            what = f"imposes pages by {resources.get('Name')}, which is not supported"
            remedy = f"send an imposed PDF, or state its {PREFIX}layout as GeneralID"
            raise document.refusal(resources, what, remedy)


def _refuse_disagreeing(document: Document, stated: tuple[str, ...]) -> None:
    by_key: dict[str, str] = {}
    for part in stated:
        if by_key.setdefault(part.partition("=")[0], part) != part:
            what = f"states both {by_key[part.partition('=')[0]]} and {part}"
            raise document.refusal(document.root, what, "state one of them")


def _products(document: Document) -> list[Element]:
    """Return the products that the job makes: those that are roots, or all where none says so."""
    products = list(document.every("Product"))
    return [each for each in products if each.get("IsRoot") in ("true", "1")] or products


def _input(document: Document, name: str) -> list[Element]:
    """Return the resources of one name that are not made by the job."""
    return [
        resource
        for resources in document.every("ResourceSet")
        if resources.get("Name") == name and resources.get("Usage") != "Output"
        for holder in document.children(resources, "Resource")
        for resource in document.children(holder, name)
    ]


def _amounts(document: Document) -> list[tuple[Element, str]]:
    """Return the numbers of copies: of products, or where none states one of the components that are made."""
    of_products = [
        (each, each.get("Amount")) for each in _products(document) if each.get("Amount") is not None
    ]
    if of_products:
        return of_products
    return [
        (part, part.get("Amount"))
        for resources in document.every("ResourceSet")
        if resources.get("Name") == "Component" and resources.get("Usage") == "Output"
        for part in resources.iter(f"{{{NAMESPACE}}}PartAmount")
        if part.get("Amount") is not None
    ]


def _papers(document: Document) -> list[Element]:
    media = [
        each
        for each in _input(document, "Media")
        if each.get("MediaType", "Paper") in ("Paper", "SelfAdhesive")
    ]
    return media or list(document.every("MediaIntent"))


def _brands(document: Document) -> list[tuple[Element, str]]:
    """Return brands: of the resource that holds the media, or of the intent."""
    holders = [each.getparent() if document.name(each) == "Media" else each for each in _papers(document)]
    return [(each, each.get("Brand")) for each in holders if each.get("Brand")]


def _weights(document: Document) -> list[tuple[Element, str]]:
    return [(each, each.get("Weight")) for each in _papers(document) if each.get("Weight") is not None]
