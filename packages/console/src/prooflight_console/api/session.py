"""Sessions: sign in, identity of the requester, sign out; and the state of the console."""

from __future__ import annotations

from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Depends, Request, Response

from prooflight import __version__
from prooflight_console.access import cookie_name, kiosk_of, needs, open_to_all
from prooflight_console.accounts.account_store import SESSION_S
from prooflight_console.accounts.passwords import Tries
from prooflight_console.accounts.roles import Role, Who
from prooflight_console.api.common import PREFIX, Viewer, console
from prooflight_console.api.schemas import AboutAnswer, NowAnswer, SessionAnswer, SignInRequest
from prooflight_console.problems import Problem, responses
from prooflight_console.reading import facts

router = APIRouter(prefix=PREFIX, tags=["session"])


@router.post("/session", dependencies=[Depends(open_to_all())], responses=responses(400, 401, 403, 422, 429))
async def sign_in(request: Request, response: Response, given: SignInRequest) -> SessionAnswer:
    """Sign in; the session is in a cookie, and its CSRF token in the answer."""
    secret = await tried(request, given.name, given.password)
    set_cookie(request, response, secret)
    who = console(request).accounts.of_session(secret)
    assert who is not None
    return SessionAnswer(**_session(who))


@router.get("/session", responses=responses(401, 403))
def whoami(who: Viewer) -> SessionAnswer:
    """Return who is signed in, or whose token it is."""
    return SessionAnswer(**_session(who))


@router.delete("/session", status_code=204, responses=responses(401, 403))
def sign_out(request: Request, who: Annotated[Who, Depends(needs(Role.VIEWER, by_key=True))]) -> Response:
    """End the session."""
    console(request).accounts.end(who)
    response = Response(status_code=204)
    response.delete_cookie(cookie_name(console(request).settings), path="/")
    return response


@router.get("/about", responses=responses(401, 403))
def about(request: Request, _who: Viewer) -> AboutAnswer:
    """Return the state of the console, and whether it can read the journal."""
    state = console(request)
    follower = state.reading.follower
    return AboutAnswer(
        version=__version__,
        journal=state.settings.journal.name,
        journal_trouble=state.live.trouble,
        journal_megabytes=None if follower is None else round(follower.megabytes, 3),
        listeners=state.live.listeners,
        up_s=round(state.accounts.clock() - state.began_s, 1),
    )


@router.get("/now", responses=responses(401, 403, 503))
def now(request: Request, _who: Viewer) -> NowAnswer:
    """Return the current state of the press: its state, open incidents, health of camera and inspection."""
    return NowAnswer(**facts.now_facts(console(request).live.now))


async def tried(request: Request, name: str, password: str) -> str:
    """Check a password in a thread and return the secret of a new session.

    Attempts of one address and of one name are made one after the other, so that each knows whether those
    before failed. Raises ``Problem`` 401 if name or password is wrong, and 429 after too many failures.
    """
    state = console(request)
    address = request.client.host if request.client else ""
    refuse_tries(state.tries, name, address)
    async with state.tries.in_turn(name, address):
        refuse_tries(state.tries, name, address)
        secret = await anyio.to_thread.run_sync(state.accounts.sign_in, name, password)
        if secret is None:
            state.tries.failed(name, address)
            detail = "name or password is wrong"
            raise Problem(401, "password", detail, headers={"WWW-Authenticate": "Bearer"})
        state.tries.passed(name, address)
    return secret


def refuse_tries(tries: Tries, name: str, address: str) -> None:
    """Raise ``Problem`` 429 after too many failures of a name or an address."""
    if wait_s := tries.wait_s(name, address):
        headers = {"Retry-After": f"{wait_s:.0f}"}
        detail = f"wait {max(wait_s / 60, 1):.0f} minutes, or ask an admin for a link"
        raise Problem(429, "tries", detail, headers=headers)


def set_cookie(request: Request, response: Response, secret: str, *, by_key: bool = False) -> None:
    """Set the cookie of a session; requests that change something need its CSRF token as well.

    On a kiosk the session ends when nobody acts. by_key: it was begun by badge or PIN, and is bound already.
    """
    if not by_key and (kiosk := kiosk_of(request)) is not None:
        console(request).accounts.kiosks.bound(kiosk, secret, full=True)
    set_secret(request, response, cookie_name(console(request).settings), secret, seconds=SESSION_S)


def set_secret(request: Request, response: Response, name: str, secret: str, *, seconds: float) -> None:
    """Set a cookie that no script can read.

    It is Lax, so that links from mails and from an OpenID provider arrive with it.
    """
    response.set_cookie(
        name,
        secret,
        max_age=int(seconds),
        path="/",
        secure=console(request).settings.secure,
        httponly=True,
        samesite="lax",
    )


def _session(who: Who) -> dict[str, Any]:
    scopes = None if who.scopes is None else sorted(who.scopes)
    return {
        "name": who.name,
        "role": who.role,
        "csrf": who.csrf,
        "ends_s": who.ends_s,
        "scopes": scopes,
    }
