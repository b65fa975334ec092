"""Prices that stand in for real ones, which take minutes; run in processes of their own, as real ones are."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from packages.console.tests.consoles import served
from threadpoolctl import threadpool_info

from prooflight.pages.zones.zones_file import PriceEntry
from prooflight_console import child_process
from prooflight_console.app import console_app
from prooflight_console.zones import pricing
from prooflight_console.zones.prices import Prices
from prooflight_console.zones.pricing import Priced, PriceRequest, Progress, Refused

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from pathlib import Path

    from packages.console.tests.consoles import Served


def row(name: str, kind: str, before: float | None, after: float | None) -> dict[str, Any]:
    def told(value: float | None) -> dict[str, Any]:
        scales = {"spot": 1.0, "streak": 8.0, "density": 14.0}
        parts = {"least": 1.0, "low": 0.7, "high": 1.4}
        return {
            sort: {
                part: None if value is None else round(value * scale * by, 3) for part, by in parts.items()
            }
            for sort, scale in scales.items()
        }

    return {"name": name, "kind": kind, "pages": [1], "before": told(before), "after": told(after)}


def entry(asked: PriceRequest) -> PriceEntry:
    told = [
        row(one.name, one.kind, 2.0, None if one.kind == "ignore" else 0.9)
        for one in asked.zones.document.zones
    ]
    return PriceEntry(
        press="p" * 64, zones=asked.zones.zones_digest, prints=asked.prints, seed=1, page_scores=(0.0, 1.0),
        careful_scores=(0.0, 1.0), careful_mean=(0.0,), careful_sd=(1.0,),
        told=(*told, row("rest", "rest", 1.5, 1.6)),
    )  # fmt: skip


def quick(asked: PriceRequest, told: Connection) -> None:
    """At once."""
    told.send(Progress(stage="prints", done=asked.prints, total=asked.prints))
    told.send(
        Priced(
            entry=entry(asked),
            promised=0.01,
            good_prints=60,
            alarmed_before=0,
            alarmed_after=1,
            extrapolated=True,
        )
    )


def real(asked: PriceRequest, told: Connection) -> None:
    """As it is, but that it takes its share of a machine that also tests: in idle time alone it may never end."""
    child_process.yield_to_all = lambda: None
    pricing.price_aside(asked, told)


def counting_threads(asked: PriceRequest, told: Connection) -> None:
    """Refuses, and says by how many threads linear algebra would have been done."""

    def refuse(*_: object) -> Refused:
        return Refused(why=f"{max(one['num_threads'] for one in threadpool_info())} at once")

    child_process.yield_to_all = lambda: None
    pricing._priced = refuse
    pricing.price_aside(asked, told)


def endless(_asked: PriceRequest, told: Connection) -> None:
    """Until it is cancelled."""
    told.send(Progress(stage="prints", done=3, total=90))
    threading.Event().wait()


def refused(_asked: PriceRequest, told: Connection) -> None:
    told.send(Refused(why="prints: 12 are too few for these zones; give 90 or more"))


def vanishing(_asked: PriceRequest, told: Connection) -> None:
    """Ends without a word, as where memory ran out."""
    told.close()


def priced_by(folder: Path, work: Any, **settings: Any) -> Served:
    """A console whose prices are made so."""
    made = served(folder, **settings)
    held = made.console.settings
    made.close()
    return replace(
        made, app=console_app(held, clock=made.clock, ticking=made.clock, prices=Prices(work)), clients=[]
    )
