"""Parts that endpoints share: requester and services, pages of lists, and conditional requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import Depends, Path, Query, Request
from fastapi.responses import Response

from prooflight_console.access import needs
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.headers import etag as etag

if TYPE_CHECKING:
    from prooflight_console.console import Console

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
