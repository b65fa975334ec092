"""The press: drift over a run, how long verdicts took, what its camera sees now."""

from __future__ import annotations

import contextlib
from typing import Annotated

from fastapi import APIRouter, Query, Request

from prooflight.journal.camera_view import CameraExchange
from prooflight.server.api.common import PREFIX, RunId, Viewer, console
from prooflight.server.api.schemas import CameraAnswer, DriftAnswer, HistogramAnswer
from prooflight.server.problems import responses
from prooflight.server.reading.drift import drift, latencies

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


@router.get("/camera", responses=responses(401, 403))
def camera(request: Request, _who: Viewer) -> CameraAnswer:
    """What the camera of the run sees now; asking makes whoever watches tell it for five seconds."""
    exchange = CameraExchange(journal=console(request).settings.journal)
    with contextlib.suppress(OSError):
        exchange.ask()
    return CameraAnswer(seen=exchange.read())
