"""The page of an incident, and that of one sheet: pictures, words, and one tap to say what it was."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response

from prooflight.journal.words import run_key
from prooflight.server.api.common import (
    IncidentNumber,
    RunId,
    SheetNumber,
    console,
    etag,
    not_modified,
    unchanged,
)
from prooflight.server.pages.shell import OperatorPage, ViewerPage, page
from prooflight.server.reading.together import reprint

if TYPE_CHECKING:
    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.accounts.roles import Who
    from prooflight.server.console import Console
    from prooflight.server.reading.incidents import Told

COLUMNS = (
    *("sheet", "page", "job_page", "verdict", "kind", "incident"),
    *("copy", "number", "pages", "set", "behind", "why", "take_out"),
)
"""Of the list of what is to be printed again."""
router = APIRouter(include_in_schema=False)

A_WHILE: Final = "private, max-age=3600"
NOTHING_KEPT: Final = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64"><path d="M20 12h17l8 8v32H20zM37 12v8h8M26 '
    '32h13M26 40h13" fill="none" stroke="#8a98a4" stroke-width="2.5" stroke-linejoin="round"/></svg>'
)


@router.get("/runs/{run}/incidents/{incident}")
def incident_page(
    request: Request,
    who: ViewerPage,
    run: RunId,
    incident: IncidentNumber,
    sheet: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
) -> Response:
    """An incident, with one of its sheets."""
    held = console(request)
    found = held.reading.run_named(run)
    told = held.incidents.one(found, incident)
    return _shown(request, who, found, told, told.incident.last_sheet if sheet is None else sheet)


@router.get("/runs/{run}/sheets/{sheet}")
def sheet_page(request: Request, who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """A sheet, with its incident where it belongs to one."""
    held = console(request)
    found = held.reading.run_named(run)
    number = held.incidents.of_sheet(found, sheet)
    told = None if number is None else held.incidents.one(found, number)
    return _shown(request, who, found, told, sheet)


@router.get("/runs/{run}/sheets/{sheet}/thumbnail")
def thumbnail(request: Request, _who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """What the camera saw at the first place, small; a mark where nothing of it is kept."""
    held = console(request)
    found = held.reading.run_named(run)
    tag = etag(run_key(found), sheet, "thumbnail", held.pictures.version)
    if unchanged(request, tag):
        return not_modified(tag, A_WHILE)
    picture = held.pictures.thumbnail(found, held.reading.sheet(found.id, sheet))
    headers = {"ETag": tag, "Cache-Control": A_WHILE}
    if picture is None:
        return Response(NOTHING_KEPT, media_type="image/svg+xml", headers=headers)
    return Response(picture, media_type="image/webp", headers=headers)


@router.get("/runs/{run}/reprint")
def reprint_page(request: Request, who: ViewerPage, run: RunId) -> Response:
    """What is to be printed again."""
    held = console(request)
    found = held.reading.run_named(run)
    return page(request, who, "reprint", run=found, listed=reprint(held.reading, held.incidents, found))


@router.get("/runs/{run}/reprint.csv")
def reprint_csv(request: Request, _who: ViewerPage, run: RunId) -> Response:
    """The same for a spreadsheet."""
    held = console(request)
    found = held.reading.run_named(run)
    file = io.StringIO()
    writer = csv.DictWriter(file, COLUMNS)
    writer.writeheader()
    listed = reprint(held.reading, held.incidents, found)["sheets"]
    writer.writerows({**one, "pages": " ".join(map(str, one["pages"]))} for one in listed)
    name = f'attachment; filename="reprint-run-{found.id}.csv"'
    return Response(file.getvalue(), media_type="text/csv", headers={"Content-Disposition": name})


@router.post("/runs/{run}/incidents/{incident}/word")
def say(
    request: Request,
    who: OperatorPage,
    run: RunId,
    incident: IncidentNumber,
    word: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """One tap: misprint, false alarm, don't know; answers with the list of words."""
    held = console(request)
    found = held.reading.run_named(run)
    held.incidents.one(found, incident)
    held.say(who, word, found, incident=incident, note=note)
    told = held.incidents.one(found, incident)
    return page(request, who, "incident_words", run=found, told=told)


@router.post("/runs/{run}/sheets/{sheet}/word")
def say_of_sheet(
    request: Request,
    who: OperatorPage,
    run: RunId,
    sheet: SheetNumber,
    word: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """One tap on a sheet that is of no incident: good, misprint, don't know."""
    held = console(request)
    found = held.reading.run_named(run)
    record = held.reading.sheet(found.id, sheet)
    held.say(who, word, found, sheet=sheet, note=note)
    words = held.incidents.said_of(found, sheet)
    return page(
        request,
        who,
        "sheet_words",
        run=found,
        sheet=sheet,
        record=record,
        said=words,
        next_asked=_next_asked(held, found, record),
    )


def _shown(request: Request, who: Who, run: RunRow, told: Told | None, sheet: int) -> Response:
    held = console(request)
    record = held.reading.sheet(run.id, sheet)
    values: dict[str, Any] = {"run": run, "told": told, "record": record, "sheet": sheet}
    values["said"] = held.incidents.said_of(run, sheet)
    values["next_asked"] = _next_asked(held, run, record)
    values["pictures"] = held.pictures.told(run, record, wait=False)
    values["can_replay"] = record.evidence is not None and held.stations.press(run) is not None
    return page(request, who, "incident", **values)


def _next_asked(held: Console, run: RunRow, record: PageRecord) -> int | None:
    """The next sheet that passed, was drawn, and was not told yet; None: there is none, or this one was not drawn."""
    if record.asked is None or record.verdict.verdict != "good":
        return None
    open_questions = [
        one.record.sheet
        for one in held.incidents.asked(run)
        if not one.alarm and not one.state and one.record.sheet != record.sheet
    ]
    behind = [number for number in open_questions if number > record.sheet]
    return next(iter(behind or open_questions), None)
