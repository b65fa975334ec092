"""Search: sheets of all runs; and of one sheet its verdict made again."""

from __future__ import annotations

from datetime import date, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request

from prooflight.errors import ProoflightError
from prooflight.inspection.redeciding import replayed
from prooflight.journal.following import Asked
from prooflight.server.api.common import Damaged, RunId, SheetNumber, console
from prooflight.server.pages.shell import ViewerPage, page
from prooflight.server.problems import Problem
from prooflight.server.replaying import evidence_of, replayable

if TYPE_CHECKING:
    from fastapi.responses import Response

    from prooflight.journal.following import Written
    from prooflight.journal.records import RunRow
    from prooflight.server.console import Console

router = APIRouter(include_in_schema=False)

AT_ONCE: Final = 50
VERDICTS: Final = ("look", "misprint", "not-inspected", "good", "any")
"""look: whatever somebody should look at."""
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
    """Sheets that are asked for, the latest first; htmx asks for what is behind, and gets rows alone."""
    held, damaged = console(request), Damaged()
    verdict = verdict if verdict in VERDICTS else "look"
    asked = Asked(
        verdict=verdict if verdict in VERDICTS[1:4] else None,
        kind=kind.strip() or None,
        page=page_name.strip() or None,
        job=job.strip() or None,
        press=press.strip() or None,
        since_s=_day_s(since),
        until_s=_day_s(until, days=1),
        to_look_at=verdict == "look",
    )
    rows = held.reading.found(asked, before=before, limit=AT_ONCE, damaged=damaged.add)
    query = {"job": job, "press": press, "page": page_name, "kind": kind}
    query |= {"verdict": verdict, "since": since, "until": until}
    behind = None
    if rows and len(rows) + damaged.count >= AT_ONCE:
        told = {name: value for name, value in query.items() if value} | {"before": rows[-1].row}
        behind = "/search?" + urlencode(told)
    values: dict[str, Any] = {"found": _with_runs(held, rows), "behind": behind, "damaged": damaged.count}
    if request.headers.get("HX-Request") and before is not None:
        return page(request, who, "search/rows", **values)
    values["any_run"] = bool(held.reading.heads().run)
    return page(request, who, "search/search", asked=query, verdicts=VERDICTS, **values)


@router.get("/runs/{run}/sheets/{sheet}/again")
def again(request: Request, who: ViewerPage, run: RunId, sheet: SheetNumber) -> Response:
    """The verdict of a sheet made again from its evidence, beside what was recorded."""
    found, record, press = replayable(console(request), run, sheet)
    why, figures = "", []
    try:
        figures = replayed(record.verdict, evidence_of(record, run=found.id), press)
    except ProoflightError as error:
        why = str(error)
    return page(request, who, "search/again", run=found, sheet=sheet, figures=figures, why=why)


def _with_runs(held: Console, rows: list[Written]) -> list[dict[str, Any]]:
    runs: dict[int, RunRow] = {}
    for row in rows:
        if row.run_id not in runs:
            runs[row.run_id] = held.reading.run(row.run_id)
    return [{"run": runs[row.run_id], "page": row.page} for row in rows]


def _day_s(text: str, *, days: int = 0) -> float | None:
    """When a day began by the clock of the console's machine, or so many days later; ``Problem`` 422."""
    if not text:
        return None
    try:
        day = date.fromisoformat(text) + timedelta(days=days)
        return datetime(day.year, day.month, day.day).astimezone().timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise Problem(422, "invalid", f"{text} is no day") from error
