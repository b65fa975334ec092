"""Runs, and lists of their sheets."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request

from prooflight_console.api.common import (
    PREFIX,
    Damaged,
    JobsOperator,
    Limit,
    RunId,
    Viewer,
    console,
    listed,
)
from prooflight_console.api.schemas import ReportAnswer, ReprintAnswer, RunAnswer, RunsAnswer, SheetsAnswer
from prooflight_console.problems import responses
from prooflight_console.reading import facts
from prooflight_console.reading.imposition import imposed_facts, imposed_sheets
from prooflight_console.reading.report import report
from prooflight_console.reading.reprints import reprint_facts
from prooflight_line.journal.following import PageQuery

router = APIRouter(prefix=PREFIX, tags=["runs"])

Verdict = Literal["good", "misprint", "not-inspected"]
Before = Annotated[int | None, Query(ge=1, lt=2**63, description="`next` of the answer before.")]
Text = Annotated[str | None, Query(max_length=200)]


@router.get("/runs", responses=responses(401, 403, 422, 503))
def runs(request: Request, _who: Viewer, before: Before = None, limit: Limit = 50) -> RunsAnswer:
    """List all runs, the latest first."""
    damaged = Damaged()
    rows = console(request).reading.runs(before=before, limit=limit, damaged=damaged.add)
    items = [facts.run_of(run) for run in rows]
    cursor = items[-1]["id"] if items else None
    return RunsAnswer(**listed(items, limit=limit, cursor=cursor, damaged=damaged.count))


@router.get("/runs/{run}", responses=responses(401, 403, 404, 422, 503))
def run(request: Request, _who: Viewer, run: RunId) -> RunAnswer:
    """Return one run, with its settings and the last status that it reported."""
    reading = console(request).reading
    return RunAnswer(**facts.whole_run(reading.run_named(run)))


@router.post("/runs/{run}/stop", status_code=202, responses=responses(401, 403, 404, 409, 422, 503))
def stop(request: Request, who: JobsOperator, run: RunId) -> RunAnswer:
    """End a run: sheets that have passed are still inspected, all others are not. The press itself does not stop.

    The run goes on for some seconds, until all that has passed is inspected.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    state.stop_run(who, run_row)
    return RunAnswer(**facts.run_of(run_row))


@router.get("/runs/{run}/sheets", responses=responses(401, 403, 404, 422, 503))
def sheets(
    request: Request,
    _who: Viewer,
    run: RunId,
    after: Annotated[int, Query(ge=-1, lt=2**63, description="`next` of the answer before.")] = -1,
    limit: Limit = 100,
    verdict: Verdict | None = None,
    kind: Text = None,
    page: Text = None,
    late: bool | None = None,
    to_review: bool = False,
) -> SheetsAnswer:
    """List sheets of a run by number; `to_review` omits those that are good, in time, and without a note."""
    reading, damaged = console(request).reading, Damaged()
    run_row = reading.run_named(run)
    query = PageQuery(
        run_id=run_row.id, verdict=verdict, kind=kind, page=page, late=late, to_review=to_review
    )
    rows = reading.sheets(query, after=after, limit=limit, damaged=damaged.add)
    cursor = rows[-1].page.sheet if rows else None
    items = [facts.sheet_of(row) for row in rows]
    return SheetsAnswer(**listed(items, limit=limit, cursor=cursor, damaged=damaged.count))


@router.get("/sheets", responses=responses(401, 403, 422, 503))
def search(
    request: Request,
    _who: Viewer,
    before: Before = None,
    limit: Limit = 100,
    verdict: Verdict | None = None,
    kind: Text = None,
    page: Text = None,
    job: Text = None,
    press: Text = None,
    since: Annotated[datetime | None, Query(description="Runs that began then or later.")] = None,
    until: Annotated[datetime | None, Query(description="Runs that began before.")] = None,
    to_review: bool = False,
) -> SheetsAnswer:
    """List sheets of all runs, the latest first."""
    damaged = Damaged()
    query = PageQuery(
        verdict=verdict,
        kind=kind,
        page=page,
        job=job,
        press=press,
        since_s=_unix_s(since),
        until_s=_unix_s(until),
        to_review=to_review,
    )
    rows = console(request).reading.search(query, before=before, limit=limit, damaged=damaged.add)
    cursor = rows[-1].row if rows else None
    items: list[dict[str, Any]] = [facts.sheet_of(row) for row in rows]
    return SheetsAnswer(**listed(items, limit=limit, cursor=cursor, damaged=damaged.count))


@router.get("/runs/{run}/reprint", responses=responses(401, 403, 404, 409, 422, 503))
def reprint_list(request: Request, _who: Viewer, run: RunId) -> ReprintAnswer:
    """List the sheets to print again.

    They are known by the trays if there is a gate, else by verdicts that no person overruled.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    reprints = state.reprints.of(run_row)
    return ReprintAnswer(**reprint_facts(run_row, reprints, state.incidents, state.reprints.gated(run_row)))


@router.get("/runs/{run}/report", responses=responses(401, 403, 404, 422, 503))
def run_report(request: Request, _who: Viewer, run: RunId) -> ReportAnswer:
    """Return a run in figures: misprints by kind and by place, labels, guaranteed and observed false alarms."""
    state = console(request)
    run_row = state.reading.run_named(run)
    imposed = imposed_sheets(state.reading, run_row)
    sheets = None if imposed is None else imposed_facts(imposed)
    figures = report(state.reading, state.incidents, state.stations, state.reprints.count(run_row), run_row)
    return ReportAnswer(**figures, layout_counts=sheets)


def _unix_s(moment: datetime | None) -> float | None:
    if moment is None:
        return None
    try:
        return moment.timestamp()
    except (ValueError, OverflowError, OSError):  # the year 1, in a zone east of Greenwich
        return 0.0
