"""The press: drift over a run, how long verdicts took, two runs side by side, what its camera sees now."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated

from fastapi import APIRouter, Query, Request

from prooflight.journal.camera_view import CameraExchange
from prooflight.server.api.common import PREFIX, RunId, Viewer, console
from prooflight.server.api.schemas import (
    CameraAnswer,
    CompareAnswer,
    ComparedRun,
    DriftAnswer,
    FiguresAnswer,
    HistogramAnswer,
    RunAnswer,
)
from prooflight.server.problems import responses
from prooflight.server.reading import facts
from prooflight.server.reading.course import run_figures
from prooflight.server.reading.drift import drift, latencies

if TYPE_CHECKING:
    from prooflight.server.console import Console

router = APIRouter(prefix=PREFIX, tags=["press"])


@router.get("/runs/{run}/drift", responses=responses(401, 403, 404, 422, 503))
def run_drift(
    request: Request,
    _who: Viewer,
    run: RunId,
    points: Annotated[int, Query(ge=2, le=1000, description="Bins of sheets, at most.")] = 200,
    channel: Annotated[str | None, Query(max_length=60, description="One; default all but columns.")] = None,
) -> DriftAnswer:
    """Densities, registers, places and lights over a run: mean, least and greatest a bin, with their tolerances."""
    held = console(request)
    found = held.reading.run_named(run)
    return DriftAnswer(**drift(held.reading, found, points=points, channel=channel))


@router.get("/runs/{run}/latency", responses=responses(401, 403, 404, 422, 503))
def run_latency(request: Request, _who: Viewer, run: RunId) -> HistogramAnswer:
    """How long each sheet's inspection took, as a histogram; from last line to verdict, see `counts` of the run."""
    held = console(request)
    found = held.reading.run_named(run)
    return HistogramAnswer(**latencies(held.reading, found))


@router.get("/runs/{run}/compared", responses=responses(401, 403, 404, 422, 503))
def compared(
    request: Request,
    _who: Viewer,
    run: RunId,
    against: Annotated[str, Query(max_length=20, description="Number of the other run, or `last`.")],
) -> CompareAnswer:
    """Two runs side by side, as the page *Press* shows them: figures, drift, troubles of lines, and times."""
    held = console(request)
    return CompareAnswer(run=_compared(held, run), against=_compared(held, against))


@router.get("/camera", responses=responses(401, 403))
def camera(request: Request, _who: Viewer) -> CameraAnswer:
    """What the camera of the run sees now; asking makes whoever watches tell it for five seconds."""
    exchange = CameraExchange(journal=console(request).settings.journal)
    with contextlib.suppress(OSError):
        exchange.ask()
    return CameraAnswer(seen=exchange.read())


def _compared(held: Console, named: str) -> ComparedRun:
    found = held.reading.run_named(named)
    course = held.courses.of(found)
    figures = FiguresAnswer(**run_figures(found, course))
    told = {name: course[name] for name in ("sheets", "charts", "troubles", "latency")}
    return ComparedRun(run=RunAnswer(**facts.run_of(found)), figures=figures, **told)
