"""The interface for programs, as OpenAPI 3.1."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from prooflight_console import problems

if TYPE_CHECKING:
    from fastapi import FastAPI


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
