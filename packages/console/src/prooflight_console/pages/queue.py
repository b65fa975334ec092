"""The page Queue: the jobs of the hot folder, a form that sends files into it, and the order of printing."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from prooflight_console.accounts.roles import Role
from prooflight_console.api.common import console
from prooflight_console.api.queue import JobKey
from prooflight_console.pages.shell import JobsPage, ViewerPage, language_of, page, rendered
from prooflight_console.reading.queue import TAKEN, Move

if TYPE_CHECKING:
    from prooflight_console.accounts.roles import Who

router = APIRouter(include_in_schema=False)

DIGEST_LETTERS: Final = 16


@router.get("/queue")
def queue_page(request: Request, who: ViewerPage) -> Response:
    """Return the page of the queue."""
    state = console(request).queue.state()
    return page(request, who, "queue/queue", state=state, taken=",".join(TAKEN), **_control(request, who))


@router.get("/queue/jobs")
def jobs(request: Request, who: ViewerPage) -> Response:
    """Return the lists of the page alone, which it loads again and again."""
    return _jobs(request, who)


@router.get("/queue/control")
def control(
    request: Request, who: ViewerPage, seen: Annotated[str, Query(max_length=DIGEST_LETTERS)] = ""
) -> Response:
    """Return the stop of the run and what waits for a start; nothing where it is as ``seen``, so that it stays open."""
    values = _control(request, who)
    if values["control_digest"] == seen:
        return Response(status_code=204)
    return page(request, who, "queue/control", **values)


@router.post("/queue/{job}/{move}")
def move(request: Request, who: JobsPage, job: JobKey, move: Move) -> Response:
    """Move a job, and return the lists."""
    console(request).move_job(who, job, move)
    return _jobs(request, who)


def _control(request: Request, who: Who) -> dict[str, Any]:
    """Return the values of the template of the control: its HTML, and the digest of that."""
    now, t = console(request).live.now, language_of(request, who)
    may_speak = who.role.may(Role.OPERATOR)
    html = rendered("now_control", t=t, now=now, may_speak=may_speak, queue_link=False)
    digest = hashlib.sha256(html.encode()).hexdigest()[:DIGEST_LETTERS]
    return {"control": html, "control_digest": digest}


def _jobs(request: Request, who: Who) -> Response:
    return page(request, who, "queue/jobs", state=console(request).queue.state())
