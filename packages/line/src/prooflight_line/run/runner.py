"""Inspection of a running press: a continuous stream of lines in, one verdict per sheet out before the reject gate.

One thread reads the source and cuts sheets, some prepare designs ahead of them, some inspect, and one puts the
results in the order of the run and passes them to the run monitor, the journal and whoever watches. A sheet that
cannot be inspected in time is passed on and reported so (``queues.Waiting`` has the rule); a source that can wait
is made to.

    waiting -> preparing -> inspecting -> draining -> stopped
                   `------------`-----------`-------> fault
"""

from __future__ import annotations

import logging
import math
import os
import queue
import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.disposition import without_gate
from prooflight.errors import ProoflightError
from prooflight.inspection.lost_lines import MOST_UNSEEN, MOST_UNSEEN_OF_UNKNOWN, unseen_share
from prooflight.inspection.reasons import reason_of
from prooflight.pages.files import page_name
from prooflight.pages.parallel import due
from prooflight.pages.process import collector_spared
from prooflight_line.run.notices import Notice, Silence, Unusable
from prooflight_line.run.outcomes import (
    InOrder,
    Outcome,
    SheetTimes,
    Unexplained,
    kinds_of,
    lost_lines,
    missing_page,
    outcome,
    skipped,
    unknown_sheet,
)
from prooflight_line.run.pace import NO_ROOM, NOT_READY, TOO_LATE, out_of_time
from prooflight_line.run.prefetch import DesignPrefetcher, ThumbnailCache
from prooflight_line.run.queues import Sheet, Waiting
from prooflight_line.run.resuming import Past
from prooflight_line.run.sheet_inspector import SheetResult
from prooflight_line.run.sheets.records import MissingPage, SeenPage
from prooflight_line.run.sheets.thumbnails import Thumbnail
from prooflight_line.run.status import VERDICTS, Phase, Status, Tally
from prooflight_line.run.warm_up import REHEARSALS, warm_up

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.packed_design import PackedDesign
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.lines import LineBlock, LineSource
    from prooflight_line.run.outcomes import RunWatch
    from prooflight_line.run.pager import Pager
    from prooflight_line.run.prefetch import PageStore
    from prooflight_line.run.settings import Settings
    from prooflight_line.run.sheet_inspector import SheetInspector
    from prooflight_line.run.sheets.following import Expected

    ReadyDesign = tuple[SheetInspector, PackedDesign, NDArray[np.float64] | None]
    """A design, who made it ready, and what was followed of the press then."""

_log = logging.getLogger(__name__)

BUSY: Final = "being_inspected"
MIND_S: Final = 0.25
"""Interval of the checks whether the source has gone silent, or a person has stopped the run."""
DOUBTED: Final = 3
"""Number of pages on either side of the expected one that an unrecognised sheet may show, if these cannot be
used."""
MOST_DESIGNS: Final = 1000
"""Greatest number of designs of a job printed repeatedly; assumed: no more fit into memory."""
STOPPED: Final = "the run was stopped"
BEGUN_WITHIN: Final = "the lines began within the sheet"
CUT_SHORT: Final = "the lines ended within the sheet"


