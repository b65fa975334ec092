"""Runs, and the report of a run for whoever answers for its quality."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from prooflight.journal.exporting import job_warnings
from prooflight.server.api.common import Damaged, RunId, console
from prooflight.server.pages.drawings import bars, heat_drawing
from prooflight.server.pages.shell import ViewerPage, page
from prooflight.server.reading.quality import quality
from prooflight.server.reading.together import together

router = APIRouter(include_in_schema=False)

RUNS_AT_ONCE = 25


@router.get("/report")
def runs_page(
    request: Request, who: ViewerPage, before: Annotated[int | None, Query(ge=1, lt=2**63)] = None
) -> Response:
    """All runs, the latest first."""
    damaged = Damaged()
    runs = console(request).reading.runs(before=before, limit=RUNS_AT_ONCE, damaged=damaged.add)
    behind = runs[-1].id if len(runs) + damaged.count >= RUNS_AT_ONCE and runs and runs[-1].id > 1 else None
    return page(
        request, who, "report/runs", runs=runs, behind=behind, damaged=damaged.count, first=before is None
    )


@router.get("/report/{run}")
def report_page(request: Request, who: ViewerPage, run: RunId) -> Response:
    """One run in figures and pictures; prints as it is seen."""
    held = console(request)
    found = held.reading.run_named(run)
    told = quality(held.reading, held.incidents, held.stations, held.reprints.count(found), found)
    return page(
        request,
        who,
        "report/report",
        run=found,
        told=told,
        warnings=job_warnings(found),
        together=together(held.reading, found),
        kinds=bars(told.figures["kinds"]),
        reasons=bars(told.reasons),
        heat=heat_drawing(told.figures["heat"]),
        most_at_once=max((sum(part.values()) for part in told.course), default=0),
    )
