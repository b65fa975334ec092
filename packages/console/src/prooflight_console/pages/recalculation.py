"""The verdict of one sheet, computed again."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from prooflight.errors import ProoflightError
from prooflight.inspection.redeciding import replayed
from prooflight_console.api.common import RunId, SheetNumber, console, evidence_of, replayable
from prooflight_console.pages.shell import ViewerPage, page

router = APIRouter(include_in_schema=False)


@router.get("/runs/{run}/sheets/{sheet}/again")
def again(request: Request, who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """Return the verdict of a sheet, computed again from its evidence, next to what was recorded."""
    run_row, record, press = replayable(console(request), run, sheet)
    why, figures = "", []
    try:
        figures = replayed(record.verdict, evidence_of(record, run=run_row.id), press)
    except ProoflightError as error:
        why = str(error)
    return page(request, who, "search/again", run=run_row, sheet=sheet, figures=figures, why=why)
