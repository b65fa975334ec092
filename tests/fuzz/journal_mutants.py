"""Damaged journals and packs of evidence, and all that the public readers ask of them.

Files go in and out as bytes, so that any harness can use these: ``journal_sample`` and ``pack_sample`` make good ones,
``spoil_*`` return a damaged copy, drawn from ``rng``, and ``read_*`` read one as the commands do: what they raise is a
``JournalError``, or the reader is at fault.
"""

from __future__ import annotations

import contextlib
import io
import json
import sqlite3
import struct
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.detectors.verdict import Ink, Region, Verdict
from prooflight_line.journal import packs
from prooflight_line.journal.aside import unclaimed_folder
from prooflight_line.journal.exporting import page_facts, run_facts, write_csv
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, Retention, RunEnd, RunFacts
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Callable

RUNS, SHEETS = 3, 6
FULL = Verdict(
    page="p0007",
    verdict="misprint",
    probability=0.99,
    score=3.5,
    threshold=1.0,
    p_value=1e-9,
    kind="streak",
    regions=(Region(x_mm=83.1, y_mm=0.1, width_mm=0.5, height_mm=297.0, score=9.7, kind="streak"),),
    shift_mm=(0.1, -0.2),
    milliseconds=12.5,
    detector="matched_filter",
    family="streak/light",
    reason="a streak",
    inks={"C": Ink(gain_percent=-3.25, dot_gain_percent=1.5, register_mm=(0.03, -0.01))},
    expected_cost={"accept": 0.03, "stop": 0.006},
    widened=1.28,
    promise_suspended=True,
)
GOOD = Verdict(page="p0001", verdict="good", score=0.5, threshold=1.0)
VALUES = (
    *(None, 0, 1, -1, 2, 0.5, -0.5, 1e308, -1e308, float("inf"), float("-inf"), 1e-320),
    *(2**31, 2**53, 2**63 - 1, -(2**63), 10**15, "", " ", "0", "-1", "nan", "NaN", "null", "good", "stopped"),
    *("../out/x", "/etc/passwd", "run000001/../../x", "run000001/00000001-0123abcd.npz", "run000009", "."),
    *("[]", "{}", "[[", '{"a":', "[NaN]", '["x"]', '{"x": Infinity}', "[" * 5000, '{"a":' * 3000, "9" * 5000),
    *('"\\ud800"', "\x00", "\x1b[31m", "a\nb", "[red]", "é", "x" * 300_000, b"", b"\xff\xfe", b"[]"),
)
"""As cells of a table, each in a column that never holds it."""
LEAVES = (
    *(
        None,
        True,
        False,
        0,
        -1,
        0.5,
        1e308,
        float("nan"),
        float("inf"),
        2**63,
        10**400,
        "",
        "good",
        "x" * 50_000,
    ),
    *([], [1], {}, {"a": 1}, [None, None], [[[]]], "\x1b[2J", "\ud800"),
)
SCHEMAS = (
    "DROP TABLE {t}",
    "DELETE FROM {t}",
    "ALTER TABLE {t} RENAME TO other",
    "ALTER TABLE {t} RENAME COLUMN {c} TO other",
    "ALTER TABLE {t} ADD COLUMN other DEFAULT 'x'",
    "CREATE TRIGGER acts AFTER INSERT ON {t} BEGIN DELETE FROM pages; END",
    "CREATE VIEW acts AS SELECT * FROM {t}",
    "ALTER TABLE {t} RENAME TO other; CREATE VIEW {t} AS SELECT * FROM other",
    "ALTER TABLE {t} RENAME TO other; CREATE TABLE {t} AS SELECT * FROM other",
    "CREATE TABLE other (x)",
    "UPDATE journal SET schema = 'x'",
    "UPDATE journal SET schema = 7",
    "INSERT INTO journal VALUES (2, 'x')",
    "DROP INDEX pages_by_outcome",
    "PRAGMA writable_schema = ON; UPDATE sqlite_master SET sql = 'x' WHERE name = '{t}'",
    "PRAGMA writable_schema = ON; UPDATE sqlite_master SET rootpage = 3 WHERE name = '{t}'",
    "PRAGMA writable_schema = ON; UPDATE sqlite_master SET type = 'index' WHERE name = '{t}'",
)


# --- good ones ---


def make_journal(path: Path) -> Path:
    """A journal with three runs and evidence, as watching leaves it; returns its path."""
    rng = np.random.default_rng(4)
    with Journal.open(str(path)) as journal:
        for number in range(RUNS):
            run = journal.begin_run(_facts(number))
            for sheet in range(SHEETS):
                journal.record(run, _page(sheet, rng))
                if sheet % 3 == 2:
                    journal.commit()
            if number < RUNS - 1:
                counts = {"late": 0, "stages": {"inspect": {"median_ms": 3.0}}}
                ended_s = 1.7e9 + 1e5 * number + 60
                journal.end_run(run, RunEnd(ended_s=ended_s, ending="finished", counts=counts))
    return path


