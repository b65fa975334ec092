"""Searches over ten million sheets, by the product's own functions, as the owner and as a role of one plant."""

from __future__ import annotations

import os
import time
from collections import defaultdict
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.rng import stream
from prooflight_line.records.database import allow, connect, upgrade
from prooflight_line.records.searching import SheetQuery, find, presses
from prooflight_line.testing.postgres import local_postgres

if TYPE_CHECKING:
    from collections.abc import Callable

PRESSES, RUNS = 40, 4000
KINDS: Final = (
    "spots-voids",
    "streak",
    "missing-content",
    "band",
    "register",
    "blur",
    "ghost",
    "swapped-planes",
)
FIRST: Final = datetime(2026, 1, 1, tzinfo=UTC)
DAYS: Final = 300
BOUND_MS: Final = 300.0
_PRESSES: Final = """INSERT INTO presses (name, plant)
    SELECT 'press ' || n, (ARRAY['north', 'south', 'east', 'west'])[1 + n %% 4] FROM generate_series(1, %s) AS n"""
_RUNS: Final = """INSERT INTO runs (press_id, key, number, job, job_digest, press_digest, detector, source, started,
        settings, ended, ending, dropped_pages, dropped_evidence)
    SELECT 1 + n %% %s, n || '@', n, 'job ' || n %% 500 || '.pdf', '', '', 'matched_filter', 'camera',
        timestamptz '2026-01-01 00:00+00' + n * interval '1 day' * %s / %s, '{}', now(), 'finished', 0, 0
    FROM generate_series(1, %s) AS n"""
# One sheet in fifty is a misprint, kinds from common to rare by halves; md5 scatters them without order.
_SHEETS: Final = """INSERT INTO sheets (run_id, sheet, press_id, at, job_page, page, verdict, disposition, kind, score,
        late, first_line, faults, notes)
    SELECT r.id, n, r.press_id, r.started + n * interval '0.2 s', n, 'p' || n %% 24,
        CASE WHEN h %% 50 = 0 THEN 'misprint' WHEN h %% 500 = 1 THEN 'not-inspected' ELSE 'good' END,
        CASE WHEN h %% 50 = 0 THEN 'stop' ELSE 'accept' END,
        CASE WHEN h %% 50 = 0
            THEN (%s::text[])[1 + least(floor(-log(2.0, 0.004 + ((h / 50) %% 1000) / 1001.0)), 7)::int] END,
        1.0, false, n * 3000, '[]', '[]'
    FROM runs r, LATERAL (SELECT n, ('x' || substr(md5(r.id || '/' || n), 1, 7))::bit(28)::int AS h
        FROM generate_series(0, %s - 1) AS n) AS drawn WHERE r.id BETWEEN %s AND %s"""


