"""The console as an ASGI application, composed of its services."""

from __future__ import annotations

import asyncio
import threading
import time
from contextlib import asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING, Final

from fastapi import FastAPI
from starlette.middleware.gzip import GZipMiddleware
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from prooflight import __version__
from prooflight_console import problems
from prooflight_console.access import include, refuse_unguarded
from prooflight_console.accounts.account_store import Accounts
from prooflight_console.accounts.passwords import Passwords, Tries
from prooflight_console.accounts.provider import Provider
from prooflight_console.alarms.alarm_store import AlarmStore
from prooflight_console.api import ROUTERS as API_ROUTERS
from prooflight_console.console import Console
from prooflight_console.engineering.notes import ChartNotes
from prooflight_console.engineering.steps import step_aside
from prooflight_console.engineering.versions import PressVersions
from prooflight_console.engineering.work import Work
from prooflight_console.middleware import BoundedBodies, Headers, RequestLog
from prooflight_console.pages import ROUTERS as PAGE_ROUTERS
from prooflight_console.pages.shell import in_language, problem_page
from prooflight_console.pictures.pictures import Pictures
from prooflight_console.quality.index import SUFFIX, SearchIndex
from prooflight_console.quality.saved import SavedSearches
from prooflight_console.reading.gate import Gates
from prooflight_console.reading.incidents import RunIncidents
from prooflight_console.reading.live import Live
from prooflight_console.reading.metrics import Metrics
from prooflight_console.reading.queue import Queue
from prooflight_console.reading.reprints import Reprints
from prooflight_console.reading.runs import Reading
from prooflight_console.reading.stations import Stations
from prooflight_console.reading.trend import Trends
from prooflight_console.zones.prices import Prices
from prooflight_console.zones.rasters import Rasters
from prooflight_console.zones.service import ZonesService
from prooflight_line.journal.labels import LabelStore
from prooflight_line.journal.run_control import RunControl

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from multiprocessing.connection import Connection

    from prooflight_console.engineering.steps import StepRequest
    from prooflight_console.settings import ConsoleSettings

DESCRIPTION: Final = """Runs of a press: sheets, verdicts, incidents, evidence, pictures, live events.

Programs send `Authorization: Bearer TOKEN`. Errors are `application/problem+json`. Lists give `next`, the cursor of the
next page, or null. Lengths are millimetres on the page as printed, times are UTC."""


def console_app(
    settings: ConsoleSettings,
    *,
    clock: Callable[[], float] = time.time,
    ticking: Callable[[], float] = time.monotonic,
    passwords: Passwords | None = None,
    prices: Prices | None = None,
    step: Callable[[StepRequest, Connection], None] = step_aside,
) -> FastAPI:
    """Return the application with all its services and endpoints.

    Parameters
    ----------
    clock
        Unix time. [s]
    ticking
        Monotonic time. [s]
    prices
        Service that computes prices of zones; None for the usual one.
    step
        Function that makes a version of the press, in a process of its own.

    Raises
    ------
    EndpointError
        If an endpoint does not state who may call it.
    ConsoleFileError, RequestError
        If the console's file or its settings cannot be used.
    """
    console = _console(
        settings, clock=clock, ticking=ticking, passwords=passwords, prices=prices or Prices(), step=step
    )
    app = FastAPI(
        title="Prooflight console",
        version=__version__,
        description=DESCRIPTION,
        openapi_url=None,  # served by an endpoint that requires a role
        docs_url=None,
        redoc_url=None,
        lifespan=partial(_alive, console),
    )
    app.state.console = console
    include(app, *API_ROUTERS, *PAGE_ROUTERS)
    app.add_middleware(BoundedBodies)
    app.add_middleware(GZipMiddleware, minimum_size=1000, compresslevel=5)
    problems.handle(app, page=problem_page, in_language=in_language)
    app.add_middleware(Headers, secure=console.settings.secure)
    app.add_middleware(RequestLog, reading=console.reading)
    if proxies := console.settings.trusted_proxies:
        app.add_middleware(ProxyHeadersMiddleware, trusted_hosts=list(proxies))
    refuse_unguarded(app)
    return app


def _console(
    settings: ConsoleSettings,
    *,
    clock: Callable[[], float],
    ticking: Callable[[], float],
    passwords: Passwords | None,
    prices: Prices,
    step: Callable[[StepRequest, Connection], None],
) -> Console:
    """Return the services of the console, each given those that it needs; see ``console_app``."""
    accounts = Accounts(settings.data, clock=clock, passwords=passwords)
    reading = Reading(settings.journal)
    label_store = LabelStore(settings.journal)
    alarm_store = AlarmStore(accounts)
    incidents = RunIncidents(reading, label_store, alarm_store)
    gates = Gates(reading, trays=settings.trays)
    reprints = Reprints(reading, incidents, label_store, gates, trays=settings.trays)
    versions = PressVersions(settings.presses[0], accounts) if settings.presses else None
    stations = Stations(
        presses=settings.presses,
        jobs=settings.jobs,
        versions=tuple if versions is None else versions.files,
    )
    pictures = Pictures(settings.tiles, bound_bytes=settings.tiles_bytes, stations=stations)
    zones = ZonesService(jobs=settings.jobs, presses=settings.presses, prices=prices, accounts=accounts)
    live = Live(reading, incidents, label_store, reprints, alarm_store, clock=ticking, ahead=pictures.ahead)
    return Console(
        settings=settings,
        accounts=accounts,
        label_store=label_store,
        tries=Tries(ticking),
        reading=reading,
        incidents=incidents,
        trends=Trends(reading),
        gates=gates,
        reprints=reprints,
        live=live,
        alarm_store=alarm_store,
        stations=stations,
        pictures=pictures,
        zones=zones,
        rasters=Rasters(pictures, settings.tiles, bound_bytes=settings.tiles_bytes),
        metrics=Metrics(reading, live, incidents, stations, reprints, queue=settings.queue, clock=ticking),
        chart_notes=ChartNotes(accounts),
        work=Work(versions, accounts, work=step),
        index=SearchIndex(
            settings.data.with_name(settings.data.name + SUFFIX), reading, incidents, label_store
        ),
        saved=SavedSearches(accounts),
        queue=Queue(path=settings.queue, control=RunControl(journal=settings.journal)),
        began_s=clock(),
        provider=None if settings.provider is None else Provider(settings.provider, clock=clock),
    )


@asynccontextmanager
async def _alive(console: Console, _app: FastAPI) -> AsyncIterator[None]:
    """Follow runs and index their sheets while the application lives, and close all services at its end."""
    looking = asyncio.create_task(console.live.run())
    indexing = threading.Thread(target=console.index.follow, name="index", daemon=True)
    indexing.start()
    try:
        yield
    finally:
        console.live.close()
        console.index.close()
        looking.cancel()
        await asyncio.gather(looking, return_exceptions=True)
        indexing.join()
        console.zones.prices.close()
        console.work.close()
        console.pictures.close()
        console.reading.close()
        console.accounts.close()
