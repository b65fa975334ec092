"""The pages of a job, several at a time; and the parts of a page."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, TypeVar

from prooflight.errors import ProoflightError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from concurrent.futures import Future

Item = TypeVar("Item")
Result = TypeVar("Result")

FEWEST_FOR_PROCESSES = 6
"""Starting a process costs about as much as a few pages."""
KILLED = "its worker process was killed, perhaps for want of memory"


@cache
def _crew(threads: int) -> ThreadPoolExecutor:
    """One for all pages under way: it takes their parts in the order they came, so that the older page is done first
    and no more threads run than asked for.
    """
    return ThreadPoolExecutor(threads, thread_name_prefix="crew")


def shared_out(tasks: Iterable[Callable[[], Result]], *, threads: int) -> list[Result]:
    """What the tasks give, in their order, that many run at once; the tasks must not share out in turn."""
    if threads == 1:
        return [task() for task in tasks]
    running = [_crew(threads).submit(task) for task in tasks]
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
