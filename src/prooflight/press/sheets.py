"""Plan of a job's sheets on one press."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.pages.layout.imposing import refuse_other_size, side_size
from prooflight.pages.layout.layout import WHERE, Layout, backs_at
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from prooflight.pages.job import Job
    from prooflight.scans.geometry import ScanGeometry


def planned(job: Job, layout: Layout, geometry: ScanGeometry, *, sheets: int | None = None) -> SheetPlan:
    """Plan how the pages of a job are placed on the sheets of one press.

    job: opened without a layout. sheets: of the run; None: the job once. In the plan's layout a back is
    upright or turned, however it was specified. RequestError: the sheets fill no whole sets, or the pages
    need more than a sheet has, or are wider than the press sees. JobError: pages of one sheet are not of one
    size.
    """
    layout, sides = layout.of(len(job)), layout.sides_of(len(job))
    flaws, sizes = job.flaws(), dict[int, tuple[float, float]]()
    for number in range(1, len(job) + 1):
        if number not in flaws:
            sizes[number] = job.page_size_mm(number)
    for number, size in sizes.items():
        first = number - (number - 1) % layout.pages_a_sheet
        if first in sizes:
            refuse_other_size(number, size, first, sizes[first])
    placed = {}
    for size in dict.fromkeys(sizes.values()):
        side = side_size(size, layout)
        if not any(geometry.sees(extent) for extent in side):
            what = f"a side is {side[0]:.1f} x {side[1]:.1f} mm, and this press sees {geometry.field_mm:.1f} mm across"
            raise RequestError(
                WHERE, what, remedy="place fewer pages on it, or build a press with more pixels"
            )
        turned = not geometry.sees(side[0]) and geometry.sees(side[1])
        across, along = side[::-1] if turned else side
        placed[turned, backs_at(layout.backs, across_mm=across, along_mm=along)] = size
    if layout.backs in ("long-edge", "short-edge"):
        meanings = {backs for _, backs in placed}
        if len(meanings) > 1:
            what = f"backs={layout.backs} is ambiguous for this job, whose sheets have both orientations"
            raise RequestError(WHERE, what, remedy="state backs=upright or backs=turned")
        layout = replace(layout, backs=meanings.pop() if meanings else "upright")
    one = len({(round(width), round(height)) for width, height in sizes.values()}) == 1
    return SheetPlan(
        layout=layout,
        sides=sides,
        sheets=sides // layout.sides if sheets is None else sheets,
        page_mm=next(iter(sizes.values())) if one else None,
        laid_turned=len(placed) > 0 and all(turned for turned, _ in placed),
    )
