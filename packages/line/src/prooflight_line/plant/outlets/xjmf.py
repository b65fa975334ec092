"""XJMF by HTTP: signals pushed to one URL of the plant, and queries answered at an address of this program."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.events import EventsLost, RunStarted, SheetAtGate, SheetJudged
from prooflight_line.plant.outlets import xjmf_messages as xjmf
from prooflight_line.plant.outlets.outlet import OutletError
from prooflight_line.plant.outlets.posting import REFUSED, answer_text, answering, posting

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable

    import httpx

    from prooflight_line.plant.events import Event
    from prooflight_line.plant.outlets.outbox import Outbox

SHEETS_RETAINED: Final = 100
"""Number of sheets in the answer to a query. assumed: more than pass between two queries of a controller."""


@dataclass(slots=True, kw_only=True)
class _RunFacts:
    """Facts of a run that every message needs."""

    device_id: str
    job: str = field(default="unknown", init=False)
    sheet_mm: tuple[float, float] | None = field(default=None, init=False)

    def note(self, event: Event) -> None:
        """Take the facts of the run from an event."""
        if isinstance(event.body, RunStarted):
            start = event.body
            self.job = start.job
            self.sheet_mm = (
                None
                if start.width_mm is None or start.height_mm is None
                else (start.width_mm, start.height_mm)
            )


@dataclass(slots=True, kw_only=True)
class XjmfPush(_RunFacts):
    """Outlet that sends a ``SignalResource`` a sheet to one URL."""

    url: str
    alarms_only: bool = False
    tls: ssl.SSLContext | None = None
    timeout_s: float = 10.0

    @property
    def name(self) -> str:
        """Name of the outlet, for people."""
        return f"XJMF to {self.url.partition('?')[0]}"

    async def run(self, outbox: Outbox) -> None:
        """Push the events; see ``Outlet``."""
        async with posting(tls=self.tls, timeout_s=self.timeout_s) as client:
            while (event := await outbox.head()) is not None:
                self.note(event)
                message = self._message(event)
                if message is None:
                    outbox.delivered(event)
                    continue
                await self._push(client, outbox, event, message)

    async def reach(self) -> str:
        """Try the web server without posting anything; see ``Outlet``."""
        async with posting(tls=self.tls, timeout_s=self.timeout_s) as client:
            return f"a web server (answers {(await client.head(self.url)).status_code} when asked for its headers)"

    def _message(self, event: Event) -> bytes | None:
        match event.body:
            case SheetJudged(incident=incident):
                if self.alarms_only and incident is None:
                    return None
                return xjmf.signals([event], device_id=self.device_id, job=self.job, sheet_mm=self.sheet_mm)
            case SheetAtGate() as passed:
                if self.alarms_only and passed.tray == "good" and passed.disposition == "accept":
                    return None
                return xjmf.at_gate(event, passed, device_id=self.device_id)
            case EventsLost():
                return xjmf.lost(event, device_id=self.device_id)
        return None

    async def _push(self, client: httpx.AsyncClient, outbox: Outbox, event: Event, message: bytes) -> None:
        answer = await client.post(self.url, content=message, headers={"Content-Type": xjmf.MIME})
        code = _return_code(answer.content) if answer.is_success else None
        if answer.status_code in REFUSED or code:
            outbox.refused(event)
            outbox.down(
                f"event {event.number} was refused: {f'return code {code}' if code else answer_text(answer)}"
            )
            return
        if not answer.is_success:
            raise OutletError(f"the receiver {answer_text(answer)}")
        outbox.delivered(event)
        outbox.up(self.url.partition("?")[0])


@dataclass(slots=True, kw_only=True)
class XjmfAnswers(_RunFacts):
    """Outlet that answers ``QueryResource`` with the results of the last sheets."""

    host: str
    port: int
    """Port; 0: any free port."""
    clock: Callable[[], float] = time.time
    sheets: deque[Event] = field(
        default_factory=lambda: deque(maxlen=SHEETS_RETAINED), init=False, repr=False
    )

    @property
    def name(self) -> str:
        """Name of the outlet, for people."""
        return f"XJMF at {self.host}:{self.port}"

    async def run(self, outbox: Outbox) -> None:
        """Serve the queries; see ``Outlet``."""
        async with answering(self.host, self.port, self.answer, mime=xjmf.MIME) as (host, port):
            outbox.up(f"{host}:{port}")
            while (event := await outbox.head()) is not None:
                self.note(event)
                if isinstance(event.body, SheetJudged):
                    self.sheets.append(event)
                outbox.delivered(event)

    async def reach(self) -> str:
        """Check whether the address is available; see ``Outlet``."""
        async with answering(self.host, self.port, self.answer, mime=xjmf.MIME) as (host, port):
            return f"{host}:{port} is free to listen at"

    def answer(self, data: bytes) -> bytes:
        """Return the answer to a message."""
        now_s = self.clock()

        def refused(kind: str, text: str, code: int, query_id: str | None = None) -> bytes:
            return xjmf.refusal(kind, text, code, device_id=self.device_id, query_id=query_id, time_s=now_s)

        try:
            messages = xjmf.messages(xjmf.read(data))
        except ValueError as error:
            return refused("Notification", f"this is not XJMF: {error}", xjmf.NOT_XML)
        if len(messages) != 1:
            return refused("Notification", "one query at a time is answered", xjmf.UNSUPPORTED)
        kind, query = messages[0]
        header = xjmf.part(query, "Header")
        query_id = None if header is None else header.get("ID")
        if kind != "QueryResource":
            answered = "QueryResource" if kind.startswith(("Query", "Command")) else "queries"
            requested = kind.removeprefix("Query").removeprefix("Command")
            answerable = requested if requested in ANSWERABLE else "Notification"
            return refused(
                answerable, f"{kind} is not answered here, only {answered}", xjmf.UNSUPPORTED, query_id
            )
        parameters = xjmf.part(query, "ResourceQuParams")
        resource = None if parameters is None else parameters.get("ResourceName")
        if resource not in (None, xjmf.RESOURCE):
            return refused(
                "Resource", f"{resource} is unknown here, only {xjmf.RESOURCE}", xjmf.INVALID, query_id
            )
        if xjmf.part(query, "Subscription") is not None:
            text = "subscriptions are in the press file, [plant.xjmf] url"
            return refused("Resource", text, xjmf.UNSUPPORTED, query_id)
        return xjmf.response(
            list(self.sheets),
            device_id=self.device_id,
            job=self.job,
            query_id=query_id,
            time_s=now_s,
            sheet_mm=self.sheet_mm,
        )


ANSWERABLE: Final = frozenset(
    {"KnownDevices", "KnownMessages", "KnownSubscriptions", "Notification", "QueueStatus", "Status"}
)
"""Messages whose response may report a refusal, by the schema."""


def _return_code(answer: bytes) -> int | None:
    """Return the error code of a receiver's answer; None if it has none, or reports success (0)."""
    if not answer.strip():
        return None
    try:
        codes = [one.get("ReturnCode") for _, one in xjmf.messages(xjmf.read(answer))]
    except ValueError:
        return None
    return next((int(code) for code in codes if code and code.isdecimal() and int(code)), None)
