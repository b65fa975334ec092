"""Parts that endpoints share: requester and services, pages of lists, conditional requests, repeated sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import Depends, Path, Query, Request
from fastapi.responses import Response

from prooflight_console.access import needs
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.middleware import etag as etag
from prooflight_console.problems import Problem, not_found

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight_console.console import Console
    from prooflight_line.journal.records import PageRecord, RunRow

PREFIX: Final = "/api/v1"
MOST_AT_ONCE: Final = 500

Viewer = Annotated[Who, Depends(needs(Role.VIEWER, Scope.READ))]
Operator = Annotated[Who, Depends(needs(Role.OPERATOR, Scope.LABELS))]
JobsOperator = Annotated[Who, Depends(needs(Role.OPERATOR, Scope.JOBS))]
OperatorThemselves = Annotated[Who, Depends(needs(Role.OPERATOR))]
"""A person who signed in; no token is accepted."""
Engineer = Annotated[Who, Depends(needs(Role.ENGINEER, Scope.READ))]
ZonesEngineer = Annotated[Who, Depends(needs(Role.ENGINEER, Scope.ZONES))]
RunId = Annotated[str, Path(alias="run", description="Number of a run, or `last`.", max_length=20)]
SheetNumber = Annotated[int, Path(alias="sheet", ge=0, lt=2**63)]
JobNumber = Annotated[int, Path(alias="job", ge=1, le=10_000, description="In the order of --job, from 1.")]
PageNumber = Annotated[int, Path(alias="page", ge=1, le=10_000_000, description="Of the job, from 1.")]
TileLevel = Annotated[int, Path(ge=0, le=24)]
TilePlace = Annotated[int, Path(ge=0, lt=2**20)]
IncidentNumber = Annotated[int, Path(alias="incident", ge=1, lt=2**63)]
Limit = Annotated[int, Query(ge=1, le=MOST_AT_ONCE, description="Rows of one answer.")]


def console(request: Request) -> Console:
    """Return the services of the application."""
    services: Console = request.app.state.console
    return services


def unchanged(request: Request, tag: str) -> bool:
    """Return whether the requester has this state already (RFC 9110, If-None-Match)."""
    condition = request.headers.get("If-None-Match", "")
    return condition.strip() == "*" or tag in {one.strip().removeprefix("W/") for one in condition.split(",")}


def not_modified(tag: str, cache: str) -> Response:
    """Return a response 304, by which a client uses its cached copy."""
    return Response(status_code=304, headers={"ETag": tag, "Cache-Control": cache})


def listed(items: list[dict[str, Any]], *, limit: int, cursor: Any, damaged: int) -> dict[str, Any]:
    """Return one page of a list; cursor is that of the next page."""
    return {"items": items, "next": cursor if len(items) + damaged >= limit else None, "damaged": damaged}


class Damaged:
    """Counter of rows that cannot be read; a list reports their number and gives the others."""

    def __init__(self) -> None:
        self.count = 0

    def add(self, _error: object) -> None:
        """Count one row."""
        self.count += 1


# --- inputs from which a sheet's verdict is repeated ---


def replayable(console: Console, run: str, sheet: int) -> tuple[RunRow, PageRecord, Press]:
    """Return the run, the sheet with its evidence, and the press; raises ``Problem`` if one is missing."""
    run_row = console.reading.run_named(run)
    page = console.reading.sheet(run_row.id, sheet)
    evidence_of(page, run=run_row.id)
    press = console.stations.press(run_row)
    if press is None:
        named = f"press {run_row.facts.press}, digest {run_row.facts.press_digest[:16]}"
        raise Problem(409, "no-press", f"start the console with --press and the artefact of {named}")
    return run_row, page, press


def evidence_of(page: PageRecord, *, run: int | str) -> Mapping[str, NDArray[Any]]:
    """Return the stored evidence of a sheet; raises ``Problem`` if there is none."""
    if page.evidence is None:
        raise not_found(f"no evidence of sheet {page.sheet} of run {run} is stored")
    return page.evidence
