"""Evidence is never removed but by tidying, and then only files that a row of the journal names."""

from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, files_of, record
from sqlalchemy.exc import OperationalError

from prooflight_line.journal import packs, rows
from prooflight_line.journal.aside import unclaimed_folder
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import Retention, RunEnd, Tidied
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    import zipfile

LATER_S = 1e7


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Three runs with a pack each; the last goes on."""
    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        for number in range(3):
            run = journal.begin_run(facts(started_s=1000.0 * number))
            journal.record(run, record(1))
            journal.end_run(run, RunEnd(ended_s=1000.0 * number + 1, ending="finished"))
    return path


def change(path: Path, statement: str, *values: object) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(statement, values)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()
    }


def tidied(path: Path, retention: Retention) -> Tidied:
    with Journal.open(str(path), announce=lambda _: None) as journal:
        return journal.tidy(retention, now_s=LATER_S)


# --- opening ---


def test_evidence_of_a_database_that_was_moved_away_is_kept_and_taken_back(
    path: Path, tmp_path: Path
) -> None:
    evidence, aside = packs.evidence_folder(path), unclaimed_folder(path)
    before = contents(evidence)
    path.rename(tmp_path / "away.sqlite")
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        journal.tidy(Retention(megabytes=0.001), now_s=0.0)
        assert journal.unclaimed is not None
        assert journal.unclaimed.moved == 3
    assert contents(aside) == before
    assert len(said) == 1
    assert "3 files" in said[0]
    assert str(aside) in said[0]
    (tmp_path / "away.sqlite").rename(path)
    with Journal.open(str(path), announce=said.append) as journal:
        assert [journal.page(run, 1).evidence is None for run in (1, 2, 3)] == [False] * 3
    assert contents(evidence) == before
    assert not contents(aside)
    assert "3 files that the journal names again were moved back" in said[1]


def test_an_older_copy_of_the_database_keeps_what_it_does_not_name(path: Path) -> None:
    older, names = path.read_bytes(), files_of(path)
    with Journal.open(str(path)) as journal:
        journal.record(journal.begin_run(facts()), record(1))
    (newer,) = set(files_of(path)) - set(names)
    content = newer.read_bytes()
    path.write_bytes(older)
    Journal.open(str(path), announce=lambda _: None).close()
    assert files_of(path) == names
    assert (unclaimed_folder(path) / newer.parent.name / newer.name).read_bytes() == content


def test_a_log_without_its_journal_is_not_thrown_away(path: Path, tmp_path: Path) -> None:
    with Journal.open(str(path)) as journal:
        journal.record(journal.begin_run(facts()), record(1))
        journal.commit()
        log = path.with_name(path.name + "-wal")
        content = log.read_bytes()
    path.unlink()
    log.write_bytes(content)
    for read_only in (False, True):
        with pytest.raises(JournalError, match="put the journal back"):
            Journal.open(str(path), read_only=read_only)
    assert log.read_bytes() == content


@pytest.mark.parametrize("which", ["evidence", "unclaimed"])
def test_a_folder_that_is_a_link_is_refused_and_what_it_points_to_left_alone(
    path: Path, tmp_path: Path, which: str
) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "photo.raw").write_bytes(b"mine")
    folder = packs.evidence_folder(path) if which == "evidence" else unclaimed_folder(path)
    if folder.exists():
        folder.rename(tmp_path / "elsewhere")
    folder.symlink_to(mine)
    with pytest.raises(JournalError, match="is a link"):
        Journal.open(str(path))
    assert contents(mine) == {"photo.raw": b"mine"}
    with Journal.open(str(path), read_only=True) as journal:  # rows can be read, evidence where it is no link
        assert len(list(journal.pages(1))) == 1
        if which == "evidence":
            with pytest.raises(JournalError, match="is a link"):
                journal.page(1, 1)


def test_links_among_evidence_are_left_and_told(path: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "photo.raw").write_bytes(b"mine")
    evidence = packs.evidence_folder(path)
    (evidence / "photos").symlink_to(mine)
    (evidence / "run000001" / "photo.npz").symlink_to(mine / "photo.raw")
    said: list[str] = []
    Journal.open(str(path), announce=said.append).close()
    assert contents(mine) == {"photo.raw": b"mine"}
    assert (evidence / "photos").is_symlink()
    assert ["2 files that are not evidence" in line for line in said] == [True]


def test_what_is_put_aside_overwrites_nothing(path: Path) -> None:
    stranger = packs.evidence_folder(path) / "notes.txt"
    aside = unclaimed_folder(path) / "notes.txt"
    aside.parent.mkdir()
    aside.write_text("older")
    stranger.write_text("newer")
    Journal.open(str(path), announce=lambda _: None).close()
    assert (stranger.read_text(), aside.read_text()) == ("newer", "older")


def test_no_pack_is_ever_overwritten(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = files_of(path)[2]
    before = file.read_bytes()
    with pytest.raises(FileExistsError):
        packs.write_pack(file, {1: {"values": np.zeros(3)}})
    monkeypatch.setattr(packs, "pack_name", lambda _run, _sheet: f"{file.parent.name}/{file.name}")
    with Journal.open(str(path), announce=lambda _: None) as journal:
        journal.record(3, record(2))
        assert not journal.commit()
        monkeypatch.undo()
        assert journal.commit()
        assert journal.page(3, 2).evidence is not None
    assert file.read_bytes() == before


# --- writing ---


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_pack_that_fails_to_be_written_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    """The disk is full at the second sheet."""
    write = packs.write_arrays

    def full(archive: zipfile.ZipFile, sheet: int, arrays: Any) -> None:
        if sheet == 2:
            raise error
        write(archive, sheet, arrays)

    monkeypatch.setattr(packs, "write_arrays", full)
    file = tmp_path / "run000001" / "p.npz"
    with pytest.raises(type(error)):
        packs.write_pack(file, {sheet: {"values": np.zeros(3)} for sheet in (1, 2)})
    assert list(tmp_path.rglob("*.npz")) == []
    monkeypatch.undo()
    assert packs.write_pack(file, {1: {"values": np.zeros(3)}}) == file.stat().st_size


def test_packs_of_rows_that_fail_to_be_written_do_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.sqlite"

    def busy(*_: Any) -> None:
        raise OperationalError("INSERT", {}, sqlite3.OperationalError("database is locked"))

    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1))
        with monkeypatch.context() as patched:
            patched.setattr(rows, "write_rows", busy)
            assert not journal.commit()
        assert files_of(path) == []
        assert journal.commit()
        assert len(files_of(path)) == 1


# --- tidying ---

NAMES = (
    "../out/x",
    "/{tmp}/out/x",
    "run000001/../../out/x",
    "..",
    "",
    ".",
    "run000001",
    "run1/x.npz",
    "a\nb",
)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("retention", [Retention(days=1.0), Retention(megabytes=0.001)], ids=["days", "size"])
def test_a_row_that_names_a_file_elsewhere_removes_nothing(
    path: Path, tmp_path: Path, name: str, retention: Retention
) -> None:
    out = tmp_path / "out" / "x"
    out.parent.mkdir()
    out.write_bytes(b"mine")
    _, second, third = files_of(path)
    change(path, "UPDATE packs SET file = ? WHERE id = 1", name.format(tmp=str(tmp_path).lstrip("/")))
    done = tidied(path, retention)
    assert out.read_bytes() == b"mine"
    assert 2 in done.runs
    assert done.packs == (2 if retention.megabytes < 1 else 1)
    assert not second.exists()
    assert third.exists() == (done.packs == 1)
    assert len(done.refused) == 1
    assert "evidence 1 stays" in done.refused[0]
    assert len(list(unclaimed_folder(path).rglob("*.npz"))) == 1  # what the row named before


def test_a_row_that_names_evidence_of_another_run_does_not_remove_it(path: Path) -> None:
    last = files_of(path)[2]
    change(path, "DELETE FROM packs WHERE id = 3")
    change(path, "UPDATE pages SET pack_id = NULL WHERE run_id = 3")
    change(path, "UPDATE packs SET file = ? WHERE id = 1", f"{last.parent.name}/{last.name}")
    done = tidied(path, Retention(days=1.0))
    assert done.runs == [1, 2]
    assert "is not the name of a pack of run 1" in done.refused[0]
    assert last.exists()


def test_a_pack_or_a_folder_that_became_a_link_is_not_followed(path: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    first, second, _ = files_of(path)
    for number, file in enumerate((first, second)):
        (mine / file.name).write_bytes(file.read_bytes())
        file.unlink()
        if number:
            file.parent.rmdir()
            file.parent.symlink_to(mine)
        else:
            file.symlink_to(mine / file.name)
    before = contents(mine)
    done = tidied(path, Retention(days=1.0))
    assert done.runs == [1, 2]
    assert done.packs == 0
    assert ["is a link" in line for line in done.refused] == [True, True]
    assert contents(mine) == before


@pytest.mark.parametrize("size", [10**15, -(10**15), "much", None, 2.5])
def test_sizes_that_rows_claim_remove_nothing(path: Path, size: object) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'bytes INTEGER NOT NULL', 'bytes')")
    change(path, "UPDATE packs SET bytes = ? WHERE id = 2", size)
    done = tidied(path, Retention(megabytes=1.0))
    assert (done.runs, done.packs, len(files_of(path))) == ([], 0, 3)


def test_a_run_whose_row_is_damaged_stays_and_the_rest_goes(path: Path) -> None:
    change(path, "UPDATE runs SET ended_s = 'long ago' WHERE id = 1")
    done = tidied(path, Retention(days=1.0))
    assert done.runs == [2]
    assert ["run 1 stays" in line for line in done.refused] == [True]
    assert len(files_of(path)) == 2


def test_what_tidying_did_is_returned(path: Path) -> None:
    size = sum(file.stat().st_size for file in files_of(path)[:2])
    done = tidied(path, Retention(days=1.0))
    assert (done.runs, done.packs, done.pack_bytes, done.refused) == ([1, 2], 2, size, [])


def test_evidence_on_a_disk_that_is_not_there_keeps_its_rows(path: Path, tmp_path: Path) -> None:
    folder = packs.evidence_folder(path)
    folder.rename(tmp_path / "elsewhere")
    with Journal.open(str(path)) as journal:
        journal.tidy(Retention(megabytes=journal.megabytes - 1e-6), now_s=0.0)
        (tmp_path / "elsewhere").rename(folder)
        assert journal.page(3, 1).evidence is not None


def test_a_sheet_that_is_told_again_puts_its_first_evidence_aside(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        journal.record(3, replace(record(1), late=True))
    Journal.open(str(path), announce=lambda _: None).close()
    assert len(files_of(path)) == 3
    assert len(list(unclaimed_folder(path).rglob("*.npz"))) == 1
