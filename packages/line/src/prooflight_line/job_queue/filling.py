"""Filling of the queue: whole files are taken in one by one, examined, and queued or rejected."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

from prooflight.files.content import content_digest
from prooflight_line.job_queue.arrivals import being_written, state_of
from prooflight_line.job_queue.examining import Examined

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight_line.job_queue.arrivals import Arrivals
    from prooflight_line.job_queue.hot_folder import Entry, HotFolder

_log = logging.getLogger(__name__)

NOTHING: Final = "0" * 64
"""Stands for the digest of what cannot be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TakenIn:
    """A job that was queued or rejected."""

    entry: Entry
    examined: Examined
    """``refused`` holds the reason."""


def fill_once(
    folder: HotFolder, arrivals: Arrivals, examine: Callable[[Path], Examined]
) -> Iterator[TakenIn]:
    """Take all whole files in, those first that a killed process left, and yield each where it has ended.

    A file that is written to while it is examined stays, and is examined again by the next call. OSError: this machine
    failed (a full disk, no right to rename); nothing is lost, and a later call goes on.
    """
    failed: OSError | None = None
    for take in (
        *(partial(lambda entry: entry, entry) for entry in folder.interrupted()),
        *(partial(folder.take_in, name) for name in arrivals.whole()),
    ):
        try:
            ended = _ended(folder, take(), examine)
        except FileNotFoundError:  # its sender took it back
            continue
        except OSError as error:
            failed = failed or error
            continue
        if ended is not None:
            yield ended
    if failed is not None:
        raise failed


def _ended(folder: HotFolder, entry: Entry, examine: Callable[[Path], Examined]) -> TakenIn | None:
    """Queue or reject a job; None: it is still being written."""
    file = entry.file
    before = state_of(file)
    if before is None or being_written(file):
        return None
    digest = NOTHING
    try:
        if file.is_file() and not file.is_symlink():
            digest = content_digest(file)
            examined = _same(folder, file, digest) or _examined(file, examine)
        else:
            examined = Examined(pages=0, refused="is no ordinary file; send the file itself")
    except PermissionError as error:
        examined = Examined(pages=0, refused=f"cannot be read ({error.strerror}); let this user read it")
    if state_of(file) != before:
        return None
    why = examined.refused
    ended = folder.reject(entry, digest, why) if why else folder.queue(entry, digest)
    return TakenIn(entry=ended, examined=examined)


def _same(folder: HotFolder, file: Path, digest: str) -> Examined | None:
    """Refuse a job whose content is queued, printing or done; None: it is new."""
    same = folder.same_as(file, digest)
    if same is None:
        return None
    reason = f"the same content is {same.stage} as {same.path.name}/{same.file.name}, and is printed once"
    return Examined(pages=0, refused=reason)


def _examined(file: Path, examine: Callable[[Path], Examined]) -> Examined:
    """Examine a job; what goes wrong within one file costs that file."""
    try:
        return examine(file)
    except OSError:
        raise
    except Exception as error:
        _log.exception("%s cannot be checked", file)
        return Examined(pages=0, refused=f"checking it failed ({type(error).__name__}: {error})")
