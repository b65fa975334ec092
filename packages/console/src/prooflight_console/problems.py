"""Errors as programs read them (RFC 9457, ``application/problem+json``) and as people do."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.middleware.errors import ServerErrorMiddleware

from prooflight.errors import ProoflightError, RequestError
from prooflight_line.journal.schema import JournalError
from prooflight_line.records.database import RecordsError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fastapi import FastAPI, Request
    from fastapi.responses import Response

    ProblemPage = Callable[[Request, int, str, str, Mapping[str, str]], Response]
    InLanguage = Callable[[Request, str], str]

MEDIA_TYPE: Final = "application/problem+json"
FOR_PROGRAMS: Final = ("/api/", "/metrics")
TITLES: Final = {
    400: "Invalid request",
    401: "Sign-in required",
    403: "Not allowed",
    404: "Not found",
    405: "Method not allowed",
    409: "Not possible in the current state",
    412: "Changed in the meantime",
    413: "Request too large",
    415: "Unsupported media type",
    422: "Invalid value",
    428: "Header If-Match required",
    429: "Too many attempts",
    500: "Internal error in Prooflight",
    503: "Temporarily unavailable",
}
TITLES_OF_KINDS: Final = {
    "csrf": "Page out of date",
    "origin": "Request from another site",
    "role": "Higher role required",
    "scope": "Token without the required scope",
}
"""Titles of kinds that say more than their status does."""


class ProblemBody(BaseModel):
    """Response that describes an error."""

    type: str = Field(description="Kind of problem, as a stable name.", examples=["urn:prooflight:not-found"])
    title: str
    status: int
    detail: str = ""
    errors: list[dict[str, Any]] = Field(default=[], description="Invalid values, with status 422.")


class Problem(ProoflightError):
    """Response other than the one requested; kind is its name, as in urn:prooflight:KIND."""

    def __init__(
        self, status: int, kind: str, detail: str, *, headers: Mapping[str, str] | None = None
    ) -> None:
        self.status, self.kind, self.detail, self.headers = status, kind, detail, dict(headers or {})
        super().__init__(detail)


def not_found(what: str) -> Problem:
    """Return the problem that there is no such run, sheet, incident or picture."""
    return Problem(404, "not-found", what)


def problem(page: ProblemPage, in_language: InLanguage, request: Request, error: Exception) -> Response:
    """Return the response to an exception.

    page: makes the one that people read. in_language: returns a sentence in the language that the request accepts.
    """
    status, kind, detail, headers, errors = _described(error)
    if not request.url.path.startswith(FOR_PROGRAMS):
        return page(request, status, kind, detail, headers)
    body = ProblemBody(
        type=f"urn:prooflight:{kind}",
        title=in_language(request, TITLES_OF_KINDS.get(kind) or TITLES.get(status, "The request failed")),
        status=status,
        detail=in_language(request, detail),
        errors=errors,
    )
    return JSONResponse(body.model_dump(), status, headers, media_type=MEDIA_TYPE)


def responses(*codes: int) -> dict[int | str, dict[str, Any]]:
    """Return the error responses of an endpoint for these status codes, for OpenAPI."""
    schema = {"schema": {"$ref": "#/components/schemas/ProblemBody"}}
    return {code: {"description": TITLES[code], "content": {MEDIA_TYPE: schema}} for code in codes}


def binary(media_type: str) -> dict[int | str, dict[str, Any]]:
    """Return the description of a response of bytes, for OpenAPI."""
    schema = {"schema": {"type": "string", "format": "binary"}}
    return {200: {"description": "Bytes.", "content": {media_type: schema}}}


def handle(app: FastAPI, *, page: ProblemPage, in_language: InLanguage) -> None:
    """Register handlers by which every error leaves the application as a problem; arguments as of ``problem``.

    A middleware answers what nobody foresaw, since Starlette's own handler of ``Exception`` is outside of all
    middleware: its responses would lack the security headers and the request's name. What is added to the application
    later is outside of it.
    """
    handler = partial(problem, page, in_language)
    for kind in (Problem, ProoflightError, RequestValidationError, HTTPException):
        app.add_exception_handler(kind, handler)
    app.add_middleware(ServerErrorMiddleware, handler=handler)


def _described(error: Exception) -> tuple[int, str, str, dict[str, str], list[dict[str, Any]]]:
    if isinstance(error, Problem):
        return error.status, error.kind, error.detail, error.headers, []
    if isinstance(error, RequestValidationError):
        errors = [
            {"where": [str(part) for part in each["loc"]], "what": str(each["msg"])}
            for each in error.errors()[:20]
        ]
        first = f"{'.'.join(errors[0]['where'][1:])}: {errors[0]['what']}" if errors else ""
        return 422, "invalid", first, {}, errors
    if isinstance(error, RequestError):
        return 409, "refused", str(error), {}, []
    if isinstance(error, JournalError):
        return 503, "journal", str(error), {}, []
    if isinstance(error, RecordsError):
        return 503, "records", str(error), {}, []
    if isinstance(error, ProoflightError):
        return 409, "unusable", str(error), {}, []
    if isinstance(error, HTTPException):
        kinds = {404: "not-found", 405: "method-not-allowed", 413: "too-large"}
        return (
            error.status_code,
            kinds.get(error.status_code, "http"),
            str(error.detail),
            dict(error.headers or {}),
            [],
        )
    return 500, "fault", "the console's log contains the details", {}, []
