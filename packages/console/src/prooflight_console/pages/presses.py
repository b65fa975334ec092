"""All presses whose records lie in one database: an overview, and search over all their sheets."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request

from prooflight.cmyk import INK_LETTERS
from prooflight_console.api.common import console
from prooflight_console.pages.search import Day, Short, Text, conditions_of, day_s
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_line.records.database import connect, refused
from prooflight_line.records.searching import SheetQuery, find, presses

if TYPE_CHECKING:
    from fastapi.responses import Response

    from prooflight_line.records.searching import Hit

router = APIRouter(include_in_schema=False)

AT_ONCE: Final = 50
VERDICTS: Final = ("misprint", "not-inspected", "good", "any")
HOURS: Final = {"day": 24, "week": 168}
QUIET_S: Final = 60.0
"""Time without shipping after which a running press is shown as out of reach."""
Position = Annotated[str, Query(max_length=80, pattern=r"^$|^[0-9T:.+-]+/\d{1,9}/\d{1,9}$")]


@router.get("/presses")
def presses_page(
    request: Request, who: ViewerPage, over: Annotated[str, Query(max_length=10)] = "day"
) -> Response:
    """Return the overview of all presses, by plant."""
    over = over if over in HOURS else "day"
    now = datetime.fromtimestamp(console(request).accounts.clock(), UTC)
    with _records(request) as connection, refused("records", "presses could not be listed"):
        states = presses(connection, since=now - timedelta(hours=HOURS[over]))
    away = {
        one.press
        for one in states
        if one.running and (one.shipped_at is None or (now - one.shipped_at).total_seconds() > QUIET_S)
    }
    return page(request, who, "presses/presses", states=states, away=away, over=over, choices=tuple(HOURS))


@router.get("/presses/sheets")
def sheets_page(
    request: Request,
    who: ViewerPage,
    press: Text = "",
    plant: Text = "",
    job: Text = "",
    kind: Text = "",
    verdict: Text = "misprint",
    page_name: Annotated[str, Query(alias="page", max_length=200)] = "",
    ink: Short = "",
    size: Short = "",
    x: Short = "",
    y: Short = "",
    width: Short = "",
    height: Short = "",
    within: Short = "",
    since: Day = "",
    until: Day = "",
    before: Position = "",
) -> Response:
    """Return matching sheets of all presses, the latest first; for the next page htmx gets rows alone."""
    verdict = verdict if verdict in VERDICTS else "misprint"
    place = {"x": x, "y": y, "width": width, "height": height, "within": within}
    query = SheetQuery(
        press=press.strip() or None,
        plant=plant.strip() or None,
        job=job.strip() or None,
        kind=kind.strip() or None,
        verdict=None if verdict == "any" else verdict,
        page=page_name.strip() or None,
        defect=conditions_of(ink=ink, size=size, **place),
        since=_day(since),
        until=_day(until, days=1),
    )
    with _records(request) as connection, refused("records", "the search failed"):
        hits = find(connection, query, before=_position(before), limit=AT_ONCE)
    entries = {"press": press, "plant": plant, "job": job, "kind": kind}
    entries |= {"page": page_name, "ink": ink, "size": size, **place}
    entries |= {"verdict": verdict, "since": since, "until": until}
    next_page = None
    if len(hits) == AT_ONCE:
        parameters = {name: value for name, value in entries.items() if value} | {"before": _text(hits[-1])}
        next_page = "/presses/sheets?" + urlencode(parameters)
    values: dict[str, Any] = {"hits": hits, "next_page": next_page}
    if request.headers.get("HX-Request") and before:
        return page(request, who, "presses/rows", **values)
    return page(
        request, who, "presses/sheets", entries=entries, verdicts=VERDICTS, inks=INK_LETTERS, **values
    )


def _records(request: Request) -> Any:
    """Return a connection to the records. Problem: none are shown here; RecordsError: they cannot be reached."""
    url = console(request).settings.records
    if url is None:
        raise Problem(404, "not-found", "this console was started without --records")
    return connect(url)


def _day(text: str, *, days: int = 0) -> datetime | None:
    start_s = day_s(text, days=days)
    return None if start_s is None else datetime.fromtimestamp(start_s, UTC)


def _text(hit: Hit) -> str:
    at, run, sheet = hit.position
    return f"{at.astimezone(UTC).isoformat()}/{run}/{sheet}"


def _position(text: str) -> tuple[datetime, int, int] | None:
    if not text:
        return None
    at, run, sheet = text.split("/")
    try:
        return datetime.fromisoformat(at), int(run), int(sheet)
    except ValueError as error:
        raise Problem(422, "invalid", f"{text[:80]} is not a place in the list") from error
