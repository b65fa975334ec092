"""A damaged journal is read as far as it can be, and refused in one line where it cannot; it never takes all memory."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import shutil
import sqlite3
import tracemalloc
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, files_of, record
from tests.fuzz import journal_mutants

from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import decided_again, evidence_to_store
from prooflight.rng import stream
from prooflight.simulation.scans import scan_page
from prooflight_line.journal import packs
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MUTANTS, SEED = 150, 28


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        for number in (1, 2):
            run = journal.begin_run(facts(started_s=1000.0 * number))
            for sheet in range(4):
                journal.record(run, record(sheet))
    return path


def change(path: Path, statement: str, *values: object) -> None:
    """In a database whose columns may hold anything."""
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'NOT NULL', '') WHERE type = 'table'")
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.executescript(statement) if ";" in statement else connection.execute(statement, values)


# --- mutants ---


@pytest.mark.parametrize("what", ["bytes", "values", "pack"])
def test_mutants_are_read_or_refused_in_one_line(tmp_path: Path, what: str) -> None:
    of_pack = what == "pack"
    sample = journal_mutants.pack_sample() if of_pack else journal_mutants.journal_sample()
    read = journal_mutants.read_pack if of_pack else journal_mutants.read_journal
    mutant = tmp_path / "mutant"
    mutant.write_bytes(sample)
    read(mutant)
    refusals: list[str] = []
    for number in range(MUTANTS):
        mutant.write_bytes(journal_mutants.SPOILERS[what](sample, np.random.default_rng([SEED, number])))
        try:
            read(mutant)
        except JournalError as refusal:
            refusals.append(str(refusal))
    assert len(refusals) > MUTANTS / 2
    assert [text for text in refusals if "mutant" not in text or len(text.splitlines()) != 1] == []


def test_mutants_are_written_on_or_refused_and_nothing_else_is_removed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL)
    good = journal_mutants.make_journal(tmp_path / "good" / "j.sqlite")
    sample, came = good.read_bytes(), Counter[str]()
    for number in range(MUTANTS // 5):
        rng = np.random.default_rng([SEED, number])
        work = shutil.copytree(good.parent, tmp_path / str(number))
        mine = [work / "x", work / "out" / "x"]
        mine[1].parent.mkdir()
        for file in mine:
            file.write_text("mine")
        spoil = journal_mutants.spoil_values if number % 3 else journal_mutants.spoil_bytes
        (work / good.name).write_bytes(spoil(sample, rng))
        try:
            journal_mutants.write_journal(work / good.name)
        except JournalError:
            came["refused"] += 1
        else:
            came["written"] += 1
        assert [file.read_text() for file in mine] == ["mine", "mine"]
    assert min(came["refused"], came["written"]) > 5


# --- rows ---


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("score", "high"),
        ("verdict", "good?"),
        ("verdict", "misprint"),
        ("late", 7),
        ("first_line", 2.5),
        ("time_s", None),
        ("time_s", float("inf")),
        ("job_page", -1),
        ("faults", '["slip"'),
        ("faults", '["slip"]'),
        ("notes", None),
        ("nuisance", "[]"),
        ("nuisance", '{"a": "x"}'),
        ("whole_verdict", "{}"),
        ("whole_verdict", "[" * 100_000),
        ("whole_verdict", b"\xff"),
        ("page", "p\x00"),
    ],
)
def test_a_damaged_row_is_named_and_the_others_are_read(path: Path, column: str, value: object) -> None:
    change(path, f"UPDATE pages SET {column} = ? WHERE run_id = 1 AND sheet = 2", value)
    found: list[JournalError] = []
    with Journal.open(str(path), read_only=True) as journal:
        pages = list(journal.pages(1, damaged=found.append))
        with pytest.raises(JournalError, match="run 1, sheet 2") as refusal:
            list(journal.pages(1))
        with pytest.raises(JournalError, match="run 1, sheet 2"):
            journal.page(1, 2)
        assert journal.page(1, 3).evidence is not None
    assert [page.sheet for page in pages] == [0, 1, 3]
    assert [str(error) for error in found] == [str(refusal.value)]
    assert column in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "columns",
    [
        "verdict = 'good'",
        "verdict = 'good', disposition = 'accept', score = 0.5, kind = NULL, threshold = 1.0",
        "verdict = 'good', whole_verdict = '{}'",
        "verdict = 'good', whole_verdict = CAST(x'ff' AS TEXT)",
        "verdict = 'good', whole_verdict = '[' || whole_verdict",
    ],
)
def test_a_misprint_that_damage_calls_good_is_not_passed_over(path: Path, columns: str) -> None:
    bad = Verdict(page="p1", verdict="misprint", score=np.nan, threshold=1.0, kind="streak")
    with Journal.open(str(path)) as journal:
        journal.record(2, record(2, verdict=bad))
        journal.record(2, record(9, faults=("slip",)))
        journal.record(2, record(10, score=np.nan))
    change(path, f"UPDATE pages SET {columns} WHERE run_id = 2 AND sheet = 2")
    change(path, "UPDATE pages SET faulty = 0 WHERE sheet = 9")
    found: list[JournalError] = []
    with Journal.open(str(path), read_only=True) as journal:
        shown = [page.sheet for page in journal.pages(2, passed=False, damaged=found.append)]
    assert shown == [10]  # nothing is good by a number that is not finite
    assert ["run 2, sheet 2 " in str(found[0]), "run 2, sheet 9 " in str(found[1])] == [True, True]


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *(("started_s", "x"), ("started_s", 1e300), ("started_s", -1.0), ("sheets", 0), ("settings", "{")),
        *(("ended_s", 5.0), ("ending", "finished"), ("dropped_pages", -1), ("job", None), ("counts", "7")),
    ],
)
def test_a_damaged_run_is_named_and_the_others_are_read(path: Path, column: str, value: object) -> None:
    change(path, f"UPDATE runs SET {column} = ? WHERE id = 1", value)
    found: list[JournalError] = []
    with Journal.open(str(path), read_only=True) as journal:
        assert [run.id for run in journal.runs(damaged=found.append)] == [2]
        with pytest.raises(JournalError, match="run 1 "):
            journal.runs()
        with pytest.raises(JournalError, match="run 1 "):
            journal.run(1)
        assert journal.last_run().id == 2
    assert ["the row of run 1 is damaged" in str(error) and column in str(error) for error in found] == [True]


@pytest.mark.parametrize(
    "statement",
    [
        "DROP TABLE packs;",
        "DELETE FROM journal;",
        "INSERT INTO journal VALUES (4, 'x');",
        "ALTER TABLE pages RENAME COLUMN score TO other;",
        "ALTER TABLE runs RENAME TO other; CREATE VIEW runs AS SELECT * FROM other;",
        "CREATE TRIGGER acts AFTER INSERT ON pages BEGIN DELETE FROM runs; END;",
    ],
)
def test_tables_that_are_no_journals_are_refused(path: Path, statement: str) -> None:
    change(path, "PRAGMA legacy_alter_table = ON;" + statement)
    before = path.read_bytes()
    for read_only in (True, False):
        with pytest.raises(JournalError) as refusal:
            Journal.open(str(path), read_only=read_only)
        assert "\n" not in str(refusal.value)
    assert path.read_bytes() == before
    assert len(files_of(path)) == 2


# --- packs ---


def bomb(path: Path, member: str, header: bytes, *, content_bytes: int = 0) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(member, "w") as file:
        file.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        for _ in range(content_bytes // 1_000_000):
            file.write(bytes(1_000_000))


@pytest.mark.parametrize(
    ("shape", "content_bytes"), [("(3000000000,)", 0), ("(90000000,)", 90_000_000), ("(8,)", 90_000_000)]
)
def test_a_small_pack_that_would_be_a_large_one_is_refused(
    path: Path, shape: str, content_bytes: int
) -> None:
    header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    for file in files_of(path):
        bomb(file, "1/values.npy", header, content_bytes=content_bytes)
        assert file.stat().st_size < 200_000
    with Journal.open(str(path), read_only=True) as journal:
        tracemalloc.start()
        try:
            with pytest.raises(JournalError, match="is damaged"):
                journal.page(1, 1)
            assert tracemalloc.get_traced_memory()[1] < 5_000_000
        finally:
            tracemalloc.stop()


def test_a_pack_that_lists_a_million_arrays_is_refused_before_they_are_read(path: Path) -> None:
    file = files_of(path)[0]
    end = zipfile.ZipFile(file)
    end.close()
    data = bytearray(file.read_bytes())
    entry = data[data.index(b"PK\x01\x02") :]
    entry = entry[: entry.index(b"PK", 4)]
    file.write_bytes(
        bytes(entry) * 60_000
        + b"PK\x05\x06\0\0\0\0"
        + (60_000).to_bytes(2, "little") * 2
        + (60_000 * len(entry)).to_bytes(4, "little")
        + bytes(6)
    )
    with (
        Journal.open(str(path), read_only=True) as journal,
        pytest.raises(JournalError, match="lists 60,000"),
    ):
        journal.page(1, 1)


def test_objects_in_a_pack_are_never_made(path: Path, tmp_path: Path) -> None:
    class Touch:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "made",))

    for file in files_of(path):
        arrays = {"1/values": np.array([Touch()], object)}
        with file.open("wb") as stream:
            np.savez(stream, **arrays)
    with (
        Journal.open(str(path), read_only=True) as journal,
        pytest.raises(JournalError, match="not an array of numbers"),
    ):
        journal.page(1, 1)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("dtype", ["?", "u1", "i8", "f2", "f4", ">f8"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 0, 5), (2, 3, 4)])
def test_what_is_kept_is_read_as_numpy_reads_it(tmp_path: Path, dtype: str, shape: tuple[int, ...]) -> None:
    array = np.asfortranarray((np.arange(24) % 2)[: int(np.prod(shape))].reshape(shape).astype(dtype))
    packs.write_pack(tmp_path / "p.npz", {7: {"values": array}, 71: {"values": array}})
    found = packs.read_pack(tmp_path / "p.npz", 7)
    assert found.keys() == {"values"}
    np.testing.assert_array_equal(found["values"], array, strict=True)
    with np.load(tmp_path / "p.npz") as archive:
        np.testing.assert_array_equal(archive["71/values"], array, strict=True)


# --- evidence that is whole, and of no page ---


@pytest.fixture(scope="module", params=["chi-square", "matched_filter"])
def kept(request: pytest.FixtureRequest, press: Press, page: Page) -> tuple[dict[str, Any], Press, str]:
    of_press = request.getfixturevalue("trained_press") if request.param == "matched_filter" else press
    inspector = Inspector.of(of_press, request.param)
    prepared = inspector.prepare(page)
    scan = scan_page(
        page, press=of_press, request=None, others=(), fetch=lambda _: page, rng=stream(1, "print", 1)
    )
    inspection = inspector.inspect(prepared, scan.dn, scan_name="scan")
    return dict(evidence_to_store(inspection, prepared.page, inspector.press)), of_press, request.param


@pytest.mark.parametrize(
    "spoil",
    [
        lambda array: array[..., :-1] if array.ndim else array[None],
        lambda array: array[None],
        lambda array: array.astype("U"),
        lambda array: np.zeros((0,) * array.ndim, array.dtype) if array.ndim else np.zeros(0, bool),
        lambda array: np.zeros_like(array, np.complex64),
    ],
    ids=["shorter", "deeper", "text", "empty", "complex"],
)
def test_evidence_of_no_page_cannot_be_decided_again(
    kept: tuple[dict[str, Any], Press, str], spoil: Callable[[Any], Any]
) -> None:
    arrays, press, name = kept
    decided_by = {
        of: array for of, array in arrays.items() if not of.startswith("cut")
    }  # cuts are for people
    for of, array in decided_by.items():
        with pytest.raises(RequestError, match="cannot be of its page"):
            decided_again(arrays | {of: spoil(array)}, press, name)


def test_evidence_that_is_no_number_gives_no_verdict(kept: tuple[dict[str, Any], Press, str]) -> None:
    arrays, press, name = kept
    spoilt = {"page_features": np.nan} if name == "matched_filter" else {"tile_histogram": 0}
    for of, value in spoilt.items():
        with pytest.raises(RequestError):
            decided_again(arrays | {of: np.full_like(arrays[of], value)}, press, name)


def test_what_an_older_version_did_not_know_may_be_missing(path: Path) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        whole = json.loads(connection.execute("SELECT whole_verdict FROM pages").fetchone()[0])
        for name in ("inks", "expected_cost", "family"):
            del whole[name]
        connection.execute(
            "UPDATE pages SET whole_verdict = ? WHERE sheet = 0", (json.dumps(whole | {"new": 1}),)
        )
    with Journal.open(str(path), read_only=True) as journal:
        assert replace(journal.page(1, 0).verdict, inks={}).inks == {}


def test_samples_of_the_mutants_are_sound() -> None:
    with zipfile.ZipFile(io.BytesIO(journal_mutants.pack_sample())) as archive:
        assert len(archive.namelist()) == 9
