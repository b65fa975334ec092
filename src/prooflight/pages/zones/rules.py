"""Zones from the marked places of a PDF page, by rules that a user names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from prooflight.errors import RequestError
from prooflight.files.given import shortly
from prooflight.pages.zones.zone import KINDS, Box, Kind
from prooflight.pages.zones.zones_file import LEAST_MM2, ZoneEntry

if TYPE_CHECKING:
    from prooflight.pages.pdf.rip import PageMarks

LONGEST_NAME: Final = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Rule that turns places of this name into zones of this kind."""

    name: str
    kind: Kind

    @classmethod
    def parse(cls, option: str, text: str) -> Self:
        """Parse ``NAME=KIND``; RequestError if the text is not of this form."""
        name, _, word = text.rpartition("=")
        for kind in KINDS:
            if name.strip() and word.strip() == kind:
                return cls(name=name.strip(), kind=kind)
        raise RequestError(
            option, f"cannot read {shortly(text)!r}", remedy="write NAME=ignore, =normal or =careful"
        )

    def of(self, names: Iterable[str]) -> bool:
        """Return whether one of these names is the rule's, ignoring case."""
        return self.name.casefold() in {name.casefold() for name in names}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """All rules that a user requested."""

    layers: tuple[Rule, ...] = ()
    annotations: tuple[Rule, ...] = ()
    outside_bleed: Kind | None = None
    """Kind of the zones outside the BleedBox; None: there are no such zones."""
    edge_mm: float = 0.0
    """Width of a strip along all edges of the TrimBox that is ignored, because the cutter may go there."""

    def entries(self, marks: PageMarks | None, number: int, size_mm: tuple[float, float]) -> list[ZoneEntry]:
        """Return the zones of one page; ``marks`` is None if the page is of no PDF."""
        zones = list(_frames("edge", "ignore", self._inner(size_mm), number, size_mm))
        if marks is None:
            return zones
        if marks.bleed is not None and self.outside_bleed is not None:
            zones += _frames("outside BleedBox", self.outside_bleed, marks.bleed, number, size_mm)
        for rule in self.layers:
            zones += _boxes(
                rule, ((name,) for name, _ in marks.layers), (box for _, box in marks.layers), number, size_mm
            )
        for rule in self.annotations:
            names, boxes = ((one for one, _ in marks.annotations), (box for _, box in marks.annotations))
            zones += _boxes(rule, names, boxes, number, size_mm)
        return zones

    def _inner(self, size_mm: tuple[float, float]) -> Box:
        edge = self.edge_mm
        return edge, edge, size_mm[0] - 2 * edge, size_mm[1] - 2 * edge

    def unmet(self, marks: Sequence[PageMarks]) -> list[str]:
        """Return a description of each rule that matches nothing on any page."""
        layers = {name for one in marks for name, _ in one.layers}
        annotations = {name for one in marks for names, _ in one.annotations for name in names}
        return [
            f"no page has {what} {rule.name!r}"
            + (f": there are {', '.join(sorted(there)[:8])}" if there else "")
            for what, rules, there in (
                ("a layer", self.layers, layers),
                ("an annotation", self.annotations, annotations),
            )
            for rule in rules
            if not rule.of(there)
        ]


def entry_of(name: str, kind: Kind, box: Box, number: int, size_mm: tuple[float, float]) -> ZoneEntry | None:
    """Return the entry of a rectangle cut to its page; None if less than the smallest zone is left."""
    left, top = max(box[0], 0.0), max(box[1], 0.0)
    right, bottom = min(box[0] + box[2], size_mm[0]), min(box[1] + box[3], size_mm[1])
    if right <= left or bottom <= top or (right - left) * (bottom - top) < LEAST_MM2:
        return None
    rectangle = round(left, 2), round(top, 2), round(right - left, 2), round(bottom - top, 2)
    return ZoneEntry(name=name[:LONGEST_NAME], kind=kind, pages=str(number), rectangle_mm=rectangle)


def _boxes(
    rule: Rule,
    names: Iterable[Iterable[str]],
    boxes: Iterable[Box],
    number: int,
    size_mm: tuple[float, float],
) -> Iterator[ZoneEntry]:
    for own_names, box in zip(names, boxes, strict=True):
        if rule.of(own_names) and (entry := entry_of(rule.name, rule.kind, box, number, size_mm)):
            yield entry


def _frames(
    name: str, kind: Kind, inner: Box, number: int, size_mm: tuple[float, float]
) -> Iterator[ZoneEntry]:
    """Yield the areas of a page outside a rectangle, which are up to four rectangles."""
    x, y, width, height = inner
    (page_width, page_height), right, bottom = size_mm, x + width, y + height
    sides: dict[str, Box] = {
        "above": (0, 0, page_width, y),
        "below": (0, bottom, page_width, page_height - bottom),
        "left": (0, y, x, height),
        "right": (right, y, page_width - right, height),
    }
    for side, box in sides.items():
        if entry := entry_of(f"{name}, {side}", kind, box, number, size_mm):
            yield entry


def on_all_pages(entries: Sequence[ZoneEntry], count: int) -> list[ZoneEntry]:
    """Return the entries with those that are equal on several pages written once."""
    pages: dict[ZoneEntry, list[int]] = {}
    for entry in entries:
        pages.setdefault(entry.model_copy(update={"pages": ""}), []).append(int(entry.pages))
    return [
        entry.model_copy(update={"pages": _listed(sorted(set(numbers)), count)})
        for entry, numbers in pages.items()
    ]


def _listed(numbers: Sequence[int], count: int) -> str:
    """Return a list of pages such as 1,4-6.

    >>> _listed([1, 4, 5, 6], 9), _listed([1, 2], 2)
    ('1,4-6', 'all')
    """
    if list(numbers) == list(range(1, count + 1)):
        return "all"
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
