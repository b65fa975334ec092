"""Protocol of an outlet, and the thread that runs it and starts it again whenever it fails."""

from __future__ import annotations

import asyncio
import logging
import os
import ssl
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, Self

from prooflight.errors import sentence
from prooflight_line.plant.outlets.outbox import ROOM, Outbox

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight_line.plant.events import Event, EventsLost
    from prooflight_line.plant.outlets.outbox import OutletHealth

_log = logging.getLogger(__name__)

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
"""First and longest pause after an outlet has failed; the pause doubles each time."""
CLOSE_S: Final = 5.0
"""Time for the delivery of waiting events at the end. assumed: as long as a person waits for a command to
end."""
CANCEL_S: Final = 2.0
MOST_FAULTS: Final = 3
"""Consecutive internal errors, without a delivery between them, after which the event at hand is dropped."""


class OutletError(ConnectionError):
    """An outlet cannot deliver now; the message is one line for a person."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """Result of trying an outlet."""

    name: str
    ok: bool
    answer: str
    """Name of the other end, or the error; one line."""
    milliseconds: float


class Outlet(Protocol):
    """Protocol of an outlet for events."""

    @property
    def name(self) -> str:
        """Name for people: the kind of outlet and its destination."""
        ...

    async def run(self, outbox: Outbox) -> None:
        """Connect, call ``outbox.up``, and deliver its events one after another until there are no more.

        Any error is reported, and the method is called again after a pause; OSError and its subclasses are
        expected.
        """
        ...

    async def reach(self) -> str:
        """Try the other end without disturbing it; return its answer in one line, or raise the error."""
        ...


def check(outlet: Outlet, *, within_s: float = 5.0) -> Checked:
    """Try whether an outlet's other end answers."""
    begun_s = time.monotonic()

    async def tried() -> str:
        return await asyncio.wait_for(outlet.reach(), within_s)

    try:
        answer, ok = asyncio.run(tried()), True
    except TimeoutError:
        answer, ok = f"no answer within {within_s:g} s", False
    except Exception as error:
        answer, ok = error_text(error), False
    return Checked(
        name=outlet.name, ok=ok, answer=answer, milliseconds=round(1e3 * (time.monotonic() - begun_s), 1)
    )


def error_text(error: BaseException) -> str:
    """Return an error in one line: the system's message if the system caused it, else that of the error itself."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and not isinstance(cause, ssl.SSLError) and (cause.errno or 0) > 0:
            return os.strerror(cause.errno or 0)
        cause = cause.__cause__ or cause.__context__
    return sentence(str(error) or type(error).__name__)


class Outlets:
    """Running outlets, each in its thread; use it as a context. ``put`` never waits for any of them."""

    def __init__(
        self,
        outlets: Sequence[Outlet],
        *,
        room: int = ROOM,
        changed: Callable[[OutletHealth], None] = lambda _: None,
        close_s: float = CLOSE_S,
        pauses_s: tuple[float, float] = (FIRST_PAUSE_S, LONGEST_PAUSE_S),
    ) -> None:
        """Prepare the threads.

        ``room`` is the number of events that may wait in each. ``changed`` is called in the outlet's thread
        when it connects or disconnects.
        """
        self._close_s = close_s
        self._threads = [
            _Thread(outlet, Outbox(outlet.name, room=room, changed=changed), pauses_s) for outlet in outlets
        ]
        self.given_up: dict[str, EventsLost] = {}
        """Events of each outlet that were still undelivered when time was up; set by ``close``."""

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, event: Event) -> None:
        """Put an event into all queues; never waits."""
        for thread in self._threads:
            thread.outbox.put(event)

    @property
    def health(self) -> list[OutletHealth]:
        """Health of each outlet, in their order."""
        return [thread.outbox.health for thread in self._threads]

    def close(self) -> None:
        """Deliver waiting events within the time given for all outlets; drop and report the rest."""
        for thread in self._threads:
            thread.outbox.close()
        until_s = time.monotonic() + self._close_s
        for thread in self._threads:
            thread.join(max(until_s - time.monotonic(), 0.0))
            thread.cancel()
        for thread in self._threads:
            thread.join(CANCEL_S)
            lost = thread.outbox.abandon()
            if lost is not None:
                self.given_up[thread.outbox.name] = lost
                which = f"events {lost.first} to {lost.last}"
                _log.warning("%s: %d undelivered at the end (%s)", thread.outbox.name, lost.count, which)


class _Thread(threading.Thread):
    """Thread of an outlet, with an event loop of its own."""

    def __init__(self, outlet: Outlet, outbox: Outbox, pauses_s: tuple[float, float]) -> None:
        super().__init__(name=f"outlet {outlet.name}", daemon=True)
        self.outlet, self.outbox, self._pauses_s = outlet, outbox, pauses_s
        self._guard = threading.Lock()
        self._serving: tuple[asyncio.AbstractEventLoop, asyncio.Task[None]] | None = None

    def run(self) -> None:
        asyncio.run(self._until_cancelled())

    def cancel(self) -> None:
        """End the outlet, whether its events are delivered or not."""
        with self._guard:
            if self._serving is not None:
                loop, task = self._serving
                loop.call_soon_threadsafe(task.cancel)

    async def _until_cancelled(self) -> None:
        task = asyncio.create_task(self._serve())
        with self._guard:
            self._serving = asyncio.get_running_loop(), task
        try:
            await asyncio.wait([task])
        finally:
            with self._guard:
                self._serving = None

    async def _serve(self) -> None:
        pause_s, faults = self._pauses_s[0], 0
        while True:
            self.outbox.attach()
            before = self.outbox.health.delivered
            try:
                await self.outlet.run(self.outbox)
            except Exception as error:
                self.outbox.down(error_text(error))
                unforeseen = not isinstance(error, OSError)
                if unforeseen:
                    _log.warning("outlet %s", self.outbox.name, exc_info=error)
            else:
                return
            if self.outbox.health.delivered > before:
                pause_s, faults = self._pauses_s[0], 0
            if unforeseen:
                faults += 1
                if faults == MOST_FAULTS:  # an event that breaks it must not keep the others
                    self.outbox.refuse_first()
                    faults = 0
            await self.outbox.pause(pause_s)
            pause_s = min(2 * pause_s, self._pauses_s[1])
