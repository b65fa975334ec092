"""The sheets of a run, and the preparation of their designs ahead of them, in threads of their own, each once."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Final, Generic, Protocol, TypeVar

from prooflight.inspection.packed_design import size_bytes
from prooflight.pages.job import opened
from prooflight.pages.process import step_back

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable

    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_line.run.notices import PageWarnings
    from prooflight_line.run.sheets.thumbnails import Thumbnail

_log = logging.getLogger(__name__)

FORESIGHT: Final = 2000
"""Number of coming sheets that are searched for the design needed last. Assumed: twice the designs that a
machine holds at most."""
RETRY_S: Final = 30.0
"""Time until a design that failed is tried again: its file may have been sent once more."""
Ready = TypeVar("Ready")
Read = TypeVar("Read")


class PageStore(Protocol):
    """The sheets of a job."""

    def __len__(self) -> int: ...

    def design(self, sheet: int) -> Hashable:
        """Return the key of a sheet's design: sheets of one design look the same."""
        ...

    def page(self, sheet: int) -> Page:
        """Return what is printed on a sheet, from 0, as it enters the press; always called by the same thread."""
        ...


class DesignPrefetcher(Generic[Ready]):
    """Cache of prepared designs, filled for the next sheets; the designs needed last are evicted first.

    The order of a job is known, and so is the design needed last: evicting the least recently used design would,
    in a job of a few more designs than fit, always evict the one that comes next (Belady, IBM Systems Journal 5,
    1966). Designs whose sheets have passed before their turn came are dropped from the queue: they would delay
    the next ones.
    """

    def __init__(
        self,
        page_store: PageStore,
        prepare: Callable[[Page], Ready],
        *,
        depth: int,
        room_bytes: int,
        threads: int = 1,
        took: Callable[[float], None] = lambda _seconds: None,
        size: Callable[[Ready], int] = size_bytes,
        on_ready: Callable[[Hashable, Ready], None] = lambda _design, _ready: None,
        failed: Callable[[Hashable, int, Exception], None] = lambda _design, _sheet, _error: None,
        stored: Callable[[Hashable], Ready | None] = lambda _design: None,
        store: Callable[[Hashable, Ready], None] = lambda _design, _ready: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin with an empty cache.

        Parameters
        ----------
        on_ready, failed
            Called with every design when it is ready, or with its sheet and the error if it failed.
        stored
            Returns a design that was prepared before the run; None: it was not.
        store
            Called with every design that was prepared now, when it is ready.
        """
        self._page_store, self._prepare = page_store, prepare
        self._took, self._size, self._on_ready = took, size, on_ready
        self._on_failed, self._stored, self._store, self._clock = failed, stored, store, clock
        self._failed_s: dict[Hashable, float] = {}
        self._depth, self._room_bytes = depth, room_bytes
        self._cached: OrderedDict[Hashable, Future[Ready]] = OrderedDict()
        self._bytes: dict[Hashable, int] = {}
        self._update: Callable[[Ready], Ready] | None = None
        self._stale: set[Hashable] = set()
        self._renewing = False
        self._queued: dict[Hashable, int] = {}  # the sheet of each design that nobody waits for yet
        self._next = 0  # the sheet that comes next
        self._guard = threading.Lock()
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="pages")  # MuPDF is not thread-safe
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="ahead", initializer=step_back)
        self._renewer = ThreadPoolExecutor(1, thread_name_prefix="renew", initializer=step_back)

    @property
    def ready(self) -> int:
        """Number of designs that are ready."""
        return len(self._bytes)

    @property
    def has_room(self) -> bool:
        """Whether one more design of average size fits into memory."""
        with self._guard:
            used, count = sum(self._bytes.values()), len(self._bytes)
        return not count or used + used / count <= self._room_bytes

    def all_ready(self) -> list[Ready]:
        """Return the designs that are ready, in the order in which they were last requested."""
        with self._guard:
            return [cached.result() for design, cached in self._cached.items() if design in self._bytes]

    def largest(self) -> Ready:
        """Return the largest of the designs that are ready; ValueError: none is."""
        with self._guard:
            return self._cached[max(self._bytes, key=self._bytes.__getitem__)].result()

    def middle(self) -> Ready:
        """Return the design of middle size of those that are ready; IndexError: none is."""
        with self._guard:
            by_size = sorted(self._bytes, key=self._bytes.__getitem__)
            return self._cached[by_size[len(by_size) // 2]].result()

    def expect(self, sheet: int) -> None:
        """Announce that a sheet of the job and those after it come next."""
        self._next = sheet
        self._drop_before(sheet)
        last = len(self._page_store) if len(self._page_store) else sheet + self._depth
        coming = range(sheet, min(sheet + self._depth, last))
        self.begin(coming)
        self._renew_one(coming)

    def begin(self, sheets: Iterable[int]) -> None:
        """Queue the designs of these sheets, except those that failed lately; do not wait."""
        for sheet in sheets:
            if not self._failed_lately(sheet):
                self._requested(sheet)

    def get(self, sheet: int, *, timeout_s: float | None = None) -> Ready:
        """Return a sheet's design, prepared now if need be; raise the error of its preparation, or TimeoutError."""
        requested = self._requested(sheet)
        with self._guard:
            self._queued.pop(self._page_store.design(sheet), None)
        return requested.result(timeout_s)

    def renew(
        self, prepare: Callable[[Page], Ready], *, again: Callable[[Ready], Ready] | None = None
    ) -> None:
        """Prepare designs with ``prepare`` from now on; ready ones may be used until they are prepared again.

        again: prepares a design again that is ready, with less work.
        """
        with self._guard:
            self._prepare, self._update = prepare, again
            self._stale = set(self._bytes)

    def close(self) -> None:
        """End the threads; work under way is finished, queued work is dropped."""
        for pool in (self._pool, self._renewer, self._reader):
            pool.shutdown(wait=True, cancel_futures=True)

    def _requested(self, sheet: int) -> Future[Ready]:
        design = self._page_store.design(sheet)
        with self._guard:
            cached = self._cached.get(design)
            if cached is not None:
                self._cached.move_to_end(design)
                if design in self._queued:
                    self._queued[design] = sheet
                return cached
            requested = self._pool.submit(self._prepared, design, sheet)
            self._cached[design] = requested
            self._queued[design] = sheet
            return requested

    def _failed_lately(self, sheet: int) -> bool:
        with self._guard:
            failed_s = self._failed_s.get(self._page_store.design(sheet))
        return failed_s is not None and self._clock() - failed_s < RETRY_S

    def _drop_before(self, sheet: int) -> None:
        with self._guard:
            for design, number in list(self._queued.items()):
                if number < sheet and self._cached[design].cancel():
                    del self._cached[design], self._queued[design]

    def _renew_one(self, coming: range) -> None:
        """Prepare one stale design again, the last to be needed: it can be used as it is, so nothing must wait."""
        with self._guard:
            stale = (number for number in reversed(coming) if self._page_store.design(number) in self._stale)
            sheet = next(stale, None)
            if sheet is None or self._renewing:
                return
            self._renewing = True
            design = self._page_store.design(sheet)
            self._stale.discard(design)
            self._renewer.submit(self._again, design, sheet)

    def _prepared(self, design: Hashable, sheet: int) -> Ready:
        with self._guard:
            self._queued.pop(design, None)
        try:
            stored = self._stored(design)
            ready = self._timed(sheet) if stored is None else stored
            self._on_ready(design, ready)
        except BaseException as error:
            with self._guard:
                self._cached.pop(design, None)
                self._failed_s[design] = self._clock()
            if isinstance(error, Exception):
                self._on_failed(design, sheet, error)
            raise
        with self._guard:
            self._failed_s.pop(design, None)
            self._bytes[design] = self._size(ready)
            self._make_room(design)
        if stored is None:
            self._store(design, ready)
        return ready

    def _again(self, design: Hashable, sheet: int) -> None:
        ready: Future[Ready] = Future()
        with self._guard:
            update, cached = self._update, self._cached.get(design)
        try:
            if update is None or cached is None:
                ready.set_result(self._timed(sheet))
            else:
                ready.set_result(self._timed_call(update, cached.result()))
            with self._guard:
                if design in self._cached:
                    self._cached[design] = ready
        except Exception:  # the ready one remains in use
            _log.exception("the design of sheet %d could not be created again", sheet)
        finally:
            self._renewing = False

    def _timed(self, sheet: int) -> Ready:
        return self._timed_call(self._prepare, self._reader.submit(self._page_store.page, sheet).result())

    def _timed_call(self, make: Callable[[Read], Ready], of: Read) -> Ready:
        started = time.perf_counter()
        ready = make(of)
        self._took(time.perf_counter() - started)
        return ready

    def _make_room(self, but: Hashable) -> None:
        """Evict the designs needed last until the rest fits into memory; of equals, the oldest."""
        while sum(self._bytes.values()) > self._room_bytes:
            others = [design for design in self._cached if design != but and design in self._bytes]
            if not others:
                return
            needed = self._needed(others)
            last = max(others, key=lambda design: needed.get(design, math.inf))
            del self._cached[last], self._bytes[last]
            self._stale.discard(last)

    def _needed(self, designs: Iterable[Hashable]) -> dict[Hashable, int]:
        """Return the next sheet of each of these designs that comes soon."""
        wanted: set[Hashable] = set(designs)
        needed: dict[Hashable, int] = {}
        last = min(self._next + FORESIGHT, len(self._page_store) or self._next + FORESIGHT)
        for sheet in range(self._next, last):
            design = self._page_store.design(sheet)
            if design in wanted:
                wanted.discard(design)
                needed[design] = sheet
            if not wanted:
                break
        return needed


# --- the sheets of a run, and the thumbnails of its designs ---

MOST_THUMBNAILS: Final = 1200
"""Greatest number of thumbnails kept, of 100 kB each: more than the widest search for a page compares."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobPageStore:
    """A job's pages in order, repeated from the first until ``sheets`` sheets have passed."""

    job: JobSource
    press: Press
    pages: int
    sheets: int
    plan: SheetPlan | None = None
    """Order of the sides, if they pass in another order than they are numbered; the pages of ``job`` are then
    its sides."""
    warnings: PageWarnings | None = None
    """Receives the warnings of each page; None: they are dropped."""

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        """Return the number of the sheet's page in the job; see ``PageStore``."""
        return sheet % self.pages + 1 if self.plan is None else self.plan.number_at(sheet)

    def name(self, sheet: int) -> str:
        """Return the display name of a sheet's page."""
        return self.job.page_name(self.design(sheet))

    def page(self, sheet: int) -> Page:
        """Return the page printed on a sheet; see ``PageStore``.

        Raises JobError and RequestError as ``Job.page`` does, and RequestError if the page is wider than the
        press's field.
        """
        page = opened(self.job).page(self.design(sheet))
        if self.warnings is not None:
            self.warnings.add(page.warnings)
        return self.press.geometry.lay(page)


class ThumbnailCache:
    """Thumbnails of a job's sheets, one for each design; None if a design is not ready, or was evicted."""

    def __init__(self, page_store: PageStore) -> None:
        self._page_store = page_store
        self._cached: OrderedDict[Hashable, Thumbnail] = OrderedDict()
        self._guard = Lock()

    def __len__(self) -> int:
        return len(self._page_store)

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < len(self._page_store):
            raise IndexError(sheet)
        with self._guard:
            return self._cached.get(self._page_store.design(sheet))

    def add(self, design: Hashable, thumbnail: Thumbnail) -> None:
        """Add the thumbnail of a design that is ready; a design that is already there keeps its object."""
        with self._guard:
            self._cached.setdefault(design, thumbnail)
            self._cached.move_to_end(design)
            while len(self._cached) > MOST_THUMBNAILS:
                self._cached.popitem(last=False)
