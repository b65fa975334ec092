"""The pages of a job, several at a time; and the parts of a page."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
from collections import deque
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from itertools import count
from multiprocessing.connection import wait
from queue import PriorityQueue
from typing import TYPE_CHECKING, Any, TypeVar

from prooflight.errors import ProoflightError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")

FEWEST_FOR_PROCESSES = 6
"""Starting a process costs about as much as a few pages."""
KILLED = "its worker process was killed, perhaps for want of memory"


class _Crew:
    """Threads for all pages under way: they take parts of the page that is due first, so that it is done first, and no
    more threads run than asked for.
    """

    def __init__(self, threads: int) -> None:
        self._parts: PriorityQueue[tuple[float, int, Callable[[], None]]] = PriorityQueue()
        self._turn = count()
        for number in range(threads):
            threading.Thread(target=self._work, name=f"crew-{number}", daemon=True).start()

    def submit(self, task: Callable[[], Result], due_s: float) -> Future[Result]:
        """Have a part done; due_s: of its page, by the clock that all pages are due by."""
        done: Future[Result] = Future()

        def work() -> None:
            try:
                done.set_result(task())
            except BaseException as error:
                done.set_exception(error)

        self._parts.put((due_s, next(self._turn), work))
        return done

    def _work(self) -> None:
        while True:
            self._parts.get()[2]()


_made = cache(_Crew)
_making = threading.Lock()
_page = threading.local()
"""Of each thread: what says when the page is due on which it works."""


@contextmanager
def due(time_s: float, clock: Callable[[], float]) -> Iterator[None]:
    """Parts that this thread shares out meanwhile are done before those of pages due later.

    What is overdue comes last: nothing is won by it any more, and it would make the next pages late as well.
    """
    _page.due_s = lambda: time_s if clock() <= time_s else math.inf
    try:
        yield
    finally:
        del _page.due_s


def shared_out(tasks: Iterable[Callable[[], Result]], *, threads: int) -> list[Result]:
    """What the tasks give, in their order, that many run at once; the tasks must not share out in turn."""
    tasks = list(tasks)
    if threads == 1 or len(tasks) == 1:
        return [task() for task in tasks]
    due_s = _page.due_s() if hasattr(_page, "due_s") else math.inf
    with _making:  # or two threads that are the first would have a crew each
        crew = _made(threads)
    running = [crew.submit(task, due_s) for task in tasks]
    return [done.result() for done in running]


def in_order(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    *,
    processes: int | None = None,
    fewest: int = FEWEST_FOR_PROCESSES,
    killed: Callable[[Item], Result] | None = None,
) -> Iterator[Result]:
    """``work`` of each item, in the order of the items, in as many processes as there are cores.

    Processes, not threads, because MuPDF may not be used from several threads. ``work`` must be picklable; it travels
    once to each process, since it may hold a press. The first error is raised where its result would have come; work
    not begun by then is dropped. fewest: items from which on processes are started.

    Where a process is killed, what was under way is done again, in half as many, and first the item that is due by
    itself; killed: what stands for an item that kills its process even so. None: ProoflightError.
    """
    waiting = list(items)
    processes = processes or os.cpu_count() or 1
    if processes == 1 or len(waiting) < fewest:
        yield from map(work, waiting)
        return
    done = 0
    while done < len(waiting):
        try:
            for result in _in_processes(work, waiting[done:], processes):
                yield result
                done += 1
        except BrokenProcessPool:
            yield _alone(work, waiting[done], killed)
            done, processes = done + 1, max(processes // 2, 1)


def _in_processes(
    work: Callable[[Item], Result], waiting: Sequence[Item], processes: int
) -> Iterator[Result]:
    """``in_order``; BrokenProcessPool: a process was killed."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        min(processes, len(waiting)), mp_context=context, initializer=_hold, initargs=(work,)
    )
    try:
        # No more is begun than is soon fetched: results hold pictures.
        begun: deque[Future[Result]] = deque()
        for item in waiting:
            begun.append(pool.submit(_held_work, item))
            if len(begun) > 2 * processes:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _alone(work: Callable[[Item], Result], item: Item, killed: Callable[[Item], Result] | None) -> Result:
    """One item in a process of its own."""
    try:
        return next(_in_processes(work, [item], 1))
    except BrokenProcessPool as error:
        if killed is None:
            raise ProoflightError(f"a page: {KILLED}; free some, and start again") from error
        return killed(item)


_held: list[Callable[[Any], Any]] = []
"""In a worker process alone: the work that it was started for."""


def _hold(work: Callable[[Any], Any]) -> None:
    from prooflight.pages.process import settle_process  # loads much that no other process needs

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started this process
    threading.Thread(target=_end_with_parent, daemon=True).start()
    settle_process()
    _held[:] = [work]


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _held_work(item: Any) -> Any:
    return _held[0](item)
