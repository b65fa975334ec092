"""Cache of the results of a study that is computed in pieces, so that an interrupted study resumes.

A study is a list of pieces, each small and picklable, and work that computes arrays of rows of a piece. Results are
stored in ``folder/<digest>/``, one file for each piece, named by the piece's ``repr``: of a study with more pieces only
the new ones are computed. The digest covers everything else that the results depend on. Damaged files are reported and
computed again.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import struct
import time
import zipfile
import zlib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

import numpy as np

from prooflight.files.atomic import whole_file
from prooflight.pages.parallel import in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.parallel import Processes

Rows = dict[str, "NDArray[Any]"]
"""Columns by name; the first axis of each counts rows (columns of counts may have another length)."""
Piece = TypeVar("Piece")
PieceIn = TypeVar("PieceIn", contravariant=True)


_log = logging.getLogger(__name__)
SPENT: Final = "seconds spent"
"""Column with the wall-clock time of a piece, stored with its rows."""


class Work(Protocol[PieceIn]):
    """Computation of the rows of a piece; picklable."""

    def __call__(self, piece: PieceIn, /) -> Rows:
        """Return the rows of one piece, which depend neither on the process nor on the time."""
        ...


def digest_of(facts: Mapping[str, Any]) -> str:
    """Return the SHA-256 of everything that results depend on; facts: values fit for JSON."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def run_pieces(
    work: Work[Piece],
    pieces: Sequence[Piece],
    folder: Path,
    *,
    digest: str,
    processes: Processes = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> Rows:
    """Return the rows of all pieces, in their order; those that are in ``folder`` are not computed again.

    processes: of this machine, or the workers of a cluster, which need no access to ``folder``. progress is called with
    the number of pieces done and of all pieces.
    """
    paths = _paths(pieces, folder, digest)
    missing = [(path, piece) for path, piece in zip(paths, pieces, strict=True) if not _whole(path)]
    done = len(pieces) - len(missing)
    progress(done, len(pieces))
    for _ in _computed(work, missing, processes):
        done += 1
        progress(done, len(pieces))
    columns: dict[str, list[NDArray[Any]]] = defaultdict(list)
    for path in paths:
        for name, column in _load(path).items():
            if name != SPENT:
                columns[name].append(column)
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def stored(pieces: Sequence[Piece], folder: Path, *, digest: str) -> list[Piece]:
    """Return the pieces whose rows are in ``folder``, in their order."""
    paths = _paths(pieces, folder, digest)
    return [piece for path, piece in zip(paths, pieces, strict=True) if _whole(path)]


def minutes_spent(pieces: Sequence[Any], folder: Path, *, digest: str) -> float:
    """Return the minutes of one process that the pieces took when they were computed, over all runs."""
    seconds = 0.0
    for path in _paths(pieces, folder, digest):
        seconds += float(_load(path).get(SPENT, 0.0))
    return seconds / 60


def _paths(pieces: Sequence[Any], folder: Path, digest: str) -> list[Path]:
    return [folder / digest[:16] / f"{digest_of({'piece': repr(piece)})[:16]}.npz" for piece in pieces]


def _computed(work: Work[Any], missing: Sequence[tuple[Path, Any]], processes: Processes) -> Iterator[None]:
    """Compute and store pieces: a process stores its own, and those of a cluster are stored here as they finish."""
    timed = _TimedWork(work)
    if processes is None or isinstance(processes, int):
        yield from in_order(_CachedWork(timed), missing, processes=processes)
        return
    for place, rows in processes.as_finished(timed, [piece for _, piece in missing]):
        _store(missing[place][0], rows)
        yield


@dataclass(frozen=True, slots=True)
class _TimedWork:
    """Computation of a piece's rows, with the time that it took."""

    work: Work[Any]

    def __call__(self, piece: Any) -> Rows:
        started = time.perf_counter()
        rows = self.work(piece)
        return rows | {SPENT: np.array(time.perf_counter() - started)}


@dataclass(frozen=True, slots=True)
class _CachedWork:
    """Computation of a piece's rows that writes them, whole or not at all."""

    timed: _TimedWork

    def __call__(self, place: tuple[Path, Any]) -> None:
        path, piece = place
        _store(path, self.timed(piece))


def _store(path: Path, rows: Rows) -> None:
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **rows)


def _whole(path: Path) -> bool:
    """Return whether a piece's rows are stored; a file that holds none is reported as damaged."""
    if not path.exists():
        return False
    try:
        return bool(_load(path))
    except _DAMAGE:
        _log.warning("%s is damaged and is computed again", path)
        return False


_DAMAGE: Final = (
    *(OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error),
    *(NotImplementedError, RuntimeError, MemoryError),  # packed in a way that is not ours, or with a password
)
"""Errors that reading a damaged archive of arrays raises."""


_END: Final = struct.Struct("<4s4H2LH")
"""End record of an archive (APPNOTE.TXT of PKWARE, section 4.3.16); the fifth field counts its members."""


def _load(path: Path) -> Rows:
    """Return the arrays of a piece as ``_store`` wrote them; raises one of ``_DAMAGE`` for a damaged file."""
    with path.open("rb") as file:
        file.seek(-_END.size, io.SEEK_END)
        members = _END.unpack(file.read())[4]  # Python's own reader does not check it
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            rows = dict(archive)
    if len(rows) != members:
        raise ValueError("it does not hold as many columns as it states")
    return rows
