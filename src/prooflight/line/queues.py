"""Sheets that wait for a verdict: a bounded room with a rule for when the machine is too slow."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.line.sheets.records import SeenPage

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """A sheet that shows a page of the job, and when its verdict is due."""

    number: int
    """Place in the run, from 0."""
    job_page: int
    """That it shows."""
    seen: SeenPage
    arrived_s: float
    """When its last line was read, by the watcher's clock."""
    deadline_s: float
    """By the same; infinite where the source waits for us."""


class Waiting(Generic[Item]):
    """Sheets in the order they came.

    A source that can wait is made to: ``put`` returns when there is room. One that cannot loses sheets, by this rule:
    where there is no room the oldest sheet goes, for its time is up first; and a sheet whose verdict would come too
    late is passed over while a younger one waits, for it would only make that one late as well. What goes is
    returned, so that nobody loses sight of it.
    """

    def __init__(self, room: int, *, source_waits: bool) -> None:
        self._room, self._source_waits = room, source_waits
        self._items: deque[tuple[Item, float]] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item, deadline_s: float) -> list[Item]:
        """Add a sheet; returns those that went."""
        with self._changed:
            while self._source_waits and len(self._items) >= self._room and not self._closed:
                self._changed.wait()
            gone = []
            while len(self._items) >= self._room and not self._source_waits:
                gone.append(self._items.popleft()[0])
            self._items.append((item, deadline_s))
            self._changed.notify_all()
            return gone

    def take(
        self, ready_s: Callable[[], float], *, behind: Callable[[], bool] = lambda: False
    ) -> tuple[Item | None, list[Item]]:
        """Wait for a sheet; returns it, or none, and those passed over; neither: closed and empty.

        ready_s: when a verdict on it would be there, if it were begun now. behind: whether lines are read so late that
        younger sheets wait unread.
        """
        with self._changed:
            while not self._items and not self._closed:
                self._changed.wait()
            gone = []
            while self._items and self._items[0][1] < ready_s() and (len(self._items) > 1 or behind()):
                gone.append(self._items.popleft()[0])
            taken = self._items.popleft()[0] if self._items else None
            self._changed.notify_all()
            return taken, gone

    def close(self) -> None:
        """No more sheets come; those that wait may still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def clear(self) -> list[Item]:
        """Take all that wait."""
        with self._changed:
            gone = [item for item, _ in self._items]
            self._items.clear()
            self._changed.notify_all()
            return gone
