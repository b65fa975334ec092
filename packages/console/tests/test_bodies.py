"""A body is bounded before it is read, whoever sends it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from prooflight_console.middleware import MOST_BYTES, BoundedBodies

if TYPE_CHECKING:
    from collections.abc import Iterator

    from packages.console.tests.consoles import Served

CHUNK = b"x" * 100_000
LARGE = {"name": "a", "password": "b" * MOST_BYTES}


def test_a_body_that_says_it_is_too_large_is_not_read(console: Served) -> None:
    answer = console.client().post("/api/v1/session", json=LARGE)
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:prooflight:too-large")
    page = console.client().post("/sign-in", data=LARGE)
    assert page.status_code == 413
    assert "4,000,000 bytes" in page.text


def test_a_body_that_does_not_say_how_large_it_is_is_read_no_further(console: Served) -> None:
    sent = 0

    def chunks() -> Iterator[bytes]:
        nonlocal sent
        for _ in range(1000):
            sent += len(CHUNK)
            yield CHUNK

    headers = {"Content-Type": "application/json"}
    answer = console.client().post("/api/v1/session", content=chunks(), headers=headers)
    assert answer.status_code == 413
    assert answer.json()["detail"] == "a body has at most 4,000,000 bytes"


@pytest.mark.parametrize(("size", "whole"), [(MOST_BYTES, True), (MOST_BYTES + 1, False)])
def test_no_more_than_the_bound_is_held(size: int, whole: bool) -> None:
    """The application asks for the body piece by piece, as servers give it."""
    given = [b"x" * min(size - at, 65_536) for at in range(0, size, 65_536)]
    asked = 0

    async def receive() -> dict[str, Any]:
        nonlocal asked
        asked += 1
        return {"type": "http.request", "body": given[asked - 1], "more_body": asked < len(given)}

    async def application(_scope: Any, receive: Any, _send: Any) -> None:
        while (await receive())["more_body"]:
            pass

    async def send(_message: Any) -> None:
        return None

    import asyncio

    from starlette.exceptions import HTTPException

    bounded = BoundedBodies(application)
    scope = {"type": "http", "headers": []}
    if whole:
        asyncio.run(bounded(scope, receive, send))  # type: ignore[arg-type]
    else:
        with pytest.raises(HTTPException) as refused:
            asyncio.run(bounded(scope, receive, send))  # type: ignore[arg-type]
        assert refused.value.status_code == 413
    assert asked == len(given)
