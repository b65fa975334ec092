"""A run's sheets and sets, from its rows, as other commands make them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.inspection.sheets import ToLookAt, to_look_at
from prooflight.journal.following import Asked
from prooflight.pages.layout.plan import SheetPlan, facts_plan
from prooflight.server.reading.runs import looked_at

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.reading.runs import Reading

MOST_LISTED: Final = 5000
BACK: Final = 64
"""Rows from the end of a run among which its furthest side is; assumed, as ``inspection.sheets.PATIENCE``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Together:
    """How a run's job lies on sheets, and what they came to."""

    plan: SheetPlan
    passed: int
    """Positions up to the furthest side that came."""
    found: ToLookAt


def together(reading: Reading, run: RunRow) -> Together | None:
    """None: its pages are sheets of their own, and belong to no sets."""
    plan = facts_plan(run.facts.settings)
    if plan is None:
        return None
    rows = list(looked_at(reading, run))
    passed = positions_passed(reading, run, rows)
    found = to_look_at(plan, rows, passed=passed, ended=run.state != "running")
    return Together(plan=plan, passed=passed, found=found)


def together_facts(told: Together) -> dict[str, Any]:
    """For programs: counts, and sheets and sets that somebody should look at."""
    return {
        "layout": told.plan.layout.words,
        "counts": told.found.counts.facts,
        "sheets": [
            {**asdict(one), "bad_pages": list(one.bad_pages)} for one in told.found.sheets[:MOST_LISTED]
        ],
        "sets": [{**asdict(one), "complete": one.complete} for one in told.found.sets[:MOST_LISTED]],
    }


def positions_passed(reading: Reading, run: RunRow, rows: Iterable[PageRecord]) -> int:
    """Positions up to the furthest side that came. rows: of the run, those that somebody should look at."""
    passed = max((one.job_page + 1 for one in rows if one.job_page is not None), default=0)
    follower = reading.follower
    last = -1 if follower is None else follower.last_sheet(run.id)
    asked = Asked(run_id=run.id, first_sheet=max(last - BACK, 0))
    for row in reading.sheets(asked, after=-1, limit=BACK + 1, damaged=lambda _: None):
        passed = max(passed, 0 if row.page.job_page is None else row.page.job_page + 1)
    return passed
