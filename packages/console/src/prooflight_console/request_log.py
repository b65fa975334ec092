"""A number for each request, in its response and in the log for programs."""

from __future__ import annotations

import logging
import re
import secrets
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from starlette.concurrency import run_in_threadpool

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
