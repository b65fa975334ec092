"""``prooflight run pair``: sheets of a press with a camera for each side, from two runs."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import typer

from prooflight.cli import exit_codes, imposition, show
from prooflight.inspection.sheets import Counts, SheetVerdict
from prooflight_line.run.pairing import pair_plan, paired

if TYPE_CHECKING:
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.reading import Damaged
    from prooflight_line.journal.records import RunRow


def pair(
    fronts: tuple[Journal, RunRow],
    backs: tuple[Journal, RunRow],
    *,
    pages_a_set: int | None,
    damaged: Damaged,
    json: bool,
) -> None:
    """Print the sheets and sets of two runs; exits 1 if one is a misprint, 3 if one was not inspected whole."""
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
