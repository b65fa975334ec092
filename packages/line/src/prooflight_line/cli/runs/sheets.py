"""Sheets and sets of a run that was watched with ``--layout``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.cli import show
from prooflight.cli.imposition import sheet_facts
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from prooflight.inspection.sheets import ReviewList
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.reading import Damaged
    from prooflight_line.journal.records import RunRow


def of_run(journal: Journal, run: RunRow, *, damaged: Damaged) -> ReviewList | None:
    """Return a run's sheets and sets that a person should examine, from its rows; None if it has none."""
    from prooflight.inspection.sheets import to_review
    from prooflight.pages.layout.plan import facts_plan

    plan = facts_plan(run.facts.settings)
    if plan is None:
        return None
    passed, rows = 0, []
    for page in journal.pages(run.id, damaged=damaged):
        passed = max(passed, 0 if page.job_page is None else page.job_page + 1)
        if page.verdict.verdict != "good" or page.faults:
            rows.append(page)
    return to_review(plan, rows, passed=passed, ended=run.state != "running")


def run_facts(journal: Journal, run: RunRow, *, damaged: Damaged) -> None:
    """Print all sheets and sets of a run for programs; RequestError if it has none."""
    from prooflight.inspection.sheets import SheetVerdict, assembled
    from prooflight.pages.layout.plan import facts_plan

    plan = facts_plan(run.facts.settings)
    if plan is None:
        what = f"run {run.id} was watched without --layout"
        raise RequestError("sheets", what, remedy="leave out --sheets: every page is a sheet of its own")
    parts = list(assembled(plan, journal.pages(run.id, damaged=damaged)))
    sheets = [sheet_facts(one)["sheet_verdict"] for one in parts if isinstance(one, SheetVerdict)]
    sets = [sheet_facts(one)["set_verdict"] for one in parts if not isinstance(one, SheetVerdict)]
    show.print_json({"run": run.id, "layout": plan.layout.text, "sheets": sheets, "sets": sets})
