"""The pages of alarms: their list, their statistics, and the hand-over of a shift."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Final, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.responses import HTMLResponse, Response

from prooflight.errors import RequestError
from prooflight_console.alarms.priority import Priority
from prooflight_console.alarms.statistics import MOST_FREQUENT
from prooflight_console.api.common import IncidentNumber, RunId, console
from prooflight_console.pages.drawings import bars
from prooflight_console.pages.shell import OperatorPage, ViewerPage, language_of, page
from prooflight_console.reading.alarms import SPANS_H, alarm_figures, handover_summary
from prooflight_console.reading.incidents import next_alarm

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_console.accounts.roles import Who
    from prooflight_console.pages.language import Language
    from prooflight_console.reading.alarms import AlarmFigures
    from prooflight_console.reading.incidents import LabelledIncident

router = APIRouter(include_in_schema=False)

Show = Literal["pending", "standing", "ended", "shelved", "all"]
AT_ONCE: Final = 50
NOTES: Final = 10
LEAST_HOURS: Final = 1.0
"""Time of operation before which no figure is judged. [h] assumed: ISA-18.2's own figures are per hour."""
MOST_FREQUENT_SHARE: Final = 0.05
"""Greatest share of the ten most frequent alarms (ISA-18.2, clause 16)."""
SELECTED: Final[dict[Show, Callable[[LabelledIncident], bool]]] = {
    "pending": lambda one: one.needs_action and not one.shelved,
    "standing": lambda one: one.incident.open,
    "ended": lambda one: not one.incident.open,
    "shelved": lambda one: one.shelved,
    "all": lambda _: True,
}
"""Conditions by which each list shows an alarm."""


