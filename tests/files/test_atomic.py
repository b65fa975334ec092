"""Files that are whole or not there."""

from __future__ import annotations

import errno
import os
import stat
from typing import TYPE_CHECKING

import pytest

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_who_may_read_a_file_is_what_the_umask_says(tmp_path: Path, mask: int, mode: int) -> None:
    before = os.umask(mask)
    try:
        with whole_file(tmp_path / "a.press") as unfinished:
            unfinished.write_text("all of it")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.press").stat().st_mode) == mode


def test_a_file_that_is_not_finished_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("before")

    def half() -> None:
        with whole_file(tmp_path / "a.txt") as unfinished:
            unfinished.write_text("ha")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "before"


def test_a_full_disk_names_the_file(tmp_path: Path) -> None:
    def write() -> None:
        with whole_file(tmp_path / "p0001.tif"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match="No space left") as failed:
        write()
    assert failed.value.filename == str(tmp_path / "p0001.tif")


def test_a_name_of_the_greatest_length_can_be_written(tmp_path: Path) -> None:
    name = "n" * 251 + ".tif"
    with whole_file(tmp_path / name) as unfinished:
        unfinished.write_text("x")
    assert (tmp_path / name).read_text() == "x"
