"""Sheets and sets of a run that was watched with ``--layout``, or of two runs that each saw one side."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import typer

from prooflight.cli import exit_codes, imposition, show
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


# --- ``run pair``: sheets from two runs ---


def pair(
    fronts: tuple[Journal, RunRow],
    backs: tuple[Journal, RunRow],
    *,
    pages_a_set: int | None,
    damaged: Damaged,
    json: bool,
) -> None:
    """Print the sheets and sets of two runs; exits 1 if one is a misprint, 3 if one was not inspected whole."""
    from prooflight.inspection.sheets import Counts, SheetVerdict
    from prooflight_line.run.pairing import pair_plan, paired

    of_job = max(_pages_of(*fronts, damaged=damaged), _pages_of(*backs, damaged=damaged))
    plan = pair_plan(fronts[1], backs[1], sheets_a_job=of_job, pages_a_set=pages_a_set)
    rows = (journal.pages(run.id, damaged=damaged) for journal, run in (fronts, backs))
    parts = list(paired(plan, *rows))
    counts = Counts.of(parts)
    if json:
        facts: dict[str, list[Any]] = {"sheets": [], "sets": []}
        for one in parts:
            for name, entry in imposition.sheet_facts(one).items():
                facts["sheets" if name == "sheet_verdict" else "sets"].append(entry)
        show.print_json({"fronts": fronts[1].id, "backs": backs[1].id, **facts, "counts": counts.facts})
    else:
        imposition.print_sheets(parts, counts)
    sheets = [one for one in parts if isinstance(one, SheetVerdict)]
    code = exit_codes.of_run(
        misprints=sum(one.verdict == "misprint" for one in sheets),
        complete=all(one.verdict != "not-inspected" for one in sheets),
    )
    if code:
        raise typer.Exit(code)


def _pages_of(journal: Journal, run: RunRow, *, damaged: Damaged) -> int:
    """Return the number of pages of one copy of a run's job, from the names of the pages that came.

    A page's name is its number in the job.
    """
    names = (
        re.fullmatch(r"p(\d{4,7})", page.verdict.page) for page in journal.pages(run.id, damaged=damaged)
    )
    return max((int(name[1]) for name in names if name is not None), default=1)
