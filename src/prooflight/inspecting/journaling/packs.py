"""Evidence of pages as compressed files beside the database: one for all pages that were committed together.

A pack is a NumPy archive (``numpy.load`` opens it) whose arrays are named SHEET/NAME.
"""

from __future__ import annotations

import os
import secrets
import zipfile
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

SUFFIX: Final = ".npz"
LEVEL: Final = 1
"""Of deflate: noise gains nothing from a higher one."""


def evidence_folder(database: Path) -> Path:
    """Where packs of a journal lie."""
    return database.with_name(database.name + ".evidence")


def pack_name(run_id: int, first_sheet: int) -> str:
    """A name below the folder that no pack had before, so that no row's evidence is ever overwritten."""
    return f"run{run_id:06}/{first_sheet:08}-{secrets.token_hex(4)}{SUFFIX}"


def write_pack(path: Path, pages: Mapping[int, Mapping[str, NDArray[Any]]]) -> int:
    """Write evidence by sheet, on the disk when this returns, whole or not at all; returns its bytes."""
    with whole_file(path) as unfinished:
        with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
            for sheet, arrays in pages.items():
                for name, array in arrays.items():
                    with archive.open(f"{sheet}/{name}.npy", "w") as member:
                        np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
        with unfinished.open("rb") as file:
            os.fsync(file.fileno())
        size = unfinished.stat().st_size
    for folder in path.parents[:2]:
        _sync_folder(folder)
    return size


def read_pack(path: Path, sheet: int) -> dict[str, NDArray[Any]]:
    """One sheet's arrays; FileNotFoundError, or ValueError where the pack is damaged."""
    begin = f"{sheet}/"
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {
                name.removeprefix(begin): archive[name] for name in archive.files if name.startswith(begin)
            }
    except (zipfile.BadZipFile, EOFError) as error:
        raise ValueError(str(error)) from error


def remove_strangers(folder: Path, known: Collection[str]) -> int:
    """Remove files that no row names: what a writer left that died between file and row. Returns how many."""
    strangers = [
        path
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).as_posix() not in known
    ]
    for path in strangers:
        path.unlink(missing_ok=True)
    return len(strangers)


def _sync_folder(folder: Path) -> None:
    """Make a new name durable; systems that cannot open a folder need no such thing."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
