"""Prices of zones, computed one at a time: begun, followed, cancelled."""

from __future__ import annotations

import secrets
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from prooflight_console.child_process import END_S, begin_process, end_process, messages_until_end
from prooflight_console.problems import Problem, not_found
from prooflight_console.zones.pricing import Priced, Progress, Refused, price_aside

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

    from prooflight_console.zones.pricing import PriceRequest

State = Literal["running", "done", "failed", "cancelled"]
MOST_STORED: Final = 16
"""Number of prices that are kept in memory; the oldest is dropped first."""
AGAIN: Final = "close other programs on this machine, and try again"
PROCESS_ENDED: Final = (
    f"the process that calculates the price ended before it was done, perhaps because memory ran out; {AGAIN}"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PriceTask:
    """State of the computation of one price."""

    id: str
    job: int
    job_digest: str
    """Digest of the job's content, on which the price depends."""
    zones_digest: str
    """Digest of exactly the zones that are priced."""
    press_digest: str
    prints: int
    trials: int
    by: str
    state: State = "running"
    progress: Progress
    why: str = ""
    priced: Priced | None = None


class Prices:
    """Prices of one console. The methods are thread-safe."""

    def __init__(self, work: Callable[[PriceRequest, Connection], None] = price_aside) -> None:
        """Create the service. work: called in the process, and therefore importable by its name."""
        self._work = work
        self._guard = threading.Condition()
        self._tasks: OrderedDict[str, PriceTask] = OrderedDict()
        self._running: tuple[str, BaseProcess] | None = None

    def begin(self, request: PriceRequest, **facts: str | int) -> PriceTask:
        """Begin a price, or return the one of exactly this request that exists or is being computed.

        Parameters
        ----------
        facts
            Fields of ``PriceTask``: job, job_digest, press_digest, by.

        Raises
        ------
        Problem
            409 if another price is being computed, 503 if no process can be started.
        """
        new = PriceTask(
            id=secrets.token_hex(8),
            zones_digest=request.zones.zones_digest,
            prints=request.prints,
            trials=request.trials,
            progress=Progress(stage="starting", done=0, total=request.prints),
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
                raise Problem(
                    409, "busy", f"a price that {by} requested is being calculated; wait, or cancel it"
                )
            try:
                process, receiver = begin_process(self._work, request, name="zones-price")
            except OSError as error:
                why = f"no process can be started for the price ({error.strerror}); {AGAIN}"
                raise Problem(503, "no-process", why) from error
            self._tasks[new.id] = new
            while len(self._tasks) > MOST_STORED:
                self._tasks.popitem(last=False)
            self._running = new.id, process
        threading.Thread(target=self._follow, args=(new.id, process, receiver), daemon=True).start()
        return new

    def one(self, task_id: str) -> PriceTask:
        """Return a price; raises ``Problem`` 404."""
        with self._guard:
            if (task := self._tasks.get(task_id)) is not None:
                return task
        raise not_found(f"there is no price {task_id[:20]!r}")

    def of_job(self, number: int) -> list[PriceTask]:
        """Return the prices of a job, the latest first."""
        with self._guard:
            return [task for task in reversed(self._tasks.values()) if task.job == number]

    def completed(self, *, job_digest: str, zones_digest: str, press_digest: str | None) -> PriceTask | None:
        """Return a price of exactly these zones; None if there is none. press_digest: None for any press."""
        with self._guard:
            for task in reversed(self._tasks.values()):
                same = task.job_digest == job_digest and task.zones_digest == zones_digest
                if same and task.state == "done" and press_digest in (None, task.press_digest):
                    return task
        return None

    def cancel(self, task_id: str) -> PriceTask:
        """Cancel a price; one that has ended stays as it is. Raises ``Problem`` 404."""
        with self._guard:
            task = self.one(task_id)
            if self._running is None or self._running[0] != task_id:
                return task
            self._running[1].terminate()
            self._tasks[task_id] = cancelled = replace(task, state="cancelled")
            return cancelled

    def close(self) -> None:
        """Cancel the price that is being computed."""
        with self._guard:
            running = self._running
        if running is not None:
            self.cancel(running[0])
            end_process(running[1])

    def _follow(self, task_id: str, process: BaseProcess, receiver: Connection) -> None:
        last: Priced | Refused = Refused(why=PROCESS_ENDED)
        for message in messages_until_end(process, receiver):
            if isinstance(message, Progress):
                self._now(task_id, progress=message)
            else:
                last = message
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


def _same(one: PriceTask, other: PriceTask) -> bool:
    names = ("job", "job_digest", "zones_digest", "press_digest", "prints", "trials")
    return all(getattr(one, name) == getattr(other, name) for name in names)
