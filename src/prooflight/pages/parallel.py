"""Parallel work on several pages of a job, and on the parts of a page."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, partial
from heapq import heappop, heappush
from itertools import count, pairwise
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, Generic, Protocol, TypeVar

from prooflight.errors import ProoflightError

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True, kw_only=True)
class Files(Generic[Item]):
    """Files and folders that work reads, which travel to workers on other machines."""

    of_work: Sequence[Path] = ()
    """Read for all items."""
    of_item: Callable[[Item], Sequence[Path]] = lambda _item: ()
    """Read for one item."""


NO_FILES: Final[Files[Any]] = Files()


class Workers(Protocol):
    """Worker processes that may be on other machines (``prooflight.cluster``)."""

    def in_order(
        self,
        work: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        killed: Callable[[Item], Result] | None = None,
        files: Files[Item] = NO_FILES,
    ) -> Iterator[Result]:
        """Apply ``work`` to each item, as the function ``in_order`` does; the files of an item travel with it."""
        ...

    def as_finished(
        self, work: Callable[[Item], Result], items: Iterable[Item], *, files: Files[Item] = NO_FILES
    ) -> Iterator[tuple[int, Result]]:
        """Apply ``work`` to each item, and yield place and result of each as it finishes."""
        ...


Processes = int | Workers | None
"""Number of worker processes on this machine, or workers; None: as many as this machine has cores."""

FEWEST_FOR_PROCESSES = 6
"""Fewest items for which processes are started; starting a process costs about as much as a few pages."""
KILLED = "its worker process was killed, perhaps for lack of memory"


class _WorkerPool:
    """Pool of processors for all pages under way.

    A thread that works on a page needs a processor, and the page that is due first gets the next free one. No
    more threads run than requested, and the page that is due first is done first.
    """

    def __init__(self, processors: int) -> None:
        self._free, self._turn = processors, count()
        self._asked: list[tuple[float, int, Callable[[], None]]] = []
        self._guard = threading.Lock()
        self._parts: SimpleQueue[Callable[[], None]] = SimpleQueue()
        for number in range(processors):
            threading.Thread(target=self._work, name=f"crew-{number}", daemon=True).start()

    def ask(self, begin: Callable[[], None], due_s: float) -> None:
        """Call ``begin``, which must be quick, once a processor is free for it.

        ``due_s`` is the deadline of its page, by the clock of all deadlines.
        """
        with self._guard:
            heappush(self._asked, (due_s, next(self._turn), begin))
            self._give()

    def wait(self, due_s: float) -> None:
        """Wait for a processor for this thread."""
        given = threading.Event()
        self.ask(given.set, due_s)
        given.wait()

    def leave(self) -> None:
        """Return a processor to the pool."""
        with self._guard:
            self._free += 1
            self._give()

    def do(
        self, tasks: Sequence[Callable[[], Result]], due_s: float, then: Callable[[], None]
    ) -> list[Future[Result]]:
        """Run a page's parts; ``then`` is called after the last, before its processor is given to another."""
        left, every = count(len(tasks) - 1, -1), [Future[Result]() for _ in tasks]

        def part(task: Callable[[], Result], done: Future[Result]) -> None:
            try:
                done.set_result(task())
            except BaseException as error:
                done.set_exception(error)
            if next(left) == 0:
                then()

        for task, done in zip(tasks, every, strict=True):
            self.ask(partial(self._parts.put, partial(part, task, done)), due_s)
        return every

    def _give(self) -> None:
        while self._free and self._asked:
            self._free -= 1
            heappop(self._asked)[2]()

    def _work(self) -> None:
        while True:
            self._parts.get()()
            self.leave()


_cached_pool = cache(_WorkerPool)
_making = threading.Lock()


class _Page(threading.local):
    """The page on which each thread works."""

    pool: _WorkerPool | None = None
    """Pool that its processor belongs to; None: the thread works without a processor of the pool."""

    def due_s(self) -> float:
        """Return the time at which its verdict is due."""
        return math.inf


_page = _Page()


def _pool_of(processors: int) -> _WorkerPool:
    with _making:  # or two threads that are the first would have a crew each
        return _cached_pool(processors)


@contextmanager
def due(time_s: float, clock: Callable[[], float], *, processors: int) -> Iterator[None]:
    """Let a page be worked on: this thread and its parallel parts precede those of pages that are due later.

    An overdue page comes last: its verdict is of no use any more, and it would make the next pages late as
    well.
    """
    _page.due_s = lambda: time_s if clock() <= time_s else math.inf  # type: ignore[method-assign]
    _page.pool = _pool_of(processors)
    _page.pool.wait(_page.due_s())
    try:
        yield
    finally:
        _page.pool.leave()
        del _page.pool, _page.due_s


def shared_out(tasks: Iterable[Callable[[], Result]], *, threads: int) -> list[Result]:
    """Run the tasks on ``threads`` threads, and return their results in order; tasks must not be nested.

    They run one after the other where ``threads_now`` is 1.
    """
    tasks = list(tasks)
    if len(tasks) <= 1 or threads_now(threads) == 1:
        return [task() for task in tasks]
    own, due_s, ended = _page.pool, _page.due_s(), threading.Event()
    goes_on = ended.set if own is None else partial(own.ask, ended.set, due_s)
    done = _pool_of(threads).do(tasks, due_s, goes_on)
    if own is not None:
        own.leave()
    ended.wait()
    return [one.result() for one in done]


