"""The queue of jobs in the hot folder: its list, moves of people, and files that are sent from a browser."""

from __future__ import annotations

import contextlib
import os
import secrets
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import RequestError
from prooflight.files.atomic import sync_folder
from prooflight.pages.files import SUFFIXES as PICTURES
from prooflight_console.problems import Problem
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.job_queue.listing import ENDED, WAITING, Listed, arriving, filled, listed
from prooflight_line.job_queue.tickets.ticket import SUFFIXES as TICKETS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from prooflight_line.job_queue.hot_folder import Entry
    from prooflight_line.journal.run_control import RunControl

Move = Literal["start", "first", "hold", "release", "remove"]
TAKEN: Final = (".pdf", *PICTURES, *TICKETS)
"""Endings of files that can be sent."""
LATEST: Final = 25
"""Jobs of each stage in which jobs end that are listed; the others lie in the folder."""
MOST_NAME: Final = 200
"""Longest name of a file that is sent. [bytes]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class QueueState:
    """What the page of the queue shows."""

    waiting: list[Listed]
    """Jobs that are printing, queued, held or checked, in the order of printing."""
    ended: list[Listed]
    """The latest that are done or rejected."""
    arriving: list[str]
    """Names of files that were not taken in yet."""
    filled: bool
    """Whether a process takes jobs in."""
    next: str
    """Key of the job that people may start now; empty: there is none, or nothing waits for a start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Queue:
    """The hot folder of one press; None: the console was started without."""

    path: Path | None
    control: RunControl
    """Requests to start its jobs."""

    @property
    def folder(self) -> HotFolder:
        """Return the hot folder; Problem 404: there is none. RequestError: it cannot be used."""
        if self.path is None:
            raise Problem(404, "not-found", "this console was started without --queue")
        return HotFolder.open(self.path)

    def state(self) -> QueueState:
        """Return the jobs that wait, and the latest that ended."""
        folder = self.folder
        waiting = [entry for stage in WAITING for entry in folder.entries(stage)]
        queued = [entry.key for entry in waiting if entry.stage == "queued"]
        ended = [entry for stage in ENDED for entry in folder.entries(stage)[-LATEST:]]
        return QueueState(
            waiting=listed(waiting),
            ended=listed(sorted(ended, key=lambda entry: -entry.number)),
            arriving=arriving(folder),
            filled=filled(folder),
            next=queued[0] if queued and self._waits_for_start else "",
        )

    def move(self, key: str, move: Move, *, by: str) -> Listed:
        """Move a job as a person asks; RequestError: it is not where that can be done any more."""
        folder = self.folder
        moves: dict[Move, Callable[[str], Entry]] = {
            "start": partial(self._start, by=by),
            "first": folder.put_first,
            "hold": folder.hold,
            "release": folder.release,
            "remove": partial(folder.remove, reason=f"removed by {by}"),
        }
        return listed([moves[move](key)])[0]

    @property
    def _waits_for_start(self) -> bool:
        starter = self.control.starter
        return starter is not None and not starter.job and starter.folder == str(self.folder.path.resolve())

    def _start(self, key: str, *, by: str) -> Entry:
        """Ask for the start of a job; RequestError: it is not queued any more, or nothing waits for a start."""
        entry = self.folder.entry(key, "queued")
        if not self._waits_for_start:
            remedy = (
                "wait until the run has ended, or start `prooflight watch --queue --on-start` at the press"
            )
            raise RequestError(self.folder.path, "nothing waits for the start of a job", remedy=remedy)
        try:
            self.control.start(key, by=by)
        except OSError as error:
            what = f"the start could not be requested ({error.strerror})"
            raise Problem(503, "storage", what) from error
        return entry

    async def take(self, name: str, pieces: AsyncIterator[bytes]) -> int:
        """Write a file that is sent into the hot folder under a temporary name, then give it its own; return its bytes.

        Problem 422: the name is none that is taken. Problem 409: there is a file of that name. Problem 503: there is no
        room. Nothing is left of a file that did not come whole.
        """
        from anyio import to_thread

        folder = self.folder.path
        _refuse_name(name)
        if (folder / name).exists():
            raise _there(name)
        unfinished, size = folder / f".{secrets.token_hex(8)}.part", 0
        try:
            with await to_thread.run_sync(unfinished.open, "xb") as file:
                async for piece in pieces:
                    await to_thread.run_sync(file.write, piece)
                    size += len(piece)
                await to_thread.run_sync(file.flush)
                await to_thread.run_sync(os.fsync, file.fileno())
            if not size:
                raise Problem(422, "invalid", f"{name} is empty")
            # A link, not a rename: it refuses where another file of that name has come meanwhile.
            await to_thread.run_sync(os.link, unfinished, folder / name)
            sync_folder(folder)
        except FileExistsError:
            raise _there(name) from None
        except OSError as error:
            detail = f"{name} could not be stored ({error.strerror})"
            raise Problem(503, "storage", detail) from error
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
        return size


def _refuse_name(name: str) -> None:
    wrong = name != PurePath(name).name or name.startswith(".") or not name.isprintable() or "\\" in name
    if wrong or len(name.encode("utf-8", "replace")) > MOST_NAME:
        raise Problem(422, "invalid", "give the name of a file, without a folder")
    if not name.lower().endswith(TAKEN):
        raise Problem(422, "invalid", f"give a file that ends in {', '.join(TAKEN)}")


def _there(name: str) -> Problem:
    return Problem(409, "there-already", f"{name} is in the folder already, and has not been taken in yet")
