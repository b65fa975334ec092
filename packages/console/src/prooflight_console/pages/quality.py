"""Quality over many runs: Pareto charts of misprints, and trends over days or weeks."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request

from prooflight_console.api.common import console
from prooflight_console.pages.drawings import channel_colour, channel_name, drift_lines, shares
from prooflight_console.pages.search import Day, Text, day_s
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_console.quality.pareto import misprints
from prooflight_console.quality.searching import SheetSearch
from prooflight_console.quality.trends import trend
from prooflight_console.reading.trend import GROUPS

if TYPE_CHECKING:
    from collections.abc import Callable

    from fastapi.responses import Response

    from prooflight.detectors.cost import RunningCosts
    from prooflight_console.console import Console
    from prooflight_console.quality.trends import Period, Step

router = APIRouter(include_in_schema=False)

DAYS: Final = {"day": 27, "week": 83}
"""Days before the last sheet with which the charts begin, unless the person names others: 4 and 12 weeks."""
_PRESSES: Final = "SELECT DISTINCT press FROM runs ORDER BY press LIMIT 500"
_LAST: Final = "SELECT max(quarter) * 900 FROM counts"
_DIGESTS: Final = "SELECT digest, max(id) FROM runs GROUP BY digest"
Runs = Annotated[list[int], Query(alias="run", max_length=200)]


@router.get("/quality")
def quality_page(
    request: Request,
    who: ViewerPage,
    run: Runs = [],  # noqa: B006 - FastAPI copies it
    press: Text = "",
    job: Text = "",
    since: Day = "",
    until: Day = "",
    step: Annotated[Literal["day", "week"], Query()] = "day",
    by: Annotated[Literal["sheets", "cost"], Query()] = "sheets",
) -> Response:
    """Return the charts of one press, of some runs, or of all runs."""
    state = console(request)
    if any(not 0 < number < 2**63 for number in run):
        raise Problem(422, "invalid", "run: no such number")
    state.index.catch_up()
    runs = tuple(sorted(set(run)))
    since = since or ("" if runs else _since(state, step, until))
    search = SheetSearch(
        verdict="misprint",
        press=press.strip(),
        job=job.strip(),
        runs=runs,
        since_s=day_s(since),
        until_s=day_s(until, days=1),
    )
    groups = misprints(state.index, search, _costs(state), by_cost=by == "cost")
    trends = trend(state.index, search, step=step)
    form: dict[str, Any] = {"press": press, "job": job, "since": since, "until": until}
    scope = {name: value for name, value in form.items() if value}
    if runs:
        scope["runs"] = ",".join(map(str, runs))

    def rows(**conditions: Any) -> str:
        """Return the address of the search that lists exactly the sheets behind a bar."""
        return f"/search?{urlencode(scope | {'verdict': 'misprint'} | conditions)}"

    def of_period(**conditions: Any) -> Callable[[Period], str]:
        """Return a function that gives the address of the sheets of a period."""
        return lambda one: rows(
            since=max(one.first.isoformat(), since),
            until=min(one.last.isoformat(), until or "9"),
            **conditions,
        )

    charts = {
        name: shares(part, [one.cents if by == "cost" else one.sheets for one in part])
        for name, part in (("kind", groups.kinds), ("ink", groups.inks), ("place", groups.places))
    }
    return page(
        request,
        who,
        "quality/quality",
        asked=form | {"step": step, "by": by},
        runs=runs,
        presses=[name for (name,) in state.index.query(_PRESSES)],
        groups=groups,
        charts=charts,
        trends=trends,
        rates={
            "misprints": [_percent(one.misprints, one.sheets) for one in trends.periods],
            "not_inspected": [_percent(one.not_inspected, one.sheets) for one in trends.periods],
            "false_alarms": [one.false_alarms for one in trends.periods],
        },
        links={
            "misprints": of_period(),
            "not_inspected": of_period(verdict="not-inspected"),
            "false_alarms": of_period(label="good"),
        },
        colour=channel_colour,
        channel_name=channel_name,
        drifts=[(name, drift_lines(trends.drifts, name)) for name, _ in GROUPS],
        rows=rows,
        indexing=state.index.progress,
    )


def _percent(number: int, total: int) -> float:
    return 100 * number / total if total else 0.0


def _since(state: Console, step: Step, until: str) -> str:
    """Return the first day that is shown: some weeks before ``until``, or before the last sheet."""
    last_s = day_s(until) if until else next((s for (s,) in state.index.query(_LAST)), None)
    if last_s is None:
        return ""
    last = datetime.fromtimestamp(last_s, UTC).astimezone().date()
    return (last - timedelta(days=DAYS[step])).isoformat()


def _costs(state: Console) -> dict[str, RunningCosts]:
    """Return the costs of the press files of all runs whose press is known here, by digest."""
    costs = {}
    for digest, number in state.index.query(_DIGESTS):
        press = state.stations.press(state.reading.run(number))
        if press is not None:
            costs[digest] = press.costs
    return costs