@router.get("/alarms")
def alarms_page(
    request: Request,
    who: ViewerPage,
    show: Show = "pending",
    priority: Priority | None = None,
    kind: Annotated[str | None, Query(max_length=60)] = None,
    run: Annotated[str, Query(max_length=20)] = "last",
    at: Annotated[int, Query(alias="page", ge=1, le=100_000)] = 1,
) -> Response:
    """Return the alarms of a run, the most urgent first, fifty at a time."""
    state = console(request)
    if run == "last" and state.reading.last_run() is None:
        return page(request, who, "alarms/list", run=None)
    run_row = state.reading.run_named(run)
    everything = sorted(state.incidents.of(run_row), key=lambda one: one.urgency)
    listed = [one for one in everything if SELECTED[show](one)]
    kinds = Counter(one.incident.kind for one in listed)
    chosen = list(filter(_shown(show=show, kind=kind, priority=priority), everything))
    pages = max(-(-len(chosen) // AT_ONCE), 1)
    pending = [one for one in everything if SELECTED["pending"](one)]
    return page(
        request,
        who,
        "alarms/list",
        run=run_row,
        show=show,
        kind=kind,
        priority=priority,
        alarms=chosen[(at - 1) * AT_ONCE : at * AT_ONCE],
        found=len(chosen),
        kinds=dict(kinds.most_common()),
        counts={name: sum(map(selects, everything)) for name, selects in SELECTED.items()},
        unseen=sum(not one.seen and not one.shelved for one in chosen),
        shown_by={
            "upto": max((one.incident.last_sheet for one in everything), default=0),
            "show": show,
            **({} if kind is None else {"kind": kind}),
            **({} if priority is None else {"priority": priority}),
        },
        next=next_alarm(pending),
        at=at,
        pages=pages,
        before=at > 1,
        behind=at < pages,
        address=partial(_address, run=run, show=show, kind=kind, priority=priority),
    )


def _shown(*, show: Show, kind: str | None, priority: Priority | None) -> Callable[[LabelledIncident], bool]:
    """Return the function that tells which alarms a list shows; kind, priority: None: of any."""
    return lambda one: (
        SELECTED[show](one) and kind in (None, one.incident.kind) and priority in (None, one.priority)
    )


@router.post("/runs/{run}/incidents/seen")
def acknowledge_all(
    request: Request,
    who: OperatorPage,
    run: RunId,
    upto: Annotated[int, Form(ge=0, lt=2**63)],
    show: Annotated[Show, Form()] = "all",
    priority: Annotated[Priority | None, Form()] = None,
    kind: Annotated[str | None, Form(max_length=60)] = None,
) -> Response:
    """Mark all incidents as seen that the list showed, on all its pages."""
    state = console(request)
    shown = _shown(show=show, kind=kind, priority=priority)
    state.acknowledge_all(who, state.reading.run_named(run), upto=upto, shown=shown)
    return HTMLResponse(status_code=204)


@router.post("/runs/{run}/incidents/{incident}/shelve")
def shelve(
    request: Request,
    who: OperatorPage,
    run: RunId,
    incident: IncidentNumber,
    priority: Annotated[Priority, Form()],
    minutes: Annotated[float, Form(ge=1, le=720)],
    reason: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Shelve an alarm, and return the part of its page."""
    state = console(request)
    run_row = state.reading.run_named(run)
    wrong = ""
    try:
        state.shelve(who, run_row, incident, priority=priority, seconds=60 * minutes, reason=reason)
    except RequestError as error:
        wrong = str(error)
    labelled = state.incidents.one(run_row, incident)
    return page(request, who, "alarms/shelve", run=run_row, told=labelled, wrong=wrong)


@router.post("/runs/{run}/shelvings/{shelving}/end")
def unshelve(
    request: Request, who: OperatorPage, run: RunId, shelving: Annotated[int, Path(ge=1, lt=2**63)]
) -> Response:
    """End a shelving before its time."""
    state = console(request)
    state.unshelve(who, state.reading.run_named(run), shelving)
    return HTMLResponse(status_code=204)


@router.get("/alarms/statistics")
def statistics_page(
    request: Request, who: ViewerPage, hours: Annotated[int, Query(ge=1, le=720)] = 24
) -> Response:
    """Return the alarm statistics of the last runs, beside the figures of ISA-18.2."""
    state = console(request)
    figures = alarm_figures(state.reading, state.incidents, hours=hours, now_s=state.accounts.clock())
    return page(
        request,
        who,
        "alarms/statistics",
        figures=figures,
        hours=hours,
        spans=SPANS_H,
        judged=judged(figures),
        rows=compared(figures, language_of(request, who)),
        kinds=bars(figures.statistics.kinds),
        most=max(figures.bins, default=0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A measure of ISA-18.2, clause 16, beside its target."""

    name: str
    here: str
    target: str
    above: bool


def compared(figures: AlarmFigures, t: Language) -> list[Compared]:
    """Return the measures of ISA-18.2 that a console can compute, with their targets (2016, clause 16).

    None is judged before an hour of operation; the share of the most frequent alarms not before there are so
    many alarms that it can meet its target.
    """
    of = figures.statistics
    high = of.priorities[Priority.HIGH] / of.alarms if of.alarms else 0.0
    shares = " · ".join(
        percent(count / of.alarms if of.alarms else 0.0, t) for count in of.priorities.values()
    )
    rate = "–" if of.per_hour is None else t.number(of.per_hour, 1)
    enough = of.alarms * MOST_FREQUENT_SHARE > MOST_FREQUENT
    rows = (
        ("per-hour", rate, "≤ 6 (12)", (of.per_hour or 0.0) > 12),
        ("most-in-period", t.number(of.most_in_period), "≤ 10", of.most_in_period > 10),
        ("flood", percent(of.flood_share, t), "< 1 %", of.flood_share >= 0.01),
        ("hours-above", percent(of.hours_above_share, t), "< 1 %", of.hours_above_share >= 0.01),
        (
            "frequent",
            percent(of.most_frequent_share, t),
            "≤ 5 %",
            enough and of.most_frequent_share > MOST_FREQUENT_SHARE,
        ),
        ("stale", t.number(figures.stale), "< 5", figures.stale >= 5),
        ("priorities", shares, "5 · 15 · 80 %", high > 0.05),
    )
    return [
        Compared(name=name, here=here, target=target, above=above and judged(figures))
        for name, here, target, above in rows
    ]


def judged(figures: AlarmFigures) -> bool:
    """Return whether there was enough operation to compare the figures with their targets."""
    return figures.statistics.hours >= LEAST_HOURS


def percent(share: float, t: Language) -> str:
    """Return a share in percent."""
    return f"{t.number(100 * share, 0 if share >= 0.1 else 1)}\N{NO-BREAK SPACE}%"


@router.get("/alarms/hand-over")
def handover_page(
    request: Request, who: ViewerPage, before: Annotated[int | None, Query(ge=1, lt=2**63)] = None
) -> Response:
    """Return the notes of hand-over, and the state that the next one would keep."""
    return _handover(request, who, before=before)


@router.post("/alarms/hand-over")
def hand_over(
    request: Request, who: OperatorPage, text: Annotated[str, Form(max_length=10_000)] = ""
) -> Response:
    """Write a note for the next shift."""
    try:
        console(request).hand_over(who, text)
    except RequestError as error:
        return _handover(request, who, wrong=str(error))
    return HTMLResponse(status_code=204, headers={"HX-Redirect": "/alarms/hand-over"})


def _handover(request: Request, who: Who, *, before: int | None = None, wrong: str = "") -> Response:
    state = console(request)
    notes = state.alarm_store.handovers(before=before, limit=NOTES)
    return page(
        request,
        who,
        "alarms/handover",
        notes=notes,
        behind=notes[-1].id if len(notes) == NOTES and notes[-1].id > 1 else None,
        summary=handover_summary(state.live.now, state.incidents, now_s=state.accounts.clock()),
        wrong=wrong,
    )


def _address(**values: str | int | Priority | None) -> str:
    return "/alarms?" + urlencode({name: str(value) for name, value in values.items() if value is not None})
