"""What a job ticket says, and how its values are read, whatever language the ticket is written in."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final, TypeVar
from urllib.parse import unquote, urlsplit

from prooflight.errors import JobError, RequestError
from prooflight.files.given import shortly
from prooflight.pages.layout.layout import Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from prooflight_line.job_queue.tickets.xml import Document, Element

SUFFIXES: Final = (".xjdf", ".jdf")
"""Endings of a ticket's file name."""
OURS: Final = "prooflight:"
"""Beginning of ``GeneralID/@IDUsage`` by which a ticket states settings of the inspection."""
KEEP: Final = ("all", "misprints", "none")
MOST_COPIES: Final = 10_000_000
"""As of ``watch --sheets``."""
MOST_TEXT: Final = 200
LIGHTEST_GSM, HEAVIEST_GSM = 10.0, 2000.0
"""assumed: from tissue to solid board."""

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ticket:
    """What a ticket says; a text that it does not state is empty."""

    job_id: str
    name: str = ""
    """Descriptive name of the job."""
    customer: str = ""
    file: str = ""
    """Name of the job's file, which lies beside the ticket; empty: the file with the ticket's own stem."""
    copies: int | None = None
    layout: str = ""
    """Words of ``--layout`` that the ticket states."""
    brand: str = ""
    """Brand of the substrate."""
    weight_gsm: float | None = None
    """Weight of the substrate. [g/m2]"""
    keep: str = ""
    """Evidence that is stored, as of ``watch --keep``."""
    sample: float | None = None
    """Share of passing sheets that people label, as of ``watch --sample``."""

    @property
    def facts(self) -> dict[str, Any]:
        """What the ticket states, in types that JSON can hold."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return {name: value for name, value in values.items() if value not in ("", None)}


def is_ticket(name: str) -> bool:
    """Return whether a file of this name is a ticket."""
    return name.lower().endswith(SUFFIXES)


def read_ticket(path: Path, *, folder: Path | None = None) -> Ticket:
    """Read a ticket; JobError names its line and element, and what would be right.

    folder: where the ticket came, for the files that it may name; None: its own.
    """
    from prooflight_line.job_queue.tickets import jdf, xjdf
    from prooflight_line.job_queue.tickets.xml import parsed

    document = parsed(path)
    readers = {xjdf.NAMESPACE: ("XJDF", xjdf.read), jdf.NAMESPACE: ("JDF", jdf.read)}
    root = document.root
    expected, read = readers.get(document.namespace, ("", None))
    if read is None or document.name(root) != expected:
        what = f"is no ticket: {document.namespace or 'no namespace'}"
        raise document.refusal(root, what, f"send XJDF 2.x ({xjdf.NAMESPACE}) or JDF 1.x ({jdf.NAMESPACE})")
    return read(document, folder or path.parent)


# --- values ---


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


def file_beside(document: Document, element: Element, url: str, folder: Path) -> str:
    """Return the name of the file that a URL names; JobError: it does not lie directly in ``folder``."""
    remedy = "name a file that lies beside the ticket, as job.pdf"
    try:
        parts = urlsplit(url)
        path = unquote(parts.path, errors="strict")
    except (ValueError, UnicodeDecodeError):
        raise document.refusal(element, f"URL {shortly(url)!r} is no address", remedy) from None
    name = PurePosixPath(path).name
    beside = path in (name, f"./{name}") and not parts.scheme
    if parts.scheme == "file" and parts.netloc in ("", "localhost"):
        beside = path in (name, f"./{name}") or PurePosixPath(path).parent == PurePosixPath(folder.resolve())
    wrong = not name or name in (".", "..") or "\\" in name or "\0" in name or parts.query or parts.fragment
    if wrong or not beside or (parts.netloc and parts.netloc != "localhost"):
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
        if not usage.startswith(OURS):
            continue
        name = usage.removeprefix(OURS)
        if name not in readers:
            what = f"{shortly(usage)} is none of {', '.join(OURS + key for key in readers)}"
            raise document.refusal(element, what, "correct its IDUsage")
        value = readers[name](document, element, text)
        if values.setdefault(name, value) != value:
            raise document.refusal(element, f"{usage} is stated twice", "state it once")
    return Inspection(**values)


def words(document: Document, element: Element, stated: Iterable[str], ours: str) -> str:
    """Return the words of ``--layout`` of a ticket: those of its standard attributes, and those of ``ours``."""
    given = dict(part.split("=", 1) for part in stated)
    for part in filter(None, ours.split(",")):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if given.setdefault(key, value) != value:
            what = f"{OURS}layout says {key}={value}, and the ticket {key}={given[key]}"
            raise document.refusal(element, what, "state it once")
    text = ",".join(f"{key}={value}" for key, value in given.items())
    return _layout(document, element, text) if text else ""


def layout_with(own: str, given: str | None) -> str | None:
    """Return the layout of a ticket's job on a press that was given ``--layout``; None: neither says anything.

    The ticket's words count; those that it does not say are the press's. Order and backs are of two sides.

    >>> layout_with("sides=2", "sides=1,gutter=4")
    'sides=2,gutter=4'
    >>> layout_with("sides=1", "sides=2,order=loop:4")
    'sides=1'
    """
    both: dict[str, str] = {}
    for part in f"{given or ''},{own}".split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key:
            both[key] = value
    if both.get("sides") == "1":
        both = {key: value for key, value in both.items() if key not in ("order", "backs")}
    return ",".join(f"{key}={value}" for key, value in both.items()) or given


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


def missing(path: Path) -> JobError:
    """Return the error of a ticket whose file did not come."""
    return JobError(path.name, "its file did not come in time", remedy="send both again")
