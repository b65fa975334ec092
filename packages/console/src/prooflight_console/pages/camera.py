"""The page Set up, camera: the view of its lines that the watching process reports."""

from __future__ import annotations

import asyncio
import json
import re
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio
from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from prooflight_console.api.common import console
from prooflight_console.api.events import MOST_LISTENERS
from prooflight_console.pages.shell import ViewerPage, language_of, rendered
from prooflight_console.problems import Problem
from prooflight_line.journal.camera_view import CameraExchange

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from prooflight_console.accounts.roles import Who
    from prooflight_console.console import Console
    from prooflight_console.pages.language import Language

router = APIRouter(include_in_schema=False)

POLL_S: Final = 0.5
FIRST_S: Final = 2.0
"""Time that the watching process has to answer before the page reports that there is none. [s]"""
ASK_S: Final = 15.0
"""Time between two checks whether the session has ended. [s]"""
WIDTH, HEIGHT = 960, 180
"""Size of the drawing."""
MARKS: Final = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Drawing of one sensor's lines."""

    name: str
    paper: str
    """Points of the polyline of the signal of paper."""
    mean: str
    """Points of the polyline of the mean of all lines."""
    facts: dict[str, Any]
    picture: str = ""
    """Picture of its lines with saturated places in red, as PNG in base64; empty: there is none."""


@router.get("/setup/camera/events")
def camera_events(request: Request, who: ViewerPage) -> StreamingResponse:
    """Stream the view as HTML whenever it changes; while this is open, the view is requested."""
    state, t = console(request), language_of(request, who)
    if state.live.listeners >= MOST_LISTENERS:
        raise Problem(503, "listeners", f"{MOST_LISTENERS} listeners are connected already")
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_events(state, who, t), media_type="text/event-stream", headers=headers)


async def _events(state: Console, who: Who, t: Language) -> AsyncIterator[str]:
    exchange = CameraExchange(journal=state.settings.journal)
    state.live.listeners += 1
    clock = asyncio.get_running_loop().time
    begun_s = checked_s = clock()
    shown = ""
    try:
        yield "retry: 1000\n\n"
        while not state.live.closing:
            html = await anyio.to_thread.run_sync(
                partial(_current_view, exchange, t, waited=clock() >= begun_s + FIRST_S)
            )
            if html and html != shown:
                shown = html
                yield f"event: camera\ndata: {json.dumps(html)}\n\n"
            if clock() >= checked_s + ASK_S:
                checked_s = clock()
                if await anyio.to_thread.run_sync(state.accounts.over, who):
                    yield "event: end\ndata: {}\n\n"
                    return
                yield ": still here\n\n"
            await asyncio.sleep(POLL_S)
    finally:
        state.live.listeners -= 1


def _current_view(exchange: CameraExchange, t: Language, *, waited: bool) -> str:
    """Return the view as HTML; empty if the watching process has not answered yet."""
    try:
        exchange.ask()
    except OSError:
        waited = True
    view = exchange.read()
    if view is None and not waited:
        return ""
    try:
        return camera_html(view, t)
    except (KeyError, TypeError, ValueError, AttributeError):  # written by another version
        return camera_html(None, t)


def camera_html(view: dict[str, Any] | None, t: Language) -> str:
    """Return a view as HTML; None if nobody watches.

    Raises KeyError, TypeError or ValueError if the view has another format.
    """
    if view is None:
        return rendered("setup/camera_live", t=t, told=None)
    top, width_mm = float(view["top_code_dn"]), float(view["width_mm"])
    step = _round_step(width_mm / MARKS)
    marks = [step * at for at in range(int(width_mm / step) + 1)]
    return rendered(
        "setup/camera_live",
        t=t,
        told=view,
        profiles=[_profile(one, top) for one in view["sensors"]],
        marks=[(WIDTH * mm / width_mm, f"{mm:g}") for mm in marks],
        width=WIDTH,
        height=HEIGHT,
    )


def _profile(sensor: dict[str, Any], top: float) -> Profile:
    return Profile(
        name=str(sensor["name"]),
        paper=_points(sensor["paper_dn"], top),
        mean=_points(sensor["mean_dn"], top),
        facts=sensor,
        picture=_base64(sensor.get("picture", "")),
    )


def _base64(text: object) -> str:
    """Return a text of base64; empty if it is none, as another process wrote it."""
    return text if isinstance(text, str) and re.fullmatch(r"[A-Za-z0-9+/]*={0,2}", text) else ""


def _points(values: list[float], top: float) -> str:
    across = WIDTH / max(len(values), 1)
    return " ".join(
        f"{across * (at + 0.5):.1f},{HEIGHT * (1 - min(max(float(value) / top, 0.0), 1.0)):.1f}"
        for at, value in enumerate(values)
    )


def _round_step(least: float) -> float:
    """Return the least of 1, 2, 5, 10, ... that is not below ``least``."""
    power = 1.0
    while True:
        for one in (1.0, 2.0, 5.0):
            if one * power >= least:
                return one * power
        power *= 10
