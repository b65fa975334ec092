"""Figures for Prometheus, and whether the console lives and is ready, for whoever starts and watches it."""

from __future__ import annotations

from fastapi import APIRouter, Depends, Request
from fastapi.responses import PlainTextResponse
from prometheus_client.exposition import CONTENT_TYPE_LATEST

from prooflight_console.access import open_to_all
from prooflight_console.api.common import Viewer, console
from prooflight_line.journal.schema import JournalError

router = APIRouter(include_in_schema=False)


@router.get("/metrics")
def metrics(request: Request, _who: Viewer) -> PlainTextResponse:
    """Return all figures in Prometheus's text format."""
    return PlainTextResponse(console(request).metrics.text(), media_type=CONTENT_TYPE_LATEST)


@router.get("/healthz", dependencies=[Depends(open_to_all())])
def lives() -> PlainTextResponse:
    """Answer, which says that the process lives."""
    return PlainTextResponse("ok\n")


@router.get("/readyz", dependencies=[Depends(open_to_all())])
def ready(request: Request) -> PlainTextResponse:
    """Return whether the journal can be read; one that no run has begun yet can be.

    The reason is for those who may see the journal, and stands in the page Now.
    """
    try:
        console(request).reading.last_run()
    except (JournalError, OSError):
        return PlainTextResponse("the journal cannot be read\n", 503)
    return PlainTextResponse("ok\n")
