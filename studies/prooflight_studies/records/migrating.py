"""Upgrades measured: records in PostgreSQL by Alembic, and a journal of version 0.2.0, each with a million sheets."""

from __future__ import annotations

import os
import sqlite3
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine, text

from prooflight import __version__
from prooflight_line.journal.following import follow
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd
from prooflight_line.journal.schema import PREVIOUS, SCHEMA
from prooflight_line.records.database import upgrade
from prooflight_line.testing.postgres import local_postgres
from prooflight_studies.records.searching import RUNS, fill
from prooflight_studies.records.shipping import run_facts, sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

REVISIONS: Final = (
    ("a column with a constant", "ALTER TABLE sheets ADD COLUMN reviewed boolean NOT NULL DEFAULT false"),
    (
        "a column computed from each row",
        "ALTER TABLE sheets ADD COLUMN metre double precision; UPDATE sheets SET metre = first_line * 0.0001",
    ),
    ("an index", "CREATE INDEX sheets_by_page ON sheets (page, at DESC)"),
    ("a column of another type, all rows written again", "ALTER TABLE sheets ALTER COLUMN sheet TYPE bigint"),
)
"""Steps as later versions may need them; there has been no second schema of the records so far."""
_REVISION: Final = """\"\"\"Rehearse.\"\"\"

from alembic import op

revision, down_revision = "{revision}", "{before}"


def upgrade():
    for one in {statements}:
        op.execute(one)
"""


def measure_migrations(*, sheets: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Fill a database and a journal, upgrade both, and return the times. sheets: a multiple of ``RUNS``."""
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="prooflight-migration-") as folder:
        journal = _of_journal(Path(folder) / "journal.sqlite", sheets, progress)
        records = _of_records(Path(folder), sheets, progress)
    cores = os.cpu_count() or 1
    return {
        "sheets": sheets,
        "records": records,
        "journal": journal,
        "cores": cores,
        "load": [load_before / cores, os.getloadavg()[0] / cores],
    }


def _of_records(folder: Path, sheets: int, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    rows = []
    with local_postgres("shared_buffers=512MB", "max_wal_size=4GB") as server:
        rows.append(_timed("all tables, in an empty database", lambda: upgrade(server.url)))
        fill(server.url, sheets // RUNS, progress)
        rows.append(_timed("nothing: it is up to date", lambda: upgrade(server.url)))
        before = upgrade(server.url)[1]
        for number, (name, statements) in enumerate(REVISIONS, start=1):
            progress(f"rehearsing a revision: {name}")
            revision = f"r{number}"
            written = _REVISION.format(revision=revision, before=before, statements=statements.split("; "))
            (folder / f"{revision}.py").write_text(written, encoding="utf-8")
            rows.append({"step": name} | _rehearsed(server.url, folder, revision))
            before = revision
    return rows


def _rehearsed(url: str, folder: Path, revision: str) -> dict[str, float]:
    """Upgrade to a revision in ``folder``, in one transaction as ``records upgrade``; return its times."""
    import psycopg

    config = Config()
    config.set_main_option("script_location", "prooflight_line.records:migrations")
    config.set_main_option("version_locations", f"prooflight_line.records:migrations/versions {folder}")
    config.set_main_option("path_separator", "space")
    engine = create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(url))
    try:
        begun, own = time.perf_counter(), time.process_time()
        with engine.begin() as connection:
            (server,) = connection.execute(text("SELECT pg_backend_pid()")).one()
            config.attributes["connection"] = connection
            command.upgrade(config, revision)
            cpu_s = _processor_s(server)
        return {
            "wall_s": time.perf_counter() - begun,
            "cpu_s": cpu_s + time.process_time() - own,
        }
    finally:
        engine.dispose()


def _of_journal(path: Path, sheets: int, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    write_journal(path, [sheets], begun_s=1e9, progress=progress)
    size = path.stat().st_size
    _make_earlier(path)
    rows = [_timed("read as it is", lambda: _count(path, sheets))]
    rows.append(_timed(f"schema {PREVIOUS} to {SCHEMA}, by the first run", lambda: _open(path)))
    rows.append(_timed("nothing: it is up to date", lambda: _open(path)))
    rows.append(_timed("read after that", lambda: _count(path, sheets)))
    return [row | {"bytes": size} for row in rows]


def _make_earlier(path: Path) -> None:
    """Make a journal of version 0.2.0 of one of this version: an action instead of a disposition."""
    with closing(sqlite3.connect(path, isolation_level=None)) as raw:
        raw.execute(
            "UPDATE pages SET whole_verdict = json_set(json_remove(whole_verdict, '$.stopping_costs_more'), '$.action',"
            " disposition) WHERE whole_verdict IS NOT NULL"
        )
        raw.execute("ALTER TABLE pages RENAME COLUMN disposition TO action")
        raw.execute("ALTER TABLE pages DROP COLUMN decided_by")
        raw.execute(f"UPDATE journal SET schema = {PREVIOUS}")
        raw.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _open(path: Path) -> None:
    Journal.open(str(path)).close()


def _count(path: Path, sheets: int) -> None:
    """Read the last hundred sheets, as the console does when it starts."""
    journal = follow(path, version=__version__)
    assert journal is not None
    written = journal.written_after(journal.heads().row - 100, limit=100, damaged=lambda error: None)
    assert written[-1].page.sheet == sheets - 1
    journal.close()


def _timed(step: str, work: Callable[[], object]) -> dict[str, Any]:
    begun, own = time.perf_counter(), time.process_time()
    work()
    return {"step": step, "wall_s": time.perf_counter() - begun, "cpu_s": time.process_time() - own}


def _processor_s(process: int) -> float:
    """Return the processor time that a process has taken. [s]"""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# --- journals of as many sheets as a press writes in days ---

FIRST_SHEETS: Final = 2000
"""Sheets that are recorded as a run does it. Copies are made in a fiftieth of the time."""
SHEET_S: Final = 0.2


def write_journal(
    path: Path, runs: Sequence[int], *, begun_s: float, progress: Callable[[str], None]
) -> None:
    """Write a journal of runs that have ended, one after another. runs: sheets of each; begun_s: Unix time. [s]"""
    first = min(FIRST_SHEETS, runs[0])
    with Journal.open(str(path)) as journal:
        for at, sheets in enumerate(runs):
            started_s = begun_s + SHEET_S * sum(runs[:at])
            run = journal.begin_run(run_facts("made-up", sheets=sheets, started_s=started_s))
            for number in range(first if at == 0 else 0):
                journal.record(run, sheet(number, SHEET_S * number))
            journal.commit()
            journal.end_run(run, RunEnd(ended_s=started_s + SHEET_S * sheets, ending="finished"))
    with closing(sqlite3.connect(path)) as raw:
        columns = [row[1] for row in raw.execute("PRAGMA table_info(pages)")]
        moved = {
            "run_id": ":run",
            "sheet": "sheet + :by",
            "job_page": "job_page + :by",
            "time_s": f"time_s + {SHEET_S} * :by",
        }
        copied = ", ".join(moved.get(name, name) for name in columns)
        for run, sheets in enumerate(runs, start=1):
            progress(f"writing a journal: {sum(runs[: run - 1]):,} of {sum(runs):,} sheets")
            for by in range(first if run == 1 else 0, sheets, first):
                raw.execute(
                    f"INSERT INTO pages ({', '.join(columns)}) SELECT {copied} FROM pages WHERE rowid <= :rest",
                    {"run": run, "by": by, "rest": min(first, sheets - by)},
                )
            raw.commit()
