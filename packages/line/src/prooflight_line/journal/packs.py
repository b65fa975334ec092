"""Evidence of pages as compressed files next to the database: one for all pages that were committed together.

A pack is a NumPy archive (``numpy.load`` opens it) whose arrays are named SHEET/NAME. A file's name in a row is
accepted only if it is a name that a journal gives, and nothing on its path is a link.
"""

from __future__ import annotations

import os
import secrets
import stat
import zipfile
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from prooflight.files.atomic import sync_folder
from prooflight.files.lock import PLAIN
from prooflight_line.journal.arrays import checked_archive, read_arrays, write_arrays
from prooflight_line.journal.columns import MOST_PACK_BYTES, PACK_NAME
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Collection, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

SUFFIX: Final = ".npz"
LEVEL: Final = 1
"""Level of deflate: noise gains nothing from a higher one."""


def evidence_folder(database: Path) -> Path:
    """Return the folder of a journal's packs."""
    return database.with_name(database.name + ".evidence")


def pack_name(run_id: int, first_sheet: int) -> str:
    """Return a new, unique name below the folder, so that no row's evidence is ever overwritten."""
    return f"run{run_id:06}/{first_sheet:08}-{secrets.token_hex(4)}{SUFFIX}"


def inside(folder: Path, file: object) -> Path:
    """Return the path of a pack in a journal's folder; JournalError: invalid name, or a link on the path."""
    if not isinstance(file, str) or not PACK_NAME.fullmatch(file):
        what = f"{str(file)!r} is not the name of a file of evidence"
        raise JournalError(folder, what, remedy="nothing of that name is read or removed")
    path = folder / file
    for part, wanted in ((folder, stat.S_ISDIR), (path.parent, stat.S_ISDIR), (path, stat.S_ISREG)):
        refuse_other(part, wanted)
    return path


def refuse_other(path: Path, wanted: Any) -> None:
    """Raise JournalError if a path exists and is not ``wanted``, a test of ``stat``; a link never is."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    except NotADirectoryError as error:
        raise JournalError(path, "is inside a file, not a folder", remedy="restore its folder") from error
    if not wanted(mode):
        what = "is a link" if stat.S_ISLNK(mode) else "is not what a journal stores there"
        raise JournalError(
            path, what, remedy="evidence is stored in plain files and folders; restore the original one"
        )


def write_pack(path: Path, pages: Mapping[int, Mapping[str, NDArray[Any]]]) -> int:
    """Write evidence by sheet into a new file, durable when this returns; return its bytes.

    OSError, FileExistsError among them: nothing is overwritten, and no part of the file stays. A process that
    dies here leaves a file that no row names.
    """

    def write(archive: zipfile.ZipFile) -> None:
        for sheet, arrays in pages.items():
            write_arrays(archive, sheet, arrays)

    return _written(path, write)


def _written(path: Path, write: Callable[[zipfile.ZipFile], None]) -> int:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as file:
        try:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
                write(archive)
            file.flush()
            os.fsync(file.fileno())
            size = os.fstat(file.fileno()).st_size
        except BaseException:
            path.unlink(missing_ok=True)
            raise
    for folder in path.parents[:2]:
        sync_folder(folder)
    return size


def read_pack(path: Path, sheet: int) -> dict[str, NDArray[Any]]:
    """Read one sheet's arrays; FileNotFoundError, or ValueError if the pack is damaged."""
    handle = os.open(path, os.O_RDONLY | PLAIN)
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError("it is not a file")
        return read_arrays(file, sheet)


def remove_pack(folder: Path, file: object) -> int:
    """Remove a pack that a row named; return its bytes, 0 if it is missing. JournalError as ``inside``."""
    path = inside(folder, file)
    try:
        size = path.lstat().st_size
        path.unlink()
    except FileNotFoundError:
        return 0
    return size


def bytes_of(path: Path, names: Collection[re.Pattern[str]]) -> int:
    """Return the size of a pack's arrays with such names; OSError, or ValueError if it is damaged."""
    with _opened(path) as archive:
        return sum(member.compress_size for member in archive.infolist() if _named(member, names))


def write_without(path: Path, out: Path, names: Collection[re.Pattern[str]]) -> int:
    """Write a pack again without the arrays of such names, durable when this returns; return its bytes.

    0: nothing would be left, and nothing was written. Errors as ``write_pack`` and ``bytes_of``.
    """
    with _opened(path) as archive:
        left = [member for member in archive.infolist() if not _named(member, names)]
        if sum(member.file_size for member in left) > MOST_PACK_BYTES:
            raise ValueError("its arrays would take more than a gigabyte")
        arrays = {member.filename: archive.read(member) for member in left}

    def write(into: zipfile.ZipFile) -> None:
        for name, array in arrays.items():
            with into.open(name, "w") as member:
                member.write(array)

    return _written(out, write) if arrays else 0


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open a pack's archive; ValueError, also later, for a damaged one."""
    handle = os.open(path, os.O_RDONLY | PLAIN)
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError("it is not a file")
        with checked_archive(file) as archive:
            yield archive


def _named(member: zipfile.ZipInfo, names: Collection[re.Pattern[str]]) -> bool:
    name = member.filename.rpartition("/")[2].removesuffix(".npy")
    return any(pattern.fullmatch(name) for pattern in names)
