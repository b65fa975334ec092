"""The option ``--layout`` of commands on jobs: imposition of pages on sheets."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from rich.text import Text

from prooflight.cli import faults, show
from prooflight.errors import RequestError, visible

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.sheets import Counts, ReviewList, SetVerdict, SheetVerdict
    from prooflight.journal.journal import Journal
    from prooflight.journal.reading import Damaged
    from prooflight.journal.records import RunRow
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.scans.geometry import ScanGeometry


def imposed(
    job: JobSource, layout_text: str | None, geometry: ScanGeometry, *, sheets: int | None = None
) -> tuple[JobSource, SheetPlan | None]:
    """Return the job as sides, and the plan of its sheets; None: no layout was given, and pages are printed
    as they are.

    ``sheets`` is the number of sheets of the run; None: the job once. Places that stay blank are reported.
    Errors as ``planned``.
    """
    if layout_text is None:
        return job, None
    from prooflight.pages.layout.layout import Layout
    from prooflight.press.sheets import planned

    layout = Layout.parse(layout_text)
    with job.open() as opened:
        plan = planned(opened, layout, geometry, sheets=sheets)
    if blank := plan.layout.blank_places:
        faults.report(
            f"the last of the job's {plan.sheets_a_job:,} sheets has {plan.layout.pages_a_sheet} places, "
            f"of which {blank} must stay blank"
        )
    return replace(job, layout=plan.layout), plan


def of_job(plan: SheetPlan, verdicts: Sequence[Verdict]) -> list[SheetVerdict | SetVerdict]:
    """Return the sheets and sets of a job that was inspected once, from the verdicts on its sides in their order."""
    from prooflight.inspection.sheets import Assembling
    from prooflight.journal.records import PageRecord

    assembling, parts = Assembling(plan), list["SheetVerdict | SetVerdict"]()
    for position in range(plan.passings):
        side = plan.side_at(position)
        verdict = verdicts[side]
        parts += assembling.add(
            PageRecord(sheet=side, job_page=position, verdict=verdict, late=False, first_line=0, time_s=0.0)
        )
    return parts + assembling.end()


def print_job(parts: Sequence[SheetVerdict | SetVerdict], *, json: bool) -> None:
    """Print the sheets and sets of a job."""
    from prooflight.inspection.sheets import Counts

    if not json:
        print_sheets(parts, Counts.of(parts))
        return
    for one in parts:
        show.print_json(sheet_facts(one))


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


def sheet_facts(part: SheetVerdict | SetVerdict) -> dict[str, Any]:
    """Return a sheet or a set for programs: ``{"sheet_verdict": ...}`` or ``{"set_verdict": ...}``."""
    from prooflight.inspection.sheets import SheetVerdict

    if isinstance(part, SheetVerdict):
        more: dict[str, Any] = {"bad_pages": part.bad_pages, "doubled": part.doubled}
        more["disposition"] = part.disposition
        return {"sheet_verdict": asdict(part) | more | {"out_of_order": part.out_of_order}}
    return {"set_verdict": asdict(part) | {"complete": part.complete}}


def print_sheets(
    parts: Iterable[SheetVerdict | SetVerdict], counts: Counts, *, last: int | None = None
) -> None:
    """Print sheets and sets that are not clean, and the counts, for people; ``last`` limits the rows of each table."""
    from prooflight.inspection.sheets import SheetVerdict

    spoiled = [one for one in parts if not one.clean]
    sheets = [one for one in spoiled if isinstance(one, SheetVerdict)]
    sets = [one for one in spoiled if not isinstance(one, SheetVerdict)]
    if sheets:
        text_columns = ("name", "verdict", "bad pages", "why")
        table = show.table_of(
            "Sheets to look at", ("sheet", "copy", *text_columns), text_columns=text_columns
        )
        for one in sheets[-last if last else 0 :]:
            table.add_row(
                str(one.sheet),
                str(one.copy),
                visible(one.name),
                Text(one.verdict, style=show.VERDICT_STYLE[one.verdict]),
                ", ".join(map(str, one.bad_pages)),
                visible("; ".join(one.why)),
            )
        show.people.print(table)
    if sets:
        of_sets = ("verdict", "why")
        table = show.table_of("Sets to look at", ("set", *of_sets), text_columns=of_sets)
        for own in sets[-last if last else 0 :]:
            style = show.VERDICT_STYLE[own.verdict]
            table.add_row(str(own.set_number), Text(own.verdict, style=style), "; ".join(own.why))
        show.people.print(table)
    show.people.print(sheets_line(counts))


def sheets_line(counts: Counts) -> str:
    """Return the number of sheets and sets of each kind, in one line."""
    parts = [_of("sheet", counts.sheets)]
    if any(counts.sets.values()):
        parts.append(f"{_of('set', counts.sets)}, {counts.spoiled:,} not to be delivered as they are")
    return "; ".join(parts)


def _of(what: str, counts: dict[Any, int]) -> str:
    from prooflight.reporting.wording import count

    bad, unseen = counts["misprint"], counts["not-inspected"]
    return ", ".join(
        [
            count(sum(counts.values()), what),
            f"{counts['good']:,} good",
            *([count(bad, "misprint")] if bad else []),
            *([f"{unseen:,} not inspected"] if unseen else []),
        ]
    )
