"""XML of a ticket: read without loading anything else, and checked against CIP4's structure where it is read.

The schemas of CIP4 are not ours to pass on. ``Rule`` states of each element that we read which attributes it needs and
which children it may have, in which order; other elements and foreign namespaces are passed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from lxml import etree  # type: ignore[import-untyped]

from prooflight.errors import JobError
from prooflight.files.given import GivenFiles, shortly

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

Element: TypeAlias = Any
AGAIN: Final = "export the ticket again"
MOST_ELEMENTS: Final = 20_000
_tickets = GivenFiles(error=JobError, remedy="send a ticket of one job", largest_mb=2)
_DOCTYPES: Final = tuple(
    "<!DOCTYPE".encode(code) for code in ("ascii", "utf-16-le", "utf-16-be", "utf-32-le")
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """What CIP4 asks of an element."""

    needs: tuple[str, ...] = ()
    """Attributes that must be there."""
    order: tuple[str, ...] | None = None
    """Its children, in this order; None: any."""
    once: tuple[str, ...] = ()
    """Those of which there is one at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A ticket as XML."""

    where: str
    root: Element

    @property
    def namespace(self) -> str:
        """Namespace of the root; empty: it has none."""
        return etree.QName(self.root).namespace or ""

    def name(self, element: Element) -> str:
        """Return the name of an element of the root's namespace; empty: it is of another, or a comment."""
        if not isinstance(element.tag, str):
            return ""
        qualified = etree.QName(element)
        return qualified.localname if (qualified.namespace or "") == self.namespace else ""

    def every(self, *names: str) -> Iterator[Element]:
        """Yield all elements of these names, in the order of the file."""
        tags = [f"{{{self.namespace}}}{name}" for name in names]
        yield from self.root.iter(*tags)

    def children(self, element: Element, name: str) -> Iterator[Element]:
        """Yield the children of an element with that name."""
        yield from element.iterchildren(f"{{{self.namespace}}}{name}")

    def stated(self, attribute: str, *names: str) -> list[tuple[Element, str]]:
        """Return all elements of these names that have an attribute, and its value."""
        return [(each, value) for each in self.every(*names) if (value := each.get(attribute)) is not None]

    def refusal(self, element: Element, what: str, remedy: str) -> JobError:
        """Return an error that names file, line and element."""
        return JobError(
            f"{self.where}, line {element.sourceline}, {self.shown(element)}", what, remedy=remedy
        )

    @staticmethod
    def shown(element: Element) -> str:
        """Return the name of an element for a message."""
        return shortly(etree.QName(element).localname)

    def check(self, rules: Mapping[str, Rule]) -> None:
        """Check the structure of all elements that have a rule, and drop the audits; JobError: CIP4 forbids it."""
        for element in self.root.iter(etree.Element):
            rule = rules.get(self.name(element))
            if rule is None:
                continue
            for attribute in rule.needs:
                if not element.get(attribute, "").strip():
                    raise self.refusal(
                        element, f"has no {attribute}", f"state its {attribute}, as CIP4 requires"
                    )
            self._check_children(element, rule)
        for audits in list(self.every("AuditPool")):  # what was, is not what is ordered
            audits.getparent().remove(audits)

    def _check_children(self, element: Element, rule: Rule) -> None:
        if rule.order is None:
            return
        place, seen = 0, set[str]()
        for child in element.iterchildren(etree.Element):
            name = self.name(child)
            if not name:
                continue
            if name not in rule.order:
                remedy = f"{self.shown(element)} has {', '.join(rule.order)}"
                raise self.refusal(child, f"is not allowed in {self.shown(element)}", remedy)
            if rule.order.index(name) < place:
                what = f"comes after {rule.order[place]}"
                raise self.refusal(child, what, f"put them in the order {', '.join(rule.order)}")
            if name in rule.once and name in seen:
                raise self.refusal(child, "appears twice", f"leave only one {name}")
            place = rule.order.index(name)
            seen.add(name)


def parsed(path: Path) -> Document:
    """Read a ticket's file; JobError: it is no XML, too large, or declares entities.

    Nothing that it refers to is loaded, and a document type is refused: what it declares could be made to grow, or to
    read files of this machine.
    """
    data = _tickets.read(path)
    if any(mark in data for mark in _DOCTYPES):
        raise JobError(path.name, "declares a document type", remedy="send it without <!DOCTYPE")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line = error.position[0] or 1
        what = f"is not XML ({shortly(str(error.msg))})"
        raise JobError(f"{path.name}, line {line}", what, remedy=AGAIN) from None
    except ValueError as error:
        raise JobError(path.name, f"is not XML ({shortly(str(error))})", remedy=AGAIN) from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise JobError(path.name, "declares a document type", remedy="send it without <!DOCTYPE")
    if sum(1 for _ in root.iter()) > MOST_ELEMENTS:
        what = f"has more than {MOST_ELEMENTS} elements"
        raise JobError(path.name, what, remedy="send a ticket of one job")
    return Document(where=path.name, root=root)
