"""A proposed tolerance put into a job's zones: an ignored zone of its place, until its price is seen and saved."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.pages.zones.zones_file import ZoneEntry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.line.tolerances import Proposal
    from prooflight.pages.zones.zones_file import JobZones

MARGIN_MM: Final = 1.0
"""About the places of the false alarms. assumed: as far as pages lie off their place, and places within theirs."""
NAME: Final = "tolerance"
PAGE: Final = re.compile(r"p([0-9]{4,})(?:-[0-9]+)?")


def granted(proposal: Proposal, sizes_mm: Sequence[tuple[float, float]]) -> ZoneEntry:
    """The zone of a proposal, on those pages that it names.

    Zones know no kind and no amount: all that is printed there is ignored, which is more than was proposed.
    RequestError: a page is none of the job's.
    """
    numbers = sorted({_number(name, len(sizes_mm)) for name in proposal.pages})
    width_mm, height_mm = (min(sizes_mm[number - 1][axis] for number in numbers) for axis in (0, 1))
    x, y, width, height = proposal.box_mm
    left, top = max(x - MARGIN_MM, 0.0), max(y - MARGIN_MM, 0.0)
    right, bottom = min(x + width + MARGIN_MM, width_mm), min(y + height + MARGIN_MM, height_mm)
    if right <= left or bottom <= top:
        what = f"its place, {x:.1f}, {y:.1f} mm, lies on no page of this job"
        raise RequestError(NAME, what, remedy="give the job that was printed")
    return ZoneEntry(
        name=f"{NAME}: {proposal.kind} at {x:.0f}, {y:.0f} mm",
        kind="ignore",
        pages=",".join(map(str, numbers)),
        rectangle_mm=(round(left, 2), round(top, 2), round(right - left, 2), round(bottom - top, 2)),
    )


def with_zone(known: JobZones | None, entry: ZoneEntry) -> tuple[ZoneEntry, ...]:
    """Zones of a file and one more; RequestError: it is there already."""
    before = () if known is None else known.document.zones
    if any(one.name == entry.name for one in before):
        raise RequestError(NAME, f"{entry.name!r} was granted already", remedy="take it back first")
    return (*before, entry)


def is_tolerance(entry: ZoneEntry) -> bool:
    """Whether it came to the zones as a tolerance: told by its name, since zones know nothing else of it."""
    return entry.kind == "ignore" and entry.name.startswith(f"{NAME}: ")


def without_zone(known: JobZones, name: str) -> tuple[ZoneEntry, ...]:
    """Zones of a file but those of this name; RequestError: there is none."""
    left = tuple(one for one in known.document.zones if one.name != name)
    if len(left) == len(known.document.zones):
        names = ", ".join(repr(one.name) for one in known.document.zones[:5])
        raise RequestError("zones", f"none is called {name!r}", remedy=f"name one of {names}")
    return left


def _number(name: str, pages: int) -> int:
    match = PAGE.fullmatch(name)
    if match is None or not 1 <= int(match[1]) <= pages:
        raise RequestError(NAME, f"{name} is no page of this job", remedy="give the job that was printed")
    return int(match[1])
