"""HTTP client for posting to a machine of the plant, and the description of its errors."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

import httpx

from prooflight_line.plant.outlets.outlet import OutletError, error_text

if TYPE_CHECKING:
    import ssl
    from collections.abc import AsyncIterator

REFUSED: Final = frozenset({400, 413, 415, 422})
"""Status codes by which a receiver refuses this event for good: it is dropped, and the others go on."""


@contextlib.asynccontextmanager
async def posting(*, tls: ssl.SSLContext | None, timeout_s: float) -> AsyncIterator[httpx.AsyncClient]:
    """Give a client that raises OutletError if there is no answer, or none in time.

    It uses no proxy, because the plant is near.
    """
    verify = True if tls is None else tls
    try:
        async with httpx.AsyncClient(verify=verify, timeout=timeout_s, trust_env=False) as client:
            yield client
    except httpx.TimeoutException as error:
        raise OutletError(f"no answer within {timeout_s:g} s") from error
    except httpx.HTTPError as error:
        raise OutletError(error_text(error)) from error


def answer_text(answer: httpx.Response) -> str:
    """Describe a receiver's answer.

    >>> answer_text(httpx.Response(503))
    'answers 503 Service Unavailable'
    """
    return f"answers {answer.status_code} {answer.reason_phrase}".rstrip()
