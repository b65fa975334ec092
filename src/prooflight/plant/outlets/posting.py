"""Posting to a machine of the plant: one client, and what goes wrong with it in words."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

import httpx

from prooflight.plant.outlets.outlet import OutletError, told

if TYPE_CHECKING:
    import ssl
    from collections.abc import AsyncIterator

REFUSED: Final = frozenset({400, 413, 415, 422})
"""Answers that say that this very event will never be taken: it is given up, and the others go on."""


@contextlib.asynccontextmanager
async def posting(*, tls: ssl.SSLContext | None, timeout_s: float) -> AsyncIterator[httpx.AsyncClient]:
    """A client; OutletError: whom it asked did not answer, or not in time. No proxy: the plant is near."""
    verify = True if tls is None else tls
    try:
        async with httpx.AsyncClient(verify=verify, timeout=timeout_s, trust_env=False) as client:
            yield client
    except httpx.TimeoutException as error:
        raise OutletError(f"no answer within {timeout_s:g} s") from error
    except httpx.HTTPError as error:
        raise OutletError(told(error)) from error


def said(answer: httpx.Response) -> str:
    """What a receiver answers.

    >>> said(httpx.Response(503))
    'answers 503 Service Unavailable'
    """
    return f"answers {answer.status_code} {answer.reason_phrase}".rstrip()
