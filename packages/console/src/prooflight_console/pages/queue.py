"""The page Queue: the jobs of the hot folder, a form that sends files into it, and the order of printing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi import APIRouter, Request

from prooflight_console.api.common import console
from prooflight_console.api.queue import JobKey
from prooflight_console.pages.shell import JobsPage, ViewerPage, page
from prooflight_console.reading.queue import TAKEN, Move

if TYPE_CHECKING:
    from fastapi.responses import Response

    from prooflight_console.accounts.roles import Who

router = APIRouter(include_in_schema=False)


@router.get("/queue")
def queue_page(request: Request, who: ViewerPage) -> Response:
    """Return the page of the queue."""
    return page(request, who, "queue/queue", state=console(request).queue.state(), taken=",".join(TAKEN))


@router.get("/queue/jobs")
def jobs(request: Request, who: ViewerPage) -> Response:
    """Return the lists of the page alone, which it loads again and again."""
    return _jobs(request, who)


@router.post("/queue/{job}/{move}")
def move(request: Request, who: JobsPage, job: JobKey, move: Move) -> Response:
    """Move a job, and return the lists."""
    console(request).move_job(who, job, move)
    return _jobs(request, who)


def _jobs(request: Request, who: Who) -> Response:
    return page(request, who, "queue/jobs", state=console(request).queue.state())
