"""Sign in at the plant's OpenID provider, next to the console's own accounts."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Final

import anyio
from fastapi import APIRouter, Depends, Request
from fastapi.responses import RedirectResponse, Response

from prooflight_console.access import cookie_name, open_to_all
from prooflight_console.accounts.provider import BEGUN_S, ProviderError
from prooflight_console.accounts.provider_file import RETURN_PATH
from prooflight_console.accounts.roles import Who
from prooflight_console.api.common import console
from prooflight_console.api.session import set_cookie, set_secret
from prooflight_console.pages.sign_in import inside, sign_in_page
from prooflight_console.problems import not_found

if TYPE_CHECKING:
    from prooflight_console.accounts.provider import Provider

router = APIRouter(include_in_schema=False)

Anybody = Annotated[Who | None, Depends(open_to_all())]
STATUS: Final = {"down": 503, "begun": 400, "refused": 403}
MOST_LETTERS: Final = 4000
"""Length to which each value from a provider is cut."""


@router.get("/sign-in/provider")
async def begin(request: Request, _who: Anybody, next: str = "/") -> Response:
    """Redirect to the provider, with the state in a cookie of this browser."""
    provider = _provider(request)
    try:
        address, state = await anyio.to_thread.run_sync(
            partial(provider.begin, next=inside(next)), limiter=provider.limiter
        )
    except ProviderError as error:
        return _refused(request, provider, error)
    response = RedirectResponse(address, 303)
    set_secret(request, response, _state_cookie(request), state, seconds=BEGUN_S)
    return response


@router.get(RETURN_PATH)
async def come_back(request: Request, _who: Anybody) -> Response:
    """Handle the return from the provider, with a code or with the reason why there is none."""
    provider, accounts = _provider(request), console(request).accounts
    parameters = {name: value[:MOST_LETTERS] for name, value in request.query_params.items()}
    state = request.cookies.get(_state_cookie(request), "")
    try:
        identity, next = await anyio.to_thread.run_sync(
            partial(provider.finish, parameters, state=state), limiter=provider.limiter
        )
    except ProviderError as error:
        if error.kind != "down":
            why = {"by": provider.settings.issuer, "why": error.detail}
            note = partial(accounts.note, "somebody", "session.refused", "somebody", after=why)
            await anyio.to_thread.run_sync(note)
        return _refused(request, provider, error)
    secret = await anyio.to_thread.run_sync(accounts.begin_as, identity)
    if secret is None:
        wrong = "provider.locked" if identity.role is not None else "provider.unmapped"
        inserted = {"name": identity.name[:60], "service": provider.settings.name}
        return _forgotten(request, sign_in_page(request, wrong=wrong, inserted=inserted, status=403))
    response = RedirectResponse(inside(next), 303)
    set_cookie(request, response, secret)
    return _forgotten(request, response)


def _provider(request: Request) -> Provider:
    provider = console(request).provider
    if provider is None:
        raise not_found("this console was started without a provider for sign-in")
    return provider


def _refused(request: Request, provider: Provider, error: ProviderError) -> Response:
    inserted = {"service": provider.settings.name, "why": error.detail}
    status = STATUS[error.kind]
    sign_in = sign_in_page(request, wrong=f"provider.{error.kind}", inserted=inserted, status=status)
    return _forgotten(request, sign_in)


def _forgotten(request: Request, response: Response) -> Response:
    """Delete the cookie of the state, which works once."""
    secure = console(request).settings.secure
    response.delete_cookie(_state_cookie(request), path="/", secure=secure, httponly=True, samesite="lax")
    return response


def _state_cookie(request: Request) -> str:
    return f"{cookie_name(console(request).settings)}-state"
