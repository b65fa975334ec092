"""Pages to sign in, choose a password by a link, sign out, and choose a language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import anyio
from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import JSONResponse, RedirectResponse, Response

from prooflight.errors import RequestError
from prooflight_console.access import cookie_name, kiosk_of, needs, open_to_all
from prooflight_console.accounts.roles import Role, Who
from prooflight_console.api.common import console
from prooflight_console.api.session import set_cookie, tried
from prooflight_console.pages.shell import page
from prooflight_console.problems import Problem

if TYPE_CHECKING:
    from collections.abc import Mapping

router = APIRouter(include_in_schema=False)

Text = Annotated[str, Form(max_length=400)]
Anybody = Annotated[Who | None, Depends(open_to_all())]
Signed = Annotated[Who, Depends(needs(Role.VIEWER, by_key=True))]


@router.get("/sign-in")
def form(request: Request, _who: Anybody, next: str = "/") -> Response:
    """Return the form."""
    return sign_in_page(request, next=next)


@router.post("/sign-in")
async def sign_in(request: Request, _who: Anybody, name: Text, password: Text, next: Text = "/") -> Response:
    """Check name and password, and sign in."""
    try:
        secret = await tried(request, name, password)
    except Problem as problem:
        wrong = {401: "sign-in.wrong", 429: "sign-in.wait"}[problem.status]
        return sign_in_page(
            request, next=next, name=name, wrong=wrong, status=problem.status, headers=problem.headers
        )
    response = RedirectResponse(inside(next), 303)
    set_cookie(request, response, secret)
    return response


@router.get("/welcome")
def welcome(request: Request, _who: Anybody) -> Response:
    """Return the page to choose a password; the secret is after the # of the link, so it is in no log."""
    return page(request, None, "welcome", wrong="")


@router.post("/welcome/name")
async def welcome_name(request: Request, _who: Anybody, secret: Text) -> Response:
    """Return the name of the person whom a link is for; 404 if it is unknown, used, or too old."""
    person = await anyio.to_thread.run_sync(console(request).accounts.linked, secret)
    return Response(status_code=404) if person is None else JSONResponse({"name": person.name})


@router.post("/welcome")
async def choose(request: Request, _who: Anybody, secret: Text, password: Text, again: Text) -> Response:
    """Set the password, and sign in."""
    accounts, wrong = console(request).accounts, ""
    if password != again:
        wrong = "welcome.differ"
    else:
        try:
            person = await anyio.to_thread.run_sync(accounts.choose, secret, password)
        except RequestError:
            wrong = "welcome.length"
        else:
            if person is not None:
                session = await anyio.to_thread.run_sync(lambda: accounts.begin(person.name, how="link"))
                response = RedirectResponse("/", 303)
                set_cookie(request, response, session)
                return response
            wrong = "welcome.used"
    return page(request, None, "welcome", status=422, wrong=wrong)


@router.post("/sign-out")
async def sign_out(request: Request, who: Signed) -> Response:
    """End the session, also at the provider at which the person signed in."""
    state, there = console(request), None
    issuer = await anyio.to_thread.run_sync(state.accounts.issuer_of, who)
    await anyio.to_thread.run_sync(state.accounts.end, who)
    if state.provider is not None and issuer == state.provider.settings.issuer:
        there = await anyio.to_thread.run_sync(state.provider.end_address, limiter=state.provider.limiter)
    response = Response(status_code=204, headers={"HX-Redirect": there or "/sign-in"})
    response.delete_cookie(cookie_name(console(request).settings), path="/")
    return response


@router.post("/language/{code}")
def speak(request: Request, who: Signed, code: str) -> Response:
    """Change the language for the person."""
    console(request).accounts.speak(who, code)
    return Response(status_code=204, headers={"HX-Refresh": "true"})


def sign_in_page(
    request: Request,
    *,
    next: str = "/",
    name: str = "",
    wrong: str = "",
    inserted: Mapping[str, str] | None = None,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return the form. wrong: key of the text of the error; inserted: values for this text."""
    provider = console(request).provider
    return page(
        request,
        None,
        "sign_in",
        status=status,
        headers=headers,
        next=inside(next),
        name=name,
        wrong=wrong,
        told=inserted or {},
        kiosk=kiosk_of(request),
        provider=None if provider is None else provider.settings,
    )


def inside(address: str) -> str:
    """Return the address if it is a page of this console, else the first page."""
    if not address.startswith("/") or address.startswith(("//", "/\\")) or not address.isprintable():
        return "/"
    return address
