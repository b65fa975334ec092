"""What is no journal is left as it is, and a journal is read wherever it lies."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.journal.journals import facts, record

from prooflight.files import lock
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Iterator

NOBODY = 65534


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


def write(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        journal.record(journal.begin_run(facts()), record(1))


def all_of(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that this process may read and not write: of another user, where it would be its master's."""
    folder = Path(tempfile.mkdtemp(dir="/tmp" if sys.platform != "win32" else None))
    folder.chmod(0o755)
    yield folder
    folder.chmod(0o755)
    shutil.rmtree(folder)


@contextlib.contextmanager
def only_reading(folder: Path) -> Iterator[None]:
    for file in folder.rglob("*"):
        file.chmod(0o555 if file.is_dir() else 0o444)
    folder.chmod(0o555)
    master = os.geteuid() == 0
    if master:
        os.seteuid(NOBODY)
    # Asked for are the rights of who acts, as SQLite has them, not of who began.
    real, os.access = os.access, lambda path, mode, **_: real(path, mode, effective_ids=True)
    try:
        yield
    finally:
        os.access = real
        if master:
            os.seteuid(0)


# --- files of others ---


@pytest.mark.parametrize("mode", ["DELETE", "WAL"])
@pytest.mark.parametrize("left", [False, True], ids=["closed", "with its log"])
def test_a_database_of_another_program_is_refused_to_the_last_byte(
    path: Path, tmp_path: Path, mode: str, left: bool
) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute(f"PRAGMA journal_mode = {mode}")
        connection.execute("CREATE TABLE songs (name)")
        connection.execute("INSERT INTO songs VALUES ('la')")
        connection.commit()
        if left:  # as a program leaves it that was killed
            copy = tmp_path / "copy"
            copy.mkdir()
            for file in (path, path.with_name(path.name + "-wal")):
                if file.exists():
                    shutil.copy(file, copy / file.name)
            path = copy / path.name
    before = all_of(path.parent)
    for read_only in (False, True):
        with pytest.raises(JournalError, match="is a database, but not a journal"):
            Journal.open(str(path), read_only=read_only)
        assert all_of(path.parent) == before


def test_a_journal_of_another_schema_is_left_to_the_last_byte(path: Path) -> None:
    write(path)
    path.with_name(path.name + ".lock").unlink()
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE journal SET schema = 7")
    before = all_of(path.parent)
    for read_only in (False, True):
        with pytest.raises(JournalError, match="has schema 7"):
            Journal.open(str(path), read_only=read_only)
        assert all_of(path.parent) == before


def test_a_new_journal_whose_writer_was_killed_is_gone_on_with(path: Path, tmp_path: Path) -> None:
    """Its tables stand in its own file at once, and what was written last in its log."""
    killed = tmp_path / "killed"
    killed.mkdir()
    with Journal.open(str(path)) as journal:
        journal.record(journal.begin_run(facts()), record(1))
        journal.commit()
        for suffix in ("", "-wal"):
            shutil.copy(f"{path}{suffix}", killed / f"{path.name}{suffix}")
    with Journal.open(str(killed / path.name), read_only=True) as journal:
        assert [page.sheet for page in journal.pages(1)] == [1]


