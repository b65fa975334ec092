"""The page Press: drift with its limits, lost lines, times; two runs side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response

from prooflight.server.api.common import RunId, console
from prooflight.server.pages.shell import ViewerPage, page
from prooflight.server.reading.course import machine, run_figures

if TYPE_CHECKING:
    from prooflight.journal.records import RunRow
    from prooflight.server.console import Console

router = APIRouter(include_in_schema=False)

RUNS_TO_CHOOSE: Final = 100
Chosen = Annotated[str, Query(max_length=20)]


@router.get("/press")
def press_page(request: Request, who: ViewerPage, run: Chosen = "last", against: Chosen = "") -> Response:
    """One run, or two side by side; their numbers come after, since a long run takes seconds to read."""
    held = console(request)
    runs = held.reading.runs(before=None, limit=RUNS_TO_CHOOSE, damaged=lambda _: None)
    shown = _shown(held, run, against) if runs or run != "last" else []
    return page(request, who, "press/press", runs=runs, shown=shown)


@router.get("/press/figures")
def press_figures(request: Request, who: ViewerPage, run: Chosen = "last", against: Chosen = "") -> Response:
    """What runs are compared by, as a table."""
    held = console(request)
    columns = [(one, run_figures(one, held.courses.of(one))) for one in _shown(held, run, against)]
    return page(request, who, "press/figures", columns=columns, machine=machine())


@router.get("/press/{run}/course")
def press_course(request: Request, _who: ViewerPage, run: RunId) -> Response:
    """The numbers of a run's charts."""
    held = console(request)
    found: dict[str, Any] = held.courses.of(held.reading.run_named(run))
    return JSONResponse(found)


def _shown(held: Console, run: str, against: str) -> list[RunRow]:
    reading = held.reading
    first = reading.run_named(run)
    other = reading.run_named(against) if against else first
    return [first] if other.id == first.id else [first, other]
