"""Middleware of all requests: a number for each, a bound of its body, and the headers of its response."""

from __future__ import annotations

import hashlib
import logging
import re
import secrets
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from prooflight.cli import event_log
from prooflight.errors import ProoflightError
from prooflight_line.journal.labels import run_key, sheet_id

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from prooflight_console.reading.runs import Reading

HEADER: Final = b"x-request-id"
PROBES: Final = ("/healthz", "/readyz")
"""Paths that are asked for every few seconds; in the log they stand only when they fail."""
_GIVEN: Final = re.compile(rb"[A-Za-z0-9_.-]{1,64}")


class RequestLog:
    """Middleware that names each request: by the name that a proxy gave it, or by one of its own."""

    def __init__(self, app: ASGIApp, *, reading: Reading) -> None:
        self._app, self._reading = app, reading

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request by the ASGI protocol."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = dict(scope["headers"]).get(HEADER, b"")
        name = given if _GIVEN.fullmatch(given) else secrets.token_hex(8).encode()
        begun_s, status = time.monotonic(), 500
        failure: Exception | None = None

        async def named(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message = {**message, "headers": [*message.get("headers", []), (HEADER, name)]}
            await send(message)

        with event_log.added(request=name.decode()):
            try:
                await self._app(scope, receive, named)
            except Exception as error:
                failure = error
                raise
            finally:
                if event_log.is_on() and not (status == 200 and scope["path"] in PROBES):
                    event_log.write(
                        "request",
                        level=logging.WARNING if status >= 500 else logging.INFO,
                        error=failure,
                        method=scope["method"],
                        path=scope["path"],
                        status=status,
                        ms=round(1e3 * (time.monotonic() - begun_s), 1),
                        **await run_in_threadpool(self._subject, scope.get("path_params", {})),
                    )

    def _subject(self, parts: dict[str, Any]) -> dict[str, Any]:
        """Return the run of a request, and the sheet by its name in all logs, where it is about one."""
        if "run" not in parts:
            return {}
        facts: dict[str, Any] = {"run": parts["run"]}
        with suppress(ProoflightError):
            run = self._reading.run_named(str(parts["run"]))
            facts = {"press": run.facts.press, "run": run.id}
            if "sheet" in parts:
                facts |= {"sheet": int(parts["sheet"]), "id": sheet_id(run_key(run), int(parts["sheet"]))}
        return facts


# --- bounds of the bodies of requests, since a sender need not have signed in yet ---

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


# --- headers of every response: what a browser may load, and what it may not tell others ---

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "font-src 'self'",
        "connect-src 'self'",
        "manifest-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
FIXED: Final = {
    b"content-security-policy": POLICY.encode(),
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"permissions-policy": b"camera=(), microphone=(), geolocation=()",
    b"x-frame-options": b"DENY",
}
A_YEAR: Final = b"max-age=31536000"


def etag(*parts: object) -> str:
    """Return a strong entity tag, the digest of all parts together."""
    return f'"{hashlib.sha256(repr(parts).encode()).hexdigest()[:32]}"'


class Headers:
    """Middleware that adds the headers to every response.

    A response without Cache-Control is not stored, since the next person to sign in may be another.
    """

    def __init__(self, app: ASGIApp, *, secure: bool) -> None:
        self._app = app
        fixed = FIXED | ({b"strict-transport-security": A_YEAR} if secure else {})
        self._fixed = list(fixed.items())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request by the ASGI protocol."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers: list[Any] = list(message.get("headers", []))
                names = {name.lower() for name, _ in headers}
                headers += [(name, value) for name, value in self._fixed if name not in names]
                if b"cache-control" not in names:
                    headers.append((b"cache-control", b"no-store"))
                message = {**message, "headers": headers}
            await send(message)

        await self._app(scope, receive, with_headers)
