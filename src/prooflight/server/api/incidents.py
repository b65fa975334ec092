"""Incidents of a run, and what people say of them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from prooflight.server.api.common import PREFIX, IncidentNumber, Limit, Operator, RunId, Viewer, console
from prooflight.server.api.schemas import IncidentAnswer, IncidentsAnswer, WordAnswer, WordRequest
from prooflight.server.problems import responses
from prooflight.server.reading import facts

router = APIRouter(prefix=PREFIX, tags=["incidents"])


@router.get("/runs/{run}/incidents", responses=responses(401, 403, 404, 422, 503))
def incidents(
    request: Request,
    _who: Viewer,
    run: RunId,
    open: Annotated[bool | None, Query(description="Those that go on, or those that have ended.")] = None,
    after: Annotated[int, Query(ge=0, lt=2**63, description="`next` of the answer before.")] = 0,
    limit: Limit = 100,
) -> IncidentsAnswer:
    """Alarms of one cause are one incident, be they one sheet or four hundred."""
    held = console(request)
    found = held.reading.run_named(run)
    told = [
        one
        for one in held.incidents.of(found)
        if one.incident.number > after and (open is None or one.incident.open == open)
    ]
    items = [IncidentAnswer(**facts.incident_of(one)) for one in told[:limit]]
    return IncidentsAnswer(items=items, next=items[-1].number if len(told) > limit else None)


@router.get("/runs/{run}/incidents/{incident}", responses=responses(401, 403, 404, 422, 503))
def incident(request: Request, _who: Viewer, run: RunId, incident: IncidentNumber) -> IncidentAnswer:
    """One incident."""
    held = console(request)
    found = held.reading.run_named(run)
    return IncidentAnswer(**facts.incident_of(held.incidents.one(found, incident)))


@router.post(
    "/runs/{run}/incidents/{incident}/words",
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 422, 503),
)
def say(
    request: Request, who: Operator, run: RunId, incident: IncidentNumber, given: WordRequest
) -> WordAnswer:
    """Say what an incident was, or that it was seen. Words are added, nothing is replaced; the last one counts.

    A label covers the sheets up to `upto`. Of sheets that were not inspected none says what they are.
    """
    held = console(request)
    found = held.reading.run_named(run)
    word = held.say(who, given.word, found, incident=incident, note=given.note, upto=given.upto)
    return WordAnswer(**facts.word_of(word))


@router.post(
    "/runs/{run}/words/{word}/undo", status_code=201, responses=responses(400, 401, 403, 404, 409, 422, 503)
)
def undo(
    request: Request, who: Operator, run: RunId, word: Annotated[int, Path(ge=1, lt=2**63)]
) -> WordAnswer:
    """Undo a word on a sheet or an incident, by its `id`: a word that says so is added, and the one before counts."""
    held = console(request)
    return WordAnswer(**facts.word_of(held.undo(who, held.reading.run_named(run), word)))