def _facts(number: int) -> RunFacts:
    return RunFacts(
        job="job.pdf",
        job_digest="j" * 64,
        press="rig",
        press_digest="p" * 64,
        detector="matched_filter",
        source="drum:5",
        started_s=1.7e9 + 1e5 * number,
        sheets=SHEETS,
        settings={"seed": 3},
    )


def _page(sheet: int, rng: np.random.Generator) -> PageRecord:
    arrays = {
        "values": rng.standard_normal(200).astype(np.float32),
        "wrong_page": np.array(False),
        "cut0": rng.integers(0, 1024, (1, 9, 7)).astype(np.uint16),
    }
    return PageRecord(
        sheet=sheet,
        job_page=sheet,
        verdict=FULL if sheet % 2 else GOOD,
        late=sheet == 3,
        first_line=3000 * sheet,
        time_s=0.2 * sheet,
        faults=("slip",) if sheet == 1 else (),
        notes=("black rises",) if sheet == 4 else (),
        nuisance={"gain-C": 0.25},
        evidence=arrays if sheet % 2 else None,
    )


def journal_sample() -> bytes:
    """The database of ``make_journal``, without its evidence."""
    with tempfile.TemporaryDirectory() as name:
        return make_journal(Path(name) / "j.sqlite").read_bytes()


def pack_sample() -> bytes:
    """A pack of the evidence of sheets 1, 3 and 5."""
    with tempfile.TemporaryDirectory() as name:
        rng, path = np.random.default_rng(4), Path(name) / "pack.npz"
        pages = {sheet: _page(sheet, rng).evidence or {} for sheet in (1, 3, 5)}
        packs.write_pack(path, pages)
        return path.read_bytes()


# --- damaged ones ---


def spoil_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Bits turned, pieces overwritten, cut out, doubled or moved, or the end gone."""
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(data) + 1))
        end = min(at + int(rng.exponential(1 + len(data) / 30)), len(data))
        match int(rng.integers(6)):
            case 0:
                changed = bytearray(data)
                for _ in range(int(rng.integers(1, 9)) * bool(data)):
                    changed[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
                data = bytes(changed)
            case 1:
                data = data[:at] + rng.bytes(end - at) + data[end:]
            case 2:
                data = data[:at] + bytes([int(rng.choice([0, 127, 128, 255]))]) * (end - at) + data[end:]
            case 3:
                data = data[:at] + data[end:]
            case 4:
                data = data[:end] + data[at:end] * int(rng.integers(1, 5)) + data[end:]
            case _:
                data = data[:at]
    return data


def spoil_values(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole database with one to three wrong values, tables that are others, or rows that are gone."""
    data = data[:18] + b"\1\1" + data[20:]  # without a log, which memory has none of
    for number in range(int(rng.integers(1, 4))):
        with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
            connection.deserialize(data)
            if not number:
                _allow_anything(connection)
            spoil = _pick((_spoil_cell, _spoil_cell, _spoil_leaf, _spoil_leaf, _spoil_schema), rng)
            # The one before may have left nothing to spoil.
            with contextlib.suppress(sqlite3.Error, LookupError, TypeError, json.JSONDecodeError):
                spoil(connection, rng)
            data = connection.serialize()
    return data


def _allow_anything(connection: sqlite3.Connection) -> None:
    """As if no column had a rule: who damages a journal keeps none."""
    connection.execute("PRAGMA writable_schema = ON")
    connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'NOT NULL', '') WHERE type = 'table'")


def _spoil_cell(connection: sqlite3.Connection, rng: np.random.Generator) -> None:
    name, column = _place(connection, rng)
    value = _pick(VALUES, rng)
    count = int(rng.integers(1, 4))
    wanted = "CAST(? AS TEXT)" if isinstance(value, bytes) and rng.random() < 0.7 else "?"
    rows = f"SELECT rowid FROM {name} LIMIT {count} OFFSET {int(rng.integers(SHEETS))}"
    connection.execute(f"UPDATE OR IGNORE {name} SET {column} = {wanted} WHERE rowid IN ({rows})", (value,))


def _spoil_leaf(connection: sqlite3.Connection, rng: np.random.Generator) -> None:
    """One value inside what is kept as JSON."""
    columns = (("pages", "whole_verdict"), ("pages", "nuisance"), ("runs", "counts"), ("runs", "settings"))
    name, column = columns[int(rng.choice(4, p=[0.7, 0.1, 0.1, 0.1]))]
    rows = connection.execute(f"SELECT rowid, {column} FROM {name} WHERE {column} <> ''").fetchall()
    row = _pick(tuple(rows), rng)
    whole = json.loads(row[1])
    part: Any = whole
    while isinstance(part, dict | list) and part:
        key = _pick(tuple(part) if isinstance(part, dict) else tuple(range(len(part))), rng)
        if not isinstance(part[key], dict | list) or rng.random() < 0.3:
            part[key] = _pick(LEAVES, rng)
            break
        part = part[key]
    connection.execute(f"UPDATE {name} SET {column} = ? WHERE rowid = ?", (json.dumps(whole), row[0]))


def _spoil_schema(connection: sqlite3.Connection, rng: np.random.Generator) -> None:
    name, column = _place(connection, rng)
    for statement in _pick(SCHEMAS, rng).format(t=name, c=column).split("; "):
        connection.execute(statement)


