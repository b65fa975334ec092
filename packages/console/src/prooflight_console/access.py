"""Access control that denies by default: every endpoint must state its role, or that it is open."""

import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from fastapi import APIRouter, FastAPI, Request
from fastapi.routing import APIRoute

from prooflight_console.accounts.account_store import Accounts
from prooflight_console.accounts.kiosks import Kiosk, Kiosks
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.problems import Problem
from prooflight_console.settings import ConsoleSettings

COOKIE: Final = "prooflight"
CSRF_HEADER: Final = "X-CSRF-Token"
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
OPEN: Final = "open"


@dataclass(frozen=True, slots=True, kw_only=True)
class Needs:
    """Access that an endpoint requires."""

    role: Role | None
    """Lowest role that may call the endpoint; None if it is open to all."""
    scope: Scope | None = None
    """Scope that a token must have; None if no token is accepted, only a person who signed in."""


def include(app: FastAPI, *routers: APIRouter) -> None:
    """Add all endpoints of the routers, whose paths are complete."""
    for router in routers:
        app.router.routes.extend(router.routes)


class EndpointError(RuntimeError):
    """An endpoint does not say who may ask it."""


def needs(role: Role, scope: Scope | None = None, *, by_key: bool = False) -> Callable[..., Any]:
    """Return a dependency that requires at least this role and gives the ``Who`` of the requester.

    A request that changes something, other than by a token, must carry the CSRF token of its session. by_key: whether
    people who signed in by badge or PIN may call an endpoint for which no token will do: passwords, tokens and PINs
    are changed in a session by password alone.
    """

    def who_may(request: Request) -> Who:
        settings: ConsoleSettings = request.app.state.console.settings
        who = authenticated(request)
        if who is None:
            raise Problem(401, "sign-in", "sign in, or send a token", headers={"WWW-Authenticate": "Bearer"})
        if not who.role.may(role):
            raise Problem(403, "role", f"this requires the role {role}; your role is {who.role}")
        if who.scopes is not None and scope not in who.scopes:
            requirement = "a user who is signed in" if scope is None else f"the scope {scope}"
            raise Problem(403, "scope", f"this requires {requirement}")
        if who.by_key and scope is None and not by_key and request.method not in SAFE:
            raise Problem(403, "password", "this requires a session by password: sign in with yours")
        if who.scopes is None and request.method not in SAFE:
            meant(request, settings)
            if not secrets.compare_digest(request.headers.get(CSRF_HEADER, "").encode(), who.csrf.encode()):
                detail = f"the header {CSRF_HEADER} does not match the session: reload the page and repeat the action"
                raise Problem(403, "csrf", detail)
        return who

    who_may.needs = Needs(role=role, scope=scope)  # type: ignore[attr-defined]
    return who_may


def open_to_all() -> Callable[..., Any]:
    """Return a dependency that requires no sign-in and gives ``Who`` or None.

    A request that changes something must come from the console's own pages.
    """

    def anybody(request: Request) -> Who | None:
        if request.method not in SAFE:
            meant(request, request.app.state.console.settings)
        return authenticated(request)

    anybody.needs = Needs(role=None)  # type: ignore[attr-defined]
    return anybody


def authenticated(request: Request) -> Who | None:
    """Return who sends the request, by token or by session; None if nobody is signed in.

    Raises ``Problem`` 401 for a token that is unknown, revoked or too old.
    """
    accounts: Accounts = request.app.state.console.accounts
    given = request.headers.get("Authorization")
    if given is not None:
        kind, _, secret = given.partition(" ")
        who = accounts.of_token(secret.strip()) if kind.lower() == "bearer" else None
        if who is None:
            detail = "the token is unknown, revoked, or expired"
            raise Problem(401, "token", detail, headers={"WWW-Authenticate": "Bearer"})
        return who
    secret = request.cookies.get(cookie_name(request.app.state.console.settings), "")
    signed_in = accounts.of_session(secret) if secret else None
    # What a page fetches by itself is no action of a person.
    acts = request.method not in SAFE or request.headers.get("Sec-Fetch-Mode") == "navigate"
    if signed_in is not None and signed_in.idle_s and acts:
        accounts.kiosks.acted(signed_in)
    return signed_in


def kiosk_of(request: Request) -> Kiosk | None:
    """Return the kiosk that sends the request; None: the device is none."""
    state = request.app.state.console
    secret = request.cookies.get(kiosk_cookie(state.settings), "")
    kiosks: Kiosks = state.accounts.kiosks
    return kiosks.one(secret) if secret else None


def kiosk_cookie(settings: ConsoleSettings) -> str:
    """Return the name of the cookie of a kiosk, as ``cookie_name``."""
    return f"{cookie_name(settings)}-kiosk"


def cookie_name(settings: ConsoleSettings) -> str:
    """Return the name of the session cookie.

    With TLS it has the prefix __Host-, by which the browser ensures that no other host sets it (RFC 6265bis).
    """
    return f"__Host-{COOKIE}" if settings.secure else COOKIE


def meant(request: Request, settings: ConsoleSettings) -> None:
    """Refuse a change that a page of another site sent, by the headers in which browsers name the origin."""
    site = request.headers.get("Sec-Fetch-Site")
    if site is not None and site not in ("same-origin", "none"):
        raise Problem(403, "origin", "the request came from another site")
    origin = request.headers.get("Origin")
    if origin is None or origin in settings.origins:
        return
    if urlsplit(origin).netloc != request.headers.get("Host", ""):
        raise Problem(403, "origin", "the request came from another site")


def refuse_unguarded(app: FastAPI) -> None:
    """Raise EndpointError if an endpoint does not state who may call it."""
    for path, methods, stated in _stated(app):
        if stated is None:
            what = f"{','.join(sorted(methods))} {path} does not state who may call it: needs(role) or open_to_all()"
            raise EndpointError(what)


def endpoint_rows(app: FastAPI) -> list[tuple[str, str, str, str]]:
    """Return method, path, role and scope of every endpoint, in the order of paths."""
    rows = []
    for path, methods, stated in _stated(app):
        if stated is None:
            raise EndpointError(path)
        role = OPEN if stated.role is None else stated.role.value
        scope = "–" if stated.scope is None else stated.scope.value
        rows += [(path, method, role, scope) for method in methods - {"HEAD"}]
    return [(method, path, role, scope) for path, method, role, scope in sorted(rows)]


def _stated(app: FastAPI) -> Iterator[tuple[str, set[str], Needs | None]]:
    for route in app.routes:
        if isinstance(route, APIRoute):
            yield route.path, set(route.methods or ()), _needs(route.dependant)  # codespell:ignore dependant
        else:
            yield getattr(route, "path", repr(route)), set(getattr(route, "methods", None) or {"GET"}), None


def _needs(dependency: Any) -> Needs | None:
    for each in dependency.dependencies:
        stated = getattr(each.call, "needs", None) or _needs(each)
        if isinstance(stated, Needs):
            return stated
    return None
