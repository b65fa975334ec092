"""The queue of jobs: its list, files that are sent into it, and the order of printing."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Path, Query, Request
from starlette.requests import ClientDisconnect

from prooflight_console.api.common import PREFIX, JobsOperator, Viewer, console
from prooflight_console.api.schemas import QueueAnswer, QueuedJobAnswer, SentAnswer
from prooflight_console.middleware import UPLOADS
from prooflight_console.problems import Problem, responses
from prooflight_console.reading.queue import MOST_NAME, Move

if TYPE_CHECKING:
    from prooflight_line.job_queue.listing import Listed

router = APIRouter(tags=["queue"])

OF_BYTES: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
JobKey = Annotated[
    str, Path(alias="job", pattern=r"^\d{6,18}-[0-9a-f]{12}$", description="`key` of the list.")
]


@router.get(f"{PREFIX}/queue", responses=responses(401, 403, 404, 409))
def queue(request: Request, _who: Viewer) -> QueueAnswer:
    """List the jobs that wait, in the order of printing, and the latest that ended."""
    state = console(request).queue.state()
    return QueueAnswer(
        waiting=[_answer(job) for job in state.waiting],
        ended=[_answer(job) for job in state.ended],
        arriving=state.arriving,
        filled=state.filled,
    )


@router.post(
    UPLOADS,
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 413, 422, 503),
    openapi_extra=OF_BYTES,
)
async def send(
    request: Request, who: JobsOperator, name: Annotated[str, Query(min_length=1, max_length=MOST_NAME)]
) -> SentAnswer:
    """Send a file into the queue: a job, or its ticket (XJDF or JDF), which is best sent before it.

    The body is the file. It is in the queue when `prooflight queue fill` has checked it; see the list.
    """
    state = console(request)
    try:
        size = await state.queue.take(name, request.stream())
    except ClientDisconnect:
        raise Problem(400, "broken-off", f"{name} did not arrive completely") from None
    state.accounts.note(who.name, "queue.send", name, after={"bytes": size})
    return SentAnswer(name=name, bytes=size)


@router.post(f"{PREFIX}/queue/{{job}}/{{move}}", responses=responses(401, 403, 404, 409, 422))
def move(request: Request, who: JobsOperator, job: JobKey, move: Move) -> QueuedJobAnswer:
    """Have a job printed first, hold it, release it, or remove it, which rejects it."""
    return _answer(console(request).move_job(who, job, move))


def _answer(job: Listed) -> QueuedJobAnswer:
    ticket = None if job.ticket is None else job.ticket.facts
    return QueuedJobAnswer(**asdict(job) | {"ticket": ticket})
