"""Searches over a large journal: time to index it, size of the index, CPU time of each search, and its plan.

The journal is written by plain SQL, as no press would write so many sheets for a study: rows have the journal's
columns and what the index reads of them, and are drawn from their numbers. CPU time is measured instead of time, which
other programs on the machine would lengthen.
"""

from __future__ import annotations

import json
import sqlite3
import tempfile
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Region, Verdict
from prooflight_console.accounts.account_store import Accounts
from prooflight_console.alarms.alarm_store import AlarmStore
from prooflight_console.quality.index import SearchIndex
from prooflight_console.quality.pareto import misprints
from prooflight_console.quality.searching import SheetSearch, count, find, find_in_journal
from prooflight_console.quality.trends import trend
from prooflight_console.reading.incidents import RunIncidents
from prooflight_console.reading.runs import Reading
from prooflight_line.journal.defect_conditions import DefectConditions
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore
from prooflight_line.journal.records import RunFacts
from prooflight_line.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SHEETS, QUICK_SHEETS = 500_000, 20_000
RUNS: Final = 200
MISPRINT_EVERY: Final = 5
"""One sheet in so many is a misprint: as many defects as of ten times as many sheets on a press of 2 %."""
RATE_HZ: Final = 5.0
FIRST_S: Final = 1_767_225_600.0
"""Start of the first run, 1 January 2026; one begins every eight hours. Unix time. [s]"""
KINDS: Final = (
    "streak",
    "spots-voids",
    "missing-content",
    "band",
    "register",
    "blur",
    "ghost-smear",
    "swapped-planes",
)
INKS: Final = ("C", "M", "Y", "K", "")
AT_ONCE: Final = 50
REPEATS: Final = 5
DAY_S: Final = 86_400.0


