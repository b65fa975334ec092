"""Pages of kiosks: sign-in by badge or PIN, and the page Set up, kiosks: devices, PINs and badges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import anyio
from fastapi import APIRouter, Depends, Form, Path, Request
from fastapi.responses import RedirectResponse, Response

from prooflight.errors import RequestError
from prooflight_console.access import kiosk_cookie, kiosk_of, needs, open_to_all
from prooflight_console.accounts.kiosks import KIOSK_S, MOST_DIGITS
from prooflight_console.accounts.roles import Role, Who
from prooflight_console.api.common import console
from prooflight_console.api.session import refuse_tries, set_cookie, set_secret
from prooflight_console.pages.shell import page
from prooflight_console.pages.sign_in import inside
from prooflight_console.problems import Problem

if TYPE_CHECKING:
    from collections.abc import Callable

router = APIRouter(include_in_schema=False)

Text = Annotated[str, Form(max_length=400)]
Anybody = Annotated[Who | None, Depends(open_to_all())]
Signed = Annotated[Who, Depends(needs(Role.VIEWER))]
AdminPage = Annotated[Who, Depends(needs(Role.ADMIN))]


@router.get("/kiosk")
def kiosk_page(request: Request, _who: Anybody, next: str = "/") -> Response:
    """Return the form; elsewhere than on a kiosk it says so."""
    return _form(request, next=next)


@router.post("/kiosk")
async def sign_in(
    request: Request, _who: Anybody, badge: Text = "", name: Text = "", pin: Text = "", next: Text = "/"
) -> Response:
    """Sign in by badge, or by name and PIN; the limit on failures is that of passwords."""
    state, kiosk = console(request), kiosk_of(request)
    if kiosk is None:
        return _form(request, next=next, status=403)
    kiosks = state.accounts.kiosks
    # Badges share one name per kiosk, so that they cannot be guessed one after the other.
    tried, address = (name or "badge"), f"kiosk {kiosk.id}"
    ask: Callable[[], str | None] = (
        (lambda: kiosks.by_badge(kiosk, badge)) if badge else (lambda: kiosks.by_pin(kiosk, name, pin))
    )
    try:
        async with state.tries.in_turn(tried, address):
            refuse_tries(state.tries, tried, address)
            secret = await anyio.to_thread.run_sync(ask)
            if secret is None:
                state.tries.failed(tried, address)
                return _form(request, next=next, name=name, wrong="kiosk.wrong", status=401)
            state.tries.passed(tried, address)
    except Problem as problem:
        return _form(request, next=next, name=name, wrong="sign-in.wait", status=problem.status)
    response = RedirectResponse(inside(next), 303)
    set_cookie(request, response, secret, by_key=True)
    return response


@router.get("/setup/kiosks")
def kiosks_page(request: Request, who: Signed) -> Response:
    """Return the devices and everybody's keys to an admin, and to all others the form for their own PIN."""
    return _kiosks(request, who)


@router.post("/setup/kiosks/pin")
async def set_pin(request: Request, who: Signed, pin: Text, again: Text) -> Response:
    """Set one's own PIN."""
    if pin != again:
        return _kiosks(request, who, wrong="kiosk.differ", status=422)
    kiosks = console(request).accounts.kiosks
    try:
        await anyio.to_thread.run_sync(lambda: kiosks.set_pin(who.name, pin, by=who.name))
    except RequestError:
        return _kiosks(request, who, wrong="kiosk.no-pin", status=422)
    return _kiosks(request, who, done="kiosk.pin-set")


@router.post("/setup/kiosks/enrol")
def enrol(request: Request, who: AdminPage, name: Text) -> Response:
    """Make this device a kiosk, and sign the admin out on it."""
    state = console(request)
    secret = state.accounts.kiosks.enrol(name, by=who.name)
    state.accounts.end(who)
    response = Response(status_code=204, headers={"HX-Redirect": "/kiosk"})
    set_secret(request, response, kiosk_cookie(state.settings), secret, seconds=KIOSK_S)
    return response


@router.post("/setup/kiosks/{kiosk}/revoke")
def revoke(request: Request, who: AdminPage, kiosk: Annotated[int, Path(ge=1, lt=2**63)]) -> Response:
    """Make a device no kiosk any more."""
    console(request).accounts.kiosks.revoke(kiosk, by=who.name)
    return Response(status_code=204, headers={"HX-Redirect": "/setup/kiosks"})


@router.post("/setup/kiosks/badge")
async def set_badge(request: Request, who: AdminPage, person: Text, badge: Text) -> Response:
    """Set the badge of a person."""
    kiosks = console(request).accounts.kiosks
    await anyio.to_thread.run_sync(lambda: kiosks.set_badge(person, badge, by=who.name))
    return _kiosks(request, who, done="kiosk.badge-set")


@router.post("/setup/kiosks/remove")
def remove_keys(request: Request, who: AdminPage, person: Text) -> Response:
    """Remove the PIN and the badge of a person."""
    console(request).accounts.kiosks.remove(person, by=who.name)
    return _kiosks(request, who)


def _form(request: Request, *, next: str, name: str = "", wrong: str = "", status: int = 200) -> Response:
    return page(
        request,
        None,
        "kiosk/sign_in",
        status=status,
        next=inside(next),
        name=name,
        wrong=wrong,
        kiosk=kiosk_of(request),
        most_digits=MOST_DIGITS,
    )


def _kiosks(request: Request, who: Who, *, wrong: str = "", done: str = "", status: int = 200) -> Response:
    accounts = console(request).accounts
    admin = who.role.may(Role.ADMIN)
    return page(
        request,
        who,
        "kiosk/setup",
        status=status,
        wrong=wrong,
        done=done,
        admin=admin,
        kiosks=accounts.kiosks.listed() if admin else [],
        keys=accounts.kiosks.keys() if admin else [],
        people=accounts.people() if admin else [],
        most_digits=MOST_DIGITS,
    )
