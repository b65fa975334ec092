"""Evidence of pages as compressed files next to the database: one for all pages that were committed together.

A pack is a NumPy archive (``numpy.load`` opens it) whose arrays are named SHEET/NAME. A file's name in a row is
accepted only if it is a name that a journal gives, and nothing on its path is a link.
"""

from __future__ import annotations

import os
import secrets
import stat
import zipfile
from typing import TYPE_CHECKING, Any, Final

from prooflight.files.atomic import sync_folder
from prooflight.files.lock import PLAIN
from prooflight_line.journal.arrays import read_arrays, write_arrays
from prooflight_line.journal.columns import PACK_NAME
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Mapping
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
        what = f"{str(file)!r} is no name of a file of evidence"
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
        raise JournalError(path, "lies in a file", remedy="put its folder back") from error
    if not wanted(mode):
        what = "is a link" if stat.S_ISLNK(mode) else "is not what a journal puts there"
        raise JournalError(
            path, what, remedy="evidence lies in plain files and folders; put what was there back"
        )


def write_pack(path: Path, pages: Mapping[int, Mapping[str, NDArray[Any]]]) -> int:
    """Write evidence by sheet into a new file, durable when this returns; return its bytes.

    OSError, FileExistsError among them: nothing is overwritten, and no part of the file stays. A process that
    dies here leaves a file that no row names.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as file:
        try:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
                for sheet, arrays in pages.items():
                    write_arrays(archive, sheet, arrays)
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
            raise ValueError("it is no file")
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
