"""New rows of the journal for any number of browsers, by one poll ten times a second.

Sheets have numbers (of their rows), so a client that was away names the last number and gets the sheets
since. All else is a state: a client gets the latest, and needs no earlier one.
"""

from __future__ import annotations

import asyncio
import json
import logging
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import anyio

from prooflight_console.reading import facts
from prooflight_console.reading.gate_health import GateFollower
from prooflight_console.reading.imposition import imposed_sheets
from prooflight_console.reading.now import RECENT, Now, now
from prooflight_console.reading.reprints import Counted
from prooflight_line.journal.labels import run_key
from prooflight_line.journal.run_control import RunControl
from prooflight_line.journal.schema import JournalError
from prooflight_line.journal.start import StartFile

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from prooflight.inspection.sheets import Counts
    from prooflight_console.alarms.alarm_store import AlarmStore
    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.reprints import Reprints
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.following import Heads, Written
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.journal.records import PageRecord, RunRow

    Parts = Callable[[Now], str]

_log = logging.getLogger(__name__)

POLL_S: Final = 0.1
"""Period of the poll; a durable row is read after half of it on average. [s]"""
STATE_S: Final = 1.0
"""Period at which the state is sent although no sheet came, since silence is a state too. [s]"""
RUN_S: Final = 0.5
"""Least time between two counts of a run, which query all its rows. [s]"""
COUNT_S: Final = 5.0
"""Least time between two counts of sheets and sets, which query all rows that are not good. [s]"""
AT_ONCE: Final = 500
MOST_MISSED: Final = 2000
"""Sheets that are sent to a client that was away; one that missed more gets a `gap` and begins anew."""
PING_S: Final = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """An event; text is JSON on one line."""

    kind: str
    text: str
    id: int | None = None

    def as_text(self) -> str:
        """Return the event in the format of ``text/event-stream``."""
        first = "" if self.id is None else f"id: {self.id}\n"
        return f"{first}event: {self.kind}\ndata: {self.text}\n\n"


@dataclass(slots=True)
class _State:
    version: int = 0
    texts: dict[str, tuple[int, str]] = field(default_factory=dict)