_elsewhere: list[Callable[[int], bool]] = []
"""Function of ``leave_processors``; empty: this process shares its processors with no other."""


def leave_processors(are_needed: Callable[[int], bool]) -> None:
    """Let ``shared_out`` use several threads only while other processes leave it their processors.

    are_needed: function that returns whether others need some of the processors of so many threads; it is called before
    each use, so that a page goes on alone when others come, and in parts when they have ended.
    """
    _elsewhere[:] = [are_needed]


def threads_now(threads: int) -> int:
    """Return how many of so many threads ``shared_out`` would use: all, or one where processors are needed elsewhere.

    In a process of ``in_order``, other pages use them; in others ``leave_processors`` tells.
    """
    return 1 if _stored or any(are_needed(threads) for are_needed in _elsewhere) else threads


def parts_of(extent: int, parts: int) -> list[tuple[int, int]]:
    """Return start and end of ``parts`` parts of about the same length; fewer if the extent is too small."""
    bounds = [part * extent // parts for part in range(parts + 1)]
    return [(first, last) for first, last in pairwise(bounds) if first < last]


def in_order(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    *,
    processes: Processes = None,
    fewest: int = FEWEST_FOR_PROCESSES,
    killed: Callable[[Item], Result] | None = None,
    files: Files[Item] = NO_FILES,
    pool: ProcessPoolExecutor | None = None,
) -> Iterator[Result]:
    """Apply ``work`` to each item, in the order of the items, in as many processes as there are cores.

    Processes, not threads, because MuPDF may not be used from several threads. ``work`` must be picklable; it
    is sent once to each process, since it may hold a press. The first error is raised where its result would
    have come; work not begun by then is dropped. ``fewest`` is the number of items from which processes are
    started; a daemonic process may start none. ``files`` names what ``work`` reads, for workers on other machines.
    ``pool`` holds processes for several works one after the other (``worker_processes``); None: they are started.

    If a process is killed, the work under way is repeated in half as many processes, and the item that is
    next in order runs alone first. ``killed`` returns the result of an item that kills its process even so;
    None: ProoflightError.
    """
    if not (processes is None or isinstance(processes, int)):
        yield from processes.in_order(work, items, killed=killed, files=files)
        return
    waiting = list(items)
    if processes is None and multiprocessing.current_process().daemon:
        processes = 1
    processes = processes or os.cpu_count() or 1
    if processes == 1 or len(waiting) < fewest:
        _settle()
        yield from map(work, waiting)
        return
    done = 0
    while done < len(waiting):
        try:
            for result in _in_processes(work, waiting[done:], processes, pool):
                yield result
                done += 1
        except BrokenProcessPool:
            pool = None
            yield _alone(work, waiting[done], killed)
            done, processes = done + 1, max(processes // 2, 1)


@contextmanager
def worker_processes(
    most: int | None = None, work: Callable[[Any], Any] | None = None
) -> Iterator[ProcessPoolExecutor]:
    """Give processes for ``in_order``, each of which starts when it is first needed, and ends with this context.

    most: their number; None: as many as there are cores. work: sent to each once; None: each item comes with its own.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(most, mp_context=context, initializer=_hold, initargs=(work,))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _in_processes(
    work: Callable[[Item], Result],
    waiting: Sequence[Item],
    processes: int,
    pool: ProcessPoolExecutor | None = None,
) -> Iterator[Result]:
    """Apply ``work`` as ``in_order``; BrokenProcessPool if a process was killed."""
    run = _run_stored if pool is None else work
    with nullcontext(pool) if pool else worker_processes(min(processes, len(waiting)), work) as workers:
        # No more is begun than is soon fetched: results hold pictures.
        begun: deque[Future[Result]] = deque()
        try:
            for item in waiting:
                begun.append(workers.submit(run, item))
                if len(begun) > 2 * processes:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for one in begun:
                one.cancel()


def _alone(work: Callable[[Item], Result], item: Item, killed: Callable[[Item], Result] | None) -> Result:
    """Apply ``work`` to one item in a process of its own."""
    try:
        return next(_in_processes(work, [item], 1))
    except BrokenProcessPool as error:
        if killed is None:
            raise ProoflightError(f"a page: {KILLED}; free some, and start again") from error
        return killed(item)


_stored: list[Callable[[Any], Any] | None] = []
"""Work that a worker process was started for, None if items come with theirs; empty in all other processes."""


def _settle() -> None:
    from prooflight.pages.process import settle_process  # loads much that no other process needs

    settle_process()


def _hold(work: Callable[[Any], Any] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started this process
    threading.Thread(target=end_with_parent, daemon=True).start()
    settle_worker(work)


def settle_worker(work: Callable[[Any], Any] | None) -> None:
    """Settle a process that does nothing but this work: parts of a page then run one after the other."""
    _settle()
    _stored[:] = [work]


def end_with_parent() -> None:
    """End this worker when its parent has ended, because it would otherwise wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _run_stored(item: Any) -> Any:
    (work,) = _stored
    assert work is not None
    return work(item)
