"""Hot folder: a job's stage is the folder in which it lies, and each change of stage is one rename.

A job that was taken in has a folder of its own, its *entry*, which moves from stage to stage. Nothing else is stored:
whatever moment a process is killed at, every file is in exactly one stage, and the next process goes on from there.

::

    FOLDER/job.pdf                              arrives
    FOLDER/checking/000012/job.pdf              is taken in
    FOLDER/queued/000012-1f0a9c44b3de/job.pdf   is good to print; the second part of the name is that of its digest
    FOLDER/printing/..., FOLDER/done/...        by `watch --queue`
    FOLDER/rejected/000012-1f0a9c44b3de/job.pdf, reason.txt
"""

from __future__ import annotations

import filecmp
import re
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Self, get_args

from prooflight.errors import RequestError, sentence
from prooflight.files.atomic import sync_folder
from prooflight.files.lock import WriterLock, writer_lives

if TYPE_CHECKING:
    from collections.abc import Iterator

Stage = Literal["checking", "queued", "printing", "done", "rejected"]
STAGES: Final[tuple[Stage, ...]] = get_args(Stage)
REASON: Final = "reason.txt"
LOCKS: Final = ".locks"
DIGEST_LETTERS: Final = 12
"""Letters of a digest in a name: files that share them are compared byte by byte."""
_NAME: Final = re.compile(rf"(\d{{6,}})(?:-([0-9a-f]{{{DIGEST_LETTERS}}}))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A job in a stage."""

    path: Path
    """Folder of the job."""
    stage: Stage
    number: int
    """Number in the order of arrival, from 1."""
    digest: str
    """First ``DIGEST_LETTERS`` letters of the digest of its content; empty while it is being checked."""

    @property
    def file(self) -> Path:
        """The job's file; RequestError: somebody has taken it away."""
        with suppress(FileNotFoundError):
            files = sorted(file for file in self.path.iterdir() if file.name != REASON)
            if files:  # the console writes zones beside a job
                return min(files, key=lambda file: file.name.endswith(".zones.json"))
        raise RequestError(self.path, "has no job in it", remedy="put the file back, or remove this folder")

    @property
    def reason(self) -> str:
        """Why the job was rejected; empty if it was not."""
        with suppress(OSError):
            return sentence((self.path / REASON).read_text(encoding="utf-8", errors="replace"))
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class HotFolder:
    """A hot folder with all its stages."""

    path: Path

    @classmethod
    def open(cls, path: Path) -> Self:
        """Make the folders of the stages; RequestError: it is no folder, or a file has the name of a stage."""
        if not path.is_dir():
            raise RequestError(path, "is no folder", remedy="make it, on a disk of this machine")
        for stage in (*STAGES, LOCKS):
            try:
                (path / stage).mkdir(exist_ok=True)
            except FileExistsError:
                what = f"has a file called {stage}, where a folder must be"
                raise RequestError(path, what, remedy="move the file away") from None
        return cls(path=path)

    def entries(self, *stages: Stage) -> list[Entry]:
        """Return the jobs of these stages in the order of their arrival; those that are moving may be absent."""
        entries = []
        for stage in stages:
            for each in (self.path / stage).iterdir():
                named = _NAME.fullmatch(each.name)
                if named is not None and not each.is_symlink() and each.is_dir():
                    number, digest = int(named[1]), named[2] or ""
                    entries.append(Entry(path=each, stage=stage, number=number, digest=digest))
        return sorted(entries, key=lambda entry: entry.number)

    @contextmanager
    def filling(self) -> Iterator[None]:
        """Be the one process that takes jobs in; RequestError: another does."""
        lock = WriterLock.take(
            self.path / LOCKS / "fill",
            error=RequestError,
            wait="let the other `prooflight queue fill` take jobs in, or end it",
            elsewhere="let this user write there",
        )
        try:
            yield
        finally:
            lock.release()

    # --- of the process that takes jobs in ---

    def take_in(self, name: str) -> Entry:
        """Take a file of the folder in, for being checked; FileNotFoundError: it has gone."""
        number = max((entry.number for entry in self.entries(*STAGES)), default=0) + 1
        path = self.path / "checking" / f"{number:06d}"
        path.mkdir()
        # An entry's reason has a name of its own.
        (self.path / name).rename(path / (f"_{name}" if name == REASON else name))
        for folder in (path, self.path):
            sync_folder(folder)
        return Entry(path=path, stage="checking", number=number, digest="")

    def interrupted(self) -> list[Entry]:
        """Return the jobs that a process took in and did not get to check."""
        for entry in self.entries("checking"):
            with suppress(OSError):
                entry.path.rmdir()  # it was killed before the file had come: the folder is empty
        return self.entries("checking")

    def same_as(self, file: Path, digest: str) -> Entry | None:
        """Return a job with the same content that is queued, printing or done; None: there is none."""
        for entry in self.entries("queued", "printing", "done"):
            if entry.digest == digest[:DIGEST_LETTERS]:
                with suppress(OSError, RequestError):
                    if filecmp.cmp(entry.file, file, shallow=False):
                        return entry
        return None

    def queue(self, entry: Entry, digest: str) -> Entry:
        """Queue a job that was checked."""
        (entry.path / REASON).unlink(
            missing_ok=True
        )  # of a process that was killed, by another program's rules
        return self._moved(entry, "queued", digest)

    def reject(self, entry: Entry, digest: str, reason: str) -> Entry:
        """Reject a job, with the reason beside it."""
        (entry.path / REASON).write_text(sentence(reason) + "\n", encoding="utf-8")
        return self._moved(entry, "rejected", digest)

    # --- of the process that prints ---

    @contextmanager
    def printing(self) -> Iterator[Printing]:
        """Take the queue's next job for a run, and put it where it belongs when that has ended.

        It is done where ``Printing.finished`` was set; otherwise, and after a process that was killed, it is queued
        again in its place. RequestError: no job is queued.
        """
        self.put_back()
        for entry in self.entries("queued"):
            lock = self._lock(entry)
            if lock is None:
                continue
            try:
                try:
                    taken = Printing(self._moved(entry, "printing"))
                except FileNotFoundError:  # another process has begun and ended it since
                    continue
                try:
                    yield taken
                finally:
                    self._moved(taken.entry, "done" if taken.finished else "queued")
            finally:
                lock.release()
            return
        what = "has no job that is queued"
        raise RequestError(self.path, what, remedy="put a job into it while `prooflight queue fill` runs")

    def put_back(self) -> list[Entry]:
        """Queue jobs again whose run was killed, and return them."""
        back = []
        for entry in self.entries("printing"):
            lock = self._lock(entry)
            if lock is not None:
                with suppress(FileNotFoundError):
                    back.append(self._moved(entry, "queued"))
                lock.release()
        return back

    def _lock(self, entry: Entry) -> WriterLock | None:
        """Take the lock of a job, which is the same in all stages; None: another process has it."""
        file = self.path / LOCKS / entry.path.name
        if writer_lives(file):
            return None
        with suppress(RequestError):
            return WriterLock.take(file, error=RequestError, wait="", elsewhere="let this user write there")
        return None

    def _moved(self, entry: Entry, stage: Stage, digest: str = "") -> Entry:
        name = f"{entry.number:06d}-{(digest or entry.digest)[:DIGEST_LETTERS]}"
        path = self.path / stage / name
        entry.path.rename(path)
        for folder in (path.parent, entry.path.parent):
            sync_folder(folder)
        return Entry(path=path, stage=stage, number=entry.number, digest=name.partition("-")[2])


@dataclass(slots=True)
class Printing:
    """The job of a run."""

    entry: Entry
    finished: bool = False
    """Whether all sheets of the job have come."""
