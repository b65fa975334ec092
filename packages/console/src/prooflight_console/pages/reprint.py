"""Sheets to print again: a page, and a table for a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections import Counter

from fastapi import APIRouter, Request
from fastapi.responses import Response

from prooflight_console.api.common import RunId, console
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.reading.reprints import reprint_facts
from prooflight_line.plant.reprinting import NOT_PRINTED

COLUMNS = (
    *("sheet", "page", "job_page", "verdict", "kind", "incident"),
    *("copy", "number", "pages", "set", "behind", "why", "take_out"),
)
router = APIRouter(include_in_schema=False)


@router.get("/runs/{run}/reprint")
def reprint_page(request: Request, who: ViewerPage, run: RunId) -> Response:
    """Return the list of sheets to print again, with their reasons."""
    state = console(request)
    row = state.reading.run_named(run)
    listed = state.reprints.of(row)
    facts = reprint_facts(row, listed, state.incidents, state.reprints.gated(row))
    facts["first_unprinted"] = listed.unprinted.start
    pages = Counter(one.page for one in listed.sheets).most_common()
    return page(request, who, "reprint", run=row, listed=facts, pages=pages, not_printed=NOT_PRINTED)


@router.get("/runs/{run}/reprint.csv")
def reprint_csv(request: Request, _who: ViewerPage, run: RunId) -> Response:
    """Return the whole list as CSV for a spreadsheet."""
    state = console(request)
    row = state.reading.run_named(run)
    file = io.StringIO()
    writer = csv.DictWriter(file, COLUMNS)
    writer.writeheader()
    for one in state.reprints.of(row).all():
        incident = None if one.sheet is None else state.incidents.of_sheet(row, one.sheet)
        pages = " ".join(map(str, one.pages))
        cells = {name: getattr(one, name) for name in COLUMNS if hasattr(one, name)}
        writer.writerow(cells | {"set": one.set_number, "pages": pages, "incident": incident})
    name = f'attachment; filename="reprint-run-{row.id}.csv"'
    return Response(file.getvalue(), media_type="text/csv", headers={"Content-Disposition": name})
