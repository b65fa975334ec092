"""Incidents of a run, and the labels that people give them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from prooflight_console.api.common import PREFIX, IncidentNumber, Limit, Operator, RunId, Viewer, console
from prooflight_console.api.schemas import IncidentAnswer, IncidentsAnswer, LabelAnswer, LabelRequest
from prooflight_console.problems import responses
from prooflight_console.reading import facts

router = APIRouter(prefix=PREFIX, tags=["incidents"])


@router.get("/runs/{run}/incidents", responses=responses(401, 403, 404, 422, 503))
def incidents(
    request: Request,
    _who: Viewer,
    run: RunId,
    open: Annotated[bool | None, Query(description="Only active incidents, or only ended ones.")] = None,
    after: Annotated[int, Query(ge=0, lt=2**63, description="`next` of the answer before.")] = 0,
    limit: Limit = 100,
) -> IncidentsAnswer:
    """List the incidents of a run; alarms of one cause are one incident, be they one sheet or four hundred."""
    state = console(request)
    run_row = state.reading.run_named(run)
    selected = [
        one
        for one in state.incidents.of(run_row)
        if one.incident.number > after and (open is None or one.incident.open == open)
    ]
    items = [IncidentAnswer(**facts.incident_of(one)) for one in selected[:limit]]
    return IncidentsAnswer(items=items, next=items[-1].number if len(selected) > limit else None)


@router.get("/runs/{run}/incidents/{incident}", responses=responses(401, 403, 404, 422, 503))
def incident(request: Request, _who: Viewer, run: RunId, incident: IncidentNumber) -> IncidentAnswer:
    """Return one incident."""
    state = console(request)
    run_row = state.reading.run_named(run)
    return IncidentAnswer(**facts.incident_of(state.incidents.one(run_row, incident)))


@router.post(
    "/runs/{run}/incidents/{incident}/labels",
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 422, 503),
)
def say(
    request: Request, who: Operator, run: RunId, incident: IncidentNumber, given: LabelRequest
) -> LabelAnswer:
    """Label an incident, or mark it as seen. Labels are added, nothing is replaced; the last one counts.

    A label covers the sheets up to `upto`. No label applies to sheets that were not inspected.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    label = state.say(who, given.label, run_row, incident=incident, note=given.note, upto=given.upto)
    return LabelAnswer(**facts.label_of(label))


@router.post(
    "/runs/{run}/labels/{label}/undo", status_code=201, responses=responses(400, 401, 403, 404, 409, 422, 503)
)
def undo(
    request: Request, who: Operator, run: RunId, label: Annotated[int, Path(ge=1, lt=2**63)]
) -> LabelAnswer:
    """Undo a label of a sheet or an incident, by its `id`.

    An entry that says so is added, and the label before it counts.
    """
    state = console(request)
    return LabelAnswer(**facts.label_of(state.undo(who, state.reading.run_named(run), label)))
