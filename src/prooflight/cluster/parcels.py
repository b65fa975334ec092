"""What travels to the workers of a cluster: pickled work and items, and the files that they read.

Work and files travel as parcels, each named by the digest of its content, and only to a worker that lacks it: a worker
on the same machine reads a file where it is, and one that was restarted asks for everything again. A pickled object
names a file by its parcel, and is given the path that the file has on the worker.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import cloudpickle

from prooflight.files.content import content_digest

PIECE_BYTES: Final = 16 << 20
"""Size of the pieces in which a parcel travels, so that neither side holds a file in memory."""
MOST_FILES: Final = 16
"""Number of files of items that a worker keeps; assumed: a worker reads one at a time, mostly once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileAt:
    """A file or folder that an object reads, as its pickle names it."""

    path: Path
    """Path on the head."""
    digest: str
    """SHA-256 of its content."""

    def digest_there(self) -> str:
        """Return the digest of what lies at its path on this machine; "": nothing."""
        return _digest_of(self.path)

    def local(self, folder: Path) -> Path | None:
        """Return its path on this machine; None: it is not here. folder: of the parcels of this worker."""
        if self.digest_there() == self.digest:
            return self.path
        sent = folder / self.digest / self.path.name
        return sent if sent.exists() else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A part of a parcel, as it travels."""

    digest: str
    member: str
    """File of the parcel, relative to the parcel's folder; "": the parcel is complete."""
    offset: int = 0
    content: bytes = b""
    of_item: bool = False
    """Whether it is the file of an item, which is removed when newer ones have come."""


class Outbox:
    """The head's side: pickles objects, and reads the parcels that workers lack."""

    def __init__(self) -> None:
        self._pickles: dict[str, bytes] = {}

    def packed(self, one: object, files: Iterable[Path]) -> tuple[bytes, tuple[FileAt, ...]]:
        """Pickle an object that reads these files; one that cannot be read stays for the worker to report."""
        digests = {path: _digest_of(path) for path in files}
        every = {path: FileAt(path=path, digest=digest) for path, digest in digests.items() if digest}
        buffer = io.BytesIO()
        _Pickler(buffer, every).dump(one)
        return buffer.getvalue(), tuple(every.values())

    def parcel(self, pickled: bytes) -> str:
        """Make a parcel of a pickle, and return its digest."""
        digest = hashlib.sha256(pickled).hexdigest()
        self._pickles[digest] = pickled
        return digest

    def pieces(self, digest: str, files: Iterable[FileAt], *, of_item: bool) -> Iterator[Piece]:
        """Yield a parcel in pieces: a pickle, or the one of ``files`` that has this digest."""
        if digest in self._pickles:
            for offset, content in _parts(io.BytesIO(self._pickles[digest])):
                yield Piece(digest=digest, member=digest, offset=offset, content=content)
        else:
            path = next(one.path for one in files if one.digest == digest)
            members = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
            for member in members:
                name = member.relative_to(path.parent).as_posix()
                with member.open("rb") as file:
                    for offset, content in _parts(file):
                        yield Piece(
                            digest=digest, member=name, offset=offset, content=content, of_item=of_item
                        )
        yield Piece(digest=digest, member="", of_item=of_item)


def store_piece(piece: Piece, folder: Path) -> None:
    """Store a piece on a worker; after the last, the parcel is complete. OSError: it cannot be stored."""
    unfinished, whole = folder / f"{piece.digest}.part", folder / piece.digest
    if piece.member:
        path = unfinished / piece.member
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("r+b" if piece.offset else "wb") as file:
            file.seek(piece.offset)
            file.write(piece.content)
        return
    if not whole.exists():
        unfinished.rename(whole)
    if piece.of_item:
        (whole / ITEM).touch()
        of_items = sorted(folder.glob(f"*/{ITEM}"), key=lambda mark: mark.stat().st_mtime)
        for mark in of_items[:-MOST_FILES]:
            shutil.rmtree(mark.parent, ignore_errors=True)


ITEM: Final = ".item"
"""Name of the mark in a parcel of an item."""


def unpacked(pickled: bytes, local: Mapping[str, Path]) -> Any:
    """Return a pickled object on a worker, with the paths that its files have there; local: by digest."""
    return _Unpickler(io.BytesIO(pickled), local).load()


def _parts(file: io.BufferedIOBase) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while (content := file.read(PIECE_BYTES)) or not offset:
        yield offset, content
        offset += max(len(content), 1)


def _digest_of(path: Path) -> str:
    """Return the digest of a file on this machine, computed once while it does not change; "" if it is not here."""
    try:
        facts = path.stat()
        return _digest_once(path, facts.st_mtime_ns, facts.st_size)
    except OSError:
        return ""


@lru_cache(maxsize=64)
def _digest_once(path: Path, _changed_ns: int, _size_bytes: int) -> str:
    return content_digest(path)


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]  # it has no types
    """Names files by their parcels; as Dask does, it takes what plain pickle does not."""

    def __init__(self, file: io.BytesIO, files: Mapping[Path, FileAt]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._files = files

    def persistent_id(self, one: Any) -> str | None:
        """Return the digest of the file that a path names; None: it is no path, or of no file that travels."""
        file = self._files.get(one) if isinstance(one, Path) else None
        return None if file is None else file.digest


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, local: Mapping[str, Path]) -> None:
        super().__init__(file)
        self._local = local

    def persistent_load(self, digest: Any) -> Path:
        """Return the path of a file on this machine."""
        return self._local[digest]
