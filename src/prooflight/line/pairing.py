"""Two runs that each saw one side of the same sheets, fronts and backs, put together to sheets.

A press with a camera a side is watched by two runs: the fronts as a job of the odd pages, the backs as one of the even.
Both runs place their sides in their job, so that the front and the back of one place are one sheet, also where one of
the cameras lost a sheet.
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
    from prooflight.journal.records import PageRecord, RunRow

NO_END: Final = 2**62
"""Sheets of two runs of which nobody says how many come."""


def pair_plan(fronts: RunRow, backs: RunRow, *, sheets_a_job: int, pages_a_set: int | None) -> SheetPlan:
    """How the sides of two runs lie on sheets. sheets_a_job: of one copy; pages_a_set: of the job, both sides.

    RequestError: a run laid its job on sheets itself, or so many pages make no whole sets.
    """
    for run, what in ((fronts, "fronts"), (backs, "backs")):
        if run.facts.settings.get("layout") is not None:
            why = f"run {run.id} of the {what} was watched with --layout, and has sheets of its own"
            raise RequestError(
                "run pair", why, remedy="pair runs that saw one page a side, watched without --layout"
            )
    words = "sides=2" if pages_a_set is None else f"sides=2,pages-a-set={pages_a_set}"
    layout = Layout.parse(words).of(2 * sheets_a_job)
    return SheetPlan(layout=layout, sides=2 * sheets_a_job, sheets=NO_END)


def paired(
    plan: SheetPlan, fronts: Iterable[PageRecord], backs: Iterable[PageRecord]
) -> Iterator[SheetVerdict | SetVerdict]:
    """Sheets and sets of two runs from all their rows, in order; a side keeps the number that its run gave it.

    What lacks a side is not inspected. A row that nobody can place belongs to no sheet.
    """
    assembling = Assembling(plan)
    for _, record in heapq.merge(_placed(fronts, 0), _placed(backs, 1), key=lambda one: one[0]):
        yield from assembling.add(record)
    yield from assembling.end()


def _placed(records: Iterable[PageRecord], back: int) -> Iterator[tuple[int, PageRecord]]:
    """Rows with the position of their side among those of both runs."""
    for record in records:
        if record.job_page is not None:
            position = 2 * record.job_page + back
            yield position, replace(record, job_page=position)
