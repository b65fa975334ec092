"""Conversion of records to rows and back, and the queries that take more than a line."""

from __future__ import annotations

from dataclasses import asdict
from operator import index
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import case, func, insert, select, true, update

from prooflight_line.journal.columns import QUERY_COLUMNS, EndColumns, PageColumns, RunColumns
from prooflight_line.journal.records import COUNTED, PageRecord, RunEnd, RunFacts, RunRow
from prooflight_line.journal.schema import json_text, plain, stored_packs, stored_pages, stored_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, Row

    from prooflight_line.journal.queue import Batch
    from prooflight_line.journal.records import State


SUSPENDED: Final = '"promise_suspended": true'
"""Text of a suspended verdict as ``json_text`` writes it; within a string its quotes would be escaped."""


def write_rows(connection: Connection, batch: Batch, packs: Mapping[int, tuple[str, int]]) -> None:
    """Write a batch's rows. packs: file and bytes of the evidence of each run in it that has some.

    ValueError: a row could not be read again.
    """
    for run_id, facts in batch.begun.items():
        row = run_row(run_id, facts) | {"dropped_pages": 0, "dropped_evidence": 0}
        # Ignored if an earlier commit that seemed to fail succeeded.
        connection.execute(insert(stored_runs).prefix_with("OR IGNORE").values(**row))
    pack_ids = {}
    for run_id, (file, size) in packs.items():
        added = connection.execute(insert(stored_packs).values(run_id=run_id, file=file, bytes=size))
        pack_ids[run_id] = added.lastrowid
    if batch.pages:
        values = [
            page_row(run_id, page, pack_ids[run_id] if page.evidence else None)
            for run_id, page in batch.pages
        ]
        connection.execute(insert(stored_pages).prefix_with("OR REPLACE"), values)
    run = stored_runs.c
    for run_id, end in batch.ended.items():
        connection.execute(update(stored_runs).where(run.id == run_id).values(**end_row(end)))
    for name, dropped in (
        ("dropped_pages", batch.dropped_pages),
        ("dropped_evidence", batch.dropped_evidence),
    ):
        for run_id, count in dropped.items():
            more = {name: run[name] + count}
            connection.execute(update(stored_runs).where(run.id == run_id).values(**more))


def run_row(run_id: int, facts: RunFacts) -> dict[str, Any]:
    """Convert a run's facts to columns; ValueError: some cannot be stored."""
    row = plain(asdict(facts) | {"id": run_id})
    row["settings"] = json_text(row["settings"])
    RunColumns(**row)
    return row


def end_row(end: RunEnd) -> dict[str, Any]:
    """Convert the end of a run to columns; ValueError: some cannot be stored."""
    row = plain(asdict(end)) | {"counts": json_text(end.counts)}
    EndColumns(**row)
    return row


def page_row(run_id: int, page: PageRecord, pack_id: int | None = None) -> dict[str, Any]:
    """Convert a record to columns, with plain numbers for NumPy's. ValueError, TypeError: it cannot be stored."""
    whole = plain(page.verdict)
    row = {name: whole[name] for name in QUERY_COLUMNS} | {
        "disposition": page.disposition,
        "decided_by": page.decided_by,
        "run_id": run_id,
        "sheet": index(page.sheet),
        "job_page": None if page.job_page is None else index(page.job_page),
        "late": int(page.late),
        "faulty": int(bool(page.faults)),
        "noted": int(bool(page.notes)),
        "first_line": index(page.first_line),
        "time_s": float(page.time_s),
        "faults": json_text(page.faults),
        "notes": json_text(page.notes),
        "nuisance": json_text(page.nuisance),
        "whole_verdict": json_text(whole),
        "asked": None if page.asked is None else float(page.asked),
        "pack_id": pack_id,
    }
    PageColumns(**row)
    return row


def page_record(row: Row[Any], evidence: Mapping[str, NDArray[Any]] | None = None) -> PageRecord:
    """Convert columns to a record; ValueError: they are not those of a valid page."""
    columns = PageColumns(**row._asdict())
    return PageRecord(
        sheet=columns.sheet,
        job_page=columns.job_page,
        verdict=columns.whole_verdict,
        late=bool(columns.late),
        first_line=columns.first_line,
        time_s=columns.time_s,
        faults=columns.faults,
        notes=columns.notes,
        nuisance=columns.nuisance,
        asked=columns.asked,
        gate=columns.disposition if columns.decided_by == "gate" else None,
        evidence=evidence,
    )


