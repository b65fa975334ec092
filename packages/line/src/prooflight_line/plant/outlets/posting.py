"""HTTP to and from a machine of the plant: a client that posts, the description of its errors, and a small server."""

from __future__ import annotations

import asyncio
import contextlib
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

import httpx

from prooflight_line.plant.outlets.outlet import OutletError, error_text

if TYPE_CHECKING:
    import ssl
    from collections.abc import AsyncIterator, Callable

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


# --- a server in an event loop: one POST request and one answer a connection ---

MOST_BYTES: Final = 1_000_000
MOST_HEADERS: Final = 100
MOST_LINKS: Final = 32
READ_S: Final = 10.0


class _Wrong(Exception):
    """A request that is not answered, with the status that refuses it."""

    def __init__(self, status: HTTPStatus) -> None:
        self.status = status
        super().__init__(status.phrase)


@contextlib.asynccontextmanager
async def answering(
    host: str, port: int, answer: Callable[[bytes], bytes], *, mime: str
) -> AsyncIterator[tuple[str, int]]:
    """Serve while the context lasts, and give the address.

    ``answer`` computes the body of the answer from that of the request.
    """
    links = 0

    async def link(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal links
        links += 1
        try:
            body = await asyncio.wait_for(_request(reader, busy=links > MOST_LINKS), READ_S)
            _send(writer, HTTPStatus.OK, answer(body), mime)
        except _Wrong as wrong:
            _send(writer, wrong.status, b"", mime)
        except (TimeoutError, OSError, EOFError, ValueError):
            writer.transport.abort()
        finally:
            links -= 1
            with contextlib.suppress(OSError):
                await writer.drain()
                writer.close()
                await writer.wait_closed()

    server = await asyncio.start_server(link, host, port, limit=65536)
    try:
        yield server.sockets[0].getsockname()[:2]
    finally:
        server.close()


async def _request(reader: asyncio.StreamReader, *, busy: bool) -> bytes:
    """Return the body of a POST; ``busy`` means that too many other requests are being answered now."""
    if busy:
        raise _Wrong(HTTPStatus.SERVICE_UNAVAILABLE)
    method, *_ = (await reader.readline()).split()
    length: int | None = None
    for _ in range(MOST_HEADERS):
        line = await reader.readline()
        if line in (b"\r\n", b"\n", b""):
            break
        field, _, value = line.partition(b":")
        if field.strip().lower() == b"content-length":
            length = int(value)
    else:
        raise _Wrong(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
    if method != b"POST":
        raise _Wrong(HTTPStatus.METHOD_NOT_ALLOWED)
    if length is None:
        raise _Wrong(HTTPStatus.LENGTH_REQUIRED)
    if not 0 <= length <= MOST_BYTES:
        raise _Wrong(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
    return await reader.readexactly(length)


def _send(writer: asyncio.StreamWriter, status: HTTPStatus, body: bytes, mime: str) -> None:
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {mime}\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    writer.write(head.encode() + body)
