"""The running press: endless lines in, a verdict a sheet out, each before the reject gate.

One thread reads the source and cuts sheets, some make designs ready ahead of them, some inspect, and one puts what they
find in the order of the run: run level, journal, whoever watches. A sheet that cannot be inspected in time is passed
on and said so (``queues.Waiting`` has the rule); a source that can wait is made to.

    waiting -> preparing -> inspecting -> draining -> stopped
                   `------------`-----------`-------> fault
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import ProoflightError
from prooflight.inspecting.ahead import Ahead, size_bytes
from prooflight.inspecting.book import KnownThumbnails
from prooflight.inspecting.outcomes import InOrder, Outcome, absent, kinds_of, outcome, passed, strange
from prooflight.inspecting.paging import MissingPage, SeenPage
from prooflight.inspecting.queues import Sheet, Waiting
from prooflight.inspecting.status import Phase, Status, Tally
from prooflight.pages.process import touch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.acquiring.lines import LineBlock, LineSource
    from prooflight.inspecting.ahead import PageBook
    from prooflight.inspecting.judging import Judge, Judged
    from prooflight.inspecting.outcomes import RunWatch
    from prooflight.inspecting.paging import Pager
    from prooflight.inspecting.settings import Settings
    from prooflight.inspecting.sheets.thumbnails import Thumbnail
    from prooflight.press import Press

_log = logging.getLogger(__name__)

BUSY: Final = "being inspected"
REHEARSALS: Final = 2
"""By each thread that inspects."""


class Running:
    """One run of a press. ``start``, then ``join`` or ``stop``; ``status`` at any time."""

    def __init__(
        self,
        *,
        press: Press,
        source: LineSource,
        pager: Callable[[Sequence[Thumbnail | None]], Pager],
        book: PageBook,
        judge: Judge[Any],
        watch: RunWatch,
        settings: Settings,
        tell: Callable[[Outcome], None] = lambda _outcome: None,
        durable: Callable[[], int] = lambda: 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """pager: made when the first thumbnails are known. tell: called with every outcome, in the order of the run, by
        one thread. durable: pages in the journal.
        """
        self._press, self._source, self._make_pager, self._book = press, source, pager, book
        self._judge, self._watch, self._settings = judge, watch, settings
        self._tell, self._durable, self._clock = tell, durable, clock
        self.tally = Tally()
        self._waiting: Waiting[Sheet] = Waiting(settings.room, source_waits=settings.source_waits)
        self._thumbnails = KnownThumbnails(book)
        self._ahead: Ahead[tuple[Judge[Any], Any, Any]] = Ahead(
            book,
            self._maker(judge),
            depth=settings.ahead,
            room_bytes=settings.ahead_bytes,
            threads=settings.preparers,
            took=lambda seconds: self.tally.took("prepare", seconds),
            size=lambda made: size_bytes(made[1]),
            made=lambda design, made: self._thumbnails.know(design, made[0].thumbnail(made[1])),
        )
        self._done: queue.SimpleQueue[Outcome | None] = queue.SimpleQueue()
        self._order = InOrder()
        self._sheets = 0
        self._behind = False
        self._unready = 0  # sheets since the last whose design was ready
        self._stopping = threading.Event()
        self._ended = threading.Event()
        self._started_s = clock()
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Begin; returns at once."""
        run = threading.Thread(target=self._run, name="run", daemon=True)
        self._threads.append(run)
        run.start()

    def join(self, timeout_s: float | None = None) -> bool:
        """Wait until the run has ended; False: it has not yet."""
        return self._ended.wait(timeout_s)

    def stop(self, *, drop: bool = False) -> None:
        """End cleanly: no more lines are read, sheets that wait are still inspected, or dropped and said so."""
        self._stopping.set()
        self._source.close()
        if drop:
            for sheet in self._waiting.clear():
                self._pass(sheet, "the run was stopped")

    def status(self) -> Status:
        """The run at this moment."""
        return self.tally.snapshot(
            queue_depth=len(self._waiting),
            being_inspected=self.tally.counts[BUSY],
            ahead=self._ahead.ready,
            journalled=self._durable(),
            elapsed_s=self._clock() - self._started_s,
        )

    # --- threads ---

    def _run(self) -> None:
        inspectors = [
            threading.Thread(target=self._inspect_all, name=f"inspect-{n}", daemon=True)
            for n in range(self._settings.inspectors)
        ]
        finisher = threading.Thread(target=self._finish_all, name="finish", daemon=True)
        try:
            self._prepare()
            for thread in (*inspectors, finisher):
                thread.start()
            self._read_all()
        except Exception as error:
            self._fault(error)
        finally:
            self._waiting.close()
            for thread in inspectors:
                if thread.ident is not None:
                    thread.join()
            self._done.put(None)
            if finisher.ident is not None:
                finisher.join()
            self._ahead.close()
            if self.tally.phase is not Phase.FAULT:
                self.tally.phase = Phase.STOPPED
            self._ended.set()

    def _prepare(self) -> None:
        """Have the first designs ready, and everything compiled, before the first line is read."""
        self.tally.phase = Phase.PREPARING
        self._ahead.expect(0)
        self._ahead.get(0)
        for sheet in range(min(self._settings.ahead, len(self._book))):
            self._ready(sheet)
        touch(self._ahead.still_to_fill())
        # On all threads at once and of the largest design, so that each finds memory for its pages when sheets come;
        # and last, or designs would lie where that memory was.
        judge, ready, _ = self._ahead.largest()
        threads = self._settings.inspectors
        with ThreadPoolExecutor(threads + 1) as rehearsing:  # one more: designs are made beside
            list(rehearsing.map(judge.rehearse, [ready] * (REHEARSALS * (threads + 1))))

    def _read_all(self) -> None:
        pager = self._make_pager(self._thumbnails)
        pager.rehearse()
        self.tally.phase = Phase.INSPECTING
        for block in self._source.blocks():
            spare_s = self._spare_s(block)
            self._behind = spare_s <= 0
            unknown = self._unknown(pager.next_page)
            if unknown and not self._behind:  # what is not known cannot be told from a stranger
                self._ready(pager.next_page, within_s=spare_s)
                unknown = self._unknown(pager.next_page)
            for page in pager.push(block):
                self._arrived(page, block, unknown=unknown, next_page=pager.next_page)
            if self._stopping.is_set():
                break
        self.tally.phase = Phase.DRAINING
        unknown = self._unknown(pager.next_page)
        for page in pager.flush():
            self._arrived(page, None, unknown=unknown, next_page=pager.next_page)

    def _spare_s(self, block: LineBlock) -> float:
        """How long a block's sheet may wait for its design and still be in time; none left: nothing is waited for."""
        if self._settings.source_waits or not self._settings.source_clock:
            return math.inf
        due_s = block.time_s + self._settings.deadline_s
        return due_s - self._inspect_s() - self._clock()

    def _unknown(self, sheet: int) -> bool:
        """Whether a sheet's design has not been made ready."""
        return sheet < len(self._book) and self._thumbnails[sheet] is None

    def _ready(self, sheet: int, *, within_s: float = math.inf) -> None:
        """Wait for a sheet's design; one that cannot be had is said when the sheet is inspected."""
        if sheet < len(self._book):
            with contextlib.suppress(ProoflightError, TimeoutError):
                self._ahead.get(sheet, timeout_s=None if within_s == math.inf else within_s)

    def _arrived(
        self, page: SeenPage | MissingPage, block: LineBlock | None, *, unknown: bool, next_page: int
    ) -> None:
        """Count a sheet and let it wait. unknown: whether the design of the page expected was not ready."""
        number, now_s = self._sheets, self._clock()
        self._sheets += 1
        if isinstance(page, MissingPage):
            self.tally.count("missing")
            self._done.put(absent(number, page, now_s if block is None else block.time_s))
            return
        self.tally.arrived(now_s, list(kinds_of(page.faults)))
        if page.job_page is None and unknown:
            self._unready += 1
            self._ahead.expect(next_page + self._unready)
            self._done.put(passed(number, page, "its design was not ready in time"))
            return
        if page.job_page is None:
            self._done.put(strange(number, page))
            return
        self._unready = 0
        self._ahead.expect(page.job_page)
        arrived_s = page.last_line_time_s if self._settings.source_clock else now_s
        deadline_s = math.inf if self._settings.source_waits else arrived_s + self._settings.deadline_s
        sheet = Sheet(number=number, seen=page, arrived_s=arrived_s, deadline_s=deadline_s)
        for gone in self._waiting.put(sheet, deadline_s):
            self._pass(gone, "too many sheets waited")

    def _inspect_all(self) -> None:
        while True:
            sheet, gone = self._waiting.take(
                lambda: self._clock() + self._inspect_s(), behind=lambda: self._behind
            )
            for late in gone:
                self._pass(late, "its verdict would have come too late")
            if sheet is None and gone:
                continue
            if sheet is None:
                return
            self.tally.count(BUSY)
            try:
                self._done.put(self._inspect(sheet))
            finally:
                self.tally.count(BUSY, by=-1)

    def _inspect_s(self) -> float:
        """What an inspection is reckoned to take; not the whole deadline, or a slow start would end all trying."""
        return min(self.tally.typical_s("inspect"), self._settings.deadline_s / 2)

    def _inspect(self, sheet: Sheet) -> Outcome:
        """The verdict on one sheet; whatever goes wrong with it does not stop the run."""
        begun_s = self._clock()
        self.tally.took("queue", begun_s - sheet.arrived_s)
        assert sheet.seen.job_page is not None
        try:
            judge, ready, used = self._ahead.get(sheet.seen.job_page)
            judged = judge.inspect(
                ready, sheet.seen.scan, name=f"sheet {sheet.number}", seed=self._settings.seed + sheet.number
            )
        except Exception as error:
            if not isinstance(error, ProoflightError):
                _log.exception("sheet %d", sheet.number)
            return passed(sheet.number, sheet.seen, f"it could not be inspected: {error}")
        decided_s = self._clock()
        self.tally.took("inspect", decided_s - begun_s)
        self.tally.took("verdict", decided_s - sheet.arrived_s)
        return self._outcome(sheet, judged, used, decided_s)

    def _outcome(self, sheet: Sheet, judged: Judged, used: Any, decided_s: float) -> Outcome:
        evidence, adapting = judged.evidence, self._watch.adapting
        if adapting is not None:
            evidence = replace(evidence, values=adapting.whole(evidence.values, used))
        return outcome(
            sheet.number,
            sheet.seen,
            judged.verdict,
            late=decided_s > sheet.deadline_s,
            latency_s=decided_s - sheet.arrived_s,
            evidence=evidence,
            kept=judged.kept,
        )

    def _pass(self, sheet: Sheet, why: str) -> None:
        self._done.put(passed(sheet.number, sheet.seen, why))

    def _finish_all(self) -> None:
        while (done := self._done.get()) is not None:
            for turn in self._order.put(done):
                try:
                    self._finish(turn)
                except Exception as error:  # who watches or the disk must not end the inspection
                    _log.exception("sheet %d", turn.record.sheet)
                    self.tally.detail = f"sheet {turn.record.sheet}: {error}"

    def _finish(self, turn: Outcome) -> None:
        told = self._watch.add(turn)
        record = told.record
        if told.came:
            self.tally.count(record.verdict.verdict)
        if record.late:
            self.tally.count("late")
        self.tally.count("announcements", by=len(told.announcements))
        adapting = self._watch.adapting
        if adapting is not None:
            press = adapting.renewed(self._press, record.sheet)
            if press is not None:
                self._judge = judge = self._judge.following(press)
                used = adapting.used.copy()
                self._ahead.renew(
                    self._maker(judge), again=lambda made: (judge, judge.renewed(made[1]), used)
                )
        self._tell(told)

    # --- parts ---

    def _maker(self, judge: Judge[Any]) -> Callable[[Any], tuple[Judge[Any], Any, Any]]:
        """Makes designs ready for this judge, and says what the press was taken to do then."""
        adapting = self._watch.adapting
        used = None if adapting is None else adapting.used.copy()
        return lambda page: (judge, judge.prepare(page), used)

    def _fault(self, error: Exception) -> None:
        if self._stopping.is_set() and isinstance(error, OSError):
            return  # a source that was closed while it read
        if not isinstance(error, (ProoflightError, OSError)):
            _log.error("the run broke off", exc_info=error)
        self.tally.phase, self.tally.detail = Phase.FAULT, str(error)
