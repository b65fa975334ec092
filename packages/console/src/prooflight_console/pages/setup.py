"""The pages Set up: the machine, people, tokens of programs, and the audit."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Depends, Form, Query, Request
from fastapi import Path as InPath

from prooflight.errors import ProoflightError, RequestError
from prooflight.pages.memory import file_stamp
from prooflight_console.access import needs
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.api.common import console
from prooflight_console.api.people import LINK_PATH
from prooflight_console.pages.shell import ViewerPage, page
from prooflight_console.reading.machine import camera_facts, job_facts, press_facts, settings_rows

if TYPE_CHECKING:
    from fastapi.responses import Response

    from prooflight_console.accounts.audit import Entry
    from prooflight_console.reading.machine import PressFacts

router = APIRouter(include_in_schema=False)

ROWS: Final = 50
DAYS: Final = (30, 90, 365, 1095)
SignedPage = Annotated[Who, Depends(needs(Role.VIEWER))]
AdminPage = Annotated[Who, Depends(needs(Role.ADMIN))]
AuditorPage = Annotated[Who, Depends(needs(Role.ADMIN, Scope.AUDIT))]
Name = Annotated[str, InPath(alias="name", max_length=120)]
ShortText = Annotated[str, Form(max_length=120)]


# --- the machine ---


@router.get("/setup")
def machine_page(request: Request, who: ViewerPage) -> Response:
    """Return the page of presses, jobs and camera."""
    state = console(request)
    run = state.reading.last_run()
    camera = camera_facts(run, [row.page for row in state.live.recent])
    return page(
        request,
        who,
        "setup/machine",
        presses=[_press(path) for path in state.settings.presses],
        jobs=[job_facts(path) for path in state.settings.jobs],
        camera=camera,
        settings=[] if run is None else settings_rows(run),
        journal=state.settings.journal.name,
    )


def _press(path: Path) -> PressFacts:
    try:
        return _cached_press(path, tuple(file_stamp(path)))
    except (OSError, ProoflightError):
        return press_facts(path)


@lru_cache(maxsize=16)
def _cached_press(path: Path, _stamp: tuple[int, ...]) -> PressFacts:
    return press_facts(path)


# --- people ---


@router.get("/setup/users")
def users_page(request: Request, who: AdminPage) -> Response:
    """Return the list of user accounts."""
    return _users(request, who, whole=True)


@router.post("/setup/users")
def add_user(request: Request, who: AdminPage, name: ShortText, role: Annotated[Role, Form()]) -> Response:
    """Add a person; the answer shows the link by which they choose a password."""
    accounts = console(request).accounts
    try:
        secret = accounts.add(name, role, by=who.name)
    except RequestError as error:
        return _users(request, who, wrong=str(error))
    return _users(request, who, link=LINK_PATH + secret, of=" ".join(name.split()))


@router.post("/setup/users/{name}/role")
def give_role(request: Request, who: AdminPage, name: Name, role: Annotated[Role, Form()]) -> Response:
    """Change a person's role, which ends their sessions."""
    return _changed(request, who, name, role=role)


@router.post("/setup/users/{name}/lock")
def lock(request: Request, who: AdminPage, name: Name, locked: Annotated[bool, Form()]) -> Response:
    """Lock a person out, or let them in again."""
    return _changed(request, who, name, locked=locked)


@router.post("/setup/users/{name}/link")
def new_link(request: Request, who: AdminPage, name: Name) -> Response:
    """Make a new link for a person who lost theirs, or their password."""
    try:
        secret = console(request).accounts.link(name, by=who.name)
    except RequestError as error:
        return _users(request, who, wrong=str(error))
    return _users(request, who, link=LINK_PATH + secret, of=name)


def _changed(request: Request, who: Who, name: str, **changes: Any) -> Response:
    try:
        console(request).accounts.change(name, by=who.name, **changes)
    except RequestError as error:
        return _users(request, who, wrong=str(error))
    return _users(request, who)


