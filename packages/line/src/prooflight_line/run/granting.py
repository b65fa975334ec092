"""Acceptance of a proposed tolerance: it becomes an ignored zone among the job's zones."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.pages.zones.zones_file import ZoneEntry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.pages.zones.zones_file import JobZones
    from prooflight_line.run.tolerances import Proposal

MARGIN_MM: Final = 1.0
"""Margin around the false alarms. assumed: the largest displacement of a page, and of a place within it."""
NAME: Final = "tolerance"
PAGE: Final = re.compile(r"p([0-9]{4,})(?:-[0-9]+)?")


def granted(proposal: Proposal, sizes_mm: Sequence[tuple[float, float]]) -> ZoneEntry:
    """Return the zone of a proposal, on the pages that it names.

    Zones have neither kind nor amount: everything printed there is ignored, which is more than was proposed.
    RequestError: a page is not one of the job's, or the place is on none of its pages.
    """
    numbers = sorted({_number(name, len(sizes_mm)) for name in proposal.pages})
    width_mm, height_mm = (min(sizes_mm[number - 1][axis] for number in numbers) for axis in (0, 1))
    x, y, width, height = proposal.box_mm
    left, top = max(x - MARGIN_MM, 0.0), max(y - MARGIN_MM, 0.0)
    right, bottom = min(x + width + MARGIN_MM, width_mm), min(y + height + MARGIN_MM, height_mm)
    if right <= left or bottom <= top:
        what = f"its place, {x:.1f}, {y:.1f} mm, is on no page of this job"
        raise RequestError(NAME, what, remedy="give the job that was printed")
    return ZoneEntry(
        name=f"{NAME}: {proposal.kind} at {x:.0f}, {y:.0f} mm",
        kind="ignore",
        pages=",".join(map(str, numbers)),
        rectangle_mm=(round(left, 2), round(top, 2), round(right - left, 2), round(bottom - top, 2)),
    )


def with_zone(job_zones: JobZones | None, entry: ZoneEntry) -> tuple[ZoneEntry, ...]:
    """Return the zones of a file and one more; RequestError: a zone of that name is there already."""
    before = () if job_zones is None else job_zones.document.zones
    if any(one.name == entry.name for one in before):
        raise RequestError(NAME, f"{entry.name!r} was granted already", remedy="remove it first")
    return (*before, entry)


def _number(name: str, pages: int) -> int:
    match = PAGE.fullmatch(name)
    if match is None or not 1 <= int(match[1]) <= pages:
        raise RequestError(NAME, f"{name} is not a page of this job", remedy="give the job that was printed")
    return int(match[1])
