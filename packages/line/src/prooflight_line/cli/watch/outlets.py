"""The outlets of ``prooflight watch --plant PRESS.toml``: the run's events and their receivers."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.press_file import PressFile
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.plant.outlets.outbox import OutletHealth
    from prooflight_line.plant.outlets.outlet import Outlet
    from prooflight_line.plant.stream import EventStream
    from prooflight_line.run.notices import Notice

REMEDY: Final = "see `prooflight plant check`, correct it, or remove its block from [plant]"


def outlets_in(plant: PressFile | None, press: str) -> list[Outlet]:
    """Return the outlets that a press file names, each tried; ``press`` is the name in the events.

    RequestError: one does not answer; others as of ``outlets_of``.
    """
    if plant is None:
        return []
    from prooflight_line.plant.outlets.configured import outlets_of
    from prooflight_line.plant.outlets.outlet import check

    outlets = outlets_of(plant, press)
    for outlet in outlets:
        tried = check(outlet)
        if not tried.ok:
            raise RequestError(tried.name, f"does not answer ({tried.answer})", remedy=REMEDY)
    return outlets


@contextmanager
def events_published(
    outlets: Sequence[Outlet],
    facts: RunFacts,
    *,
    run_id: int | None,
    room: int,
    size_mm: tuple[float, float] | None,
    plan: SheetPlan | None,
    notice: Callable[[Notice], None],
) -> Iterator[EventStream | None]:
    """Give the run's stream of events while its outlets are served; None if there are no outlets.

    ``size_mm`` is the size of a sheet, and ``plan`` as for ``EventStream``. ``notice`` is called when an
    outlet connects or disconnects.
    """
    if not outlets:
        yield None
        return
    from prooflight_line.plant.outlets.outlet import Outlets
    from prooflight_line.plant.stream import EventStream
    from prooflight_line.run.notices import Notice

    def changed(health: OutletHealth) -> None:
        if health.connected:
            notice(Notice(kind="outlet-ready", text=f"{health.name}: connected"))
        else:
            notice(Notice(kind="outlet-away", text=f"{health.name}: {health.detail}; events wait"))

    with Outlets(outlets, room=room, changed=changed) as served:
        stream = EventStream([served.put], press=facts.press, run=run_id, size_mm=size_mm, plan=plan)
        stream.started(facts)
        yield stream
