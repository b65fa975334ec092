"""What a journal holds is in the database once, whatever is cut off on the way."""

from __future__ import annotations

import math
import shutil
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import psycopg
import pytest
from packages.line.tests.journal.journals import facts, files_of, record
from packages.line.tests.records.conftest import misprint

from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key
from prooflight_line.journal.records import PageRecord, Retention, RunEnd
from prooflight_line.records import service as service_module
from prooflight_line.records.database import RecordsError, connect
from prooflight_line.records.pictures import ObjectStore
from prooflight_line.records.service import ShippingService
from prooflight_line.records.shipping import LinkDownError, Shipper
from prooflight_line.testing.postgres import local_postgres

Open = Callable[..., Shipper]


def rows_of(url: str, query: str) -> list[tuple[Any, ...]]:
    with connect(url) as connection:
        return connection.execute(query).fetchall()


def shipped(shipper: Shipper) -> int:
    """Ship all; the number of sheets."""
    total = 0
    while (step := shipper.step()).sheets or step.labels or step.more:
        total += step.sheets
    return total


def write(path: Path, *pages: PageRecord, started_s: float = 1000.0, end: bool = False) -> int:
    with Journal.open(str(path)) as journal:
        unfinished = [one.id for one in journal.runs() if one.end is None]
        run = unfinished[-1] if unfinished else journal.begin_run(facts(started_s=started_s))
        for page in pages:
            journal.record(run, page)
        if end:
            journal.end_run(run, RunEnd(ended_s=started_s + 60.0, ending="finished"))
    return run


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


def test_every_sheet_is_shipped_with_its_own_time_and_reasons(
    path: Path, shipper: Open, records: str
) -> None:
    write(path, *(record(sheet) for sheet in range(5)), misprint(record(5)), end=True)
    assert shipped(shipper()) == 6
    query = "SELECT sheet, extract(epoch FROM at), verdict, kind, page, details ->> 'reason' FROM sheets ORDER BY 1"
    expected = [(sheet, 1000.0 + 0.2 * sheet, "good", None, f"p{sheet:04}", None) for sheet in range(5)]
    expected.append((5, 1001.0, "misprint", "streak", "p0005", "test"))
    found = [(a, pytest.approx(float(b), abs=1e-6), *c) for a, b, *c in rows_of(records, query)]
    assert found == expected
    assert rows_of(records, "SELECT number, ending, extract(epoch FROM ended)::int FROM runs") == [
        (1, "finished", 1060)
    ]


def test_rows_are_shipped_once_across_restarts_of_the_shipper(
    path: Path, shipper: Open, records: str
) -> None:
    write(path, *(record(sheet) for sheet in range(3)))
    first = shipper()
    assert shipped(first) == 3
    first.close()
    write(path, *(record(sheet) for sheet in range(3, 7)))
    assert shipped(shipper()) == 4
    assert rows_of(records, "SELECT count(*), max(sheet) FROM sheets") == [(7, 6)]


def test_a_sheet_that_is_recorded_again_replaces_the_earlier_row(
    path: Path, shipper: Open, records: str
) -> None:
    write(path, record(0), record(1))
    opened = shipper()
    shipped(opened)
    write(path, misprint(record(0)))
    shipped(opened)
    assert rows_of(records, "SELECT sheet, verdict FROM sheets ORDER BY 1") == [(0, "misprint"), (1, "good")]


def test_a_journal_that_is_replaced_mixes_with_nothing(path: Path, shipper: Open, records: str) -> None:
    write(path, *(record(sheet) for sheet in range(4)))
    first = shipper()
    shipped(first)
    for file in path.parent.glob(f"{path.name}*"):
        shutil.rmtree(file) if file.is_dir() else file.unlink()
    write(path, *(record(sheet) for sheet in range(6)), started_s=9000.0)
    first.close()
    assert shipped(shipper()) == 6
    query = "SELECT r.key, count(*) FROM sheets s JOIN runs r ON r.id = s.run_id GROUP BY 1 ORDER BY 1"
    assert rows_of(records, query) == [("1@1000", 4), ("1@9000", 6)]


