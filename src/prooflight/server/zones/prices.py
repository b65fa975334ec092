"""Prices that are being made and were made, one at a time: begun, followed, cancelled."""

from __future__ import annotations

import multiprocessing
import secrets
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from prooflight.server.problems import Problem, not_found
from prooflight.server.zones.pricing import Priced, Progress, Refused, price_aside

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

    from prooflight.server.zones.pricing import PriceRequest

State = Literal["running", "done", "failed", "cancelled"]
KEPT: Final = 16
"""Prices that stay known; the oldest go first."""
END_S: Final = 10.0
"""For a process to end; then it is killed."""
AGAIN: Final = "close what takes memory on this machine, and ask again"
GONE: Final = (
    f"the process that makes the price ended before it was done, perhaps for want of memory; {AGAIN}"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PriceTask:
    """One price as it stands."""

    id: str
    job: int
    """Number of the job."""
    job_digest: str
    """Of its content, on which the price rests."""
    zones_digest: str
    """Of exactly the zones that are priced."""
    press_digest: str
    prints: int
    trials: int
    by: str
    state: State = "running"
    progress: Progress
    why: str = ""
    priced: Priced | None = None


class Prices:
    """Of one console. Its methods may be called from several threads."""

    def __init__(self, work: Callable[[PriceRequest, Connection], None] = price_aside) -> None:
        """work: called in the process; importable by its name."""
        self._work = work
        self._guard = threading.Condition()
        self._tasks: OrderedDict[str, PriceTask] = OrderedDict()
        self._running: tuple[str, BaseProcess] | None = None

    def begin(self, asked: PriceRequest, **facts: str | int) -> PriceTask:
        """Begin; what is there or under way for exactly this is given instead. ``Problem`` 409: another is under way;
        503: no process can be started.

        facts: of ``PriceTask``: job, job_digest, press_digest, by.
        """
        new = PriceTask(
            id=secrets.token_hex(8),
            zones_digest=asked.zones.zones_digest,
            prints=asked.prints,
            trials=asked.trials,
            progress=Progress(stage="starting", done=0, total=asked.prints),
            **facts,  # type: ignore[arg-type]
        )
        with self._guard:
            for task in reversed(self._tasks.values()):
                if _same(task, new) and task.state in ("running", "done"):
                    return task
            if self._running is not None and self._tasks[self._running[0]].state == "cancelled":
                self._guard.wait_for(lambda: self._running is None, END_S)
            if self._running is not None:
                by = self._tasks[self._running[0]].by
                raise Problem(409, "busy", f"a price that {by} asked for is being made; wait, or cancel it")
            context = multiprocessing.get_context("spawn")
            heard, told = context.Pipe(duplex=False)
            process = context.Process(target=self._work, args=(asked, told), name="zones-price", daemon=True)
            try:
                process.start()
            except OSError as error:
                heard.close()
                told.close()
                why = f"no process can be started for the price ({error.strerror}); {AGAIN}"
                raise Problem(503, "no-process", why) from error
            told.close()  # of this side: where the process ends, reading ends
            self._tasks[new.id] = new
            while len(self._tasks) > KEPT:
                self._tasks.popitem(last=False)
            self._running = new.id, process
        threading.Thread(target=self._follow, args=(new.id, process, heard), daemon=True).start()
        return new

    def one(self, task_id: str) -> PriceTask:
        """As it stands; ``Problem`` 404."""
        with self._guard:
            if (task := self._tasks.get(task_id)) is not None:
                return task
        raise not_found(f"there is no price {task_id[:20]!r}")

    def of_job(self, number: int) -> list[PriceTask]:
        """The latest first."""
        with self._guard:
            return [task for task in reversed(self._tasks.values()) if task.job == number]

    def made(self, *, job_digest: str, zones_digest: str, press_digest: str | None) -> PriceTask | None:
        """A price of exactly these zones; None: there is none. press_digest: None: on any press."""
        with self._guard:
            for task in reversed(self._tasks.values()):
                same = task.job_digest == job_digest and task.zones_digest == zones_digest
                if same and task.state == "done" and press_digest in (None, task.press_digest):
                    return task
        return None

    def cancel(self, task_id: str) -> PriceTask:
        """End it; one that has ended stays as it is. ``Problem`` 404."""
        with self._guard:
            task = self.one(task_id)
            if self._running is None or self._running[0] != task_id:
                return task
            self._running[1].terminate()
            self._tasks[task_id] = cancelled = replace(task, state="cancelled")
            return cancelled

    def close(self) -> None:
        """End what is under way."""
        with self._guard:
            running = self._running
        if running is not None:
            self.cancel(running[0])
            _ended(running[1])

    def _follow(self, task_id: str, process: BaseProcess, heard: Connection) -> None:
        last: Priced | Refused = Refused(why=GONE)
        while True:
            try:
                told = heard.recv()
            except (EOFError, OSError):
                break
            if isinstance(told, Progress):
                self._now(task_id, progress=told)
            else:
                last = told
        heard.close()
        _ended(process)
        with self._guard:
            self._running = None
        if isinstance(last, Priced):
            self._now(task_id, state="done", priced=last)
        else:
            self._now(task_id, state="failed", why=last.why)

    def _now(self, task_id: str, **changes: object) -> None:
        with self._guard:
            task = self._tasks.get(task_id)
            if task is not None and task.state == "running":
                self._tasks[task_id] = replace(task, **changes)  # type: ignore[arg-type]
            self._guard.notify_all()


def _ended(process: BaseProcess) -> None:
    process.join(END_S)
    if process.is_alive():
        process.kill()
        process.join()


def _same(one: PriceTask, other: PriceTask) -> bool:
    names = ("job", "job_digest", "zones_digest", "press_digest", "prints", "trials")
    return all(getattr(one, name) == getattr(other, name) for name in names)
