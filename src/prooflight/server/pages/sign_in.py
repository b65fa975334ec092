"""Sign in, choose a password by a link, sign out, choose a language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import anyio
from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import JSONResponse, RedirectResponse, Response

from prooflight.errors import RequestError
from prooflight.server.access import cookie_name, needs, open_to_all
from prooflight.server.accounts.roles import Role, Who
from prooflight.server.api.common import console
from prooflight.server.api.session import set_cookie, tried
from prooflight.server.pages.shell import page
from prooflight.server.problems import Problem

if TYPE_CHECKING:
    from collections.abc import Mapping

router = APIRouter(include_in_schema=False)

Text = Annotated[str, Form(max_length=400)]
Anybody = Annotated[Who | None, Depends(open_to_all())]
Signed = Annotated[Who, Depends(needs(Role.VIEWER))]


@router.get("/sign-in")
def form(request: Request, _who: Anybody, next: str = "/") -> Response:
    """The form."""
    return sign_in_page(request, next=next)


@router.post("/sign-in")
async def sign_in(request: Request, _who: Anybody, name: Text, password: Text, next: Text = "/") -> Response:
    """Try it."""
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
    """Choose a password; the secret of the link stands behind the # and never in a log."""
    return page(request, None, "welcome", wrong="")


@router.post("/welcome/name")
async def welcome_name(request: Request, _who: Anybody, secret: Text) -> Response:
    """Say to whoever has a link whose it is; 404: nobody's, used, or too old."""
    person = await anyio.to_thread.run_sync(console(request).accounts.linked, secret)
    return Response(status_code=404) if person is None else JSONResponse({"name": person.name})


@router.post("/welcome")
async def choose(request: Request, _who: Anybody, secret: Text, password: Text, again: Text) -> Response:
    """Set it, and sign in."""
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
    """End the session; whoever signed in at a provider is signed out there as well."""
    held, there = console(request), None
    issuer = await anyio.to_thread.run_sync(held.accounts.issuer_of, who)
    await anyio.to_thread.run_sync(held.accounts.end, who)
    if held.provider is not None and issuer == held.provider.settings.issuer:
        there = await anyio.to_thread.run_sync(held.provider.end_address, limiter=held.provider.limiter)
    response = Response(status_code=204, headers={"HX-Redirect": there or "/sign-in"})
    response.delete_cookie(cookie_name(console(request).settings), path="/")
    return response


@router.post("/language/{code}")
def speak(request: Request, who: Signed, code: str) -> Response:
    """Read in another language from now on."""
    console(request).accounts.speak(who, code)
    return Response(status_code=204, headers={"HX-Refresh": "true"})


def sign_in_page(
    request: Request,
    *,
    next: str = "/",
    name: str = "",
    wrong: str = "",
    told: Mapping[str, str] | None = None,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """The form. wrong: key of the words that say what was wrong; told: what is put in these."""
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
        told=told or {},
        provider=None if provider is None else provider.settings,
    )


def inside(address: str) -> str:
    """A page of this console; anything else is the first page."""
    if not address.startswith("/") or address.startswith(("//", "/\\")) or not address.isprintable():
        return "/"
    return address