def _place(connection: sqlite3.Connection, rng: np.random.Generator) -> tuple[str, str]:
    name = _pick(("journal", "runs", "packs", "pages", "pages", "runs"), rng)
    columns = tuple(row[1] for row in connection.execute(f"PRAGMA table_info({name})"))
    return name, _pick(columns, rng) if columns else "rowid"


def spoil_pack(data: bytes, rng: np.random.Generator) -> bytes:
    """Damaged bytes, or a sound archive whose arrays are not what they say they are."""
    return spoil_bytes(data, rng) if rng.random() < 0.6 else _lying_pack(rng)


def _lying_pack(rng: np.random.Generator) -> bytes:
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (50,), }"
    lies = (
        (
            b"(50,)",
            b"(50000000000,)",
            b"(99999, 99999)",
            b"(-1,)",
            b"(1e9,)",
            b"()",
            b"(51,)",
            b"(" + b"1, " * 99 + b")",
        ),
        (
            b"'<f4'",
            b"'|O'",
            b"'<f16'",
            b"'<M8'",
            b"'|V9'",
            b"'|S99999999'",
            b"[('a', '<f4')]",
            b"'<c8'",
            b"'>u8'",
        ),
        (b"False", b"True", b"None", b"__import__('os').abort()", b"(" * 900 + b")" * 900),
    )
    for old, *new in lies:
        if rng.random() < 0.5:
            header = header.replace(old, _pick(tuple(new), rng))
    magic = _pick((b"\x93NUMPY\x01\x00", b"\x93NUMPY\x02\x00", b"\x93NUMPX\x01\x00"), rng)
    length = len(header) + 1 if rng.random() < 0.8 else int(rng.integers(65536))
    content = bytes(int(rng.choice([0, 100, 200, 200, 3_000_000])))
    member = magic + struct.pack("<H", length) + header + b"\n" + content
    file = io.BytesIO()
    names = ("1/values", "1/values", "3/values", "1/../x", "1/" + "a" * 200, "1/wrong_page")
    methods = (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(file, "w", _pick(methods, rng), compresslevel=1) as archive:
        archive.writestr(f"{_pick(names, rng)}.npy", member)
    return file.getvalue()


def _pick(things: tuple[Any, ...], rng: np.random.Generator) -> Any:
    return things[int(rng.integers(max(len(things), 1)))]


# --- readers ---


def read_journal(path: Path) -> None:
    """All that the commands read, first as they do, damaged rows left out, and then as Python reads it."""
    with Journal.open(str(path), read_only=True) as journal:
        bad: list[JournalError] = []
        for run in journal.runs(damaged=bad.append):
            json.dumps(run_facts(run), allow_nan=False)
            pages = list(journal.pages(run.id, damaged=bad.append))
            list(journal.pages(run.id, passed=False, damaged=bad.append))
            json.dumps([page_facts(page) for page in pages], allow_nan=False)
            write_csv(pages, io.StringIO())
            for page in pages:
                with _noting(bad):
                    journal.page(run.id, page.sheet)
        with _noting(bad):
            journal.last_run()
        assert journal.megabytes >= 0
        for error in bad:
            assert str(path.name) in str(error), error
        if bad:
            raise bad[0]


def write_journal(path: Path) -> None:
    """Go on with a journal as watching does, and tidy it; JournalError, and nothing is removed but by tidying."""
    before = _evidence(path)
    with Journal.open(str(path), announce=lambda _: None) as journal:
        assert _evidence(path) == before
        run = journal.begin_run(_facts(9))
        journal.record(run, _page(1, np.random.default_rng(1)))
        journal.commit()
        assert before.items() <= _evidence(path).items()
        journal.tidy(Retention(days=1.0), now_s=1.7e9 + 2e5)
        held = journal.megabytes
        journal.tidy(Retention(megabytes=0.1), now_s=0.0)
        if journal.health.unrecorded:
            raise JournalError(path, str(journal.health.trouble), remedy="none")
        told_lost = journal.health.dropped_evidence > 0
        assert journal.page(run, 1).evidence is not None or held > 0.1 or told_lost


def _evidence(path: Path) -> dict[str, int]:
    """Sizes of all files of evidence, those that were put aside among them."""
    folders = packs.evidence_folder(path), unclaimed_folder(path)
    return {
        file.relative_to(folder).as_posix(): file.stat().st_size
        for folder in folders
        for file in folder.rglob("*.npz")
    }


def read_pack(path: Path) -> None:
    """Every page's arrays; JournalError as the journal raises it."""
    for sheet in (1, 3, 5):
        try:
            arrays = packs.read_pack(path, sheet)
        except ValueError as error:
            raise JournalError(path, f"is damaged ({error})", remedy="none") from error
        assert sum(array.nbytes for array in arrays.values()) < 70_000_000


@contextlib.contextmanager
def _noting(bad: list[JournalError]) -> Any:
    try:
        yield
    except JournalError as error:
        bad.append(error)


SPOILERS: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "bytes": spoil_bytes,
    "values": spoil_values,
    "pack": spoil_pack,
}
