"""Backup of a journal while it is written, and its restoration: the same rows, nothing overwritten."""

from __future__ import annotations

import json
import shutil
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, files_of, record
from tests.cli.calls import call

from prooflight.errors import RequestError
from prooflight_line.journal.backup import MANIFEST, back_up, restore
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, labels_path
from prooflight_line.journal.schema import JournalError


def write(path: Path, sheets: int = 6) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        for sheet in range(sheets):
            journal.record(run, record(sheet))
            journal.commit()


def accounts(path: Path) -> Path:
    """A stand-in for the console's file, with a log that holds the last row."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE people (name)")
        database.execute("INSERT INTO people VALUES ('Ann')")
        database.commit()
    return path


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """A journal of two runs, with labels, a console's file and a gate's log."""
    path = tmp_path / "press" / "runs.sqlite"
    write(path)
    write(path)
    with Journal.open(str(path), read_only=True) as opened:
        run = opened.last_run()
    LabelStore(path).say("misprint", run=f"{run.id}@1000", by="Ann", at_s=1.0, sheet=3)
    accounts(path.with_name("runs.sqlite.console.sqlite"))
    gate = path.with_name("runs.sqlite.gate")
    gate.mkdir()
    (gate / "run000001.jsonl").write_text('{"sheet": 1}\n')
    return path


def rows(path: Path) -> list[tuple[int, int, float, bytes]]:
    """What a journal holds of each sheet, with its evidence."""
    with Journal.open(str(path), read_only=True) as opened:
        found = []
        for run in opened.runs():
            for page in opened.pages(run.id):
                whole = opened.page(run.id, page.sheet)
                assert whole.evidence is not None
                found.append(
                    (
                        run.id,
                        page.sheet,
                        page.verdict.score or 0.0,
                        np.asarray(whole.evidence["values"]).tobytes(),
                    )
                )
        return found


def test_what_is_restored_is_what_was_backed_up(journal: Path, tmp_path: Path) -> None:
    press = tmp_path / "my.press"
    press.write_bytes(b"a press")
    done = back_up(journal, tmp_path / "backups" / "monday", presses=[press])
    assert done.missing == ()
    assert len(done.files) == 3 + 12 + 1 + 1  # three databases, packs, the gate's log, the press
    other = tmp_path / "other" / "named-otherwise.sqlite"
    restored = restore(done.folder, other, presses=tmp_path / "presses")
    assert len(restored) == len(done.files)
    assert restored[-1] == other
    assert rows(other) == rows(journal)
    assert len(files_of(other)) == len(files_of(journal)) == 12
    assert (tmp_path / "presses" / "my.press").read_bytes() == b"a press"
    assert (
        other.with_name("named-otherwise.sqlite.gate").joinpath("run000001.jsonl").read_text()
        == '{"sheet": 1}\n'
    )
    assert LabelStore(other).last() == LabelStore(journal).last() > 0
    with closing(sqlite3.connect(f"{other}.console.sqlite")) as database:
        assert database.execute("SELECT name FROM people").fetchall() == [("Ann",)]
    with Journal.open(str(other)) as opened:  # and it is written on
        opened.begin_run(facts())
    assert not other.with_name("named-otherwise.sqlite.unclaimed").exists()


def test_a_journal_is_backed_up_while_it_is_written(tmp_path: Path) -> None:
    path, ended = tmp_path / "runs.sqlite", threading.Event()
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(0))
        journal.commit()

        def print_on() -> None:
            sheet = 1
            while not ended.is_set():
                journal.record(run, record(sheet))
                journal.commit()
                sheet += 1

        printing = threading.Thread(target=print_on)
        printing.start()
        try:
            for number in range(4):
                before = rows(path)
                done = back_up(path, tmp_path / f"backup-{number}")
                after = rows(path)
                other = tmp_path / f"restored-{number}" / "runs.sqlite"
                restore(done.folder, other, presses=other.parent)
                found = rows(other)
                assert before == found[: len(before)]  # nothing that was durable is missing,
                assert found == after[: len(found)]  # and evidence belongs to its rows
                assert done.missing == ()
        finally:
            ended.set()
            printing.join()


def test_nothing_is_overwritten_and_an_interrupted_restoration_goes_on(journal: Path, tmp_path: Path) -> None:
    done = back_up(journal, tmp_path / "backup")
    with pytest.raises(RequestError, match="exists already; give a new folder"):
        back_up(journal, tmp_path / "backup")
    before = {path: path.read_bytes() for path in journal.parent.rglob("*") if path.is_file()}
    labels = labels_path(journal)
    labels.write_bytes(labels.read_bytes() + b"said since")
    with pytest.raises(
        RequestError, match=r"runs\.sqlite\.words\.sqlite: exists already, with another content"
    ):
        restore(done.folder, journal, presses=journal.parent)
    labels.write_bytes(before[labels])
    other = tmp_path / "other" / "runs.sqlite"
    restore(done.folder, other, presses=other.parent)
    other.unlink()
    assert restore(done.folder, other, presses=other.parent) == [other]  # the rest is there already
    assert restore(done.folder, other, presses=other.parent) == []
    assert not list(tmp_path.rglob("*.part"))
    other.unlink()
    other.with_name("runs.sqlite-wal").write_bytes(b"of another")
    with pytest.raises(RequestError, match="is the log of another journal"):
        restore(done.folder, other, presses=other.parent)


@pytest.mark.parametrize("damage", ["bit", "short", "missing", "manifest", "outside", "format", "none"])
def test_a_damaged_backup_restores_nothing(journal: Path, tmp_path: Path, damage: str) -> None:
    folder = back_up(journal, tmp_path / "backup").folder
    file, manifest = sorted((folder / "journal.sqlite.evidence").rglob("*.npz"))[3], folder / MANIFEST
    content, listed = file.read_bytes(), json.loads(manifest.read_text())
    match damage:
        case "bit":
            file.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
        case "short":
            file.write_bytes(content[:-1])
        case "missing":
            file.unlink()
        case "manifest":
            manifest.write_text("{")
        case "outside":
            listed["files"][0]["path"] = "journal.sqlite/../../../evil"
            manifest.write_text(json.dumps(listed))
        case "format":
            manifest.write_text(json.dumps(listed | {"format": 2}))
        case "none":
            shutil.rmtree(folder)
    other = tmp_path / "other" / "runs.sqlite"
    with pytest.raises(RequestError, match=r"damaged|not a backup|format 2"):
        restore(folder, other, presses=other.parent)
    assert not other.parent.exists()


def test_a_backup_that_fails_leaves_nothing(journal: Path, tmp_path: Path) -> None:
    database = journal.with_name("runs.sqlite.console.sqlite")
    database.write_bytes(database.read_bytes()[:4096] + b"\xff" * 4096)
    with pytest.raises(
        JournalError, match=r"runs\.sqlite\.console\.sqlite: (cannot be backed up|is damaged)"
    ):
        back_up(journal, tmp_path / "backup")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["press"]
    with pytest.raises(JournalError, match="there is no journal"):
        back_up(tmp_path / "none.sqlite", tmp_path / "backup")


def test_missing_evidence_is_said(journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files_of(journal)[0].unlink()
    code, out, err = call(capsys, "backup", "-o", tmp_path / "backup", "--journal", journal, "--json")
    assert code == 1
    assert len(json.loads(out)["missing"]) == 1
    assert "1 file of evidence" in err
    other = tmp_path / "other.sqlite"
    code, out, _ = call(capsys, "restore", tmp_path / "backup", "--journal", other)
    assert code == 0
    assert "2 runs in the journal" in out
    code, _, err = call(capsys, "restore", tmp_path / "press", "--journal", other)
    assert code == 2
    assert "is not a backup; give a folder that `prooflight backup` made" in err
