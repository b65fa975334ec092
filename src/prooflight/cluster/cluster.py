"""Work on the workers of a cluster: results in order or as they finish, whatever happens to a worker."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any, Final, TypeVar
from uuid import uuid4

from distributed import CancelledError, Client, Future

from prooflight.cluster.parcels import Outbox
from prooflight.cluster.worker import Done, Lacking, Order, receive, run
from prooflight.errors import RequestError
from prooflight.files.program import program_parts
from prooflight.pages.parallel import NO_FILES, Files

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD: Final = 4
"""Results, for each worker, that may wait for the one whose turn it is."""
POLL_S: Final = 1.0
"""Interval of counting the workers."""
FETCH_S: Final = 60.0
"""Longest time for one result to be fetched; assumed: 20 MB by a slow network take a tenth of it."""
DEATHS: Final = 3
"""Number of workers that are lost with an item before it counts as the cause."""
PATIENCE_S: Final = 300.0
"""Time without any worker after which work ends; assumed: a restart takes seconds, on a machine under load a minute."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sent:
    """An item on its way."""

    place: int
    item: Any
    order: Order
    at: str = ""
    """Address of the worker that has it."""
    deaths: int = 0
    """Number of workers that were lost with it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ended:
    """An item that ended: with a result, or with an error."""

    place: int
    result: Any = None
    error: BaseException | None = None

    def value(self) -> Any:
        if self.error is not None:
            raise self.error
        return self.result


@dataclass(slots=True, kw_only=True, eq=False)
class Cluster:
    """The workers behind a scheduler, to which a client is connected; see ``connection.connected``."""

    client: Client
    where: str
    """Address of the scheduler, as the user gave it."""
    start_missing: Callable[[], None]
    """Starts again the workers of this machine that were killed."""
    _outbox: Outbox = field(default_factory=Outbox)
    _brought: set[tuple[str, str]] = field(default_factory=set)
    """Worker processes and parcels that were sent to them."""
    _addresses: frozenset[str] = frozenset()
    _counted_s: float = -math.inf
    _seen_s: float = field(default_factory=time.monotonic)
    """Time at which there was a worker."""

    def in_order(
        self,
        work: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        killed: Callable[[Item], Result] | None = None,
        files: Files[Item] = NO_FILES,
    ) -> Iterator[Result]:
        """Apply ``work`` to each item, in the order of the items; see ``pages.parallel.in_order``.

        Items are taken one by one, since they may be many. The first error is raised where its result would have come.
        """
        waiting: dict[int, _Ended] = {}
        with closing(self._ended(work, items, killed=killed, files=files, waiting=waiting)) as ended:
            for due in count():
                while due not in waiting:
                    one = next(ended, None)
                    if one is None:
                        return
                    waiting[one.place] = one
                yield waiting.pop(due).value()

    def as_finished(
        self, work: Callable[[Item], Result], items: Iterable[Item], *, files: Files[Item] = NO_FILES
    ) -> Iterator[tuple[int, Result]]:
        """Apply ``work`` to each item, and yield place and result of each as it finishes: none waits for another."""
        with closing(self._ended(work, items, killed=None, files=files, waiting={})) as ended:
            for one in ended:
                yield one.place, one.value()

    def _ended(
        self,
        work: Callable[[Any], Any],
        items: Iterable[Any],
        *,
        killed: Callable[[Any], Any] | None,
        files: Files[Any],
        waiting: Sized,
    ) -> Generator[_Ended, None, None]:
        """Yield items as they end; waiting: results that the caller holds.

        Each worker is given one item at a time, by its address: when it is lost, its item is the cause, and no other
        item that waited there is blamed, as Dask by itself would.
        """
        order_of = self._orders(work, files)
        coming, done = enumerate(items), SimpleQueue[Any]()
        flying, again = dict[Any, _Sent](), deque[_Sent]()
        more = True
        try:
            while more or again or flying:
                workers = self._workers()
                for future, sent in list(flying.items()):
                    if sent.at not in workers:
                        self.client.cancel([future])
                        del flying[future]
                        if sent.deaths + 1 < DEATHS:
                            again.append(replace(sent, deaths=sent.deaths + 1))
                        else:
                            yield self._killed(sent, killed)
                free = list(workers - {sent.at for sent in flying.values()})
                while free and (again or (more and len(flying) + len(waiting) < AHEAD * len(workers))):
                    if again:
                        sent = again.popleft()
                    else:
                        place, item = next(coming, (-1, None))
                        more = place >= 0
                        if not more:
                            continue
                        sent = _Sent(place=place, item=item, order=order_of(item))
                    self._send(replace(sent, at=free.pop()), flying, done)
                with suppress(Empty):
                    future = done.get(timeout=POLL_S)
                    if future in flying:
                        answer = self._answer(future, flying[future])
                        if answer is None:
                            done.put(future)
                            continue
                        sent = flying.pop(future)
                        if isinstance(answer, Lacking):
                            self._bring(answer, sent.order)
                            self._send(sent, flying, done)
                        else:
                            yield answer
        finally:
            self.client.cancel(list(flying))

    def _send(self, sent: _Sent, flying: dict[Any, _Sent], done: SimpleQueue[Any]) -> None:
        future = self.client.submit(
            run, sent.order, key=f"prooflight-{uuid4().hex}", pure=False, workers=[sent.at]
        )
        flying[future] = sent
        future.add_done_callback(done.put)

    def _orders(self, work: Callable[[Any], Any], files: Files[Any]) -> Callable[[Any], Order]:
        """Return the function that makes an order of an item."""
        pickled, work_files = self._outbox.packed(work, files.of_work)
        package = type(work).__module__.partition(".")[0]
        packages = ("prooflight", *({package} - {"prooflight"} if package.startswith("prooflight") else ()))
        program, digest = program_parts(*packages), self._outbox.parcel(pickled)

        def order(item: Any) -> Order:
            content, item_files = self._outbox.packed(item, files.of_item(item))
            return Order(
                program=program,
                packages=packages,
                work=digest,
                work_files=work_files,
                item=content,
                item_files=item_files,
            )

        return order

    def _answer(self, future: Future, sent: _Sent) -> _Ended | Lacking | None:
        """Return what became of an item; None: it cannot be fetched now. RequestError: the scheduler was lost."""
        try:
            answer: Done | Lacking = future.result(timeout=FETCH_S)
        except TimeoutError:
            return None
        except CancelledError as error:
            raise self._lost("its scheduler has ended") from error
        except Exception as error:
            return _Ended(place=sent.place, error=error)
        return answer if isinstance(answer, Lacking) else _Ended(place=sent.place, result=answer.result)

    def _killed(self, sent: _Sent, killed: Callable[[Any], Any] | None) -> _Ended:
        """Return how an item ends that has ended its workers."""
        if killed is not None:
            return _Ended(place=sent.place, result=killed(sent.item))
        what = f"item {sent.place + 1} ended its worker {DEATHS} times"
        remedy = "give workers more memory; finished work is stored"
        return _Ended(place=sent.place, error=RequestError(f"cluster {self.where}", what, remedy=remedy))

    def _bring(self, lacking: Lacking, order: Order) -> None:
        """Send a worker the parcels that it lacks, unless they are already there: it was asked before they came."""
        of_item = {file.digest for file in order.item_files}
        for digest in lacking.digests:
            if (lacking.worker_id, digest) in self._brought:
                self._brought.remove(
                    (lacking.worker_id, digest)
                )  # if it is lacking once more, it was removed
                continue
            self._brought.add((lacking.worker_id, digest))
            files = (*order.work_files, *order.item_files)
            for piece in self._outbox.pieces(digest, files, of_item=digest in of_item):
                answers = self.client.run(receive, piece, workers=[lacking.address], on_error="return")
                trouble = answers.get(lacking.address, "")
                if isinstance(trouble, Exception):
                    return  # the worker was lost: another one will ask
                if trouble:
                    remedy = "free its disk, or give it another --local-directory"
                    what = f"cannot store a file: {trouble}"
                    raise RequestError(f"worker {lacking.address}", what, remedy=remedy)

    def _workers(self) -> frozenset[str]:
        """Return the addresses of the workers; RequestError: there has been none for a while."""
        now_s = time.monotonic()
        if now_s - self._counted_s >= POLL_S:
            self._counted_s = now_s
            self.start_missing()
            try:
                self._addresses = frozenset(self.client.nthreads())
            except OSError as error:
                raise self._lost("its scheduler does not answer any more") from error
            if self._addresses:
                self._seen_s = now_s
        if now_s - self._seen_s > PATIENCE_S:
            raise self._lost(f"it has had no worker for {PATIENCE_S:.0f} s")
        return self._addresses

    def _lost(self, what: str) -> RequestError:
        remedy = "start it again, and repeat the command: finished work is stored"
        return RequestError(f"cluster {self.where}", what, remedy=remedy)
