"""The audit, and OpenAPI."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import JSONResponse

from prooflight_console import problems
from prooflight_console.access import needs
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.api.common import PREFIX, Limit, Viewer, console
from prooflight_console.api.schemas import AuditAnswer, ChainAnswer
from prooflight_console.problems import responses

if TYPE_CHECKING:
    from fastapi import FastAPI

router = APIRouter(prefix=PREFIX, tags=["audit"])

Auditor = Annotated[Who, Depends(needs(Role.ADMIN, Scope.AUDIT))]


@router.get("/audit", responses=responses(401, 403, 422))
def audit(
    request: Request,
    _who: Auditor,
    before: Annotated[int | None, Query(ge=1, lt=2**63, description="`next` of the answer before.")] = None,
    limit: Limit = 100,
) -> AuditAnswer:
    """List who did what, before and after, the latest first."""
    items = [asdict(entry) for entry in console(request).accounts.audited(before=before, limit=limit)]
    return AuditAnswer(items=items, next=items[-1]["id"] if len(items) == limit else None)


@router.get("/audit/chain", responses=responses(401, 403, 422))
def chain(
    request: Request,
    _who: Auditor,
    expected_head: Annotated[
        str | None, Query(max_length=64, description="Head that was noted earlier.")
    ] = None,
) -> ChainAnswer:
    """Verify that every row of the audit is as it was written."""
    result = console(request).accounts.verified(expected_head=expected_head)
    return ChainAnswer(**asdict(result), whole=result.whole)


@router.get("/openapi.json", responses=responses(401, 403))
def schema(request: Request, _who: Viewer) -> JSONResponse:
    """Return this interface as OpenAPI 3.1."""
    document: dict[str, Any] = openapi(request.app)
    return JSONResponse(document)


def openapi(app: FastAPI) -> dict[str, Any]:
    """Return the interface for programs as OpenAPI 3.1, without the pages."""
    if app.openapi_schema is None:
        schema = app.openapi()
        schema.setdefault("components", {}).setdefault("schemas", {})["ProblemBody"] = (
            problems.ProblemBody.model_json_schema()
        )
        schema["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        schema["security"] = [{"token": []}]
    return app.openapi_schema or {}