def measure_searches(
    *, sheets: int, searches: int, seed: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Fill a database with sheets, search it, and return the times. sheets: a multiple of ``RUNS``."""
    rng = stream(seed, "record-searches")
    with local_postgres("shared_buffers=512MB", "max_wal_size=8GB", "synchronous_commit=off") as server:
        upgrade(server.url)
        seconds = fill(server.url, sheets // RUNS, progress)
        with connect(server.url) as connection:
            connection.execute("CREATE ROLE quality LOGIN")
        allow(server.url, "quality", "south")
        queries = [_drawn(rng) for _ in range(searches)]
        rows: list[dict[str, Any]] = []
        for role, url in (("owner", server.url), ("one plant", server.url.replace("postgres@", "quality@"))):
            progress(f"{searches} searches as {role}")
            rows += _times(role, url, queries)
        plan = _plan(server.url, max(rows, key=lambda row: row["greatest_ms"])["slowest"])
        with connect(server.url) as connection:
            begun = time.perf_counter()
            presses(connection, since=FIRST + timedelta(days=DAYS - 1))
            overview_ms = 1000 * (time.perf_counter() - begun)
            ((size,),) = connection.execute("SELECT pg_database_size(current_database())").fetchall()
    for row in rows:
        row["slowest"] = _conditions(row["slowest"])
    return {
        "sheets": sheets,
        "searches": searches,
        "bytes": int(size),
        "fill_s": seconds,
        "rows": rows,
        "plan": plan,
        "overview_ms": overview_ms,
        "bound_ms": BOUND_MS,
        "cores": os.cpu_count() or 1,
        "load": os.getloadavg()[0] / (os.cpu_count() or 1),
    }


def fill(url: str, each: int, progress: Callable[[str], None]) -> float:
    """Fill the tables with ``RUNS`` runs of ``each`` sheets; return the time that it took. [s]"""
    begun = time.perf_counter()
    with connect(url) as connection:
        connection.execute(_PRESSES, (PRESSES,))
        connection.execute(_RUNS, (PRESSES, DAYS, RUNS, RUNS))
        step = RUNS // 20
        for first in range(1, RUNS + 1, step):
            done = (first - 1) / RUNS
            spent = time.perf_counter() - begun
            left = f", {spent / done * (1 - done):.0f} s left" if done else ""
            progress(f"filling the database, {100 * done:.0f} %{left}")
            connection.execute(_SHEETS, (list(KINDS), each, first, first + step - 1))
        connection.execute("VACUUM ANALYZE")
    return time.perf_counter() - begun


def _drawn(rng: np.random.Generator) -> tuple[str, SheetQuery]:
    """Draw a search as people make them: what it asks for, and its conditions."""
    day = FIRST + timedelta(days=float(rng.uniform(0, DAYS)))
    week = {"since": day, "until": day + timedelta(days=7)}
    press = f"press {rng.integers(1, PRESSES + 1)}"
    kind = str(rng.choice(KINDS))
    job = f"job {rng.integers(0, 500)}.pdf"
    drawn: tuple[tuple[str, dict[str, Any]], ...] = (
        ("latest of all", {}),
        ("a press", {"press": press}),
        ("misprints of a week", {"verdict": "misprint", **week}),
        ("a kind", {"kind": kind}),
        ("a kind of a press", {"kind": kind, "press": press}),
        ("a kind of a plant in a week", {"kind": kind, "plant": "south", **week}),
        ("a job", {"job": job}),
        ("misprints of a job", {"job": job, "verdict": "misprint"}),
        ("not inspected, of a press in a week", {"verdict": "not-inspected", "press": press, **week}),
        ("nothing: a press that is not there", {"press": "none", "verdict": "misprint"}),
    )
    name, conditions = drawn[int(rng.integers(len(drawn)))]
    return name, SheetQuery(**conditions)


def _times(role: str, url: str, queries: list[tuple[str, SheetQuery]]) -> list[dict[str, Any]]:
    """Time each search's first page and its second."""
    times: dict[str, list[tuple[float, SheetQuery]]] = defaultdict(list)
    hits: dict[str, int] = defaultdict(int)
    with connect(url) as connection:
        for name, query in queries:
            begun = time.perf_counter()
            first = find(connection, query)
            middle = time.perf_counter()
            if first:
                find(connection, query, before=first[-1].position)
                times[name].append((1000 * (time.perf_counter() - middle), query))
            times[name].append((1000 * (middle - begun), query))
            hits[name] += len(first)
    rows = []
    for name, values in {**times, "all": [one for part in times.values() for one in part]}.items():
        taken = np.array([ms for ms, _ in values])
        rows.append(
            {
                "role": role,
                "search": name,
                "count": len(values),
                "median_ms": float(np.median(taken)),
                "p99_ms": float(np.quantile(taken, 0.99)),
                "greatest_ms": float(taken.max()),
                "slowest": values[int(taken.argmax())][1],
            }
        )
    return rows


def _plan(url: str, query: SheetQuery) -> list[str]:
    text, values = query.sql(limit=100)
    with connect(url) as connection:
        plan = connection.execute(f"EXPLAIN (ANALYZE, TIMING OFF) {text}", values, prepare=False)
        return [line for (line,) in plan.fetchall()]


def _conditions(query: SheetQuery) -> str:
    names = ("press", "plant", "job", "verdict", "kind")
    return ", ".join(f"{name} {value}" for name in names if (value := getattr(query, name)) is not None)