def test_a_journal_that_is_restored_from_an_older_copy_is_shipped_whole(
    path: Path, shipper: Open, records: str, tmp_path: Path
) -> None:
    write(path, *(record(sheet) for sheet in range(3)), end=True)
    older = tmp_path / "older.sqlite"
    shutil.copyfile(path, older)
    write(path, *(record(sheet) for sheet in range(4)), started_s=2000.0)
    first = shipper()
    shipped(first)
    first.close()
    # What came after the copy is another run with the same numbers of rows.
    write(older, *(record(sheet, score=0.25) for sheet in range(5)), started_s=3000.0)
    shipped(shipper(path=older))
    query = "SELECT r.key, count(*) FROM sheets s JOIN runs r ON r.id = s.run_id GROUP BY 1 ORDER BY 1"
    assert rows_of(records, query) == [("1@1000", 3), ("2@2000", 4), ("2@3000", 5)]


def test_a_step_that_is_cut_off_has_not_happened_and_happens_again(
    path: Path, shipper: Open, records: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(path, *(record(sheet) for sheet in range(3)))
    opened = shipper()

    def cut(self: Shipper, *_: object) -> None:
        raise psycopg.OperationalError("the server closed the connection unexpectedly")

    with monkeypatch.context() as patched:
        patched.setattr(Shipper, "_write_sheets", cut)
        with pytest.raises(LinkDownError, match="closed the connection"):
            opened.step()
    assert rows_of(records, "SELECT (SELECT count(*) FROM runs), (SELECT max(shipped_row) FROM presses)") == [
        (0, 0)
    ]
    assert shipped(opened) == 3


def test_a_damaged_row_is_named_once_and_holds_up_nothing(path: Path, shipper: Open, records: str) -> None:
    write(path, *(record(sheet) for sheet in range(4)))
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE pages SET whole_verdict = '{}' WHERE sheet IN (1, 3)")
    opened = shipper()
    lines: list[str] = []
    opened.announce = lines.append
    assert shipped(opened) == 2
    assert [line.count("sheet 1") + 2 * line.count("sheet 3") for line in lines] == [1, 2]
    assert not opened.step().more
    write(path, record(4))
    assert shipped(opened) == 1
    assert len(lines) == 2
    assert opened.waiting_rows == 0
    assert rows_of(records, "SELECT sheet FROM sheets ORDER BY 1") == [(0,), (2,), (4,)]


def test_one_press_is_shipped_by_one_process(path: Path, shipper: Open) -> None:
    write(path, record(0))
    shipper()
    with pytest.raises(RecordsError, match="another process ships press 'one'"):
        shipper()


def test_labels_follow_once(path: Path, shipper: Open, records: str) -> None:
    write(path, misprint(record(0)))
    with Journal.open(str(path), read_only=True) as journal:
        key = run_key(journal.run(1))
    store = LabelStore(path)
    label = store.say("misprint", run=key, sheet=0, by="Ada", at_s=1234.5, note="a\0b")
    opened = shipper()
    shipped(opened)
    store.undo(label.id, run=key, by="Ada", at_s=1240.0)
    shipped(opened)
    assert rows_of(records, "SELECT run_key, label, note, undoes FROM labels ORDER BY id") == [
        (key, "misprint", "a\N{REPLACEMENT CHARACTER}b", None),
        (key, "undone", "", label.id),
    ]


def test_values_that_postgresql_cannot_hold_are_shipped_as_json_can(
    path: Path, shipper: Open, records: str
) -> None:
    odd = replace(misprint(record(0)).verdict, page="p\0", reason="N\0L", score=math.inf, widened=math.inf)
    write(path, replace(record(0), verdict=odd, notes=("a\0b",)))
    assert shipped(shipper()) == 1
    query = "SELECT page, score, notes, details ->> 'widened' FROM sheets"
    assert rows_of(records, query) == [
        ("p\N{REPLACEMENT CHARACTER}", math.inf, ["a\N{REPLACEMENT CHARACTER}b"], None)
    ]


def test_evidence_is_stored_by_its_digest(path: Path, records: str, tmp_path: Path) -> None:
    write(path, record(0), record(1, kept=False))
    (file,) = files_of(path)
    store = ObjectStore.open(f"file://{tmp_path / 'objects'}")
    service = ShippingService(
        url=records, press="one", plant="north", journal=path, pictures=store, announce=lambda line: None
    )
    service.once()
    service.close()
    ((digest,), (none,)) = rows_of(records, "SELECT evidence FROM sheets ORDER BY sheet")
    assert none is None
    assert store.get(digest) == file.read_bytes()
    assert store.put(file) == digest  # a second time changes nothing
    (stored,) = (tmp_path / "objects").rglob("*.npz")
    stored.write_bytes(b"other")
    with pytest.raises(ValueError, match="damaged"):
        store.get(digest)
    stored.unlink()
    with pytest.raises(OSError, match=r"^file://[^\n]*not found[^\n]*$"):
        store.get(digest)


def test_records_outlive_the_journals_retention(path: Path, shipper: Open, records: str) -> None:
    write(path, *(record(sheet) for sheet in range(3)), end=True)
    write(path, *(record(sheet) for sheet in range(2)), started_s=2000.0)
    opened = shipper()
    shipped(opened)
    with Journal.open(str(path)) as journal:
        assert journal.tidy(Retention(days=1), now_s=1e6).runs == [1]
    write(path, record(2))
    assert shipped(opened) == 1
    assert rows_of(records, "SELECT count(*) FROM sheets") == [(6,)]


def test_the_service_waits_for_a_server_that_is_killed_and_loses_nothing(path: Path) -> None:
    from prooflight_line.records.database import upgrade
    from prooflight_line.testing.postgres import server_programs

    if server_programs() is None:
        pytest.skip("PostgreSQL is not installed")
    lines: list[str] = []
    with local_postgres() as server:
        upgrade(server.url)
        write(path, *(record(sheet) for sheet in range(3)))
        service = ShippingService(
            url=server.url, press="one", plant="north", journal=path, pictures=None, announce=lines.append
        )
        stop = threading.Event()
        thread = threading.Thread(target=service.run, args=(stop,))
        thread.start()
        try:
            _until(lambda: rows_of(server.url, "SELECT count(*) FROM sheets") == [(3,)])
            server.kill()
            write(path, *(record(sheet) for sheet in range(3, 8)))
            _until(lambda: bool(lines))
            server.start()
            _until(lambda: rows_of(server.url, "SELECT count(*) FROM sheets") == [(8,)])
        finally:
            stop.set()
            thread.join()
        assert rows_of(server.url, "SELECT count(*), count(DISTINCT sheet) FROM sheets") == [(8, 8)]
    assert len(lines) == 2
    assert "the journal stores all rows" in lines[0]
    assert lines[1].startswith("ships again")


def test_a_press_that_prints_nothing_is_still_within_reach(
    path: Path, records: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(path, record(0))
    monkeypatch.setattr(service_module, "SEEN_EVERY_S", 0.0)
    service = ShippingService(
        url=records, press="one", plant="north", journal=path, pictures=None, announce=lambda line: None
    )
    service.once()
    ((first,),) = rows_of(records, "SELECT shipped_at FROM presses")
    service.once()
    service.close()
    assert rows_of(records, f"SELECT shipped_at > '{first.isoformat()}' FROM presses") == [(True,)]


def test_a_journal_that_is_being_created_is_waited_for(path: Path, records: str) -> None:
    path.touch()  # as SQLite does before it writes the first table
    lines: list[str] = []
    service = ShippingService(
        url=records, press="one", plant="north", journal=path, pictures=None, announce=lines.append
    )
    stop = threading.Event()
    thread = threading.Thread(target=service.run, args=(stop,))
    thread.start()
    try:
        _until(lambda: bool(lines))
        write(path, record(0))
        _until(lambda: rows_of(records, "SELECT count(*) FROM sheets") == [(1,)])
    finally:
        stop.set()
        thread.join()


def _until(condition: Callable[[], bool]) -> None:
    waiting = threading.Event()
    for _ in range(300):
        if condition():
            return
        waiting.wait(0.1)
    raise AssertionError("it did not come to be within 30 s")
