"""Backup of a journal and of what belongs to it, taken while runs are written, and its restoration.

A backup is a folder: copies, and a manifest with the size and SHA-256 of each. It is made under another name and
renamed when it is whole. Databases are copied by SQLite's backup, as they were at one moment; of the evidence, exactly
the packs that this copy names.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
import sqlite3
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight import __version__
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight_line.journal.labels import SUFFIX as LABELS
from prooflight_line.journal.labels import labels_path
from prooflight_line.journal.opening import UNREADABLE, examine, why
from prooflight_line.journal.packs import evidence_folder, inside
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

FORMAT: Final = 1
MANIFEST: Final = "manifest.json"
JOURNAL: Final = "journal.sqlite"
"""Name that the journal has in a backup; what lies beside it is named after it."""
CONSOLE: Final = ".console.sqlite"
"""What the console adds to the journal's name for its own file."""
PRESSES: Final = "presses"
PLAIN_PARTS: Final = (".aside.jsonl", ".gate")
"""What a journal's file or folder beside it may be called, besides databases and evidence."""
_PIECE: Final = 1 << 20
_PATH: Final = re.compile(rf"(?:{re.escape(JOURNAL)}[\w.]*|{PRESSES})(?:/[^/\0]+)*")
_FILES = GivenFiles(error=RequestError, remedy="give a folder that `prooflight backup` made", largest_mb=500)


@dataclass(frozen=True, slots=True, kw_only=True)
class Copied:
    """A file of a backup."""

    path: str
    """Path within the backup."""
    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BackedUp:
    """A backup as it was made."""

    folder: Path
    files: tuple[Copied, ...]
    missing: tuple[str, ...]
    """Packs of evidence that the journal names and that are not there."""

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files)