def clearly_good() -> ColumnElement[bool]:
    """Return the condition of pages that need no review: good, in time, without fault and note, in all columns.

    ``needs_no_review`` decides about the others; a verdict with NaN, which SQLite does not accept as JSON, is
    one.
    """
    page = stored_pages.c
    full_verdict = case(
        (func.json_valid(page.whole_verdict), func.json_extract(page.whole_verdict, "$.verdict")), else_=""
    )
    good = (page.verdict == "good") & (full_verdict == "good") & (page.late == 0)
    unremarkable = (page.faulty == 0) & (page.noted == 0) & (page.faults == "[]") & (page.notes == "[]")
    return (good & unremarkable).is_(true())


def absent() -> ColumnElement[bool]:
    """Return the condition of pages of the job that did not come, as ``inspection.sheets.came`` has it."""
    page = stored_pages.c
    return (page.faults == '["missing"]') & (page.verdict == "not-inspected") & page.job_page.is_not(None)


def needs_no_review(page: PageRecord) -> bool:
    """Return whether a page needs no review: it is good, in time, and without fault and note."""
    return page.verdict.verdict == "good" and not (page.late or page.faults or page.notes)


def read_runs(
    connection: Connection,
    run_id: int | None,
    *,
    writer_lives: bool,
    damaged: Callable[[object, ValueError], None],
) -> list[RunRow]:
    """Return runs by number, with the counts of their pages; of one run, or of all.

    damaged: called for each run that cannot be read, with the value in place of its number, and the error.
    """

    def count(condition: Any) -> Any:
        return func.sum(case((condition, 1), else_=0))

    page = stored_pages.c
    of_pages = select(
        page.run_id,
        func.count().label("pages"),
        count(page.verdict == "misprint").label("misprints"),
        count(page.verdict == "not-inspected").label("not_inspected"),
        count(page.late == 1).label("late"),
        count(page.faulty == 1).label("faulty"),
        count(absent()).label("absent"),
    ).group_by(page.run_id)
    query = select(stored_runs).order_by(stored_runs.c.id)
    if run_id is not None:
        of_pages = of_pages.where(page.run_id == run_id)
        query = query.where(stored_runs.c.id == run_id)
    counts = {row.run_id: row._asdict() for row in connection.execute(of_pages)}
    suspended = _suspended_from(connection, run_id)
    last = connection.execute(select(func.max(stored_runs.c.id))).scalar()
    runs = []
    for row in connection.execute(query):
        try:
            lives = writer_lives and row.id == last
            runs.append(_run(row, counts.get(row.id, {}), suspended.get(row.id), writer_lives=lives))
        except ValueError as error:
            damaged(row.id, error)
    return runs


def _suspended_from(connection: Connection, run_id: int | None) -> dict[Any, int]:
    """Return, by run, the first sheet that reports the false-alarm rate not to hold, which is marked by a note."""
    page = stored_pages.c
    suspended = func.instr(page.whole_verdict, SUSPENDED) > 0
    query = select(page.run_id, func.min(page.sheet).label("sheet")).where(page.noted == 1, suspended)
    if run_id is not None:
        query = query.where(page.run_id == run_id)
    rows = connection.execute(query.group_by(page.run_id))
    return {row.run_id: row.sheet for row in rows if isinstance(row.sheet, int)}


def _run(
    row: Row[Any], counts: Mapping[Any, Any], suspended_from: int | None, *, writer_lives: bool
) -> RunRow:
    columns, end = RunColumns(**row._asdict()), None
    state: State = "running" if writer_lives else "interrupted"
    if columns.ended_s is not None and columns.ending is not None:
        state = columns.ending
        end = RunEnd(
            ended_s=columns.ended_s, ending=state, detail=columns.detail or "", counts=columns.counts or {}
        )
    return RunRow(
        id=columns.id,
        facts=RunFacts(**{name: getattr(columns, name) for name in RunFacts.__slots__}),
        end=end,
        state=state,
        dropped_pages=columns.dropped_pages,
        dropped_evidence=columns.dropped_evidence,
        promise_suspended_from=suspended_from,
        **{name: counts.get(name, 0) for name in COUNTED},
    )
