"""Search for sheets of all runs; and the verdict of one sheet computed again."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response, StreamingResponse

from prooflight.errors import ProoflightError
from prooflight.inspection.redeciding import replayed
from prooflight_console.api.common import Damaged, RunId, SheetNumber, console
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_console.replaying import evidence_of, replayable
from prooflight_line.journal.exporting import CSV_COLUMNS, csv_row, page_facts
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_console.console import Console
    from prooflight_line.journal.following import Written
    from prooflight_line.journal.records import RunRow

router = APIRouter(include_in_schema=False)

AT_ONCE: Final = 50
EXPORTED_AT_ONCE: Final = 500
VERDICTS: Final = ("look", "misprint", "not-inspected", "good", "any")
"""Choices of verdict; look selects all sheets that need review."""
Text = Annotated[str, Query(max_length=200)]
Day = Annotated[str, Query(pattern=r"^(\d{4}-\d\d-\d\d)?$", description="A day, or none.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """A search: what the form states, and the same for the journal."""

    form: dict[str, str]
    query: PageQuery

    def address(self, path: str, **more: Any) -> str:
        """Return the address of the same search under another path."""
        return f"{path}?{urlencode({name: value for name, value in self.form.items() if value} | more)}"


def _search(
    job: Text = "",
    press: Text = "",
    page_name: Annotated[str, Query(alias="page", max_length=200)] = "",
    kind: Text = "",
    verdict: Text = "look",
    since: Day = "",
    until: Day = "",
) -> Search:
    verdict = verdict if verdict in VERDICTS else "look"
    query = PageQuery(
        verdict=verdict if verdict in VERDICTS[1:4] else None,
        kind=kind.strip() or None,
        page=page_name.strip() or None,
        job=job.strip() or None,
        press=press.strip() or None,
        since_s=day_s(since),
        until_s=day_s(until, days=1),
        to_review=verdict == "look",
    )
    form = {"job": job, "press": press, "page": page_name, "kind": kind}
    return Search(form=form | {"verdict": verdict, "since": since, "until": until}, query=query)


SearchForm = Annotated[Search, Depends(_search)]


@router.get("/search")
def search_page(
    request: Request,
    who: ViewerPage,
    search: SearchForm,
    before: Annotated[int | None, Query(ge=1, lt=2**63)] = None,
) -> Response:
    """Return matching sheets, the latest first; for the next page htmx requests and gets rows alone."""
    state, damaged = console(request), Damaged()
    rows = state.reading.search(search.query, before=before, limit=AT_ONCE, damaged=damaged.add)
    next_page = None
    if rows and len(rows) + damaged.count >= AT_ONCE:
        next_page = search.address("/search", before=rows[-1].row)
    values: dict[str, Any] = {"found": _with_runs(state, rows), "behind": next_page, "damaged": damaged.count}
    if request.headers.get("HX-Request") and before is not None:
        return page(request, who, "search/rows", **values)
    values["any_run"] = bool(state.reading.heads().run)
    values["exports"] = {kind: search.address(f"/search.{kind}") for kind in ("csv", "json")} if rows else {}
    return page(request, who, "search/search", asked=search.form, verdicts=VERDICTS, **values)


@router.get("/search.csv")
def search_csv(request: Request, _who: ViewerPage, search: SearchForm) -> Response:
    """Return all matching sheets as CSV, the latest first: run, job and press before ``CSV_COLUMNS``."""
    file = io.StringIO()
    runs: dict[int, RunRow] = {}

    def lines() -> Iterator[str]:
        writer = csv.DictWriter(file, ("run", "job", "press", *CSV_COLUMNS), lineterminator="\n")
        writer.writeheader()
        for row in _every(console(request), search.query):
            writer.writerow(_run_of(console(request), row, runs) | csv_row(row.page))
            yield file.getvalue()
            file.seek(0)
            file.truncate()
        yield file.getvalue()

    return _download(lines(), "csv", "text/csv")


@router.get("/search.json")
def search_json(request: Request, _who: ViewerPage, search: SearchForm) -> Response:
    """Return all matching sheets as one JSON array, the latest first."""
    runs: dict[int, RunRow] = {}

    def lines() -> Iterator[str]:
        before = "["
        for row in _every(console(request), search.query):
            yield before + json_text(_run_of(console(request), row, runs) | page_facts(row.page))
            before = ",\n"
        yield "]" if before != "[" else "[]"

    return _download(lines(), "json", "application/json")


def _download(lines: Iterator[str], ending: str, kind: str) -> Response:
    name = f'attachment; filename="sheets.{ending}"'
    return StreamingResponse(lines, media_type=kind, headers={"Content-Disposition": name})


def _every(state: Console, query: PageQuery) -> Iterator[Written]:
    """Yield all matching sheets, ``EXPORTED_AT_ONCE`` from the journal at a time; damaged ones are left out."""
    before: int | None = None
    while rows := state.reading.search(query, before=before, limit=EXPORTED_AT_ONCE, damaged=lambda _: None):
        yield from rows
        before = rows[-1].row


def _run_of(state: Console, row: Written, runs: dict[int, RunRow]) -> dict[str, Any]:
    if row.run_id not in runs:
        runs[row.run_id] = state.reading.run(row.run_id)
    run_facts = runs[row.run_id].facts
    return {"run": row.run_id, "job": run_facts.job, "press": run_facts.press}


@router.get("/runs/{run}/sheets/{sheet}/again")
def again(request: Request, who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """Return the verdict of a sheet, computed again from its evidence, next to what was recorded."""
    run_row, record, press = replayable(console(request), run, sheet)
    why, figures = "", []
    try:
        figures = replayed(record.verdict, evidence_of(record, run=run_row.id), press)
    except ProoflightError as error:
        why = str(error)
    return page(request, who, "search/again", run=run_row, sheet=sheet, figures=figures, why=why)


def _with_runs(state: Console, rows: list[Written]) -> list[dict[str, Any]]:
    runs: dict[int, RunRow] = {}
    for row in rows:
        if row.run_id not in runs:
            runs[row.run_id] = state.reading.run(row.run_id)
    return [{"run": runs[row.run_id], "page": row.page} for row in rows]


def day_s(text: str, *, days: int = 0) -> float | None:
    """Return the Unix time at which a day began, by the clock of the console's machine, or ``days`` later.

    Raises ``Problem`` 422 if the text is no day.
    """
    if not text:
        return None
    try:
        day = date.fromisoformat(text) + timedelta(days=days)
        return datetime(day.year, day.month, day.day).astimezone().timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise Problem(422, "invalid", f"{text} is no day") from error
