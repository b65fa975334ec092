"""A run's sheets and sets, and what of them is to be printed again; both from its rows, as other commands make them."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.inspection.sheets import ToLookAt, to_look_at
from prooflight.journal.following import Asked
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan, facts_plan
from prooflight.plant.gate.log import KeptDecisions, PlantError
from prooflight.plant.gate.reconciling import reconciled
from prooflight.plant.reprinting import NO_END, Reprint, by_trays, by_verdicts
from prooflight.server.problems import Problem
from prooflight.server.reading.gate import all_pages, log_of
from prooflight.server.reading.report import looked_at

if TYPE_CHECKING:
    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.reading.incidents import RunIncidents
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
    return None if plan is None else _together(reading, run, plan, list(looked_at(reading, run)))


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


def reprint(reading: Reading, incidents: RunIncidents, run: RunRow) -> dict[str, Any]:
    """What is to be printed again: by the trays where the run had a gate, else by its verdicts.

    Of a misprint that people called a false alarm only the trays say that it is to be printed again.
    """
    rows = list(looked_at(reading, run))
    cleared = {told.incident.number for told in incidents.of(run) if told.word == "false-alarm"}

    def said_good(sheet: int) -> bool:
        return incidents.of_sheet(run, sheet) in cleared

    kept = _kept(reading, run)
    plan = facts_plan(run.facts.settings) or SheetPlan(
        layout=Layout(), sides=run.facts.sheets or NO_END, sheets=NO_END
    )
    if kept is not None:
        listed = by_trays(reconciled(all_pages(reading, run), kept, None).sheets, kept)
        shown = SheetPlan.of(kept.began.get("layout"))
        plan = plan if shown is None else shown
    else:
        told = _together(reading, run, plan, rows)
        upto = sum(told.found.counts.sheets.values())
        listed = by_verdicts(plan, told.found.sheets, upto=upto, said_good=said_good)
    of_sheet = _worst_by_sheet(plan, rows)
    sheets: list[dict[str, Any]] = []
    pages: Counter[str] = Counter()
    for one in listed:
        row = of_sheet.get(one.run_sheet)
        named = one if row is None or plan.layout.pages_a_sheet > 1 else replace(one, page=row.verdict.page)
        pages[named.page] += 1
        if len(sheets) < MOST_LISTED:
            sheets.append(_facts(named, row, None if row is None else incidents.of_sheet(run, row.sheet)))
    by = "verdicts" if kept is None else "trays"
    return {"sheets": sheets, "pages": dict(pages), "truncated": len(listed) > len(sheets), "by": by}


# --- parts ---


def _together(reading: Reading, run: RunRow, plan: SheetPlan, rows: list[PageRecord]) -> Together:
    passed = max((one.job_page + 1 for one in rows if one.job_page is not None), default=0)
    follower = reading.follower
    last = -1 if follower is None else follower.last_sheet(run.id)
    asked = Asked(run_id=run.id, first_sheet=max(last - BACK, 0))
    for row in reading.sheets(asked, after=-1, limit=BACK + 1, damaged=lambda _: None):
        passed = max(passed, 0 if row.page.job_page is None else row.page.job_page + 1)
    found = to_look_at(plan, rows, passed=passed, ended=run.state != "running")
    return Together(plan=plan, passed=passed, found=found)


def _kept(reading: Reading, run: RunRow) -> KeptDecisions | None:
    """None: the run had no gate, or what was kept of it is damaged."""
    try:
        return KeptDecisions.read(log_of(reading, run))
    except (Problem, PlantError, OSError):
        return None


def _worst_by_sheet(plan: SheetPlan, rows: list[PageRecord]) -> dict[int, PageRecord]:
    """Of each sheet the side that people look at first."""
    found: dict[int, PageRecord] = {}
    order = ("misprint", "not-inspected", "good")
    for row in rows:
        if row.job_page is None or row.job_page >= plan.passings:
            continue
        sheet, _ = plan.sheet_at(row.job_page)
        known = found.get(sheet)
        if known is None or order.index(row.verdict.verdict) < order.index(known.verdict.verdict):
            found[sheet] = row
    return found


def _facts(one: Reprint, row: PageRecord | None, incident: int | None) -> dict[str, Any]:
    verdict = None if row is None else row.verdict
    return {
        "sheet": None if row is None else row.sheet,
        "page": one.page,
        "job_page": None if row is None else row.job_page,
        "verdict": "good" if verdict is None else verdict.verdict,
        "kind": None if verdict is None else verdict.kind,
        "incident": incident,
        "copy": one.copy,
        "number": one.number,
        "pages": list(one.pages),
        "set": one.set_number,
        "behind": one.behind,
        "why": one.why,
        "take_out": one.take_out,
    }
