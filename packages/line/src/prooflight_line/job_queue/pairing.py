"""Pairing of jobs with their tickets, whichever comes first."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

from prooflight.errors import JobError, RequestError
from prooflight_line.job_queue.tickets.reading import read_ticket
from prooflight_line.job_queue.tickets.ticket import is_ticket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight_line.job_queue.arrivals import Arrivals
    from prooflight_line.job_queue.hot_folder import Entry, HotFolder

WAIT_S: Final = 600.0
"""Time for which a ticket waits for its file. assumed: both are sent by one program, at one time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivery:
    """Files of the folder that are taken in together."""

    names: tuple[str, ...]
    """The ticket before the job's file; either may be alone."""
    refused: str = ""
    """Reason why they are rejected unexamined; empty: they are examined."""
    queued: Entry | None = None
    """The job that was queued before its ticket came; None: its file is among ``names``."""


@dataclass(slots=True, kw_only=True)
class Pairing:
    """Pairing of the files of one folder, from look to look."""

    folder: HotFolder
    wait_s: float = WAIT_S
    needed: bool = False
    """Whether a job waits for its ticket, and is rejected without one."""
    clock: Callable[[], float] = time.monotonic
    _since: dict[str, float] = field(default_factory=dict)
    """Since when each file waits for its other."""

    def deliveries(self, arrivals: Arrivals) -> Iterator[Delivery]:
        """Yield what can be taken in now, in the order in which its last part came."""
        whole = arrivals.whole()
        jobs = dict.fromkeys(name for name in whole if not is_ticket(name))
        coming = {PurePath(name).stem for name in arrivals.pending if is_ticket(name)}
        before, self._since = self._since, {}
        self._since.update({name: before.get(name, self.clock()) for name in whole})
        ready = list[Delivery]()
        for name in filter(is_ticket, whole):
            delivery = self._of_ticket(name, jobs)
            if delivery is not None:
                ready.append(delivery)
                jobs.pop(delivery.names[-1], None)
        for name in jobs:
            if PurePath(name).stem in coming:
                continue
            if not self.needed:
                ready.append(Delivery(names=(name,)))
            elif self._waited(name):
                refused = f"arrived without a ticket within {self.wait_s:g} s; send both again"
                ready.append(Delivery(names=(name,), refused=refused))
        place = {name: number for number, name in enumerate(whole)}
        yield from sorted(ready, key=lambda delivery: max(place[name] for name in delivery.names))

    def _of_ticket(self, name: str, jobs: dict[str, None]) -> Delivery | None:
        """Return what is taken in with a ticket; None: it waits for its file, or has gone."""
        wrong = file = ""
        try:
            file = read_ticket(self.folder.path / name).file
        except JobError as error:
            wrong = str(error)
        except FileNotFoundError:
            return None
        except OSError as error:
            wrong = f"{name} cannot be read ({error.strerror}); let this user read it"

        def its(other: str) -> bool:
            return other == file if file else PurePath(other).stem == PurePath(name).stem

        job = next(filter(its, jobs), None)
        if job is not None:
            return Delivery(names=(name, job), refused=wrong)
        late = None if wrong else self._queued(its)
        if late is not None:
            return Delivery(names=(name,), queued=late)
        if not self._waited(name):
            return None
        what = f"its file {file} did not arrive" if file else "no file of its name arrived"
        return Delivery(names=(name,), refused=wrong or f"{what} within {self.wait_s:g} s; send both again")

    def _queued(self, its: Callable[[str], bool]) -> Entry | None:
        """Return the job without a ticket that waits in the queue for this one."""
        for entry in self.folder.entries("queued"):
            with suppress(RequestError):
                if its(entry.file.name) and entry.ticket is None:
                    return entry
        return None

    def _waited(self, name: str) -> bool:
        return self.clock() - self._since[name] >= self.wait_s
