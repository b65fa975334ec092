"""Filling of the queue: whole files are taken in one by one, examined, and queued or rejected."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, Protocol

from prooflight.errors import InputError
from prooflight.files.content import content_digest
from prooflight_line.job_queue.arrivals import being_written, state_of
from prooflight_line.job_queue.examining import Examined
from prooflight_line.job_queue.listing import job_id
from prooflight_line.job_queue.pairing import Pairing
from prooflight_line.job_queue.tickets.reading import read_ticket
from prooflight_line.job_queue.tickets.ticket import is_ticket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight_line.job_queue.arrivals import Arrivals
    from prooflight_line.job_queue.hot_folder import Entry, HotFolder
    from prooflight_line.job_queue.pairing import Delivery
    from prooflight_line.job_queue.tickets.ticket import Ticket

_log = logging.getLogger(__name__)

NOTHING: Final = "0" * 64
"""Stands for the digest of what cannot be read."""


class Examine(Protocol):
    """Examination of a job's file by what its ticket says; None: it has none."""

    def __call__(self, path: Path, ticket: Ticket | None, /) -> Examined:
        """Return what was seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TakenIn:
    """A job that was queued or rejected."""

    entry: Entry
    examined: Examined
    """``refused`` holds the reason."""


def fill_once(
    folder: HotFolder, arrivals: Arrivals, examine: Examine, pairing: Pairing | None = None
) -> Iterator[TakenIn]:
    """Take all whole files in, those first that a killed process left, and yield each where it has ended.

    pairing: of jobs and tickets, which remembers what waits; None: of this call alone. A file that is written to while
    it is examined stays, and is examined again by the next call. OSError: this machine failed (a full disk, no right to
    rename); nothing is lost, and a later call goes on.
    """
    failed: OSError | None = None
    pairing = pairing or Pairing(folder=folder)
    ended_by = partial(_ended, folder, examine=examine, needed=pairing.needed)
    for end in (
        *(partial(ended_by, entry) for entry in folder.interrupted()),
        *(partial(_taken_in, folder, each, ended_by) for each in pairing.deliveries(arrivals)),
    ):
        try:
            ended = end()
        except FileNotFoundError:  # its sender took it back
            continue
        except OSError as error:
            failed = failed or error
            continue
        if ended is not None:
            yield ended
    if failed is not None:
        raise failed


def _taken_in(
    folder: HotFolder, delivery: Delivery, ended: Callable[[Entry], TakenIn | None]
) -> TakenIn | None:
    """Take files in, and queue or reject them; None: they are still being written."""
    if delivery.queued is not None:
        return ended(folder.check_again(delivery.queued, delivery.names[0]))
    entry = folder.take_in(*delivery.names)
    if not delivery.refused:
        return ended(entry)
    return _rejected(folder, entry, _digest(entry.file), delivery.refused)


def _rejected(folder: HotFolder, entry: Entry, digest: str, refused: str) -> TakenIn:
    examined = Examined(pages=0, refused=refused)
    return TakenIn(entry=folder.reject(entry, digest, refused), examined=examined)


def _digest(file: Path) -> str:
    with suppress(PermissionError):
        if file.is_file() and not file.is_symlink():
            return content_digest(file)
    return NOTHING


def _ended(folder: HotFolder, entry: Entry, *, examine: Examine, needed: bool) -> TakenIn | None:
    """Queue or reject a job; None: it is still being written."""
    files = [file for file in (entry.file, entry.ticket) if file is not None]
    before = [state_of(file) for file in files]
    if None in before or any(map(being_written, files)):
        return None
    file, digest = entry.file, NOTHING
    if is_ticket(file.name):
        return _rejected(folder, entry, _digest(file), "another ticket of its name arrived; send it again")
    if needed and entry.ticket is None:  # it was waited for before the process was killed
        return _rejected(folder, entry, _digest(file), "arrived without a ticket; send both again")
    try:
        if file.is_file() and not file.is_symlink():
            digest = content_digest(file)
            ticket = None if entry.ticket is None else read_ticket(entry.ticket, folder=folder.path)
            examined = _same(folder, file, digest, ticket) or _examined(file, ticket, examine)
        else:
            examined = Examined(pages=0, refused="is not a regular file; send the file itself")
    except InputError as error:
        examined = Examined(pages=0, refused=str(error))
    except PermissionError as error:
        examined = Examined(pages=0, refused=f"cannot be read ({error.strerror}); let this user read it")
    if [state_of(file) for file in files] != before:
        return None
    why = examined.refused
    ended = folder.reject(entry, digest, why) if why else folder.queue(entry, digest, examined.facts)
    return TakenIn(entry=ended, examined=examined)


def _same(folder: HotFolder, file: Path, digest: str, ticket: Ticket | None) -> Examined | None:
    """Refuse a job whose content was ordered before; None: it is new.

    The same content under another job's ID is another order.
    """
    own = "" if ticket is None else ticket.job_id
    same = folder.same_as(file, digest, lambda entry: job_id(entry) == own)
    if same is None:
        return None
    reason = f"the same content is {same.stage} as {same.path.name}/{same.file.name}, and is printed once"
    return Examined(pages=0, refused=reason)


def _examined(file: Path, ticket: Ticket | None, examine: Examine) -> Examined:
    """Examine a job; what goes wrong within one file costs that file."""
    try:
        return examine(file, ticket)
    except OSError:
        raise
    except Exception as error:
        _log.exception("%s cannot be checked", file)
        return Examined(pages=0, refused=f"checking it failed ({type(error).__name__}: {error})")
