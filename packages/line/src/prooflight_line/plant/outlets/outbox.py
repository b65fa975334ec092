"""Bounded queue of events that wait to leave by one outlet; it never blocks a producer, and reports losses."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.events import Event, EventsLost

if TYPE_CHECKING:
    from collections.abc import Callable

ROOM: Final = 10_000
"""Capacity in events. assumed: half an hour at 5 sheets a second, some 20 MB."""
LAST_PAUSE_S: Final = 0.2
"""Pause between tries when the run has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutletHealth:
    """Health of an outlet."""

    name: str
    connected: bool
    detail: str
    """Reason why it is not connected, or the name of the other end; one line."""
    delivered: int
    lost: int
    """Number of events dropped, because the queue was full or time was up."""
    waiting: int


class Outbox:
    """Queue between the threads of a run and the event loop of one outlet.

    ``put`` may be called from any thread and never waits: if the queue is full, the oldest event that is not
    being delivered is dropped, and an event ``events-lost`` takes its place. The outlet reads the first with
    ``head`` or the first few with ``heads``, and removes each with ``delivered`` when it has arrived; until
    then it may be tried again.
    """

    def __init__(
        self, name: str, *, room: int = ROOM, changed: Callable[[OutletHealth], None] = lambda _: None
    ) -> None:
        """Create an empty queue.

        ``room`` is the number of events that may wait, in addition to two that report losses. ``changed`` is
        called when the outlet connects or disconnects.
        """
        self.name, self._room, self._changed = name, room, changed
        self._waiting: deque[Event] = deque()
        self._guard = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._more: asyncio.Event | None = None
        self._closing: asyncio.Event | None = None
        self._held = 0
        """Number of events, from the first, that are being delivered."""
        self._closed = False
        self._connected, self._detail = False, "not yet connected"
        self._delivered = self._lost = 0

    def put(self, event: Event) -> None:
        """Add an event; after ``close``, do nothing."""
        with self._guard:
            if self._closed:
                return
            self._waiting.append(event)
            if len(self._waiting) > self._room:
                self._give_up()
            self._wake()

    def close(self) -> None:
        """Accept no more events; those that wait may still be delivered."""
        with self._guard:
            self._closed = True
            self._wake()
            self._wake(closing=True)

    def attach(self) -> None:
        """Attach the queue to the running event loop, which is the outlet's."""
        with self._guard:
            self._loop, self._held = asyncio.get_running_loop(), 0
            self._more, self._closing = asyncio.Event(), asyncio.Event()
            if self._closed:
                self._closing.set()

    async def pause(self, seconds: float) -> None:
        """Let time pass, but little of it once the queue is closed."""
        if self._closing is None or self._closing.is_set():
            await asyncio.sleep(min(seconds, LAST_PAUSE_S))
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._closing.wait(), seconds)

    async def head(self) -> Event | None:
        """Wait for the next event and return it; the same until it is delivered.

        None: the queue is closed, and all events are delivered.
        """
        events = await self.heads(1)
        return events[0] if events else None

    async def heads(self, most: int) -> list[Event]:
        """Wait for the next events and return them; the same until they are delivered.

        The list is empty if the queue is closed and all events are delivered.
        """
        while True:
            with self._guard:
                more = self._more
                if more is None:
                    message = f"no loop is attached to {self.name}"
                    raise RuntimeError(message)
                more.clear()
                if self._waiting:
                    self._held = min(max(self._held, most), len(self._waiting))
                    return list(islice(self._waiting, most))
                if self._closed:
                    return []
            await more.wait()

    def delivered(self, event: Event) -> None:
        """Remove an event that has arrived."""
        with self._guard:
            if self._waiting and self._waiting[0].key == event.key:
                self._waiting.popleft()
                self._held = max(self._held - 1, 0)
                self._delivered += 1

    def refused(self, event: Event) -> None:
        """Replace an event that the receiver will never take by a report of its loss."""
        with self._guard:
            if self._waiting and self._waiting[0].key == event.key:
                self._refuse()

    def refuse_first(self) -> None:
        """Replace the first event, if there is one, by a report of its loss."""
        with self._guard:
            if self._waiting:
                self._refuse()

    def up(self, detail: str) -> None:
        """Note that the outlet is connected; ``detail`` names the other end."""
        self._say(connected=True, detail=detail)

    def down(self, detail: str) -> None:
        """Note that the outlet is not connected; ``detail`` is the reason."""
        self._say(connected=False, detail=detail)

    def abandon(self) -> EventsLost | None:
        """Drop all waiting events because time is up, and return which they were; None if there were none."""
        with self._guard:
            dropped, self._waiting = list(self._waiting), deque()
            if not dropped:
                return None
            self._lost += _untold(dropped)
            return _lost(dropped)

    @property
    def health(self) -> OutletHealth:
        """Health of the outlet now."""
        with self._guard:
            return OutletHealth(
                name=self.name,
                connected=self._connected,
                detail=self._detail,
                delivered=self._delivered,
                lost=self._lost,
                waiting=len(self._waiting),
            )

    # --- under the guard ---

    def _refuse(self) -> None:
        dropped = self._waiting.popleft()
        self._held = 0
        if not isinstance(dropped.body, EventsLost):
            self._lost += 1
            self._waiting.appendleft(replace(dropped, body=_lost([dropped])))

    def _give_up(self) -> None:
        """Drop the oldest event that is not being delivered; one ``events-lost`` reports all that were dropped."""
        in_delivery = [self._waiting.popleft() for _ in range(min(self._held, len(self._waiting) - 1))]
        dropped = [self._waiting.popleft()]
        if isinstance(dropped[0].body, EventsLost) and self._waiting:
            dropped.append(self._waiting.popleft())
        lost = _lost(dropped)
        self._lost += _untold(dropped)
        self._waiting.extendleft([replace(dropped[-1], body=lost), *reversed(in_delivery)])

    def _wake(self, *, closing: bool = False) -> None:
        flag = self._closing if closing else self._more
        if self._loop is not None and flag is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended since
                self._loop.call_soon_threadsafe(flag.set)

    def _say(self, *, connected: bool, detail: str) -> None:
        with self._guard:
            news = connected != self._connected or (not connected and detail != self._detail)
            self._connected, self._detail = connected, detail
        if news:
            self._changed(self.health)


def _lost(dropped: list[Event]) -> EventsLost:
    """Return the report of consecutive lost events, which may include reports of earlier losses."""
    first, last = dropped[0], dropped[-1]
    before = sum(one.body.count for one in dropped if isinstance(one.body, EventsLost))
    return EventsLost(
        count=before + _untold(dropped),
        first=first.body.first if isinstance(first.body, EventsLost) else first.number,
        last=last.number,
    )


def _untold(dropped: list[Event]) -> int:
    """Count the events that have not been counted as lost."""
    return sum(not isinstance(one.body, EventsLost) for one in dropped)
