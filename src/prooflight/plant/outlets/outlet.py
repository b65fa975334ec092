"""What an outlet is, and the thread that it runs in: it is started again whenever it breaks off."""

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
from prooflight.plant.outlets.outbox import ROOM, Outbox

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.plant.events import Event, EventsLost
    from prooflight.plant.outlets.outbox import OutletHealth

_log = logging.getLogger(__name__)

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
"""After an outlet has broken off, doubled each time."""
CLOSE_S: Final = 5.0
"""For what waits to be delivered at the end. assumed: as long a person waits for a command to end."""
CANCEL_S: Final = 2.0
MOST_FAULTS: Final = 3
"""Of our own, one after another with nothing delivered between, after which the event at hand is given up."""


class OutletError(ConnectionError):
    """An outlet cannot deliver now: what it says is one line for a person."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """What answered when an outlet was tried."""

    name: str
    ok: bool
    said: str
    """Who answered, or what went wrong; one line."""
    milliseconds: float


class Outlet(Protocol):
    """One way out for events."""

    @property
    def name(self) -> str:
        """For people: what it is and where it leads."""
        ...

    async def run(self, outbox: Outbox) -> None:
        """Connect, say ``outbox.up``, and deliver its events one after another until there are no more.

        Whatever it raises is said, and it is called again after a pause; OSError and its kind are expected.
        """
        ...

    async def reach(self) -> str:
        """Try the other end without disturbing it; returns what answered, in one line, or raises what went wrong."""
        ...


def check(outlet: Outlet, *, within_s: float = 5.0) -> Checked:
    """Try whether an outlet's other end answers."""
    begun_s = time.monotonic()

    async def tried() -> str:
        return await asyncio.wait_for(outlet.reach(), within_s)

    try:
        said, ok = asyncio.run(tried()), True
    except TimeoutError:
        said, ok = f"no answer within {within_s:g} s", False
    except Exception as error:
        said, ok = told(error), False
    return Checked(
        name=outlet.name, ok=ok, said=said, milliseconds=round(1e3 * (time.monotonic() - begun_s), 1)
    )


def told(error: BaseException) -> str:
    """What went wrong, in one line: what the system says of it, where it is to blame, else the error itself."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and not isinstance(cause, ssl.SSLError) and (cause.errno or 0) > 0:
            return os.strerror(cause.errno or 0)
        cause = cause.__cause__ or cause.__context__
    return sentence(str(error) or type(error).__name__)


class Outlets:
    """Outlets at work, each in its thread; use it as a context. ``put`` never waits for any of them."""

    def __init__(
        self,
        outlets: Sequence[Outlet],
        *,
        room: int = ROOM,
        changed: Callable[[OutletHealth], None] = lambda _: None,
        close_s: float = CLOSE_S,
        pauses_s: tuple[float, float] = (FIRST_PAUSE_S, LONGEST_PAUSE_S),
    ) -> None:
        """room: events that may wait in each. changed: told when one is connected or no longer, by its thread."""
        self._close_s = close_s
        self._threads = [
            _Thread(outlet, Outbox(outlet.name, room=room, changed=changed), pauses_s) for outlet in outlets
        ]
        self.given_up: dict[str, EventsLost] = {}
        """By outlet, what was still undelivered when time was up; known after the end."""

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, event: Event) -> None:
        """To all; never waits."""
        for thread in self._threads:
            thread.outbox.put(event)

    @property
    def health(self) -> list[OutletHealth]:
        """Of each, in their order."""
        return [thread.outbox.health for thread in self._threads]

    def close(self) -> None:
        """Deliver what waits, within the time given for all together; what is left is given up and told."""
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
    """An outlet's thread, with an event loop of its own."""

    def __init__(self, outlet: Outlet, outbox: Outbox, pauses_s: tuple[float, float]) -> None:
        super().__init__(name=f"outlet {outlet.name}", daemon=True)
        self.outlet, self.outbox, self._pauses_s = outlet, outbox, pauses_s
        self._guard = threading.Lock()
        self._serving: tuple[asyncio.AbstractEventLoop, asyncio.Task[None]] | None = None

    def run(self) -> None:
        asyncio.run(self._until_cancelled())

    def cancel(self) -> None:
        """End it, delivered or not."""
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
                self.outbox.down(told(error))
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
