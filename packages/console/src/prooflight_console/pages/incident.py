"""The page of an incident and that of one sheet: pictures, labels, and one tap to label it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.responses import Response

from prooflight.inspection.sheets import came
from prooflight_console.accounts.roles import Role
from prooflight_console.api.common import (
    IncidentNumber,
    OperatorThemselves,
    RunId,
    SheetNumber,
    console,
    etag,
    not_modified,
    unchanged,
)
from prooflight_console.pages.defects import incident_text, sheet_text
from prooflight_console.pages.shell import OperatorPage, ViewerPage, language_of, page
from prooflight_console.reading.effects import effects
from prooflight_console.reading.incidents import next_alarm
from prooflight_line.journal.labels import UNDONE, Labels, run_key
from prooflight_line.plant.gate.log import log_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_console.accounts.roles import Who
    from prooflight_console.console import Console
    from prooflight_console.reading.effects import Effects
    from prooflight_console.reading.incidents import LabelledIncident
    from prooflight_line.journal.labels import Label
    from prooflight_line.journal.records import PageRecord, RunRow

router = APIRouter(include_in_schema=False)

SAME_PLACE_MM: Final = 5
"""Distance within which defects count as at the same place. Assumed: more than pages and regions move. [mm]"""
A_WHILE: Final = "private, max-age=3600"
NO_SCAN: Final = (
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
    """Return the page of an incident, with one of its sheets."""
    state = console(request)
    run_row = state.reading.run_named(run)
    labelled = state.incidents.one(run_row, incident)
    return _shown(request, who, run_row, labelled, labelled.incident.last_sheet if sheet is None else sheet)


@router.get("/runs/{run}/sheets/{sheet}")
def sheet_page(request: Request, who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """Return the page of a sheet, with its incident if it belongs to one."""
    state = console(request)
    run_row = state.reading.run_named(run)
    number = state.incidents.of_sheet(run_row, sheet)
    labelled = None if number is None else state.incidents.one(run_row, number)
    return _shown(request, who, run_row, labelled, sheet)


@router.get("/runs/{run}/sheets/{sheet}/thumbnail")
def thumbnail(request: Request, _who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """Return a small picture of the sheet's first region, or a mark if no scan of it is stored."""
    state = console(request)
    run_row = state.reading.run_named(run)
    tag = etag(run_key(run_row), sheet, "thumbnail", state.pictures.version)
    if unchanged(request, tag):
        return not_modified(tag, A_WHILE)
    picture = state.pictures.thumbnail(run_row, sheet, lambda: state.reading.sheet(run_row.id, sheet))
    headers = {"ETag": tag, "Cache-Control": A_WHILE}
    if picture is None:
        return Response(NO_SCAN, media_type="image/svg+xml", headers=headers)
    return Response(picture, media_type="image/webp", headers=headers)


@router.post("/runs/{run}/incidents/{incident}/label")
def say(
    request: Request,
    who: OperatorPage,
    run: RunId,
    incident: IncidentNumber,
    label: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
    upto: Annotated[int | None, Form(ge=0, lt=2**63)] = None,
) -> Response:
    """Label an incident by one tap, and return the list of labels. upto: the last sheet shown."""
    state = console(request)
    run_row = state.reading.run_named(run)
    before = _effects(state, run_row, state.incidents.one(run_row, incident))
    state.say(who, label, run_row, incident=incident, note=note, upto=upto)
    return _incident_part(request, who, run_row, incident, before=before)


