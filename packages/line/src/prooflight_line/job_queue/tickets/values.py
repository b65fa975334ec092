"""Values of a ticket as its elements state them, in either language; what is wrong names line and element."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final, TypeVar
from urllib.parse import unquote, urlsplit

from prooflight.errors import RequestError
from prooflight.files.given import shortly
from prooflight.pages.layout.layout import Layout
from prooflight_line.job_queue.tickets.ticket import is_ticket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from prooflight_line.job_queue.tickets.xml import Document, Element

PREFIX: Final = "prooflight:"
"""Beginning of ``GeneralID/@IDUsage`` by which a ticket states settings of the inspection."""
KEEP: Final = ("all", "misprints", "none")
MOST_COPIES: Final = 10_000_000
"""Limit of ``watch --sheets``."""
MOST_TEXT: Final = 200
LIGHTEST_GSM, HEAVIEST_GSM = 10.0, 2000.0
"""assumed: from tissue to solid board."""

Value = TypeVar("Value")


def one(
    document: Document,
    stated: Iterable[tuple[Element, str]],
    read: Callable[[Element, str], Value],
    what: str,
) -> Value | None:
    """Return the value that elements state for one thing; None: none does. JobError: they disagree."""
    first: tuple[Element, Value] | None = None
    for element, text in stated:
        value = read(element, text)
        if first is None:
            first = element, value
        elif value != first[1]:
            here = f"states {what} {value}, and line {first[0].sourceline} {first[1]}"
            raise document.refusal(element, here, f"send one ticket for each {what}")
    return None if first is None else first[1]


def plain_text(document: Document, element: Element, text: str) -> str:
    """Return a name; JobError: it is longer than a name can be."""
    text = " ".join(text.split())
    if len(text) > MOST_TEXT:
        raise document.refusal(element, f"{shortly(text)!r} is too long", f"give {MOST_TEXT} letters at most")
    return text


def amount(document: Document, element: Element, text: str) -> int:
    """Return a number of copies."""
    number = _number(text)
    if number is None or number != int(number) or not 1 <= number <= MOST_COPIES:
        what = f"Amount is {shortly(text)!r}"
        raise document.refusal(element, what, f"give a whole number from 1 to {MOST_COPIES}")
    return int(number)


def weight(document: Document, element: Element, text: str) -> float:
    """Return the weight of a substrate. [g/m2]"""
    number = _number(text)
    if number is None or not LIGHTEST_GSM <= number <= HEAVIEST_GSM:
        what = f"Weight is {shortly(text)!r}"
        raise document.refusal(element, what, f"give {LIGHTEST_GSM:g} to {HEAVIEST_GSM:g} g/m2")
    return number


def number_up(document: Document, element: Element, text: str) -> str:
    """Return the word of ``--layout`` for ``NumberUp``, columns and rows."""
    if not re.fullmatch(r"[0-9]{1,2}(\.0+)? [0-9]{1,2}(\.0+)?", " ".join(text.split())):
        raise document.refusal(element, f"NumberUp is {shortly(text)!r}", 'give columns and rows, as "2 1"')
    columns, rows = (int(float(part)) for part in text.split())
    return f"n-up={columns}x{rows}"


def sides(document: Document, element: Element, text: str) -> str:
    """Return the word of ``--layout`` for ``Sides`` of either language."""
    if re.fullmatch(r"OneSided|OneSidedFront", text):
        return "sides=1"
    if re.fullmatch(r"TwoSided(HeadTo(Head|Foot)|Flip[XY])?", text):
        return "sides=2"
    remedy = "give OneSided or TwoSidedHeadToHead: backs alone are printed as fronts of a PDF of their own"
    raise document.refusal(element, f"Sides is {shortly(text)!r}", remedy)


def adjacent_file(document: Document, element: Element, url: str, folder: Path) -> str:
    """Return the name of the file that a URL names; JobError: it does not lie directly in ``folder``."""
    remedy = "name a file next to the ticket, such as job.pdf"
    try:
        parts = urlsplit(url)
        path = unquote(parts.path, errors="strict")
    except (ValueError, UnicodeDecodeError):
        raise document.refusal(element, f"URL {shortly(url)!r} is not an address", remedy) from None
    name = PurePosixPath(path).name
    adjacent = path in (name, f"./{name}") and not parts.scheme
    if parts.scheme == "file" and parts.netloc in ("", "localhost"):
        adjacent = path in (name, f"./{name}") or PurePosixPath(path).parent == PurePosixPath(
            folder.resolve()
        )
    wrong = not name or name in (".", "..") or "\\" in name or "\0" in name or parts.query or parts.fragment
    if wrong or not adjacent or (parts.netloc and parts.netloc != "localhost"):
        raise document.refusal(element, f"names {shortly(url)}, outside this folder", remedy)
    if is_ticket(name):
        raise document.refusal(element, f"names {shortly(url)}, which is a ticket", remedy)
    return name


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Settings that a ticket states for the inspection of its job."""

    layout: str = ""
    keep: str = ""
    sample: float | None = None


def inspection(document: Document, stated: Iterable[tuple[Element, str, str]]) -> Inspection:
    """Return the settings of ``GeneralID``: elements with ``IDUsage`` and ``IDValue``; others' are passed over."""
    readers = {"layout": _layout, "keep": _keep, "sample": _sample}
    values: dict[str, Any] = {}
    for element, usage, text in stated:
        if not usage.startswith(PREFIX):
            continue
        name = usage.removeprefix(PREFIX)
        if name not in readers:
            what = f"{shortly(usage)} is none of {', '.join(PREFIX + key for key in readers)}"
            raise document.refusal(element, what, "correct its IDUsage")
        value = readers[name](document, element, text)
        if values.setdefault(name, value) != value:
            raise document.refusal(element, f"{usage} is stated twice", "state it once")
    return Inspection(**values)


def layout_text(document: Document, element: Element, stated: Iterable[str], stated_layout: str) -> str:
    """Return the words of ``--layout`` of a ticket: of its standard attributes, and those of ``stated_layout``."""
    given = dict(part.split("=", 1) for part in stated)
    for part in filter(None, stated_layout.split(",")):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if given.setdefault(key, value) != value:
            what = f"{PREFIX}layout states {key}={value}, and the ticket {key}={given[key]}"
            raise document.refusal(element, what, "state it once")
    text = ",".join(f"{key}={value}" for key, value in given.items())
    return _layout(document, element, text) if text else ""


def _layout(document: Document, element: Element, text: str) -> str:
    try:
        Layout.parse(text)
    except RequestError as error:
        raise document.refusal(element, f"layout: {error.what}", error.remedy) from None
    return text


def _keep(document: Document, element: Element, text: str) -> str:
    if text not in KEEP:
        raise document.refusal(element, f"keep is {shortly(text)!r}", f"give {', '.join(KEEP)}")
    return text


def _sample(document: Document, element: Element, text: str) -> float:
    number = _number(text)
    if number is None or not 0 <= number <= 1:
        raise document.refusal(element, f"sample is {shortly(text)!r}", "give a share from 0 to 1")
    return number


def _number(text: str) -> float | None:
    """Return a decimal number of XML Schema; None: it is none."""
    if len(text) > 30 or not re.fullmatch(r"\s*[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]{1,3})?\s*", text):
        return None
    number = float(text)
    return number if math.isfinite(number) else None
