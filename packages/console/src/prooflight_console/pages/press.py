"""The page Press: drift with its limits, lost lines and times of one run, or of two side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response

from prooflight_console.api.common import RunId, console
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.reading.trend import machine, run_figures

if TYPE_CHECKING:
    from prooflight_console.console import Console
    from prooflight_line.journal.records import RunRow

router = APIRouter(include_in_schema=False)

RUNS_TO_CHOOSE: Final = 100
Chosen = Annotated[str, Query(max_length=20)]


@router.get("/press")
def press_page(request: Request, who: ViewerPage, run: Chosen = "last", against: Chosen = "") -> Response:
    """Return the page of one run or two; figures come later, since a long run takes seconds to read."""
    state = console(request)
    runs = state.reading.runs(before=None, limit=RUNS_TO_CHOOSE, damaged=lambda _: None)
    shown = _shown(state, run, against) if runs or run != "last" else []
    return page(request, who, "press/press", runs=runs, shown=shown)


@router.get("/press/figures")
def press_figures(request: Request, who: ViewerPage, run: Chosen = "last", against: Chosen = "") -> Response:
    """Return the figures by which runs are compared, as a table."""
    state = console(request)
    columns = [(one, run_figures(one, state.trends.of(one))) for one in _shown(state, run, against)]
    return page(request, who, "press/figures", columns=columns, machine=machine())


@router.get("/press/{run}/course")
def press_trend(request: Request, _who: ViewerPage, run: RunId) -> Response:
    """Return the data of a run's charts."""
    state = console(request)
    trend: dict[str, Any] = state.trends.of(state.reading.run_named(run))
    return JSONResponse(trend)


def _shown(state: Console, run: str, against: str) -> list[RunRow]:
    reading = state.reading
    first = reading.run_named(run)
    other = reading.run_named(against) if against else first
    return [first] if other.id == first.id else [first, other]
