"""People and tokens."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request, Response

from prooflight_console.access import needs
from prooflight_console.accounts.account_store import Person, Token
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.api.common import PREFIX, console
from prooflight_console.api.schemas import (
    LinkAnswer,
    NewPerson,
    NewToken,
    NewTokenAnswer,
    PeopleAnswer,
    PersonAnswer,
    PersonChange,
    TokenAnswer,
    TokensAnswer,
)
from prooflight_console.problems import responses

router = APIRouter(prefix=PREFIX, tags=["people"])

Admin = Annotated[Who, Depends(needs(Role.ADMIN, Scope.PEOPLE))]
Signed = Annotated[Who, Depends(needs(Role.VIEWER))]
"""A person who signed in, since a token cannot create others."""
Name = Annotated[str, Path(alias="name", max_length=120)]
LINK_PATH = "/welcome#"
"""Path of a link, with the secret after the #, so that it is in no log."""


@router.get("/people", responses=responses(401, 403))
def people(request: Request, _who: Admin) -> PeopleAnswer:
    """List all user accounts."""
    return PeopleAnswer(items=[_person(person) for person in console(request).accounts.people()])


@router.post("/people", status_code=201, responses=responses(400, 401, 403, 409, 422))
def add(request: Request, who: Admin, given: NewPerson) -> LinkAnswer:
    """Add a person; the answer holds a link by which they choose a password."""
    secret = console(request).accounts.add(given.name, given.role, by=who.name)
    return LinkAnswer(name=given.name, link=LINK_PATH + secret)


@router.patch("/people/{name}", responses=responses(400, 401, 403, 409, 422))
def change(request: Request, who: Admin, name: Name, given: PersonChange) -> PersonAnswer:
    """Change a person's role, or lock them out; their sessions end at once."""
    changed = console(request).accounts.change(name, by=who.name, role=given.role, locked=given.locked)
    return _person(changed)


@router.post("/people/{name}/link", status_code=201, responses=responses(401, 403, 409, 422))
def link(request: Request, who: Admin, name: Name) -> LinkAnswer:
    """Make a new link for a person who lost theirs, or their password."""
    return LinkAnswer(name=name, link=LINK_PATH + console(request).accounts.link(name, by=who.name))


@router.get("/tokens", responses=responses(401, 403))
def tokens(request: Request, who: Signed) -> TokensAnswer:
    """List your tokens; an admin sees all."""
    owner = None if who.role is Role.ADMIN else who.name
    return TokensAnswer(items=[_token(token) for token in console(request).accounts.tokens(owner)])


@router.post("/tokens", status_code=201, responses=responses(400, 401, 403, 409, 422))
def new_token(request: Request, who: Signed, given: NewToken) -> NewTokenAnswer:
    """Add a token of yours; its secret is shown this once."""
    accounts = console(request).accounts
    token, secret = accounts.new_token(who.name, given.name, given.scopes, by=who.name, days=given.days)
    return NewTokenAnswer(**_facts(token), secret=secret)


@router.delete("/tokens/{token}", status_code=204, responses=responses(401, 403, 409, 422))
def revoke(request: Request, who: Signed, token: Annotated[int, Path(ge=1, lt=2**63)]) -> Response:
    """Revoke a token of yours; an admin may revoke any."""
    owner = None if who.role is Role.ADMIN else who.name
    console(request).accounts.revoke(token, by=who.name, owner=owner)
    return Response(status_code=204)


def _person(person: Person) -> PersonAnswer:
    return PersonAnswer(**asdict(person))


def _token(token: Token) -> TokenAnswer:
    return TokenAnswer(**_facts(token))


def _facts(token: Token) -> dict[str, Any]:
    return asdict(token) | {"scopes": list(token.scopes)}
