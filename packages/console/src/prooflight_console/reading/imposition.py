"""A run's sheets and sets, computed from its rows as by other commands."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.inspection.sheets import ReviewList, to_review
from prooflight.pages.layout.plan import SheetPlan, facts_plan
from prooflight_console.reading.runs import pages_to_review
from prooflight_line.journal.following import PageQuery

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import PageRecord, RunRow

MOST_LISTED: Final = 5000
BACK: Final = 64
"""Rows from the end of a run that include its furthest side; assumed, as ``inspection.sheets.PATIENCE``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImposedSheets:
    """Imposition of a run's job on sheets, and the sheets to review."""

    plan: SheetPlan
    passed: int
    """Number of positions up to the furthest side that came."""
    review: ReviewList


def imposed_sheets(reading: Reading, run: RunRow) -> ImposedSheets | None:
    """Return a run's sheets and sets; None if its pages are sheets of their own, and belong to no sets."""
    plan = facts_plan(run.facts.settings)
    if plan is None:
        return None
    rows = list(pages_to_review(reading, run))
    passed = positions_passed(reading, run, rows)
    review = to_review(plan, rows, passed=passed, ended=run.state != "running")
    return ImposedSheets(plan=plan, passed=passed, review=review)


def imposed_facts(imposed: ImposedSheets) -> dict[str, Any]:
    """Return counts, and sheets and sets to review, for programs."""
    return {
        "layout": imposed.plan.layout.text,
        "counts": imposed.review.counts.facts,
        "sheets": [
            {**asdict(one), "bad_pages": list(one.bad_pages)} for one in imposed.review.sheets[:MOST_LISTED]
        ],
        "sets": [{**asdict(one), "complete": one.complete} for one in imposed.review.sets[:MOST_LISTED]],
    }


def positions_passed(reading: Reading, run: RunRow, rows: Iterable[PageRecord]) -> int:
    """Return the number of positions up to the furthest side that came; rows: those of the run to review."""
    passed = max((one.job_page + 1 for one in rows if one.job_page is not None), default=0)
    follower = reading.follower
    last = -1 if follower is None else follower.last_sheet(run.id)
    query = PageQuery(run_id=run.id, first_sheet=max(last - BACK, 0))
    for row in reading.sheets(query, after=-1, limit=BACK + 1, damaged=lambda _: None):
        passed = max(passed, 0 if row.page.job_page is None else row.page.job_page + 1)
    return passed
