"""Alarms: acknowledgement of all, shelving, statistics, and notes for the next shift."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Path, Query, Request

from prooflight_console.api.common import PREFIX, IncidentNumber, Limit, Operator, RunId, Viewer, console
from prooflight_console.api.schemas import (
    AcknowledgedAnswer,
    AcknowledgeRequest,
    HandoverAnswer,
    HandoverRequest,
    HandoversAnswer,
    ShelveRequest,
    ShelvingAnswer,
    ShelvingsAnswer,
    StatisticsAnswer,
)
from prooflight_console.problems import responses
from prooflight_console.reading.alarms import alarm_figures
from prooflight_line.journal.labels import run_key

if TYPE_CHECKING:
    from prooflight_console.alarms.alarm_store import Shelving

router = APIRouter(prefix=PREFIX, tags=["alarms"])

Hours = Annotated[float, Query(ge=1, le=720, description="Period up to now that the statistics cover.")]
ShelvingNumber = Annotated[int, Path(alias="shelving", ge=1, lt=2**63)]


@router.post("/runs/{run}/incidents/seen", responses=responses(400, 401, 403, 404, 422, 503))
def acknowledge_all(
    request: Request, who: Operator, run: RunId, given: AcknowledgeRequest
) -> AcknowledgedAnswer:
    """Mark all incidents as seen that opened or came back up to a sheet, but for those that are shelved."""
    state = console(request)
    return AcknowledgedAnswer(
        incidents=state.acknowledge_all(who, state.reading.run_named(run), upto=given.upto)
    )


@router.get("/runs/{run}/shelvings", responses=responses(401, 403, 404, 422, 503))
def shelvings(
    request: Request,
    _who: Viewer,
    run: RunId,
    in_force: Annotated[bool, Query(description="Only those that have not ended.")] = False,
) -> ShelvingsAnswer:
    """List the shelvings of a run's alarms, the latest first."""
    state = console(request)
    items = [
        _answer(one, state.alarm_store.clock())
        for one in state.alarm_store.shelvings(run_key(state.reading.run_named(run)))
    ]
    return ShelvingsAnswer(items=[one for one in items if one.in_force or not in_force])


@router.post(
    "/runs/{run}/incidents/{incident}/shelvings",
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 422, 503),
)
def shelve(
    request: Request, who: Operator, run: RunId, incident: IncidentNumber, given: ShelveRequest
) -> ShelvingAnswer:
    """Shelve an alarm: it needs no action until then. An alarm of high priority needs an engineer.

    A shelving ends by itself, and hides its alarm only while that is of no higher priority. It changes no
    verdict, no disposition, and no list of sheets to print again.
    """
    state = console(request)
    shelving = state.shelve(
        who,
        state.reading.run_named(run),
        incident,
        priority=given.priority,
        seconds=60 * given.minutes,
        reason=given.reason,
    )
    return _answer(shelving, state.alarm_store.clock())


@router.delete("/runs/{run}/shelvings/{shelving}", responses=responses(400, 401, 403, 404, 409, 422, 503))
def unshelve(request: Request, who: Operator, run: RunId, shelving: ShelvingNumber) -> ShelvingAnswer:
    """End a shelving before its time."""
    state = console(request)
    ended = state.unshelve(who, state.reading.run_named(run), shelving)
    return _answer(ended, state.alarm_store.clock())


@router.get("/alarms/statistics", responses=responses(401, 403, 422, 503))
def alarm_statistics(request: Request, _who: Viewer, hours: Hours = 24) -> StatisticsAnswer:
    """Return the alarm statistics of the last runs; an alarm counts each time that it opens or comes back."""
    state = console(request)
    figures = alarm_figures(state.reading, state.incidents, hours=hours, now_s=state.accounts.clock())
    return StatisticsAnswer(**figures.facts)


@router.get("/handovers", responses=responses(401, 403, 422, 503))
def handovers(
    request: Request,
    _who: Viewer,
    before: Annotated[int | None, Query(ge=1, lt=2**63, description="`next` of the answer before.")] = None,
    limit: Limit = 20,
) -> HandoversAnswer:
    """List the notes for the next shift, the latest first."""
    notes = console(request).alarm_store.handovers(before=before, limit=limit)
    items = [HandoverAnswer(**asdict(note)) for note in notes]
    return HandoversAnswer(
        items=items, next=items[-1].id if len(items) == limit and items[-1].id > 1 else None
    )


@router.post("/handovers", status_code=201, responses=responses(400, 401, 403, 409, 422, 503))
def hand_over(request: Request, who: Operator, given: HandoverRequest) -> HandoverAnswer:
    """Write a note for the next shift; the state of the alarms is kept with it."""
    return HandoverAnswer(**asdict(console(request).hand_over(who, given.text)))


def _answer(shelving: Shelving, now_s: float) -> ShelvingAnswer:
    fields: dict[str, Any] = asdict(shelving)
    del fields["run"]
    return ShelvingAnswer(**fields, in_force=shelving.in_force(now_s))