def test_an_old_empty_one_with_all_its_tables_in_its_log_is_a_journal(path: Path, tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    killed.mkdir()
    with contextlib.closing(sqlite3.connect(path)) as new:
        new.execute("PRAGMA journal_mode = WAL")
        new.execute("PRAGMA wal_autocheckpoint = 0")
        tables = tmp_path / "tables.sqlite"
        write(tables)
        with contextlib.closing(sqlite3.connect(tables)) as other:
            new.executescript("\n".join(other.iterdump()))
        for suffix in ("", "-wal"):
            shutil.copy(f"{path}{suffix}", killed / f"{path.name}{suffix}")
    assert (killed / path.name).stat().st_size == 4096
    with Journal.open(str(killed / path.name), read_only=True) as journal:
        assert [page.sheet for page in journal.pages(1)] == [1]


@pytest.mark.parametrize("empty", [b"", b"\0" * 512], ids=["empty", "zeros"])
def test_an_empty_file_is_no_journal_to_read(path: Path, empty: bytes) -> None:
    path.write_bytes(empty)
    with pytest.raises(JournalError):
        Journal.open(str(path), read_only=True)
    assert all_of(path.parent) == {path.name: empty}


# --- names and places ---


@pytest.mark.parametrize(
    "name",
    [
        "a b.sqlite",
        "a?mode=ro.sqlite",
        "a#b.sqlite",
        "a%41.sqlite",
        "ä\n'\".sqlite",
        "pag\udce9.sqlite",
        "[x]",
    ],
)
def test_names_mean_nothing(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    write(path)
    assert path.is_file()
    with Journal.open(str(path), read_only=True) as journal:
        assert journal.page(1, 1).evidence is not None
    assert {file.name for file in tmp_path.iterdir()} == {name, f"{name}.lock", f"{name}.evidence"}


@pytest.mark.parametrize("read_only", [False, True])
def test_what_can_be_no_file_is_refused(tmp_path: Path, read_only: bool) -> None:
    (tmp_path / "file").write_text("x")
    os.mkfifo(tmp_path / "pipe")
    write(tmp_path / "j.sqlite")
    (tmp_path / "link.sqlite").symlink_to(tmp_path / "j.sqlite")
    for name, said in (
        ("", "is a folder"),
        ("pipe", "is not a file"),
        ("file/j.sqlite", "not a directory"),
        ("x" * 300, "name too long"),
        ("j\0.sqlite", "null"),
        ("link.sqlite", "is a link"),
    ):
        with pytest.raises(JournalError, match=said) as refusal:
            Journal.open(f"{tmp_path}/{name}", read_only=read_only)
        assert len(str(refusal.value).splitlines()) == 1


def test_passwords_in_urls_are_not_told() -> None:
    for url in (
        "postgresql://me:secret@host/runs",
        "sqlite://me:secret@host/x",
        "x://me:secret@h:port/x",
        "sqlite://h/x",
    ):
        with pytest.raises(JournalError) as refusal:
            Journal.open(url)
        assert "secret" not in str(refusal.value)


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_lock_that_is_no_file_is_refused(
    path: Path, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "PATIENCE_S", 0.0)
    write(path)
    file = path.with_name(path.name + ".lock")
    file.unlink()
    mine = tmp_path / "mine"
    mine.write_text("mine")
    if kind == "link":
        file.symlink_to(mine)
    elif kind == "pipe":
        os.mkfifo(file)
    else:
        file.mkdir()
    if kind != "pipe":  # a pipe can be locked as well as a file
        with pytest.raises(JournalError, match="cannot be written"):
            Journal.open(str(path))
    with Journal.open(str(path), read_only=True) as journal:
        assert journal.last_run().state == "interrupted"
    assert mine.read_text() == "mine"


# --- where nothing can be written ---


def test_a_journal_is_read_where_nothing_can_be_written(folder: Path) -> None:
    path = folder / "journal.sqlite"
    write(path)
    before = all_of(folder)
    with only_reading(folder), Journal.open(str(path), read_only=True) as journal:
        assert journal.page(journal.last_run().id, 1).evidence is not None
        assert journal.megabytes > 0
    assert all_of(folder) == before


def test_a_log_that_cannot_be_read_is_said(folder: Path) -> None:
    """Without it the last pages would be missing, and nobody would know."""
    path = folder / "journal.sqlite"
    write(path)
    with Journal.open(str(path)) as journal:
        journal.record(1, record(2))
        journal.commit()
        log = path.with_name(path.name + "-wal")
        content = log.read_bytes()
    log.write_bytes(content)
    with (
        only_reading(folder),
        pytest.raises(JournalError, match=r"its log journal\.sqlite-wal cannot be read.*copy both"),
    ):
        Journal.open(str(path), read_only=True)


def test_a_journal_cannot_be_written_where_nothing_can(folder: Path) -> None:
    for name in ("new.sqlite", "in/a/new.sqlite"):
        with only_reading(folder), pytest.raises(JournalError, match="cannot be written") as refusal:
            Journal.open(str(folder / name))
        assert "\n" not in str(refusal.value)


def test_numbers_that_no_run_has_are_no_run(path: Path) -> None:
    write(path)
    with Journal.open(str(path), read_only=True) as journal:
        for number in (-1, 0, 10**20, 2**63):
            with pytest.raises(JournalError, match="there is no run"):
                journal.run(number)
            with pytest.raises(JournalError, match=r"there is no run|has no sheet"):
                journal.page(1, number)
