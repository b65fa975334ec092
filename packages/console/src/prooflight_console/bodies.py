"""Middleware that bounds the bodies of requests, since a sender need not have signed in yet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from starlette.exceptions import HTTPException

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_BYTES: Final = 4_000_000
"""Largest body; the zones of a job, at most 2,000, take a megabyte. [bytes]"""
UPLOADS: Final = "/api/v1/queue/files"
MOST_UPLOADED: Final = 4_000_000_000
"""Largest file of a job that is sent into the queue, which is written to disk piece by piece. [bytes]"""


class BoundedBodies:
    """Middleware that refuses a body declared too large, and stops reading one that turns out to be."""

    def __init__(
        self, app: ASGIApp, *, most_bytes: int = MOST_BYTES, most_uploaded: int = MOST_UPLOADED
    ) -> None:
        self._app, self._most_bytes, self._most_uploaded = app, most_bytes, most_uploaded

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request by the ASGI protocol."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most_bytes = self._most_uploaded if scope.get("path") == UPLOADS else self._most_bytes
        stated = dict(scope["headers"]).get(b"content-length", b"0")
        too_large = stated.isdigit() and int(stated) > most_bytes
        came = 0

        async def bounded() -> Message:
            nonlocal came
            if too_large:
                raise _refusal(most_bytes)
            message = await receive()
            came += len(message.get("body", b""))
            if came > most_bytes:
                raise _refusal(most_bytes)
            return message

        await self._app(scope, bounded, send)


def _refusal(most_bytes: int) -> HTTPException:
    return HTTPException(413, f"a body has at most {most_bytes:,} bytes", headers={"Connection": "close"})
