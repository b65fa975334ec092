"""Files among a journal's evidence that no row names: put aside, never removed, and taken back when a row names them.

They come of a writer that died between file and rows, of a sheet that was recorded again, or of a database that was
moved away or put back from an older copy; nobody but a person can tell which.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from prooflight.journal.packs import evidence_folder, refuse_other

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Unclaimed:
    """What opening a journal found."""

    evidence: Path
    aside: Path
    moved: int = 0
    """Files, into ``aside``."""
    moved_bytes: int = 0
    taken_back: int = 0
    left: int = 0
    """Links and whatever else is no plain file, and files that could not be moved; they lie where they were."""

    @classmethod
    def nothing(cls, database: Path) -> Self:
        """Before anything was looked at."""
        return cls(evidence=evidence_folder(database), aside=unclaimed_folder(database))

    @property
    def told(self) -> list[str]:
        """For people."""
        said = []
        if self.moved:
            size = f"{_files(self.moved)} ({self.moved_bytes / 1e6:.1f} MB) that no page of the journal names"
            said.append(f"{self.evidence}: {size} went to {self.aside}; remove them if nobody needs them")
        if self.taken_back:
            said.append(
                f"{self.aside}: {_files(self.taken_back)} that the journal names again were taken back"
            )
        if self.left:
            said.append(
                f"{self.evidence}: {_files(self.left)} that are no evidence, or could not be moved, stay there"
            )
        return said


def unclaimed_folder(database: Path) -> Path:
    """Where files are put that no row names: beside the evidence, so that among it lies nothing else."""
    return database.with_name(database.name + ".unclaimed")


def put_aside(database: Path, named: Collection[str]) -> Unclaimed:
    """Move what no row names out of the evidence, and back what one names; JournalError: a link is in the way."""
    found = Unclaimed.nothing(database)
    evidence, aside = found.evidence, found.aside
    for folder in (evidence, aside):
        refuse_other(folder, stat.S_ISDIR)
    taken_back = sum(
        _moved(aside, evidence, name) for name, status in _below(aside) if name in named and _plain(status)
    )
    moved = size = left = 0
    for name, status in _below(evidence):
        if name in named and _plain(status):
            continue
        if _plain(status) and _moved(evidence, aside, name):
            moved, size = moved + 1, size + status.st_size
        else:
            left += 1
    return replace(found, moved=moved, moved_bytes=size, taken_back=taken_back, left=left)


def _below(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """All but folders, by their names below this one; links are not followed."""
    for here, folders, files in os.walk(folder):
        for name in (*files, *folders):
            path = os.path.join(here, name)  # noqa: PTH118  # a million paths are made here
            status = os.lstat(path)
            if not stat.S_ISDIR(status.st_mode):
                yield os.path.relpath(path, folder).replace(os.sep, "/"), status


def _plain(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode)


def _moved(source: Path, target: Path, name: str) -> bool:
    """Whether it could be moved; nothing is overwritten."""
    end = target / name
    try:
        end.parent.mkdir(parents=True, exist_ok=True)
        if any(folder.is_symlink() for folder in end.parents if target in (folder, *folder.parents)):
            return False
        if os.path.lexists(end):
            return False
        (source / name).rename(end)
    except OSError:
        return False
    return True


def _files(count: int) -> str:
    return f"{count:,} {'file' if count == 1 else 'files'}"