class Running:
    """One run of a press: call ``start``, then ``join`` or ``stop``; ``status`` at any time."""

    def __init__(
        self,
        *,
        press: Press,
        source: LineSource,
        pager: Callable[[Expected], Pager],
        page_store: PageStore,
        inspector: SheetInspector,
        watch: RunWatch,
        settings: Settings,
        tell: Callable[[Outcome], None] = lambda _outcome: None,
        misprint: Callable[[Outcome], None] = lambda _outcome: None,
        notice: Callable[[Notice], None] = lambda _notice: None,
        arrived: Callable[[int, SeenPage], None] = lambda _number, _page: None,
        name: Callable[[int], str] = lambda sheet: page_name(sheet + 1),
        flaws: Mapping[int, Exception] = MappingProxyType({}),
        durable: Callable[[], int] = lambda: 0,
        stored: Callable[[Hashable], PackedDesign | None] = lambda _design: None,
        store: Callable[[Hashable, PackedDesign], None] = lambda _design, _packed: None,
        past: Past | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Store the parts of a run.

        Parameters
        ----------
        pager
            Makes the pager when the first thumbnails are known.
        tell
            Called with every outcome, in the order of the run, by one thread.
        misprint
            Called by the same thread, in the same order, with misprints that are still being explained.
        notice
            Called by the same thread with notices that belong to no sheet.
        arrived
            Called by the thread that reads, with each sheet that has passed and its number in the run.
        name
            Returns the display name of a sheet's page.
        flaws
            Sheets whose pages are known to be unusable, and why.
        durable
            Returns the number of pages in the journal.
        stored
            Returns a design that was prepared before the run for the press as it was then; None: it was not.
        store
            Called with designs that were prepared now for the press as it was then.
        past
            Recorded part of a run that is resumed, which ``watch`` has followed; None: the run is new.
        """
        self._press, self._source, self._make_pager, self._page_store = press, source, pager, page_store
        self._inspector, self._watch, self._settings = inspector, watch, settings
        self._first_inspector = inspector
        self._tell, self._notice, self._on_arrived, self._name = tell, notice, arrived, name
        self._on_misprint = misprint
        self._flaws, self._durable, self._clock = flaws, durable, clock
        self._stored, self._store = stored, store
        past = past or Past()
        self.tally = Tally(counts=Counter(past.counts), faults=Counter(past.faults))
        self._waiting: Waiting[Sheet] = Waiting(settings.room, source_waits=settings.source_waits)
        self._thumbnails = ThumbnailCache(page_store)
        self._done: queue.SimpleQueue[Outcome | Unexplained | Notice | None] = queue.SimpleQueue()
        self._unexplained: dict[int, Outcome] = {}
        self._unusable = Unusable(self._done.put)
        self._silence = Silence(settings.stall_s, self._done.put, clock=clock)
        self._prefetcher: DesignPrefetcher[ReadyDesign] = DesignPrefetcher(
            page_store,
            self._maker(inspector),
            depth=settings.ahead,
            room_bytes=settings.ahead_bytes,
            threads=settings.preparers,
            took=lambda seconds: self.tally.took("prepare", seconds),
            size=lambda ready: ready[1].nbytes,
            on_ready=self._design_ready,
            failed=lambda design, sheet, error: self._unusable.add(design, self._name(sheet), error),
            stored=self._taken,
            store=self._store_first,
            clock=clock,
        )
        self._order = InOrder(past.first_sheet)
        self._sheets = self._finished = self._first_untold = past.first_sheet
        self._first_due = min(past.due, max(len(page_store) - 1, 0))
        self._noted: list[str] = []
        self._behind = False
        self._unready = 0  # sheets since the last whose design was ready
        self._deciding = threading.Semaphore(settings.inspectors)
        self._stopping, self._dropping = threading.Event(), threading.Event()
        self._ended = threading.Event()
        self._started_s = clock()
        self._threads: list[threading.Thread] = []
        self._follow(past.first_sheet)

    def start(self) -> None:
        """Start the threads; return at once."""
        run = threading.Thread(target=self._run, name="run", daemon=True)
        self._threads.append(run)
        run.start()

    def join(self, timeout_s: float | None = None) -> bool:
        """Wait until the run has ended; False: it has not yet."""
        return self._ended.wait(timeout_s)

    def stop(self, *, drop: bool = False) -> None:
        """End cleanly: read no more lines; inspect the sheets that wait, or drop them and report so."""
        self._stopping.set()
        self._source.close()
        if drop:
            self._dropping.set()
            for sheet in self._waiting.clear():
                self._pass(sheet, STOPPED)

    def note(self, notice: Notice) -> None:
        """Queue a notice that belongs to no sheet; from any thread."""
        self._done.put(notice)

    def status(self) -> Status:
        """Return a snapshot of the run."""
        return self.tally.snapshot(
            queue_depth=len(self._waiting),
            ahead=self._prefetcher.ready,
            journalled=self._durable(),
            elapsed_s=self._clock() - self._started_s,
        )

    # --- threads ---

    def _run(self) -> None:
        inspectors = [
            threading.Thread(target=self._inspect_all, name=f"inspect-{n}", daemon=True)
            for n in range(self._settings.inspectors + self._settings.explainers)
        ]
        finisher = threading.Thread(target=self._finish_all, name="finish", daemon=True)
        minder = threading.Thread(target=self._mind, name="mind", daemon=True)
        try:
            finisher.start()
            minder.start()
            self._prepare()
            with collector_spared():
                for thread in inspectors:
                    thread.start()
                self._read_all()
        except Exception as error:
            self._fault(error)
        finally:
            self._waiting.close()
            for thread in inspectors:
                if thread.ident is not None:
                    thread.join()
            self._inspector.close()
            self._source.close()
            self._prefetcher.close()
            self._done.put(None)
            if finisher.ident is not None:
                finisher.join()
            self.tally.count("untold", by=self._sheets - self._finished)
            if self.tally.phase is not Phase.FAULT:
                self.tally.phase = Phase.STOPPED
            self._ended.set()

    def _prepare(self) -> None:
        """Prepare the job's designs, as many as fit into memory, and compile everything, before the first line.

        A run that starts at once prepares the first design alone; if its source waits, it compiles nothing in advance.
        """
        self.tally.phase = Phase.PREPARING
        for sheet, flaw in self._flaws.items():
            self._unusable.add(self._page_store.design(sheet), self._name(sheet), flaw)
        first = self._first_of_designs()
        self.tally.to_prepare = len(first)
        # Where the first sheets wait, they warm up themselves, and the first verdict does not wait for a rehearsal.
        waits = self._settings.start_at_once and self._settings.source_waits
        self.tally.to_rehearse = 0 if waits else REHEARSALS
        for count, sheet in enumerate(first):
            if self._stopping.is_set() or (count >= self._settings.ahead and not self._prefetcher.has_room):
                break
            self._prefetcher.begin(first[count : count + self._settings.preparers])
            self._ready(sheet)
        self._prefetcher.expect(self._first_due)
        if self._stopping.is_set():
            return
        if not self._prefetcher.ready:
            # Raises the error: none of the first designs can be used.
            self._prefetcher.get(self._first_due)
        if not self.tally.to_rehearse:
            return
        # With the largest design, so that each thread has memory for its pages, and with one of middle size, since the
        # largest may be a picture alone, without letters.
        designs = self._prefetcher.largest(), self._prefetcher.middle()
        warm_up(
            [one[:2] for one in self._prefetcher.all_ready()],
            [one[:2] for one in designs],
            threads=self._settings.inspectors,
            is_stopping=self._stopping.is_set,
            done=lambda: self.tally.count("rehearsed"),
        )

    def _first_of_designs(self) -> list[int]:
        """Return the first sheet of each design that is made ready before the first line is read.

        These are all designs of the job, for a press does not wait. A source that does wait needs a few ahead.
        """
        if self._settings.start_at_once:
            return [self._first_due]
        until = max(min(self._first_due + MOST_DESIGNS, len(self._page_store)), 1)
        sheets = range(self._first_due, until)
        first = list({self._page_store.design(sheet): sheet for sheet in reversed(sheets)}.values())[::-1]
        return first[: self._settings.ahead] if self._settings.source_waits else first

    def _read_all(self) -> None:
        """Read until the lines end; whatever ends them, inspect what has passed until then."""
        pager = self._make_pager(self._thumbnails)
        pager.warm_up()
        self.tally.phase = Phase.INSPECTING
        broken: Exception | None = None
        try:
            self._read_lines(pager)
        except Exception as error:
            broken = error
        self.tally.phase = Phase.DRAINING
        try:
            for page in pager.flush():
                self._arrived(page, None, next_page=pager.next_page)
        finally:
            self.tally.count("to_come", by=pager.to_come)
            self.tally.count("absent", by=pager.to_come + pager.missing)
        closed = self._stopping.is_set() and isinstance(broken, (ProoflightError, OSError))
        if broken is not None and not closed:  # a source that is closed while it reads may break
            raise broken

    def _read_lines(self, pager: Pager) -> None:
        for block in self._silence.heard(self._source.blocks()):
            self._behind = self._spare_s(block) <= 0
            for page in pager.may_come:
                if self._unknown(page) and not self._behind:  # it would look like an unknown sheet
                    self._ready(page, within_s=self._spare_s(block))
            for came in pager.push(block):
                self._arrived(came, block, next_page=pager.next_page)
            if self._stopping.is_set():
                return

    def _spare_s(self, block: LineBlock) -> float:
        """Return how long a block's sheet may wait for its design and still be in time; at most 0: no wait."""
        if self._settings.source_waits or not self._settings.source_clock:
            return math.inf
        due_s = block.time_s + self._settings.deadline_s
        return due_s - self._inspect_s() - self._clock()

    def _unknown(self, sheet: int) -> bool:
        """Return whether a sheet's design has not been prepared."""
        return sheet < len(self._page_store) and self._thumbnails[sheet] is None

    def _ready(self, sheet: int, *, within_s: float = math.inf) -> None:
        """Wait for a sheet's design; a failure is reported as soon as it is known, and ends the wait."""
        begun_s = self._clock()
        while sheet < len(self._page_store) and not self._unusable[self._page_store.design(sheet)]:
            left_s = within_s - (self._clock() - begun_s)
            try:
                self._prefetcher.get(sheet, timeout_s=max(min(left_s, MIND_S), 0.0))
            except TimeoutError:
                if left_s > MIND_S and not self._stopping.is_set():
                    continue
            except Exception as error:
                _log.debug("sheet %d", sheet, exc_info=error)  # `_unusable` has reported it
            return

    def _design_ready(self, design: Hashable, ready: ReadyDesign) -> None:
        self._thumbnails.add(design, Thumbnail.of_arrays(ready[1].additional))
        self._unusable.remove(design)

    def _arrived(self, page: SeenPage | MissingPage, block: LineBlock | None, *, next_page: int) -> None:
        """Count a sheet and queue it for inspection."""
        number, now_s = self._sheets, self._clock()
        self._sheets += 1
        if isinstance(page, MissingPage):
            self.tally.count("missing", by=not page.is_unwatched)
            name = self._name(page.job_page)
            self._done.put(missing_page(number, page, now_s if block is None else block.time_s, name=name))
            return
        self.tally.arrived(now_s, list(kinds_of(page.faults)))
        self._on_arrived(number, page)
        if lost := self._lost(page):
            shown = page.taken_for if page.job_page is None else page.job_page
            self._done.put(skipped(number, page, lost, name=None if shown is None else self._name(shown)))
            return
        if page.job_page is None:
            self._arrived_unknown(number, page, next_page)
            return
        self._unready = 0
        # By the pages that may come next, not the page shown: a wrong one may be any page of the job.
        self._prefetcher.expect(max(next_page - 1, 0))
        arrived_s = page.last_line_time_s if self._settings.source_clock else now_s
        deadline_s = math.inf if self._settings.source_waits else arrived_s + self._settings.deadline_s
        sheet = Sheet(
            number=number,
            job_page=page.job_page,
            seen=page,
            arrived_s=arrived_s,
            placed_s=now_s,
            deadline_s=deadline_s,
        )
        if self._dropping.is_set():
            self._pass(sheet, STOPPED)
        else:
            for dropped in self._waiting.put(sheet, deadline_s):
                self._pass(dropped, NO_ROOM)

    def _lost(self, page: SeenPage) -> str:
        """Return why a sheet with lost lines cannot be judged; empty: it can be."""
        share = unseen_share(page.unseen, page.scan.shape[1])
        most = MOST_UNSEEN if page.job_page is not None else MOST_UNSEEN_OF_UNKNOWN
        if not page.torn and share <= most:
            return ""
        lost = "; ".join(lost_lines(page)) or (BEGUN_WITHIN if page.begun_within else "lines lost")
        return lost if page.torn else f"{lost}: {share:.0%} of the sheet was not seen"

    def _arrived_unknown(self, number: int, page: SeenPage, next_page: int) -> None:
        """Report a sheet that resembles no page of the job: an unknown one, or one of a page not prepared yet."""
        name = None if page.taken_for is None else self._name(page.taken_for)
        if page.cut_short:
            self._done.put(skipped(number, page, CUT_SHORT, name=name))
        elif page.taken_for is not None:
            why = self._why_unusable(page.taken_for)
            self._unready += not why
            self._prefetcher.expect(next_page + self._unready)
            self._done.put(skipped(number, page, why or NOT_READY, name=name))
        elif "blank" not in kinds_of(page.faults) and (doubt := self._doubt(next_page)):
            self._done.put(skipped(number, page, doubt))
        else:
            self._done.put(
                unknown_sheet(number, page, stored_evidence=self._inspector.picture_to_store(page.scan))
            )

    def _why_unusable(self, sheet: int) -> str:
        """Return why a sheet's page cannot be used; empty: no failure is recorded."""
        return self._unusable[self._page_store.design(sheet)] if sheet < len(self._page_store) else ""

    def _doubt(self, next_page: int) -> str:
        """Return why a sheet may show a page that cannot be used; empty: no page that may come is such."""
        for page in range(max(next_page - DOUBTED, 0), next_page + DOUBTED):
            if self._unknown(page) and (why := self._why_unusable(page)):
                return f"the sheet matches no prepared page, but may show {self._name(page)}: {why}"
        return ""

    def _inspect_all(self) -> None:
        while True:
            with ExitStack() as deciding:
                deciding.enter_context(self._deciding)
                sheet, dropped = self._waiting.take(
                    lambda: self._clock() + self._inspect_s(), is_late=lambda: self._behind
                )
                for late in dropped:
                    self._pass(late, TOO_LATE)
                if sheet is None and dropped:
                    continue
                if sheet is None:
                    return
                self.tally.count(BUSY)
                try:
                    self._done.put(self._inspect(sheet, deciding.close))
                finally:
                    self.tally.count(BUSY, by=-1)

    def _inspect_s(self) -> float:
        """Return the expected time of an inspection.

        It is at most half the deadline; otherwise, after a slow start, nothing would be tried any more.
        """
        return min(self.tally.typical_s("inspect"), self._settings.deadline_s / 2)

    def _inspect(self, sheet: Sheet, on_decision: Callable[[], None]) -> Outcome:
        """Return the outcome of one sheet; no failure of its inspection stops the run.

        on_decision: called when it is known to be a misprint, and is only explained from then on.
        """
        begun_s = self._clock()
        self.tally.took("queue", begun_s - sheet.arrived_s)
        times = SheetTimes(
            lines_s=sheet.seen.lines_s,
            last_line_s=sheet.arrived_s,
            placed_s=sheet.placed_s,
            begun_s=begun_s,
            decided_s=math.inf,
        )

        def decided(verdict: Verdict) -> None:
            nonlocal times
            times = replace(times, decided_s=self._clock())
            unexplained = self._outcome(sheet, SheetResult(verdict=verdict), None, times)
            self._done.put(Unexplained(outcome=unexplained))
            on_decision()

        try:
            inspector, ready, used = self._prefetcher.get(sheet.job_page)
            processors = (os.cpu_count() or 1) + self._settings.explainers
            with due(sheet.deadline_s, self._clock, processors=processors):
                result = inspector.inspect(
                    ready,
                    sheet.seen.scan,
                    unseen=sheet.seen.unseen,
                    name=f"sheet {sheet.number}",
                    seed=self._settings.seed + sheet.number,
                    sheet=sheet.number,
                    decided=decided,
                )
            ended_s = self._clock()
            times = replace(times, decided_s=min(times.decided_s, ended_s))
            done = self._outcome(sheet, result, used, times)
        except Exception as error:
            why = f"the sheet could not be inspected: {reason_of(error, of=f'sheet {sheet.number}')}"
            return skipped(sheet.number, sheet.seen, why, name=self._name(sheet.job_page))
        self.tally.took("inspect", ended_s - begun_s)
        self.tally.took("verdict", times.decided_s - sheet.arrived_s)
        return done

    def _outcome(
        self, sheet: Sheet, result: SheetResult, used: NDArray[np.float64] | None, times: SheetTimes
    ) -> Outcome:
        evidence, adapting = result.evidence, self._watch.adapting
        if adapting is not None and used is not None:
            evidence = replace(evidence, values=adapting.whole(evidence.values, used))
        return outcome(
            sheet.number,
            sheet.seen,
            result.verdict,
            late=times.decided_s > sheet.deadline_s,
            latency_s=times.decided_s - sheet.arrived_s,
            evidence=evidence,
            stored_evidence=result.stored_evidence,
            asked=result.asked,
            times=times,
        )

    def _pass(self, sheet: Sheet, why: str) -> None:
        self._done.put(skipped(sheet.number, sheet.seen, why, name=self._name(sheet.job_page)))

    def _mind(self) -> None:
        while not self._ended.wait(MIND_S):
            self._silence.check()

    def _finish_all(self) -> None:
        while (done := self._done.get()) is not None:
            if isinstance(done, Notice):
                self._finish_one(f"notice {done.kind}", self._say, done)
                continue
            if isinstance(done, Unexplained):
                self._unexplained[done.outcome.record.sheet] = done.outcome
            else:
                self._unexplained.pop(done.record.sheet, None)
                for turn in self._order.put(done):
                    self._finished += self._finish_one(f"sheet {turn.record.sheet}", self._finish, turn)
            self._tell_misprints()

    def _tell_misprints(self) -> None:
        """Report misprints that are being explained, once each sheet before them was reported or is one of them."""
        self._first_untold = max(self._first_untold, self._order.next)
        while (misprint := self._unexplained.pop(self._first_untold, None)) is not None:
            self._finish_one(f"sheet {misprint.record.sheet}", self._on_misprint, misprint)
            self._first_untold += 1

    def _finish_one(self, name: str, finish: Callable[[Any], None], done: Outcome | Notice) -> bool:
        """Run ``finish`` and return whether it succeeded: a failing observer or disk must not end the inspection."""
        try:
            finish(done)
        except Exception as error:
            self.tally.detail = f"{name}: {reason_of(error, of=name)}"
            return False
        return True

    def _say(self, notice: Notice) -> None:
        self._noted.append(notice.text)
        self._notice(notice)

    def _finish(self, turn: Outcome) -> None:
        finished = self._noting(self._watch.add(turn))
        record = finished.record
        if finished.came:
            self.tally.count(VERDICTS[record.verdict.verdict])
        if record.late:
            self.tally.count("late")
        unvouched = (
            record.verdict.verdict == "good" and without_gate(record.verdict, record.faults)[0] == "hold"
        )
        self.tally.count("unvouched", by=finished.came and unvouched)
        self.tally.count("out_of_time", by=out_of_time(record))
        self.tally.overloaded = self._watch.pace.overloaded
        self.tally.count("promise_suspended", by=record.verdict.promise_suspended)
        self.tally.count("overloads", by=sum(notice.kind == "overloaded" for notice in finished.notices))
        for notice in finished.notices:  # the record has it among its notes
            self._finish_one(f"notice {notice.kind}", self._notice, notice)
        self.tally.count("announcements", by=len(finished.announcements))
        self._follow(record.sheet)
        self._tell(finished)

    # --- parts ---

    def _follow(self, sheet: int) -> None:
        """Predict for the press as it is followed now, if it has changed enough until ``sheet``."""
        adapting = self._watch.adapting
        if adapting is None or (press := adapting.renewed(self._press, sheet)) is None:
            return
        self._inspector = inspector = self._inspector.following(press)
        used = adapting.used.copy()
        self._prefetcher.renew(
            self._maker(inspector), again=lambda ready: (inspector, inspector.renewed(ready[1]), used)
        )

    def _noting(self, finished: Outcome) -> Outcome:
        """Return an outcome with the notices since the last sheet in its notes, for the journal."""
        noted, self._noted = self._noted, []
        if not noted:
            return finished
        return replace(finished, record=replace(finished.record, notes=(*finished.record.notes, *noted)))

    def _maker(self, inspector: SheetInspector) -> Callable[[Page], ReadyDesign]:
        """Return a function that prepares designs for this inspector, with the adapted amounts in force then."""
        adapting = self._watch.adapting
        used = None if adapting is None else adapting.used.copy()
        return lambda page: (inspector, inspector.prepare(page), used)

    def _taken(self, design: Hashable) -> ReadyDesign | None:
        """Return a stored design, adapted to the press as it is followed now; None: none is stored."""
        known, inspector, adapting = self._stored(design), self._inspector, self._watch.adapting
        if known is None:
            return None
        used = None if adapting is None else adapting.used.copy()
        return inspector, inspector.renewed(known), used

    def _store_first(self, design: Hashable, ready: ReadyDesign) -> None:
        """Store a design unless it was prepared for light that this run has followed; a full disk costs no sheet."""
        if ready[0] is not self._first_inspector:
            return
        try:
            self._store(design, ready[1])
        except OSError as error:
            _log.warning("design %s was not stored: %s", design, error)

    def _fault(self, error: Exception) -> None:
        if not isinstance(error, (ProoflightError, OSError)):
            _log.error("the run broke off", exc_info=error)
        self.tally.phase, self.tally.detail = Phase.FAULT, str(error)
