"""The page Now: the current state of the press, for people who stand next to it."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Form, Request
from fastapi.responses import HTMLResponse, Response, StreamingResponse

from prooflight_console.accounts.roles import Role
from prooflight_console.api.common import IncidentNumber, RunId, console
from prooflight_console.api.events import After, LastId, live_answer, position
from prooflight_console.pages.shell import JobsPage, OperatorPage, ViewerPage, language_of, page, rendered
from prooflight_console.reading import facts

if TYPE_CHECKING:
    from prooflight_console.pages.language import Language
    from prooflight_console.reading.now import Now

router = APIRouter(include_in_schema=False)

PARTS: Final = ("state", "todo", "control", "incidents", "health")
"""Parts of the page that are updated: templates now_PART, which fill the element of that id."""


@router.get("/")
def now_page(request: Request, who: ViewerPage) -> Response:
    """Return the whole page; later changes come by ``now_events``."""
    state = console(request)
    live, queue_link = state.live, state.settings.queue is not None
    now, last_id, recent = live.now, live.last_id, live.recent
    strip = [facts.live_sheet(row) for row in recent]
    return page(request, who, "now", now=now, strip=strip, last_id=last_id, queue_link=queue_link)


@router.get("/now/events")
def now_events(
    request: Request, who: ViewerPage, last_id: LastId = None, after: After = None
) -> StreamingResponse:
    """Stream events as ``/api/v1/events``, with the parts of the page in place of the state."""
    t, may_speak = language_of(request, who), who.role.may(Role.OPERATOR)
    state = console(request)
    queue_link = state.settings.queue is not None
    make = partial(_cached_parts, t=t, may_speak=may_speak, queue_link=queue_link)
    return live_answer(state, who, position(last_id, after), parts=make)


@router.post("/runs/{run}/incidents/{incident}/seen")
def seen(
    request: Request,
    who: OperatorPage,
    run: RunId,
    incident: IncidentNumber,
    upto: Annotated[int | None, Form(ge=0, lt=2**63)] = None,
) -> Response:
    """Mark an incident as seen, so that it need not sound any more; the page is updated like all others."""
    state = console(request)
    run_row = state.reading.run_named(run)
    state.say(who, "seen", run_row, incident=incident, upto=upto)
    return HTMLResponse(status_code=204)


@router.post("/runs/{run}/stop")
def stop(request: Request, who: JobsPage, run: RunId) -> Response:
    """Ask for the end of a run; the page is updated like all others."""
    state = console(request)
    state.stop_run(who, state.reading.run_named(run))
    return HTMLResponse(status_code=204)


_cached: dict[tuple[str, bool], tuple[Now, str]] = {}


def _cached_parts(now: Now, *, t: Language, may_speak: bool, queue_link: bool) -> str:
    """Return ``parts``, rendered once for all with the same language and rights."""
    key = t.code, may_speak
    cached = _cached.get(key)
    if cached is None or cached[0] is not now:
        cached = _cached[key] = now, parts(now, t=t, may_speak=may_speak, queue_link=queue_link)
    return cached[1]


def parts(now: Now, *, t: Language, may_speak: bool, queue_link: bool) -> str:
    """Return the parts of the page as JSON: HTML by element id, and what sounds."""
    values: dict[str, Any] = {"now": now, "may_speak": may_speak, "queue_link": queue_link}
    rendered_parts: dict[str, Any] = {part: rendered(f"now_{part}", t=t, **values) for part in PARTS}
    message = {"parts": rendered_parts, "alarm": now.alarm, "unseen": now.unseen_costly, "state": now.state}
    return json.dumps(message)
