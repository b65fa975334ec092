"""Set up, the camera now: what whoever watches the press lets others see of its lines."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio
from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from prooflight.journal.camera_view import CameraExchange
from prooflight.server.api.common import console
from prooflight.server.api.events import MOST_LISTENERS
from prooflight.server.pages.shell import ViewerPage, language_of, rendered
from prooflight.server.problems import Problem

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from prooflight.server.accounts.roles import Who
    from prooflight.server.console import Console
    from prooflight.server.pages.language import Language

router = APIRouter(include_in_schema=False)

LOOK_S: Final = 0.5
FIRST_S: Final = 2.0
"""In which whoever watches answers; until then nothing is said of there being nobody."""
ASK_S: Final = 15.0
"""Between two questions whether the session goes on."""
WIDTH, HEIGHT = 960, 180
"""Of the drawing."""
MARKS: Final = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """One sensor's lines, as a drawing."""

    name: str
    paper: str
    """Points of a polyline: what stands for paper."""
    mean: str
    """Likewise: the mean of all lines."""
    facts: dict[str, Any]


@router.get("/setup/camera/events")
def camera_events(request: Request, who: ViewerPage) -> StreamingResponse:
    """The view as HTML, again whenever it is another; while this is open, whoever watches is asked for it."""
    held, t = console(request), language_of(request, who)
    if held.live.listeners >= MOST_LISTENERS:
        raise Problem(503, "listeners", f"{MOST_LISTENERS} listen already")
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_events(held, who, t), media_type="text/event-stream", headers=headers)


async def _events(held: Console, who: Who, t: Language) -> AsyncIterator[str]:
    exchange = CameraExchange(journal=held.settings.journal)
    held.live.listeners += 1
    clock = asyncio.get_running_loop().time
    begun_s = asked_s = clock()
    shown = ""
    try:
        yield "retry: 1000\n\n"
        while not held.live.closing:
            html = await anyio.to_thread.run_sync(
                partial(_look, exchange, t, waited=clock() >= begun_s + FIRST_S)
            )
            if html and html != shown:
                shown = html
                yield f"event: camera\ndata: {json.dumps(html)}\n\n"
            if clock() >= asked_s + ASK_S:
                asked_s = clock()
                if await anyio.to_thread.run_sync(held.accounts.over, who):
                    yield "event: end\ndata: {}\n\n"
                    return
                yield ": still here\n\n"
            await asyncio.sleep(LOOK_S)
    finally:
        held.live.listeners -= 1


def _look(exchange: CameraExchange, t: Language, *, waited: bool) -> str:
    """The view as HTML; empty: whoever watches has not answered yet."""
    try:
        exchange.ask()
    except OSError:
        waited = True
    told = exchange.read()
    if told is None and not waited:
        return ""
    try:
        return camera_html(told, t)
    except (KeyError, TypeError, ValueError, AttributeError):  # of another version
        return camera_html(None, t)


def camera_html(told: dict[str, Any] | None, t: Language) -> str:
    """What was written, as HTML; None: nobody watches. KeyError, TypeError, ValueError: it is nothing of ours."""
    if told is None:
        return rendered("setup/camera_live", t=t, told=None)
    top, width_mm = float(told["top_code_dn"]), float(told["width_mm"])
    step = _round_step(width_mm / MARKS)
    marks = [step * at for at in range(int(width_mm / step) + 1)]
    return rendered(
        "setup/camera_live",
        t=t,
        told=told,
        profiles=[_profile(one, top) for one in told["sensors"]],
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
    )


def _points(values: list[float], top: float) -> str:
    across = WIDTH / max(len(values), 1)
    return " ".join(
        f"{across * (at + 0.5):.1f},{HEIGHT * (1 - min(max(float(value) / top, 0.0), 1.0)):.1f}"
        for at, value in enumerate(values)
    )


def _round_step(least: float) -> float:
    """The next of 1, 2, 5, 10, ... that is not less."""
    power = 1.0
    while True:
        for one in (1.0, 2.0, 5.0):
            if one * power >= least:
                return one * power
        power *= 10
