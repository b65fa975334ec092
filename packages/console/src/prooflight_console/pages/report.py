"""The list of runs, and the report of a run for people who are responsible for its quality."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from prooflight_console.api.common import Damaged, RunId, console
from prooflight_console.pages.drawings import bars, heat_drawing
from prooflight_console.pages.shell import ViewerPage, language_of, page
from prooflight_console.reading.imposition import imposed_sheets
from prooflight_console.reading.quality import quality
from prooflight_line.journal.exporting import job_warnings
from prooflight_line.journal.journal import Journal
from prooflight_line.run_package.report import write_report

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.reporting.defect_phrases import Code

router = APIRouter(include_in_schema=False)

RUNS_AT_ONCE = 25


@router.get("/report")
def runs_page(
    request: Request, who: ViewerPage, before: Annotated[int | None, Query(ge=1, lt=2**63)] = None
) -> Response:
    """Return the list of runs, the latest first."""
    damaged = Damaged()
    runs = console(request).reading.runs(before=before, limit=RUNS_AT_ONCE, damaged=damaged.add)
    next_before = (
        runs[-1].id if len(runs) + damaged.count >= RUNS_AT_ONCE and runs and runs[-1].id > 1 else None
    )
    return page(
        request,
        who,
        "report/runs",
        runs=runs,
        behind=next_before,
        damaged=damaged.count,
        first=before is None,
    )


@router.get("/report/{run}")
def report_page(request: Request, who: ViewerPage, run: RunId) -> Response:
    """Return one run in figures and pictures."""
    state = console(request)
    run_row = state.reading.run_named(run)
    report = quality(state.reading, state.incidents, state.stations, state.reprints.count(run_row), run_row)
    return page(
        request,
        who,
        "report/report",
        run=run_row,
        told=report,
        warnings=job_warnings(run_row),
        layout_counts=imposed_sheets(state.reading, run_row),
        kinds=bars(report.figures["kinds"]),
        reasons=bars(report.reasons),
        heat=heat_drawing(report.figures["heat"]),
        most_at_once=max((sum(part.values()) for part in report.trend), default=0),
    )


@router.get("/runs/{run}/report.pdf")
def report_pdf(request: Request, who: ViewerPage, run: RunId) -> Response:
    """Return the report of a run as a PDF, as `prooflight run report` writes it and packages hold it.

    It is made in the process that makes pictures, so that no other page waits for it.
    """
    state = console(request)
    run_id = state.reading.run_named(run).id
    code = language_of(request, who).code
    content = state.pictures.aside(_pdf, state.reading.path, run_id, code)
    name = f'attachment; filename="run-{run_id}.pdf"'
    return Response(content, media_type="application/pdf", headers={"Content-Disposition": name})


def _pdf(journal: Path, run_id: int, code: Code) -> bytes:
    file = io.BytesIO()
    with Journal.open(str(journal), read_only=True) as opened:
        write_report(file, opened, opened.run(run_id), language=code)
    return file.getvalue()
