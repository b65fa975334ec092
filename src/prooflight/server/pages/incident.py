"""The page of an incident, and that of one sheet: pictures, words, and one tap to say what it was."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.responses import Response

from prooflight.inspection.sheets import came
from prooflight.journal.words import UNDONE, Labels, run_key
from prooflight.plant.gate.log import log_path
from prooflight.server.accounts.roles import Role
from prooflight.server.api.common import (
    IncidentNumber,
    OperatorThemselves,
    RunId,
    SheetNumber,
    console,
    etag,
    not_modified,
    unchanged,
)
from prooflight.server.pages.shell import OperatorPage, ViewerPage, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.journal.words import Word
    from prooflight.server.accounts.roles import Who
    from prooflight.server.console import Console
    from prooflight.server.reading.incidents import Told

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


@router.post("/runs/{run}/incidents/{incident}/word")
def say(
    request: Request,
    who: OperatorPage,
    run: RunId,
    incident: IncidentNumber,
    word: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
    upto: Annotated[int | None, Form(ge=0, lt=2**63)] = None,
) -> Response:
    """One tap: misprint, false alarm, don't know; answers with the list of words. upto: the last sheet shown."""
    held = console(request)
    found = held.reading.run_named(run)
    held.say(who, word, found, incident=incident, note=note, upto=upto)
    return _incident_part(request, who, found, incident)


@router.post("/runs/{run}/sheets/{sheet}/word")
def say_of_sheet(
    request: Request,
    who: OperatorPage,
    run: RunId,
    sheet: SheetNumber,
    word: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """One tap on a sheet that passed: good, misprint, don't know."""
    held = console(request)
    found = held.reading.run_named(run)
    held.reading.sheet(found.id, sheet)
    held.say(who, word, found, sheet=sheet, note=note)
    return _sheet_part(request, who, found, sheet)


@router.post("/runs/{run}/sheets/{sheet}/vouch")
def vouch(
    request: Request,
    who: OperatorThemselves,
    run: RunId,
    sheet: SheetNumber,
    reason: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Somebody has this one sheet in hand, and it is good."""
    held = console(request)
    found = held.reading.run_named(run)
    if not reason.strip():
        return _sheet_part(request, who, found, sheet, vouch_wrong=True)
    held.vouch(who, found, sheet, reason=reason)
    return _sheet_part(request, who, found, sheet)


@router.post("/runs/{run}/words/{word}/undo")
def undo(
    request: Request,
    who: OperatorPage,
    run: RunId,
    word: Annotated[int, Path(ge=1, lt=2**63)],
    shown: Annotated[int, Query(ge=0, lt=2**63, description="The sheet on whose page it was undone.")],
) -> Response:
    """A word does not count any more; answers with the list that it stood in."""
    held = console(request)
    found = held.reading.run_named(run)
    undone = held.undo(who, found, word)
    if undone.incident is not None:
        return _incident_part(request, who, found, int(undone.incident), sheet=shown)
    return _sheet_part(request, who, found, shown)


def _incident_part(
    request: Request, who: Who, run: RunRow, incident: int, *, sheet: int | None = None
) -> Response:
    told = console(request).incidents.one(run, incident)
    shown = told.incident.last_sheet if sheet is None else sheet
    return page(request, who, "incident_words", run=run, told=told, sheet=shown, history_of=history_of)


def _sheet_part(
    request: Request, who: Who, run: RunRow, sheet: int, *, vouch_wrong: bool = False
) -> Response:
    values = _of_sheet(console(request), who, run, sheet) | {"vouch_wrong": vouch_wrong}
    return page(request, who, "sheet_words", run=run, sheet=sheet, **values)


def _of_sheet(held: Console, who: Who, run: RunRow, sheet: int) -> dict[str, Any]:
    """What its page says of a sheet itself."""
    record, said = held.reading.sheet(run.id, sheet), held.incidents.said_of(run, sheet)
    doubtful = not (record.verdict.verdict == "good" and record.disposition == "accept")
    doubtful |= log_path(held.reading.path, run.id).is_file()
    return {
        "record": record,
        "said": said,
        "label": Labels(said).of(sheet),
        "history_of": history_of,
        "next_asked": _next_asked(held, run, record),
        "may_vouch": who.role.may(Role.OPERATOR) and doubtful and came(record),
        "vouch_wrong": False,
    }


def history_of(words: Sequence[Word]) -> list[tuple[Word, Word | None]]:
    """The latest first, each with what undid it; None: it stands."""
    undone = {word.undoes: word for word in words if word.undoes is not None}
    return [(word, undone.get(word.id)) for word in reversed(words) if word.word != UNDONE]


def _shown(request: Request, who: Who, run: RunRow, told: Told | None, sheet: int) -> Response:
    held = console(request)
    values = _of_sheet(held, who, run, sheet)
    record = values["record"]
    values |= {"run": run, "told": told, "sheet": sheet}
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
