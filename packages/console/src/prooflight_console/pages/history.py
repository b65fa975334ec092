"""The page History: the means of all runs of a press, and the notes that people wrote about them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Final

from fastapi import APIRouter, Form, Path, Request
from fastapi.responses import Response

from prooflight_console.api.common import console
from prooflight_console.pages.drawings import channel_colour, channel_name
from prooflight_console.pages.search import day_s
from prooflight_console.pages.shell import OperatorPage, ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_console.reading.history import HEIGHT, WIDTH, TimeScale, history

router = APIRouter(include_in_schema=False)

RUNS: Final = 60
"""Number of last runs that are shown."""


@router.get("/press/history")
def history_page(request: Request, who: ViewerPage) -> Response:
    """Return the page; the charts come later, since many runs take seconds to read."""
    state = console(request)
    today = datetime.fromtimestamp(state.accounts.clock()).astimezone().strftime("%Y-%m-%d")
    return page(request, who, "engineering/history", notes=state.chart_notes.listed(), today=today)


@router.get("/press/history/charts")
def history_charts(request: Request, who: ViewerPage) -> Response:
    """Return the charts of the last runs of the press that ran last."""
    state = console(request)
    runs = state.reading.runs(before=None, limit=RUNS, damaged=lambda _: None)
    own = [run for run in runs if run.facts.press == runs[0].facts.press and run.pages]
    scale = TimeScale.of(own)
    notes = [(one, scale.x(one.at_s)) for one in state.chart_notes.listed()]
    return page(
        request,
        who,
        "engineering/history_charts",
        charts=history(own, state.trends),
        notes=notes,
        width=WIDTH,
        height=HEIGHT,
        colour=channel_colour,
        channel_name=channel_name,
    )


@router.post("/press/history/notes")
def write_note(
    request: Request,
    who: OperatorPage,
    text: Annotated[str, Form(max_length=1000)],
    day: Annotated[str, Form(max_length=10)],
) -> Response:
    """Add a note of a day."""
    at_s = day_s(day)
    if at_s is None:
        raise Problem(422, "day", "give a day as 2026-11-27")
    console(request).chart_notes.write(text, at_s=at_s, by=who.name)
    return Response(status_code=204, headers={"HX-Redirect": "/press/history"})


@router.post("/press/history/notes/{note}/remove")
def remove_note(request: Request, who: OperatorPage, note: Annotated[int, Path(ge=1, lt=2**63)]) -> Response:
    """Remove a note from the charts."""
    console(request).chart_notes.remove(note, by=who.name)
    return Response(status_code=204, headers={"HX-Redirect": "/press/history"})
