"""Bounded queue of sheets that wait for a verdict, and the rule by which it drops them."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.run.sheets.records import SeenPage

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """A sheet that shows a page of the job, and the time at which its verdict is due."""

    number: int
    """Position in the run, from 0."""
    job_page: int
    seen: SeenPage
    arrived_s: float
    """Time at which its last line was read, by the watcher's clock."""
    placed_s: float
    """Time at which it was queued, by the same clock."""
    deadline_s: float
    """Time at which its verdict is due, by the same clock; infinite if the source can wait."""


class Waiting(Generic[Item]):
    """Queue of sheets in order of arrival.

    A source that can wait is made to: ``put`` returns when there is room. One that cannot wait loses sheets, by
    this rule: if there is no room, the oldest sheet is dropped, since its time is up first; and a sheet whose
    verdict would come too late is dropped while a younger one waits, since it would only make that one late as
    well. Dropped sheets are returned, so that each is accounted for.
    """

    def __init__(self, room: int, *, source_waits: bool) -> None:
        self._room, self._source_waits = room, source_waits
        self._items: deque[tuple[Item, float]] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item, deadline_s: float) -> list[Item]:
        """Add a sheet; return those that were dropped."""
        with self._changed:
            while self._source_waits and len(self._items) >= self._room and not self._closed:
                self._changed.wait()
            dropped = []
            while len(self._items) >= self._room and not self._source_waits:
                dropped.append(self._items.popleft()[0])
            self._items.append((item, deadline_s))
            self._changed.notify_all()
            return dropped

    def take(
        self, ready_s: Callable[[], float], *, is_late: Callable[[], bool] = lambda: False
    ) -> tuple[Item | None, list[Item]]:
        """Wait for a sheet; return it, or None, and those dropped; None and none dropped: closed and empty.

        ready_s: returns the time at which its verdict would be ready if inspection began now. behind: returns
        whether lines are read so late that younger sheets wait unread.
        """
        with self._changed:
            while not self._items and not self._closed:
                self._changed.wait()
            dropped = []
            while self._items and self._items[0][1] < ready_s() and (len(self._items) > 1 or is_late()):
                dropped.append(self._items.popleft()[0])
            taken = self._items.popleft()[0] if self._items else None
            self._changed.notify_all()
            return taken, dropped

    def close(self) -> None:
        """Close the queue for new sheets; those that wait may still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def clear(self) -> list[Item]:
        """Remove and return all sheets that wait."""
        with self._changed:
            dropped = [item for item, _ in self._items]
            self._items.clear()
            self._changed.notify_all()
            return dropped
