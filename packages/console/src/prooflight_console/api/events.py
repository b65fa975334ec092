"""Live events, as server-sent events."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Final

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import StreamingResponse

from prooflight_console.api.common import PREFIX, Viewer, console
from prooflight_console.problems import Problem, binary, responses

if TYPE_CHECKING:
    from prooflight_console.accounts.roles import Who
    from prooflight_console.console import Console
    from prooflight_console.reading.live import Parts

router = APIRouter(prefix=PREFIX, tags=["live"])

MOST_LISTENERS: Final = 500
LastId = Annotated[str | None, Header(alias="Last-Event-ID", max_length=20)]
After = Annotated[
    int | None, Query(ge=0, lt=2**63, description="The same as Last-Event-ID, which has precedence.")
]


@router.get(
    "/events",
    response_class=StreamingResponse,
    responses=responses(401, 403, 422, 503) | binary("text/event-stream"),
)
async def events(
    request: Request, who: Viewer, last_id: LastId = None, after: After = None
) -> StreamingResponse:
    """Stream sheets and states of the press as they come.

    `sheet`: a sheet got its verdict; its id is that of the journal's row, and a client that reconnects with
    Last-Event-ID gets all sheets since. `now`: the state of the press. `gap`: more was missed than is sent
    again, read anew. `end`: the session is over.
    """
    return live_answer(console(request), who, position(last_id, after))


def position(last_id: str | None, after: int | None) -> int | None:
    """Return the row after which to stream; an id that is no number counts as none."""
    if last_id is not None and last_id.isascii() and last_id.isdecimal():
        return int(last_id)
    return after


def live_answer(
    state: Console, who: Who, after: int | None, *, parts: Parts | None = None
) -> StreamingResponse:
    """Return a streaming response; raises ``Problem`` 503 if there are too many listeners."""
    if state.live.listeners >= MOST_LISTENERS:
        raise Problem(503, "listeners", f"{MOST_LISTENERS} listeners are connected already")

    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    stream = state.live.events(after, until=partial(state.accounts.over, who), parts=parts)
    return StreamingResponse(stream, media_type="text/event-stream", headers=headers)