@router.post("/runs/{run}/sheets/{sheet}/label")
def say_of_sheet(
    request: Request,
    who: OperatorPage,
    run: RunId,
    sheet: SheetNumber,
    label: Annotated[str, Form(max_length=40)],
    note: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Label a sheet by one tap: good, misprint, don't know."""
    state = console(request)
    run_row = state.reading.run_named(run)
    state.reading.sheet(run_row.id, sheet)
    state.say(who, label, run_row, sheet=sheet, note=note)
    return _sheet_part(request, who, run_row, sheet)


@router.post("/runs/{run}/sheets/{sheet}/release")
def vouch(
    request: Request,
    who: OperatorThemselves,
    run: RunId,
    sheet: SheetNumber,
    reason: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Record that a person has this one sheet in hand and that it is good."""
    state = console(request)
    run_row = state.reading.run_named(run)
    if not reason.strip():
        return _sheet_part(request, who, run_row, sheet, vouch_wrong=True)
    state.vouch(who, run_row, sheet, reason=reason)
    return _sheet_part(request, who, run_row, sheet)


@router.post("/runs/{run}/labels/{label}/undo")
def undo(
    request: Request,
    who: OperatorPage,
    run: RunId,
    label: Annotated[int, Path(ge=1, lt=2**63)],
    shown: Annotated[int, Query(ge=0, lt=2**63, description="The sheet on whose page it was undone.")],
) -> Response:
    """Undo a label, and return the list that it was in."""
    state = console(request)
    run_row = state.reading.run_named(run)
    labels = state.label_store.of_run(run_key(run_row))
    number = next((one.incident for one in labels if one.id == label), None)
    if number is None:
        state.undo(who, run_row, label)
        return _sheet_part(request, who, run_row, shown)
    before = _effects(state, run_row, state.incidents.one(run_row, int(number)))
    state.undo(who, run_row, label)
    return _incident_part(request, who, run_row, int(number), sheet=shown, before=before)


def _incident_part(
    request: Request,
    who: Who,
    run: RunRow,
    incident: int,
    *,
    sheet: int | None = None,
    before: Effects | None = None,
) -> Response:
    state = console(request)
    labelled = state.incidents.one(run, incident)
    shown = labelled.incident.last_sheet if sheet is None else sheet
    after = _effects(state, run, labelled)
    values = _of_incident(state, run, labelled) | {"run": run, "sheet": shown, "history_of": history_of}
    values["effects"] = after if after is None or before is None else after.since(before)
    return page(request, who, "incident_words", **values)


def _effects(state: Console, run: RunRow, labelled: LabelledIncident) -> Effects | None:
    """Return what labels changed; None for an incident to which no label applies."""
    if not labelled.of_misprints:
        return None
    return effects(state.incidents, state.reprints, state.stations, run, labelled)


def _of_incident(state: Console, run: RunRow, labelled: LabelledIncident) -> dict[str, Any]:
    """Return the values of an incident for its page: its neighbours, and the alarm to look at next."""
    number = labelled.incident.number
    every = state.incidents.of(run)
    numbers = [one.incident.number for one in every]
    pending = sorted(
        (one for one in every if one.needs_action and not one.shelved), key=lambda one: one.urgency
    )
    return {
        "told": labelled,
        "previous": max((one for one in numbers if one < number), default=None),
        "following": min((one for one in numbers if one > number), default=None),
        "last": numbers[-1],
        "next": next_alarm(pending, after=number),
        "left": sum(one.incident.number != number for one in pending),
        "wrong": "",
    }


def _sheet_part(
    request: Request, who: Who, run: RunRow, sheet: int, *, vouch_wrong: bool = False
) -> Response:
    values = _of_sheet(console(request), who, run, sheet) | {"vouch_wrong": vouch_wrong}
    return page(request, who, "sheet_words", run=run, sheet=sheet, **values)


def _of_sheet(state: Console, who: Who, run: RunRow, sheet: int) -> dict[str, Any]:
    """Return the values of a sheet itself for its page."""
    record, labels = state.reading.sheet(run.id, sheet), state.incidents.labels_of(run, sheet)
    doubtful = not (record.verdict.verdict == "good" and record.disposition == "accept")
    doubtful |= log_path(state.reading.path, run.id).is_file()
    return {
        "record": record,
        "said": labels,
        "label": Labels(labels).of(sheet),
        "history_of": history_of,
        "next_asked": _next_sampled(state, run, record),
        "may_vouch": who.role.may(Role.OPERATOR) and doubtful and came(record),
        "vouch_wrong": False,
    }


def history_of(labels: Sequence[Label]) -> list[tuple[Label, Label | None]]:
    """Return labels, the latest first, each with the entry that undid it; None if it stands."""
    undone = {label.undoes: label for label in labels if label.undoes is not None}
    return [(label, undone.get(label.id)) for label in reversed(labels) if label.word != UNDONE]


def _shown(
    request: Request, who: Who, run: RunRow, labelled: LabelledIncident | None, sheet: int
) -> Response:
    state = console(request)
    values = _of_sheet(state, who, run, sheet)
    record = values["record"]
    values |= {"run": run, "told": labelled, "sheet": sheet}
    values["passed_s"] = state.reading.clock_zero_s(run) + record.time_s
    values["same_place"] = _same_place(record)
    if labelled is not None:
        changed = _effects(state, run, labelled) if labelled.labels else None
        values |= _of_incident(state, run, labelled) | {"effects": changed}
    values["pictures"] = pictures = state.pictures.describe(run, record, wait=False)
    size_mm = (pictures["width_mm"], pictures["height_mm"]) if "expected" in pictures["layers"] else None
    t = language_of(request, who)
    values["text"] = (
        sheet_text(t, record.verdict, size_mm)
        if labelled is None
        else incident_text(t, labelled.incident, verdict=record.verdict, sheet=sheet, size_mm=size_mm)
    )
    values["can_replay"] = record.verdict.score is not None and (
        record.evidence is not None and state.stations.press(run) is not None
    )
    return page(request, who, "incident", **values)


def _same_place(record: PageRecord) -> str:
    """Return the address of the search for such defects at this place in all runs; empty: the sheet has none."""
    regions = record.verdict.regions
    if record.verdict.verdict != "misprint" or not regions:
        return ""
    first = regions[0]
    box = {"x": first.x_mm, "y": first.y_mm, "width": first.width_mm, "height": first.height_mm}
    sides = {name: f"{mm:.1f}" for name, mm in box.items()}
    return (
        f"/search?{urlencode({'verdict': 'misprint', 'kind': first.kind, **sides, 'within': SAME_PLACE_MM})}"
    )


def _next_sampled(state: Console, run: RunRow, record: PageRecord) -> int | None:
    """Return the next sampled sheet that passed and has no label.

    Returns None if there is none, or if this sheet was not sampled.
    """
    if record.asked is None or record.verdict.verdict != "good":
        return None
    open_questions = [
        one.record.sheet
        for one in state.incidents.sampled(run)
        if not one.alarm and not one.state and one.record.sheet != record.sheet
    ]
    later = [number for number in open_questions if number > record.sheet]
    return next(iter(later or open_questions), None)
