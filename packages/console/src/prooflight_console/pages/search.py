"""Search for sheets of all runs; and the verdict of one sheet computed again."""

from __future__ import annotations

from datetime import date, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request

from prooflight.errors import ProoflightError
from prooflight.inspection.redeciding import replayed
from prooflight_console.api.common import Damaged, RunId, SheetNumber, console
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_console.replaying import evidence_of, replayable
from prooflight_line.journal.following import PageQuery

if TYPE_CHECKING:
    from fastapi.responses import Response

    from prooflight_console.console import Console
    from prooflight_line.journal.following import Written
    from prooflight_line.journal.records import RunRow

router = APIRouter(include_in_schema=False)

AT_ONCE: Final = 50
VERDICTS: Final = ("look", "misprint", "not-inspected", "good", "any")
"""Choices of verdict; look selects all sheets that need review."""
Text = Annotated[str, Query(max_length=200)]
Day = Annotated[str, Query(pattern=r"^(\d{4}-\d\d-\d\d)?$", description="A day, or none.")]


@router.get("/search")
def search_page(
    request: Request,
    who: ViewerPage,
    job: Text = "",
    press: Text = "",
    page_name: Annotated[str, Query(alias="page", max_length=200)] = "",
    kind: Text = "",
    verdict: Text = "look",
    since: Day = "",
    until: Day = "",
    before: Annotated[int | None, Query(ge=1, lt=2**63)] = None,
) -> Response:
    """Return matching sheets, the latest first; for the next page htmx requests and gets rows alone."""
    state, damaged = console(request), Damaged()
    verdict = verdict if verdict in VERDICTS else "look"
    selection = PageQuery(
        verdict=verdict if verdict in VERDICTS[1:4] else None,
        kind=kind.strip() or None,
        page=page_name.strip() or None,
        job=job.strip() or None,
        press=press.strip() or None,
        since_s=day_s(since),
        until_s=day_s(until, days=1),
        to_review=verdict == "look",
    )
    rows = state.reading.search(selection, before=before, limit=AT_ONCE, damaged=damaged.add)
    query = {"job": job, "press": press, "page": page_name, "kind": kind}
    query |= {"verdict": verdict, "since": since, "until": until}
    next_page = None
    if rows and len(rows) + damaged.count >= AT_ONCE:
        parameters = {name: value for name, value in query.items() if value} | {"before": rows[-1].row}
        next_page = "/search?" + urlencode(parameters)
    values: dict[str, Any] = {"found": _with_runs(state, rows), "behind": next_page, "damaged": damaged.count}
    if request.headers.get("HX-Request") and before is not None:
        return page(request, who, "search/rows", **values)
    values["any_run"] = bool(state.reading.heads().run)
    return page(request, who, "search/search", asked=query, verdicts=VERDICTS, **values)


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