class Live:
    """Live events of the server; ``run`` is its only task."""

    def __init__(
        self,
        reading: Reading,
        incidents: RunIncidents,
        label_store: LabelStore,
        reprints: Reprints,
        alarm_store: AlarmStore,
        *,
        clock: Callable[[], float] = time.monotonic,
        ahead: Callable[[RunRow, PageRecord], None] = lambda _run, _page: None,
    ) -> None:
        """Create the service.

        ahead: called with the misprints of the current run, so that their pictures exist before people open
        them.
        """
        self._reading, self._incidents, self._label_store, self._clock = (
            reading,
            incidents,
            label_store,
            clock,
        )
        self._reprints, self._alarm_store = reprints, alarm_store
        self._gate = GateFollower(reading.path)
        self._start_file = StartFile(journal=reading.path)
        self._control = RunControl(journal=reading.path)
        self._events: deque[Event] = deque(maxlen=MOST_MISSED)
        self._recent: deque[Written] = deque(maxlen=RECENT)
        self._row, self._state_label = -1, (-1, -1)
        self._guard = threading.Lock()
        self._heads: Heads | None = None
        self._moved_s = self._state_s = clock()
        self._state = _State()
        self._changed = asyncio.Event()
        self._ahead = ahead
        self._now: Now | None = None
        self._sheet_counts: tuple[tuple[int, int, str] | None, float, Counts | None] = None, 0.0, None
        self._trouble = ""
        self.closing = False
        self.listeners = 0

    # --- for pages ---

    @property
    def now(self) -> Now:
        """Current state of the press at the last poll."""
        if self._now is None:
            self._poll()
        assert self._now is not None
        return self._now

    @property
    def trouble(self) -> str:
        """Reason why the journal cannot be read; empty if it can."""
        return self._trouble

    @property
    def recent(self) -> list[Written]:
        """The last sheets of the last run, in order."""
        return list(self._recent)

    @property
    def last_id(self) -> int:
        """Number of the row of the last sheet that was sent."""
        return max(self._row, 0)

    # --- the task ---

    async def run(self) -> None:
        """Poll until the task is cancelled."""
        while not self.closing:
            try:
                changed = await anyio.to_thread.run_sync(self._poll)
            except JournalError as error:
                changed = self._publish("trouble", {"text": str(error)})
                self._trouble = str(error)
            except Exception:
                _log.exception("the journal %s", self._reading.path)
                changed = False
            if changed:
                self._wake()
            await asyncio.sleep(POLL_S)

    def close(self) -> None:
        """End all event streams; browsers reconnect by themselves."""
        self.closing = True
        self._wake()

    def _wake(self) -> None:
        waiting, self._changed = self._changed, asyncio.Event()
        waiting.set()

    def _poll(self) -> bool:
        """Read new rows; returns whether anything changed."""
        with self._guard:
            return self._read()

    def _read(self) -> bool:
        heads, clock = self._reading.heads(), self._clock()
        last_label = self._label_store.last(), self._alarm_store.version
        news = heads != self._heads
        if not news and last_label == self._state_label and clock - self._state_s < STATE_S:
            return False
        begun = self._heads is None or heads.run != self._heads.run or heads.row < self._row
        if begun:
            self._recent.clear()
        if self._row < 0 or heads.row < self._row:  # the first poll, or another journal at this path
            self._events.clear()
            self._row = max(heads.row - RECENT, 0)
        moved = urgent = False
        misprint: PageRecord | None = None
        while heads.row > self._row:
            rows = self._reading.written_after(self._row, limit=AT_ONCE, damaged=lambda _: None)
            if not rows:
                self._row = heads.row  # the remaining rows cannot be read
                break
            for row in rows:
                self._row, moved = row.row, True
                urgent = urgent or row.page.verdict.verdict != "good"
                if row.run_id == heads.run:
                    self._recent.append(row)
                    misprint = row.page if row.page.verdict.verdict == "misprint" else misprint
                text = json.dumps(facts.live_sheet(row))
                self._events.append(Event(kind="sheet", text=text, id=row.row))
        if moved or begun:
            self._moved_s = clock
        self._heads, self._trouble = heads, ""
        if moved and not (urgent or begun or heads.ended) and clock - self._state_s < RUN_S:
            return True
        self._state_label, self._state_s = last_label, clock
        return self._publish_state(misprint) or moved

    def _publish_state(self, misprint: PageRecord | None) -> bool:
        run = self._reading.last_run()
        if run is not None and misprint is not None:
            self._ahead(run, misprint)
        incidents = [] if run is None else self._incidents.of(run)
        counts = None if run is None else self._counted(run)
        reprints = Counted(count=0) if run is None else self._reprints.counted(run)
        self._now = now(
            run,
            incidents,
            [row.page for row in self._recent],
            quiet_s=self._clock() - self._moved_s,
            reprints=reprints,
            layout_counts=counts,
            gate=None if run is None else self._gate.of(run, reprints.gated),
            handover=self._alarm_store.last_handover(),
            start=self._start_file.read(),
            stopping=self._stopping(run),
            starter=self._control.starter,
            begun_s=() if run is None else self._incidents.begun_s(run),
        )
        return self._publish("now", facts.now_facts(self._now))

    def _stopping(self, run: RunRow | None) -> str:
        """Return who asked for the end of a run that goes on; empty: nobody."""
        if run is None or run.state != "running":
            return ""
        request = self._control.stop_request(run_key(run))
        return "" if request is None else request.by

    def _counted(self, run: RunRow) -> Counts | None:
        """Count sheets and sets of a run, which needs many rows and is therefore done seldom."""
        key, clock = (run.id, run.pages, run.state), self._clock()
        counted_key, counted_s, counts = self._sheet_counts
        if counted_key != key and (
            counted_key is None or counted_key[::2] != key[::2] or clock - counted_s >= COUNT_S
        ):
            imposed = imposed_sheets(self._reading, run)
            counts = None if imposed is None else imposed.review.counts
            self._sheet_counts = key, clock, counts
        return counts

    def _publish(self, name: str, value: dict[str, Any]) -> bool:
        text = json.dumps(value)
        if self._state.texts.get(name, (0, ""))[1] == text:
            return False
        self._state.version += 1
        self._state.texts[name] = self._state.version, text
        return True

    # --- for listeners ---

    async def events(
        self, after: int | None, *, until: Callable[[], bool] = lambda: False, parts: Parts | None = None
    ) -> AsyncIterator[str]:
        """Stream the sheets after that id, or from now on if it is None, until the server ends.

        Parameters
        ----------
        until
            Called every quarter of a minute; True ends the stream.
        parts
            Renders the state as HTML for a page, which is sent as the event ``parts`` in place of ``now``.
        """
        self.listeners += 1
        try:
            yield "retry: 1000\n\n"
            row, version = self.last_id if after is None else after, 0
            checked_s = self._clock()
            if row > self.last_id:  # an id of an earlier journal
                yield Event(kind="gap", text="{}", id=self.last_id).as_text()
                row = self.last_id
            while not self.closing:
                waiting = self._changed
                missed = await self._missed(row)
                if missed is None:
                    row = self.last_id
                    yield Event(kind="gap", text="{}", id=row).as_text()
                else:
                    for event in missed:
                        row = event.id or row
                        yield event.as_text()
                version_now = self._state.version
                for name, (changed_at, text) in list(self._state.texts.items()):
                    if changed_at <= version:
                        continue
                    if name == "now" and parts is not None:
                        name, text = "parts", await anyio.to_thread.run_sync(parts, self.now)
                    yield Event(kind=name, text=text).as_text()
                version = version_now
                if self._clock() >= checked_s + PING_S:
                    checked_s = self._clock()
                    if await anyio.to_thread.run_sync(until):
                        yield Event(kind="end", text="{}").as_text()
                        return
                try:
                    await asyncio.wait_for(waiting.wait(), PING_S)
                except TimeoutError:
                    yield ": still here\n\n"
        finally:
            self.listeners -= 1

    async def _missed(self, row: int) -> list[Event] | None:
        """Return the sheets after that row; None if there are too many to send."""
        if row >= self.last_id:
            return []
        if self._events and (self._events[0].id or 0) <= row + 1:
            return [event for event in self._events if (event.id or 0) > row]

        def read() -> list[Written]:
            return self._reading.written_after(row, limit=MOST_MISSED + 1, damaged=lambda _: None)

        rows = await anyio.to_thread.run_sync(read)
        if len(rows) > MOST_MISSED:
            return None
        upto = self.last_id
        return [
            Event(kind="sheet", text=json.dumps(facts.live_sheet(row)), id=row.row)
            for row in rows
            if row.row <= upto
        ]
