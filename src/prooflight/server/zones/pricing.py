"""The price of zones, made by a process of its own that runs only where nothing else wants to."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.commissioning.zones.price import price_of
from prooflight.errors import ProoflightError
from prooflight.pages.process import LOWEST, settle_process
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from multiprocessing.connection import Connection
    from pathlib import Path

    from prooflight.commissioning.zones.price import Price
    from prooflight.pages.zones.zones_file import JobZones, PriceEntry

_log = logging.getLogger(__name__)

FULL: Final = (
    "memory ran out while the price was made; close what takes memory on this machine, and ask again"
)
FAULT: Final = "the price could not be made, by a fault of Prooflight itself; the console's log says which"
Stage = Literal["starting", "prints", "defects"]
STAGES: Final[dict[str, Stage]] = {"printing good pages": "prints", "trying defects": "defects"}
"""What ``price_of`` says of its progress, by the words of this room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PriceRequest:
    """What is to be priced."""

    job: Path
    press: Path
    zones: JobZones
    prints: int
    trials: int
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far it has come."""

    stage: Stage
    done: int
    total: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Priced:
    """A price that was made."""

    entry: PriceEntry
    """For the file of zones."""
    promised: float
    good_prints: int
    alarmed_before: int
    alarmed_after: int
    extrapolated: bool

    def plain(self) -> dict[str, Any]:
        """As ``prooflight zones price --json`` tells it."""
        told = {name: value for name, value in asdict(self).items() if name != "entry"}
        return {"zones": list(self.entry.told), **told}


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """Why there is none."""

    why: str


def price_aside(asked: PriceRequest, told: Connection) -> None:
    """Called in a process of its own: sends ``Progress``, then ``Priced`` or ``Refused``; ends where nobody listens."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal; whoever started it ends it
    yield_to_all()
    settle_process()
    try:
        with contextlib.suppress(BrokenPipeError):
            told.send(_priced(asked, told))
    finally:
        told.close()


def yield_to_all() -> None:
    """Take only what time no other process wants, so that no verdict waits, however long a price takes then."""
    if hasattr(os, "SCHED_IDLE"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if hasattr(os, "nice"):
        os.nice(LOWEST)


def _priced(asked: PriceRequest, told: Connection) -> Priced | Refused:
    def shown(items: Iterable[Any], total: int, what: str) -> Iterator[Any]:
        stage = STAGES[what]
        begun = done[stage]
        whole = asked.prints if stage == "prints" else asked.trials
        for at, one in enumerate(items, start=1):
            yield one
            done[stage] = begun + at
            told.send(Progress(stage=stage, done=done[stage], total=whole))

    done = dict.fromkeys(STAGES.values(), 0)
    try:
        press = Press.load(asked.press)
        found: Price = price_of(
            job_source(asked.job, press),
            press,
            asked.zones,
            prints=asked.prints,
            trials=asked.trials,
            seed=asked.seed,
            processes=1,
            shown=shown,
        )
    except ProoflightError as error:
        return Refused(why=str(error))
    except BrokenPipeError:
        raise
    except MemoryError:
        return Refused(why=FULL)
    except OSError as error:
        return Refused(
            why=f"a file of the price cannot be read or written ({error.strerror}); see to it, and ask again"
        )
    except Exception:
        _log.exception("the price of zones of %s", asked.job.name)
        return Refused(why=FAULT)
    return Priced(
        entry=found.entry,
        promised=found.promised,
        good_prints=found.good,
        alarmed_before=found.alarmed_before,
        alarmed_after=found.alarmed_after,
        extrapolated=found.extrapolated,
    )
