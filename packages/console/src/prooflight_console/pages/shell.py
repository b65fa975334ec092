"""Parts that all pages share: templates, languages, the person signed in, and the page of errors."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import quote

from fastapi import Depends, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined

from prooflight import __version__
from prooflight_console.access import authenticated, kiosk_of, needs
from prooflight_console.accounts.account_store import LANGUAGES
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.pages.defects import incident_text, sheet_text
from prooflight_console.pages.language import ENGLISH, Language, language
from prooflight_console.problems import Problem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight_console.console import Console

ViewerPage = Annotated[Who, Depends(needs(Role.VIEWER, Scope.READ))]
OperatorPage = Annotated[Who, Depends(needs(Role.OPERATOR, Scope.LABELS))]
JobsPage = Annotated[Who, Depends(needs(Role.OPERATOR, Scope.JOBS))]
EngineerPage = Annotated[Who, Depends(needs(Role.ENGINEER, Scope.ZONES))]
MOST_LETTERS: Final = 2000


def language_of(request: Request, who: Who | None) -> Language:
    """Return the language that a person chose, else the first that their browser accepts, else English."""
    if who is not None and who.language in LANGUAGES:
        return language(who.language)
    for part in request.headers.get("Accept-Language", "").split(","):
        code = part.partition(";")[0].strip().lower()[:2]
        if code in LANGUAGES:
            return language(code)
    return language(ENGLISH)


def in_language(request: Request, text: str) -> str:
    """Return a sentence in the language that a request accepts; pages' scripts state the page's own."""
    return language_of(request, None).sentence(text)


@cache
def environment() -> Environment:
    """Return the environment of templates, which escapes all values."""
    templates = Environment(
        loader=PackageLoader("prooflight_console.pages", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.globals |= {
        "asset": asset,
        "incident_text": incident_text,
        "sheet_text": sheet_text,
        "Role": Role,
    }
    templates.filters["moment"] = moment
    templates.filters["quoted"] = lambda text: quote(str(text), safe="")
    return templates


@cache
def asset(name: str) -> str:
    """Return the address of a file of ``static``, with its digest, so that browsers may cache it for good."""
    content = (files("prooflight_console") / "static" / name).read_bytes()
    return f"/static/{name}?v={hashlib.sha256(content).hexdigest()[:12]}"


def moment(unix_s: float, how: str = "%Y-%m-%d %H:%M") -> str:
    """Return a Unix time as text, by the clock of the console's machine."""
    return datetime.fromtimestamp(unix_s, UTC).astimezone().strftime(how)


def rendered(name: str, /, *, t: Language, **values: Any) -> str:
    """Return a rendered template."""
    return environment().get_template(f"{name}.html.j2").render(t=t, **values)


def page(
    request: Request,
    who: Who | None,
    template: str,
    /,
    *,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
    **values: Any,
) -> HTMLResponse:
    """Return a page; values: those of its template."""
    state: Console = request.app.state.console
    html = rendered(
        template,
        t=language_of(request, who),
        who=who,
        path=request.url.path,
        version=__version__,
        trouble=state.live.trouble,
        many_presses=state.settings.records is not None,
        has_queue=state.settings.queue is not None,
        may_speak=who is not None and who.role.may(Role.OPERATOR),
        **values,
    )
    return HTMLResponse(html, status, dict(headers or {}))


def problem_page(
    request: Request, status: int, kind: str, detail: str, headers: Mapping[str, str]
) -> Response:
    """Return the page of an error for people; a person who is not signed in is redirected to sign in."""
    if status == 401 and request.headers.get("accept") == "text/event-stream":
        return Response(status_code=204)  # the browser reconnects no more, and the page loads itself again
    wants_page = "HX-Request" not in request.headers
    if status == 401 and wants_page and request.method == "GET":
        back = request.url.path + (f"?{request.url.query}" if request.url.query else "")
        where = "/sign-in" if kiosk_of(request) is None else "/kiosk"
        return RedirectResponse(f"{where}?next={quote(back[:MOST_LETTERS], safe='')}", 303)
    try:
        who = authenticated(request)
    except Problem:
        who = None
    if status == 401:
        headers = {**headers, "HX-Redirect": "/sign-in"}
    return page(
        request, who, "problem", status=status, headers=headers, code=status, kind=kind, detail=detail
    )