def measure_searches(*, quick: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Write a journal, index it, and search it; the results, as the study's page states them."""
    sheets = QUICK_SHEETS if quick else SHEETS
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "runs.sqlite"
        progress(f"writing a journal of {sheets:,} sheets")
        _write(path, sheets // RUNS)
        reading, label_store = Reading(path), LabelStore(path)
        accounts = Accounts(Path(folder) / "console.sqlite")
        index = SearchIndex(
            Path(folder) / "index",
            reading,
            RunIncidents(reading, label_store, AlarmStore(accounts)),
            label_store,
        )
        begun_s = time.process_time()
        while index.step():
            if index.progress is not None:
                left_s = index.progress.left_s
                progress(
                    f"indexing, {index.progress.percent} %"
                    + ("" if left_s is None else f", {left_s:.0f} s left")
                )
        index_s = time.process_time() - begun_s
        rows = [_timed(reading, index, name, search) for name, search in _searches()]
        whole = SheetSearch(verdict="misprint")
        charts = {
            "misprints by kind, ink and place": lambda: misprints(index, whole, {}),
            "the same of a week": lambda: misprints(index, _week(whole), {}),
            "trends by day": lambda: trend(index, SheetSearch(), step="day"),
        }
        chart_rows = [{"chart": name, "cpu_ms": _cpu_ms(draw)} for name, draw in charts.items()]
        slowest = max(rows, key=lambda row: row["cpu_ms"])["search"]
        condition, values = dict(_searches())[slowest].condition(index)
        query = f"EXPLAIN QUERY PLAN SELECT count(*) FROM sheets s WHERE {condition}"
        plan = [str(row[3]) for row in index.query(query, values)]
        figures = {
            "sheets": sheets // RUNS * RUNS,
            "runs": RUNS,
            "indexed": index.query("SELECT count(*) FROM sheets")[0][0],
            "defects": index.query("SELECT count(*) FROM defects")[0][0],
            "journal_mb": path.stat().st_size / 1e6,
            "index_mb": index.path.stat().st_size / 1e6,
            "index_cpu_s": index_s,
            "rows": rows,
            "charts": chart_rows,
            "slowest": slowest,
            "plan": plan,
            "repeats": REPEATS,
            "quick": quick,
        }
        reading.close()
        accounts.close()
    return figures


def _searches() -> Iterator[tuple[str, SheetSearch]]:
    """Yield searches as people make them: name and conditions."""
    bad = "misprint"
    yield "all that need review", SheetSearch()
    yield "misprints of a week", _week(SheetSearch(verdict=bad))
    yield "a kind", SheetSearch(verdict=bad, defect=DefectConditions(kind="streak"))
    yield "a kind in a week", _week(SheetSearch(verdict=bad, defect=DefectConditions(kind="streak")))
    yield "an ink", SheetSearch(verdict=bad, defect=DefectConditions(ink="K"))
    yield "50 mm and longer", SheetSearch(verdict=bad, defect=DefectConditions(least_mm=50.0))
    corner = DefectConditions(x_mm=0.0, y_mm=0.0, width_mm=20.0, height_mm=20.0)
    yield "in a corner of 20 mm", SheetSearch(verdict=bad, defect=corner)
    yield (
        "within 2 mm of a point",
        SheetSearch(defect=DefectConditions(x_mm=105.0, y_mm=148.0, within_mm=2.0)),
    )
    everything = DefectConditions(
        kind="spots-voids", ink="M", least_mm=3.0, x_mm=50.0, y_mm=50.0, within_mm=30.0
    )
    yield "kind, ink, size and place", SheetSearch(verdict=bad, defect=everything)
    yield "a job", SheetSearch(job="job 7.pdf")
    yield "a customer in a week", _week(SheetSearch(customer="customer 3"))
    yield "not inspected", SheetSearch(verdict="not-inspected")
    yield (
        "good sheets of a day",
        SheetSearch(verdict="good", since_s=FIRST_S + DAY_S, until_s=FIRST_S + 2 * DAY_S),
    )
    yield "no hit: no such location", SheetSearch(defect=DefectConditions(x_mm=5000.0, y_mm=5000.0))


def _week(search: SheetSearch) -> SheetSearch:
    return replace(search, since_s=FIRST_S + 14 * DAY_S, until_s=FIRST_S + 21 * DAY_S)


def _timed(reading: Reading, index: SearchIndex, name: str, search: SheetSearch) -> dict[str, Any]:
    """Measure a search as its page makes it: the number of sheets, and the first of them with their records."""

    def first_page() -> int:
        if search.of_journal:
            find_in_journal(reading, index, search, before=None, limit=AT_ONCE)
        else:
            find(reading, index, search, limit=AT_ONCE, upto_row=2**62)
        return count(index, search, upto_row=2**62) or 0

    return {"search": name, "sheets": first_page(), "cpu_ms": _cpu_ms(first_page)}


def _cpu_ms(what: Callable[[], object]) -> float:
    """Return the median CPU time of some repetitions. [ms]"""
    taken = []
    for _ in range(REPEATS):
        begun_s = time.process_time()
        what()
        taken.append(1000 * (time.process_time() - begun_s))
    return sorted(taken)[REPEATS // 2]


def _write(path: Path, each: int) -> None:
    """Write ``RUNS`` runs of so many sheets."""
    with Journal.open(str(path)) as journal:
        for number in range(RUNS):
            journal.begin_run(_facts(number))
        journal.commit()
    good = json_text(Verdict(page="PAGE", verdict="good", score=-1.0, threshold=1.0))
    columns = (
        "run_id, sheet, job_page, page, verdict, disposition, decided_by, kind, probability, score, threshold, "
        "p_value, late, faulty, noted, first_line, time_s, faults, notes, nuisance, whole_verdict"
    )
    insert = f"INSERT INTO pages ({columns}) VALUES ({', '.join('?' * 21)})"
    with closing(sqlite3.connect(path)) as connection:
        for run in range(RUNS):
            with connection:
                connection.executemany(insert, (_row(run, sheet, good) for sheet in range(each)))
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _row(run: int, sheet: int, good: str) -> tuple[Any, ...]:
    drawn = (
        (run * 1_000_003 + sheet) * 2_654_435_761
    ) % 2**32 >> 4  # scatters numbers (Knuth, volume 3, 6.4)
    page = f"p{sheet % 24 + 1:04}"
    verdict, kind, whole = "good", None, good.replace("PAGE", page)
    if drawn % MISPRINT_EVERY == 0:
        kind = KINDS[min((drawn // 7) % 16 // 2, 7)]
        regions = tuple(_region(drawn // 11 + 97 * at, kind) for at in range(1 + drawn // 5 % 2))
        verdict = "misprint"
        whole = json_text(
            Verdict(page=page, verdict="misprint", kind=kind, regions=regions, score=8.0, threshold=1.0)
        )
    elif drawn % 500 == 1:
        verdict = "not-inspected"
        whole = json_text(
            Verdict(
                page=page,
                verdict="not-inspected",
                reason="lines 700 to 706 were lost: parts of block 3 did not arrive",
            )
        )
    facts = json.loads(whole)
    gains = {f"gain-{ink}": 0.001 * (drawn % 11) for ink in ("cyan", "black")} if sheet % 20 == 0 else {}
    disposition = {"good": "accept", "misprint": "stop", "not-inspected": "hold"}[verdict]
    return (
        *(run + 1, sheet, sheet, page, verdict, disposition, "default", kind, None, facts["score"]),
        *(
            facts["threshold"],
            None,
            0,
            0,
            0,
            3000 * sheet,
            sheet / RATE_HZ,
            "[]",
            "[]",
            json.dumps(gains),
            whole,
        ),
    )


def _region(drawn: int, kind: str) -> Region:
    x, y = drawn % 2100 / 10.0, drawn // 2100 % 2970 / 10.0
    if kind == "streak":
        return Region(
            x_mm=x, y_mm=0.0, width_mm=1.2, height_mm=297.0, score=9.0, kind=kind, ink=INKS[drawn % 5]
        )
    side = 1.0 + drawn % 60 / 10.0
    return Region(
        x_mm=x, y_mm=y, width_mm=side, height_mm=side / 2, score=9.0, kind=kind, ink=INKS[drawn % 5]
    )


def _facts(number: int) -> RunFacts:
    return RunFacts(
        job=f"job {number % 40}.pdf",
        job_digest="",
        press=f"press {number % 4}",
        press_digest="0" * 64,
        detector="matched_filter",
        source="made-up",
        started_s=FIRST_S + number * DAY_S / 3,
        settings={"customer": f"customer {number % 10}"},
    )
