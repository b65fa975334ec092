"""The press: drift over a run, inspection times, two runs side by side, and the view of its camera."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated

from fastapi import APIRouter, Query, Request

from prooflight_console.api.common import PREFIX, RunId, Viewer, console
from prooflight_console.api.schemas import (
    CameraAnswer,
    CompareAnswer,
    ComparedRun,
    DriftAnswer,
    FiguresAnswer,
    HistogramAnswer,
    RunAnswer,
)
from prooflight_console.problems import responses
from prooflight_console.reading import facts
from prooflight_console.reading.trend import drift, latencies, run_figures
from prooflight_line.journal.camera_view import CameraExchange

if TYPE_CHECKING:
    from prooflight_console.console import Console

router = APIRouter(prefix=PREFIX, tags=["press"])


@router.get("/runs/{run}/drift", responses=responses(401, 403, 404, 422, 503))
def run_drift(
    request: Request,
    _who: Viewer,
    run: RunId,
    points: Annotated[int, Query(ge=2, le=1000, description="Bins of sheets, at most.")] = 200,
    channel: Annotated[str | None, Query(max_length=60, description="One; default all but columns.")] = None,
) -> DriftAnswer:
    """Return densities, registers, positions and light levels over a run.

    Each bin has mean, least and greatest value; each channel has its tolerance.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    return DriftAnswer(**drift(state.reading, run_row, points=points, channel=channel))


@router.get("/runs/{run}/latency", responses=responses(401, 403, 404, 422, 503))
def run_latency(request: Request, _who: Viewer, run: RunId) -> HistogramAnswer:
    """Return a histogram of each sheet's inspection time.

    For the time from last line to verdict see `counts` of the run.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    return HistogramAnswer(**latencies(state.reading, run_row))


@router.get("/runs/{run}/compared", responses=responses(401, 403, 404, 422, 503))
def compared(
    request: Request,
    _who: Viewer,
    run: RunId,
    against: Annotated[str, Query(max_length=20, description="Number of the other run, or `last`.")],
) -> CompareAnswer:
    """Compare two runs as the page *Press* shows them: figures, drift, troubles of lines, and times."""
    state = console(request)
    return CompareAnswer(run=_compared(state, run), against=_compared(state, against))


@router.get("/camera", responses=responses(401, 403))
def camera(request: Request, _who: Viewer) -> CameraAnswer:
    """Return the camera's current view; a request makes the watching process report it for five seconds."""
    exchange = CameraExchange(journal=console(request).settings.journal)
    with contextlib.suppress(OSError):
        exchange.ask()
    return CameraAnswer(seen=exchange.read())


def _compared(state: Console, named: str) -> ComparedRun:
    run_row = state.reading.run_named(named)
    trend = state.trends.of(run_row)
    figures = FiguresAnswer(**run_figures(run_row, trend))
    parts = {name: trend[name] for name in ("sheets", "charts", "troubles", "latency")}
    return ComparedRun(run=RunAnswer(**facts.run_of(run_row)), figures=figures, **parts)