def _users(request: Request, who: Who, *, whole: bool = False, **texts: str) -> Response:
    values: dict[str, Any] = {"wrong": "", "link": "", "of": ""} | texts
    if values["link"]:
        values["link"] = str(request.base_url).rstrip("/") + values["link"]
    people = console(request).accounts.people()
    return page(
        request,
        who,
        "setup/users" if whole else "setup/users_list",
        people=people,
        roles=list(Role),
        status=422 if values["wrong"] else 200,
        **values,
    )


# --- tokens ---


@router.get("/setup/tokens")
def tokens_page(request: Request, who: SignedPage) -> Response:
    """Return the requester's tokens; an admin sees all."""
    return _tokens(request, who, whole=True)


@router.post("/setup/tokens")
def add_token(
    request: Request,
    who: SignedPage,
    name: ShortText,
    days: Annotated[float, Form(gt=0, le=3660)] = 365.0,
    scopes: Annotated[list[Scope] | None, Form()] = None,
) -> Response:
    """Add a token; the answer shows its secret, this once."""
    accounts = console(request).accounts
    try:
        _, secret = accounts.new_token(who.name, name, scopes or [], by=who.name, days=days)
    except RequestError as error:
        return _tokens(request, who, wrong=str(error))
    return _tokens(request, who, secret=secret)


@router.post("/setup/tokens/{token}/revoke")
def revoke(request: Request, who: SignedPage, token: Annotated[int, InPath(ge=1, lt=2**63)]) -> Response:
    """Revoke a token; an admin may revoke any."""
    owner = None if who.role is Role.ADMIN else who.name
    try:
        console(request).accounts.revoke(token, by=who.name, owner=owner)
    except RequestError as error:
        return _tokens(request, who, wrong=str(error))
    return _tokens(request, who)


def _tokens(
    request: Request, who: Who, *, whole: bool = False, wrong: str = "", secret: str = ""
) -> Response:
    accounts = console(request).accounts
    return page(
        request,
        who,
        "setup/tokens" if whole else "setup/tokens_list",
        tokens=accounts.tokens(None if who.role is Role.ADMIN else who.name)[::-1],
        scopes=list(Scope),
        days=DAYS,
        now_s=accounts.clock(),
        status=422 if wrong else 200,
        wrong=wrong,
        secret=secret,
    )


# --- the audit ---


@router.get("/setup/audit")
def audit_page(
    request: Request, who: AuditorPage, before: Annotated[int | None, Query(ge=1, lt=2**63)] = None
) -> Response:
    """Return the audit, the latest first; htmx requests the next rows."""
    entries = console(request).accounts.audited(before=before, limit=ROWS)
    next_before = entries[-1].id if len(entries) == ROWS and entries[-1].id > 1 else None
    rows_only = bool(request.headers.get("HX-Request")) and before is not None
    template = "setup/audit_rows" if rows_only else "setup/audit"
    return page(request, who, template, entries=[(one, _change(one)) for one in entries], behind=next_before)


@router.get("/setup/audit/chain")
def chain(request: Request, who: AuditorPage, noted: Annotated[str, Query(max_length=64)] = "") -> Response:
    """Verify that every row is as it was written; noted: a head that was noted earlier."""
    result = console(request).accounts.verified(expected_head=noted.strip().lower() or None)
    return page(request, who, "setup/chain", chain=result, noted=noted)


def _change(entry: Entry) -> list[tuple[str, Any, Any]]:
    """Return name, old and new value of each change."""
    before, after = ({} if part is None else json.loads(part) for part in (entry.before, entry.after))
    if not isinstance(before, dict) or not isinstance(after, dict):
        return [("", before, after)]
    names = [name for name in {**before, **after} if before.get(name) != after.get(name)]
    return [(name, before.get(name), after.get(name)) for name in names if after.get(name) != ""]
