"""Pairing of two runs that each saw one side of the same sheets, fronts and backs.

A press with one camera for each side is watched by two runs: the fronts as a job of the odd pages, the backs as
one of the even. Both runs locate their sides in their job, so that the front and the back at one place form one
sheet, even if one of the cameras lost a sheet.
"""

from __future__ import annotations

import heapq
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.inspection.sheets import Assembling
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from prooflight.inspection.sheets import SetVerdict, SheetVerdict
    from prooflight_line.journal.records import PageRecord, RunRow

NO_END: Final = 2**62
"""Number of sheets assumed of two runs whose length is unknown."""


def pair_plan(fronts: RunRow, backs: RunRow, *, sheets_a_job: int, pages_a_set: int | None) -> SheetPlan:
    """Return how the sides of two runs form sheets.

    sheets_a_job: of one copy; pages_a_set: of the job, both sides. RequestError: a run was watched with a layout
    of its own, or so many pages make no whole sets.
    """
    for run, what in ((fronts, "fronts"), (backs, "backs")):
        if run.facts.settings.get("layout") is not None:
            why = f"run {run.id} of the {what} was watched with --layout, and has sheets of its own"
            raise RequestError(
                "run pair", why, remedy="pair runs that saw one page a side, watched without --layout"
            )
    spec = "sides=2" if pages_a_set is None else f"sides=2,pages-a-set={pages_a_set}"
    layout = Layout.parse(spec).of(2 * sheets_a_job)
    return SheetPlan(layout=layout, sides=2 * sheets_a_job, sheets=NO_END)


def paired(
    plan: SheetPlan, fronts: Iterable[PageRecord], backs: Iterable[PageRecord]
) -> Iterator[SheetVerdict | SetVerdict]:
    """Yield the sheets and sets of two runs from all their rows, in order; a side keeps its number in its run.

    A sheet that lacks a side is not inspected. A row whose page is unknown belongs to no sheet.
    """
    assembling = Assembling(plan)
    for _, record in heapq.merge(_placed(fronts, 0), _placed(backs, 1), key=lambda one: one[0]):
        yield from assembling.add(record)
    yield from assembling.end()


def _placed(records: Iterable[PageRecord], back: int) -> Iterator[tuple[int, PageRecord]]:
    """Yield rows with the position of their side among those of both runs."""
    for record in records:
        if record.job_page is not None:
            position = 2 * record.job_page + back
            yield position, replace(record, job_page=position)
