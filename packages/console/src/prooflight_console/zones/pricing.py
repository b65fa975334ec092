"""The price of zones, computed in a process of the lowest priority."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.commissioning.zones.price import price_of
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight_console.child_process import result_or_refusal, send_result

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from multiprocessing.connection import Connection
    from pathlib import Path

    from prooflight.commissioning.zones.price import Price
    from prooflight.pages.zones.zones_file import JobZones, PriceEntry

Stage = Literal["starting", "prints", "defects"]
STAGES: Final[dict[str, Stage]] = {"printing good pages": "prints", "trying defects": "defects"}
"""Stages of progress by the texts of ``price_of``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PriceRequest:
    """Inputs of a price."""

    job: Path
    press: Path
    zones: JobZones
    prints: int
    trials: int
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Progress of a price."""

    stage: Stage
    done: int
    total: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Priced:
    """A complete price."""

    entry: PriceEntry
    """Entry for the file of zones."""
    promised: float
    good_prints: int
    alarmed_before: int
    alarmed_after: int
    extrapolated: bool

    def plain(self) -> dict[str, Any]:
        """Return the price as ``prooflight zones price --json`` prints it."""
        fields = {name: value for name, value in asdict(self).items() if name != "entry"}
        return {"zones": list(self.entry.told), **fields}


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """Failure of a price."""

    why: str


def price_aside(request: PriceRequest, sender: Connection) -> None:
    """Compute a price in a process of its own: sends ``Progress``, then ``Priced`` or ``Refused``.

    Ends when nobody receives any more.
    """
    what = f"the price of zones of {request.job.name}"
    send_result(
        sender,
        lambda: result_or_refusal(lambda: _priced(request, sender), lambda why: Refused(why=why), what=what),
    )


def _priced(request: PriceRequest, sender: Connection) -> Priced:
    def shown(items: Iterable[Any], total: int, what: str) -> Iterator[Any]:
        stage = STAGES[what]
        begun = done[stage]
        whole = request.prints if stage == "prints" else request.trials
        for at, one in enumerate(items, start=1):
            yield one
            done[stage] = begun + at
            sender.send(Progress(stage=stage, done=done[stage], total=whole))

    done = dict.fromkeys(STAGES.values(), 0)
    press = Press.load(request.press)
    price: Price = price_of(
        job_source(request.job, press),
        press,
        request.zones,
        prints=request.prints,
        trials=request.trials,
        seed=request.seed,
        shown=shown,
    )
    return Priced(
        entry=price.entry,
        promised=price.promised,
        good_prints=price.good,
        alarmed_before=price.alarmed_before,
        alarmed_after=price.alarmed_after,
        extrapolated=price.extrapolated,
    )