def back_up(
    journal: Path,
    folder: Path,
    *,
    console: Path | None = None,
    presses: Sequence[Path] = (),
    shown: Callable[[Sequence[tuple[Path, str]]], Iterable[tuple[Path, str]]] = lambda files: files,
) -> BackedUp:
    """Copy a journal, with all that belongs to it, into a new folder.

    Parameters
    ----------
    journal : may be written meanwhile
    folder : must not exist
    console : the console's own file; None: the one beside the journal, if there is one
    presses : press artefacts to be stored with it
    shown : shows the progress of copying these files, with their paths within the backup

    Raises
    ------
    RequestError
        The folder exists, or two presses have one name.
    JournalError
        The journal or another database cannot be read, or is damaged.
    """
    examine(journal, read_only=True)
    if folder.exists():
        raise RequestError(folder, "exists already", remedy="give a new folder; a backup overwrites nothing")
    if len({press.name for press in presses}) < len(presses):
        raise RequestError("--press", "two presses have the same file name", remedy="rename one of them")
    unfinished = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.part")
    unfinished.mkdir(parents=True)
    try:
        done = [_copied_database(journal, unfinished, JOURNAL)]
        evidence, missing = _evidence(journal, unfinished / JOURNAL)
        console = console or journal.with_name(journal.name + CONSOLE)
        for database, suffix in ((labels_path(journal), LABELS), (console, CONSOLE)):
            if database.is_file():
                done.append(_copied_database(database, unfinished, JOURNAL + suffix))
        plain = [
            *evidence,
            *_plain_parts(journal),
            *((press, f"{PRESSES}/{press.name}") for press in presses),
        ]
        for source, path in shown(plain):
            done.append(_copied(source, unfinished / path, path))
        manifest = {
            "format": FORMAT,
            "version": __version__,
            "made_s": time.time(),
            "journal": journal.name,
            "missing": missing,
            "files": [{"path": one.path, "bytes": one.bytes, "sha256": one.sha256} for one in done],
        }
        text = json.dumps(manifest, indent=1).encode("utf-8", "surrogateescape")
        _write(unfinished / MANIFEST, [text])
        unfinished.rename(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return BackedUp(folder=folder, files=tuple(done), missing=tuple(missing))


def restore(
    folder: Path,
    journal: Path,
    *,
    presses: Path,
    shown: Callable[[Sequence[Copied]], Iterable[Copied]] = lambda files: files,
) -> list[Path]:
    """Verify a backup, and put its files where they belong; return those that were not there.

    A file that is there with the same content stays; so a restoration that was interrupted can go on. The journal
    itself comes last.

    Parameters
    ----------
    journal : path that the journal gets
    presses : folder that press artefacts get

    Raises
    ------
    RequestError
        It is not a backup, a file of it is damaged or missing, or another file is where one would go: then nothing was
        written.
    """
    files = sorted(_manifest(folder), key=lambda file: file.path == JOURNAL)
    targets: dict[str, Path] = {}
    for file in shown(files):
        source = folder / file.path
        if not source.is_file() or source.stat().st_size != file.bytes or _digest(source) != file.sha256:
            what = "is damaged or missing: it differs from the backup's manifest"
            raise RequestError(source, what, remedy="restore another backup")
        target = _target(file.path, journal=journal, presses=presses)
        if not _absent_or_same(target, file):
            what = "exists already, with another content"
            raise RequestError(target, what, remedy="move it away, or give another --journal or --presses")
        targets[file.path] = target
    for suffix in ("-wal", "-journal"):  # SQLite would play it back into the restored journal
        if (log := journal.with_name(journal.name + suffix)).exists() and not journal.exists():
            raise RequestError(log, "is the log of another journal", remedy="move it away")
    restored = []
    for path, target in targets.items():
        if not target.exists():
            _placed(folder / path, target)
            restored.append(target)
    return restored


def _target(path: str, *, journal: Path, presses: Path) -> Path:
    """Return where a file of a backup goes."""
    if path.startswith(f"{PRESSES}/"):
        return presses / path.removeprefix(f"{PRESSES}/")
    return journal.parent / (journal.name + path.removeprefix(JOURNAL))


def _copied_database(source: Path, folder: Path, name: str) -> Copied:
    """Copy a database as it is at one moment, and check the copy; JournalError."""
    target = folder / name
    try:
        with (
            closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as read,
            closing(sqlite3.connect(target)) as written,
        ):
            read.backup(written)
            result = written.execute("PRAGMA quick_check(1)").fetchone()[0]
    except UNREADABLE as error:
        what = f"cannot be backed up ({why(error)})"
        raise JournalError(source, what, remedy="copy its files while nothing writes them") from error
    if result != "ok":
        raise JournalError(source, f"is damaged ({result})", remedy="restore an earlier backup of it")
    with target.open("rb+") as file:
        os.fsync(file.fileno())
    return Copied(path=name, bytes=target.stat().st_size, sha256=_digest(target))


def _evidence(journal: Path, copy: Path) -> tuple[list[tuple[Path, str]], list[str]]:
    """Return the packs that the copy of a journal names, with their paths in the backup, and those that are missing."""
    with closing(sqlite3.connect(copy)) as connection:
        names = [name for (name,) in connection.execute("SELECT file FROM packs ORDER BY id")]
    there, missing = [], []
    for name in names:
        pack = inside(evidence_folder(journal), name)
        if pack.is_file():
            there.append((pack, f"{evidence_folder(Path(JOURNAL)).name}/{name}"))
        else:
            missing.append(str(name))
    return there, missing


def _plain_parts(journal: Path) -> Iterator[tuple[Path, str]]:
    for suffix in PLAIN_PARTS:
        part = journal.with_name(journal.name + suffix)
        for file in sorted(part.rglob("*")) if part.is_dir() else [part]:
            if file.is_file() and not file.is_symlink():
                yield file, f"{JOURNAL}{suffix}{file.as_posix()[len(part.as_posix()) :]}"


def _manifest(folder: Path) -> list[Copied]:
    """Return the files of a backup; RequestError: it is none."""
    path = folder / MANIFEST
    if not path.is_file():
        raise RequestError(folder, "is not a backup", remedy="give a folder that `prooflight backup` made")
    try:
        read: Any = json.loads(_FILES.read_text(path))
        if read["format"] != FORMAT:
            what = f"has format {read['format']!r:.20}, this version reads format {FORMAT}"
            raise RequestError(path, what, remedy="restore it with the version that wrote it")
        files = [
            Copied(path=str(one["path"]), bytes=int(one["bytes"]), sha256=str(one["sha256"]))
            for one in read["files"]
        ]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        if isinstance(error, RequestError):
            raise
        raise RequestError(path, "is damaged", remedy="restore another backup") from error
    for file in files:
        if not _PATH.fullmatch(file.path) or ".." in file.path.split("/"):
            raise RequestError(
                path,
                f"names {file.path!r}, which does not belong in a backup",
                remedy="restore another backup",
            )
    if JOURNAL not in {file.path for file in files}:
        raise RequestError(path, "names no journal", remedy="restore another backup")
    return files


def _absent_or_same(target: Path, file: Copied) -> bool:
    if not target.exists():
        return not target.is_symlink()
    return target.is_file() and target.stat().st_size == file.bytes and _digest(target) == file.sha256


def _placed(source: Path, target: Path) -> None:
    """Copy a file to a name that is free, whole or not at all; FileExistsError: it is free no more."""
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(f".{target.name[:200]}.{secrets.token_hex(8)}.part")
    try:
        with source.open("rb") as read:
            _write(unfinished, iter(lambda: read.read(_PIECE), b""))
        os.link(unfinished, target)  # which, unlike a rename, replaces nothing
    finally:
        unfinished.unlink(missing_ok=True)


def _copied(source: Path, target: Path, path: str) -> Copied:
    sha, size = hashlib.sha256(), 0

    def pieces() -> Iterator[bytes]:
        nonlocal size
        with source.open("rb") as read:
            while piece := read.read(_PIECE):
                sha.update(piece)
                size += len(piece)
                yield piece

    target.parent.mkdir(parents=True, exist_ok=True)
    _write(target, pieces())
    return Copied(path=path, bytes=size, sha256=sha.hexdigest())


def _write(path: Path, pieces: Iterable[bytes]) -> None:
    with path.open("xb") as file:
        for piece in pieces:
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
