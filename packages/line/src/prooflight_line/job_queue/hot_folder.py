"""Hot folder: a job's stage is the folder in which it lies, and each change of stage is one rename.

A job that was taken in has a folder of its own, its *entry*, which moves from stage to stage with its ticket, if it has
one. Nothing else is stored: whatever moment a process is killed at, every file is in exactly one stage, and the next
process goes on from there.

::

    FOLDER/job.pdf                              arrives
    FOLDER/checking/000012/job.pdf              is taken in
    FOLDER/queued/000012-1f0a9c44b3de/job.pdf   is good to print; the second part of the name is that of its digest
    FOLDER/queued/000013-...-1/job.pdf          is printed before it: the third part is its rank, 0 where absent
    FOLDER/held/...                             waits for a person
    FOLDER/printing/..., FOLDER/done/...        by `watch --queue`
    FOLDER/rejected/000012-1f0a9c44b3de/job.pdf, reason.txt
"""

from __future__ import annotations

import filecmp
import json
import re
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, Self, get_args

from prooflight.errors import RequestError, sentence
from prooflight.files.atomic import sync_folder
from prooflight.files.lock import WriterLock, writer_lives
from prooflight_line.job_queue.tickets.ticket import is_ticket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

Stage = Literal["checking", "queued", "held", "printing", "done", "rejected"]
STAGES: Final[tuple[Stage, ...]] = get_args(Stage)
REASON: Final = "reason.txt"
EXAMINED: Final = "examined.json"
"""What was seen when the job was checked, for lists."""
OWN: Final = (REASON, EXAMINED)
LOCKS: Final = ".locks"
FILL: Final = "fill"
DIGEST_LETTERS: Final = 12
"""Letters of a digest in a name: files that share them are compared byte by byte."""
MOST_RANK: Final = 999_999
_NAME: Final = re.compile(rf"(\d{{6,}})(?:-([0-9a-f]{{{DIGEST_LETTERS}}})(?:-(\d{{1,6}}))?)?")


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

    rank: int = 0
    """A job of higher rank is printed before those that came earlier; 0: none was asked for."""

    @property
    def key(self) -> str:
        """Name of the job that is the same in all stages after it was checked."""
        return f"{self.number:06d}-{self.digest}"

    @property
    def file(self) -> Path:
        """The job's file, or its ticket where that came alone; RequestError: somebody has taken it away."""
        with suppress(FileNotFoundError):
            files = sorted(file for file in self.path.iterdir() if file.name not in OWN)
            if files:  # the console writes zones beside a job
                return min(files, key=lambda file: (is_ticket(file.name), file.name.endswith(".zones.json")))
        raise RequestError(self.path, "has no job in it", remedy="put the file back, or remove this folder")

    @property
    def ticket(self) -> Path | None:
        """The job's ticket; None: it has none."""
        with suppress(OSError):
            return next((file for file in sorted(self.path.iterdir()) if is_ticket(file.name)), None)
        return None

    @property
    def reason(self) -> str:
        """Why the job was rejected; empty if it was not."""
        if self.stage == "rejected":
            with suppress(OSError):
                return sentence((self.path / REASON).read_text(encoding="utf-8", errors="replace"))
        return ""

    @property
    def examined(self) -> dict[str, Any]:
        """What was seen when it was checked; empty: it was not yet, or by an earlier program."""
        with suppress(OSError, ValueError):
            facts = json.loads((self.path / EXAMINED).read_text(encoding="utf-8"))
            return facts if isinstance(facts, dict) else {}
        return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class HotFolder:
    """A hot folder with all its stages."""

    path: Path

    @classmethod
    def open(cls, path: Path) -> Self:
        """Make the folders of the stages; RequestError: it is not a folder, or a file has the name of a stage."""
        if not path.is_dir():
            raise RequestError(path, "is not a folder", remedy="create it, on a disk of this machine")
        for stage in (*STAGES, LOCKS):
            try:
                (path / stage).mkdir(exist_ok=True)
            except FileExistsError:
                what = f"has a file called {stage}, where a folder must be"
                raise RequestError(path, what, remedy="move the file away") from None
        return cls(path=path)

    def entries(self, *stages: Stage) -> list[Entry]:
        """Return the jobs of these stages in the order of their printing; those that are moving may be absent.

        That is the order of their arrival, except of those to which a person gave a rank.
        """
        entries = []
        for stage in stages:
            for each in (self.path / stage).iterdir():
                named = _NAME.fullmatch(each.name)
                if named is not None and not each.is_symlink() and each.is_dir():
                    number, digest, rank = int(named[1]), named[2] or "", int(named[3] or 0)
                    entries.append(Entry(path=each, stage=stage, number=number, digest=digest, rank=rank))
        return sorted(entries, key=lambda entry: (-entry.rank, entry.number))

    def entry(self, key: str, *stages: Stage) -> Entry:
        """Return one job by its ``key``; RequestError: it is in none of these stages."""
        for entry in self.entries(*stages):
            if entry.key == key:
                return entry
        raise RequestError(
            self.path, f"has no job {key} that is {' or '.join(stages)}", remedy="list the jobs again"
        )

    @contextmanager
    def filling(self) -> Iterator[None]:
        """Be the one process that takes jobs in; RequestError: another does."""
        lock = WriterLock.take(
            self.path / LOCKS / FILL,
            error=RequestError,
            wait="let the other `prooflight queue fill` take jobs in, or end it",
            elsewhere="let this user write there",
        )
        try:
            yield
        finally:
            lock.release()

    # --- of the process that takes jobs in ---

    def take_in(self, *names: str) -> Entry:
        """Take files of one job in, its ticket before its own, for being checked; FileNotFoundError: one has gone."""
        number = max((entry.number for entry in self.entries(*STAGES)), default=0) + 1
        path = self.path / "checking" / f"{number:06d}"
        path.mkdir()
        for name in names:
            # What an entry holds beside its job has names of its own.
            (self.path / name).rename(path / (f"_{name}" if name in OWN else name))
        for folder in (path, self.path):
            sync_folder(folder)
        return Entry(path=path, stage="checking", number=number, digest="")

    def check_again(self, entry: Entry, ticket: str) -> Entry:
        """Take a ticket in that came after its job was queued; FileNotFoundError: one of them has gone."""
        path = self.path / "checking" / f"{entry.number:06d}"
        entry.path.rename(path)
        (self.path / ticket).rename(path / ticket)
        for folder in (path, self.path, path.parent, entry.path.parent):
            sync_folder(folder)
        return Entry(path=path, stage="checking", number=entry.number, digest="")

    def interrupted(self) -> list[Entry]:
        """Return the jobs that a process took in and did not get to check; a ticket alone goes back to the folder."""
        for entry in self.entries("checking"):
            with suppress(OSError, RequestError):
                if is_ticket(entry.file.name) and not (self.path / entry.file.name).exists():
                    entry.file.rename(self.path / entry.file.name)
            with suppress(OSError):
                entry.path.rmdir()  # it was killed before the file had come: the folder is empty
        return self.entries("checking")

    def same_as(
        self, file: Path, digest: str, same: Callable[[Entry], bool] = lambda _: True
    ) -> Entry | None:
        """Return a job with the same content that is queued, held, printing or done; None: there is none.

        same: whether it is the same order too.
        """
        for entry in self.entries("queued", "held", "printing", "done"):
            if entry.digest == digest[:DIGEST_LETTERS]:
                with suppress(OSError, RequestError):
                    if filecmp.cmp(entry.file, file, shallow=False) and same(entry):
                        return entry
        return None

    def queue(self, entry: Entry, digest: str, facts: dict[str, Any] | None = None) -> Entry:
        """Queue a job that was checked; facts: what was seen of it, in types that JSON can hold."""
        (entry.path / EXAMINED).write_text(json.dumps(facts or {}) + "\n", encoding="utf-8")
        (entry.path / REASON).unlink(
            missing_ok=True
        )  # of a process that was killed, by another program's rules
        return self._moved(entry, "queued", digest)

    def reject(self, entry: Entry, digest: str, reason: str) -> Entry:
        """Reject a job, with the reason beside it."""
        (entry.path / REASON).write_text(sentence(reason) + "\n", encoding="utf-8")
        return self._moved(entry, "rejected", digest)

    # --- of people ---

    def hold(self, key: str) -> Entry:
        """Keep a queued job from being printed; RequestError: it is not queued any more."""
        return self._by_person(key, "queued", "held")

    def release(self, key: str) -> Entry:
        """Queue a job again that was held; RequestError: it is not held."""
        return self._by_person(key, "held", "queued")

    def put_first(self, key: str) -> Entry:
        """Have a queued job printed before all others; RequestError: it is not queued any more."""
        rank = max((entry.rank for entry in self.entries("queued", "held")), default=0) + 1
        return self._by_person(key, "queued", "queued", rank=min(rank, MOST_RANK))

    def remove(self, key: str, reason: str) -> Entry:
        """Reject a job that is queued or held; RequestError: it is neither any more."""
        entry = self.entry(key, "queued", "held")
        try:
            return self.reject(entry, "", reason)
        except FileNotFoundError:
            raise RequestError(
                self.path, f"job {key} is not queued any more", remedy="list the jobs again"
            ) from None

    def _by_person(self, key: str, stage: Stage, to: Stage, *, rank: int | None = None) -> Entry:
        entry = self.entry(key, stage)
        try:
            return self._moved(entry if rank is None else replace(entry, rank=rank), to)
        except FileNotFoundError:
            raise RequestError(
                self.path, f"job {key} is not {stage} any more", remedy="list the jobs again"
            ) from None

    # --- of the process that prints ---

    @contextmanager
    def printing(self, key: str | None = None) -> Iterator[Printing]:
        """Take the queue's next job for a run, and put it where it belongs when that has ended.

        It is done where ``Printing.finished`` was set; otherwise, and after a process that was killed, it is queued
        again in its place. key: take this job and no other. RequestError: no job is queued, or this one is not.
        """
        self.put_back()
        for entry in self.entries("queued"):
            if key is not None and entry.key != key:
                continue
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
        if key is not None:
            raise RequestError(self.path, f"job {key} is not queued any more", remedy="list the jobs again")
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
        file = self.path / LOCKS / entry.key
        if writer_lives(file):
            return None
        with suppress(RequestError):
            return WriterLock.take(file, error=RequestError, wait="", elsewhere="let this user write there")
        return None

    def _moved(self, entry: Entry, stage: Stage, digest: str = "") -> Entry:
        rank = 0 if stage in ("done", "rejected") else entry.rank
        moved = replace(entry, stage=stage, digest=(digest or entry.digest)[:DIGEST_LETTERS], rank=rank)
        path = self.path / stage / (f"{moved.key}-{rank}" if rank else moved.key)
        entry.path.rename(path)
        for folder in (path.parent, entry.path.parent):
            sync_folder(folder)
        return replace(moved, path=path)


@dataclass(slots=True)
class Printing:
    """The job of a run."""

    entry: Entry
    finished: bool = False
    """Whether all sheets of the job have come."""
