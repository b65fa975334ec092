"""Requests of people to start and to stop runs, which other processes than the run's own write next to its journal.

::

    JOURNAL.stop.json         who stops which run; the process that watches removes it
    JOURNAL.start-job.json    who starts which job of a hot folder; the process that waits for a start removes it
    JOURNAL.starter.json      what waits for a start; it counts while its process holds JOURNAL.starter.json.lock

A request names its run or its job, and older ones are removed before a process looks for any. So a file that a killed
process left stops and starts nothing.
"""

from __future__ import annotations

import contextlib
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

from prooflight.errors import ProoflightError, RequestError
from prooflight.files.lock import WriterLock, writer_lives
from prooflight_line.journal.side_files import SideFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

STOP, START, STARTER = ".stop.json", ".start-job.json", ".starter.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A request of a person."""

    of: str
    """Run by ``labels.run_key``, or job by ``job_queue.hot_folder.Entry.key``."""
    by: str
    at_s: float
    """Unix time. [s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Starter:
    """A process that starts the jobs of a hot folder when people ask for it."""

    folder: str
    """The hot folder, absolute."""
    job: str = ""
    """Key of the job that was started and has not ended; empty: it waits for a start."""
    trouble: str = ""
    """Why the last job could not be started, in one line; empty: it could."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunControl:
    """The requests of one journal. clock: Unix time. [s]"""

    journal: Path
    clock: Callable[[], float] = time.time

    # --- of people ---

    def stop(self, run: str, *, by: str) -> None:
        """Ask for the end of a run. OSError."""
        self._file(STOP).write(asdict(Request(of=run, by=by, at_s=self.clock())))

    def start(self, job: str, *, by: str) -> None:
        """Ask for the start of a job. OSError."""
        self._file(START).write(asdict(Request(of=job, by=by, at_s=self.clock())))

    @property
    def starter(self) -> Starter | None:
        """What starts jobs when people ask for it; None: nothing does."""
        if not writer_lives(self._file(STARTER).path):
            return None
        with contextlib.suppress(OSError, ValueError, TypeError):
            starter = Starter(**self._file(STARTER).read())
            if all(isinstance(text, str) for text in asdict(starter).values()):
                return starter
        return None

    # --- of processes that watch, or wait for a start ---

    def stop_request(self, run: str) -> Request | None:
        """Return the request to end this run; None: nobody asked for it."""
        request = self._request(STOP)
        return request if request is not None and request.of == run else None

    def start_request(self) -> Request | None:
        """Take the request to start a job, which is removed; None: nobody asked for it."""
        request = self._request(START)
        if request is not None:
            self._file(START).remove()
        return request

    @contextmanager
    def stoppable(self) -> Iterator[None]:
        """Remove requests for an end before a run, and after it."""
        self._file(STOP).remove()
        try:
            yield
        finally:
            self._file(STOP).remove()

    @contextmanager
    def starting(self, starter: Starter) -> Iterator[None]:
        """Be the one process that waits for a start. RequestError: another does, or nothing can be written."""
        lock = WriterLock.take(
            self._file(STARTER).path,
            error=RequestError,
            wait="end the other `prooflight watch --on-start` of this journal",
            elsewhere="let this user write next to the journal",
        )
        try:
            self._file(START).remove()
            self.write_starter(starter)
            yield
        finally:
            self._file(STARTER).remove()
            lock.release()

    def write_starter(self, starter: Starter) -> None:
        """Write what starts jobs. OSError."""
        self._file(STARTER).write(asdict(starter))

    @contextmanager
    def trouble_noted(self, starter: Starter) -> Iterator[None]:
        """Write why the block failed, if it does, for the people who asked for the start."""
        try:
            yield
        except (ProoflightError, OSError) as error:
            with contextlib.suppress(OSError):
                self.write_starter(replace(starter, trouble=str(error)))
            raise

    def _request(self, suffix: str) -> Request | None:
        with contextlib.suppress(OSError, ValueError, TypeError):
            request = Request(**self._file(suffix).read())
            if isinstance(request.of, str) and isinstance(request.by, str):
                return request
        return None

    def _file(self, suffix: str) -> SideFile:
        return SideFile.of(self.journal, suffix)
