"""Records to rows and back, and the queries that take more than a line."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

from sqlalchemy import case, func, insert, select, update

from prooflight.deciding.verdict import Ink, Region, Verdict
from prooflight.inspecting.journaling.records import PageRecord, RunEnd, RunFacts, RunRow
from prooflight.inspecting.journaling.schema import json_text, packs_table, pages_table, runs_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray
    from sqlalchemy import Connection, Row

    from prooflight.inspecting.journaling.queue import Batch
    from prooflight.inspecting.journaling.records import State

ASKED_ALONE = ("page", "verdict", "action", "kind", "probability", "score", "threshold", "p_value")
"""Of a verdict, as columns, so that a query can ask for them."""


def write_rows(connection: Connection, batch: Batch, packs: Mapping[int, tuple[str, int]]) -> None:
    """A batch's rows. packs: file and bytes of the evidence of each run in it that has some."""
    for run_id, facts in batch.begun.items():
        # Ignored where a commit that seemed to fail did not.
        connection.execute(insert(runs_table).prefix_with("OR IGNORE").values(id=run_id, **asdict(facts)))
    pack_ids = {}
    for run_id, (file, size) in packs.items():
        added = connection.execute(insert(packs_table).values(run_id=run_id, file=file, bytes=size))
        pack_ids[run_id] = added.lastrowid
    if batch.pages:
        found = [
            page_row(run_id, page, pack_ids[run_id] if page.evidence else None)
            for run_id, page in batch.pages
        ]
        connection.execute(insert(pages_table).prefix_with("OR REPLACE"), found)
    for run_id, end in batch.ended.items():
        connection.execute(update(runs_table).where(runs_table.c.id == run_id).values(**asdict(end)))
    for column, dropped in (
        (runs_table.c.dropped_pages, batch.dropped_pages),
        (runs_table.c.dropped_evidence, batch.dropped_evidence),
    ):
        for run_id, count in dropped.items():
            more = {column.name: column + count}
            connection.execute(update(runs_table).where(runs_table.c.id == run_id).values(**more))


def page_row(run_id: int, page: PageRecord, pack_id: int | None) -> dict[str, Any]:
    """Record -> columns; numbers of NumPy become plain ones."""
    whole = json.loads(json_text(asdict(page.verdict)))
    return {name: whole[name] for name in ASKED_ALONE} | {
        "run_id": run_id,
        "sheet": int(page.sheet),
        "job_page": None if page.job_page is None else int(page.job_page),
        "late": bool(page.late),
        "faulty": bool(page.faults),
        "noted": bool(page.notes),
        "first_line": int(page.first_line),
        "time_s": float(page.time_s),
        "faults": list(page.faults),
        "notes": list(page.notes),
        "nuisance": dict(page.nuisance),
        "whole_verdict": whole,
        "pack_id": pack_id,
    }


def page_record(row: Row[Any], evidence: Mapping[str, NDArray[Any]] | None = None) -> PageRecord:
    """Columns -> record."""
    return PageRecord(
        sheet=row.sheet,
        job_page=row.job_page,
        verdict=_verdict(row.whole_verdict),
        late=row.late,
        first_line=row.first_line,
        time_s=row.time_s,
        faults=tuple(row.faults),
        notes=tuple(row.notes),
        nuisance=row.nuisance,
        evidence=evidence,
    )


def _verdict(whole: Mapping[str, Any]) -> Verdict:
    """What JSON made of a verdict -> the verdict; lists were tuples. What this version does not know is left out."""
    known = {field.name for field in fields(Verdict)}
    found = {name: _tupled(value) for name, value in whole.items() if name in known}
    found["regions"] = tuple(Region(**region) for region in found["regions"])
    found["inks"] = {letter: Ink(**ink) for letter, ink in found.get("inks", {}).items()}
    return Verdict(**found)


def _tupled(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tupled(part) for part in value)
    if isinstance(value, dict):
        return {name: _tupled(part) for name, part in value.items()}
    return value


def read_runs(connection: Connection, run_id: int | None, *, writer_lives: bool) -> list[RunRow]:
    """Runs by number, with what their pages come to; of one run, or of all."""

    def count(condition: Any) -> Any:
        return func.sum(case((condition, 1), else_=0))

    of_pages = select(
        pages_table.c.run_id,
        func.count().label("pages"),
        count(pages_table.c.verdict == "misprint").label("misprints"),
        count(pages_table.c.verdict == "not-inspected").label("not_inspected"),
        count(pages_table.c.late).label("late"),
        count(pages_table.c.faulty).label("faulty"),
    ).group_by(pages_table.c.run_id)
    query = select(runs_table).order_by(runs_table.c.id)
    if run_id is not None:
        of_pages = of_pages.where(pages_table.c.run_id == run_id)
        query = query.where(runs_table.c.id == run_id)
    counts = {row.run_id: row._asdict() for row in connection.execute(of_pages)}
    last = connection.execute(select(func.max(runs_table.c.id))).scalar()
    return [
        _run(row, counts.get(row.id, {}), writer_lives=writer_lives and row.id == last)
        for row in connection.execute(query)
    ]


def _run(row: Row[Any], counts: Mapping[str, int], *, writer_lives: bool) -> RunRow:
    end, state = None, _unended(writer_lives=writer_lives)
    if row.ended_s is not None:
        end = RunEnd(ended_s=row.ended_s, ending=row.ending, detail=row.detail, counts=row.counts)
        state = end.ending
    return RunRow(
        id=row.id,
        facts=RunFacts(**{name: getattr(row, name) for name in RunFacts.__slots__}),
        end=end,
        state=state,
        dropped_pages=row.dropped_pages,
        dropped_evidence=row.dropped_evidence,
        **{name: counts.get(name, 0) for name in ("pages", "misprints", "not_inspected", "late", "faulty")},
    )


def _unended(*, writer_lives: bool) -> State:
    return "running" if writer_lives else "interrupted"
