"""Passwords: argon2, a few at a time beside the event loop, with a limit on failed tries."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections import defaultdict, deque
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final
from weakref import WeakValueDictionary

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

LEAST_LETTERS: Final = 10
"""NIST SP 800-63B asks for 8 at least, and for no rules about kinds of letters."""
MOST_LETTERS: Final = 200
AT_ONCE: Final = 2
"""Passwords that are verified at one time: each takes 64 MiB and, on a small machine, 0.6 s."""
WINDOW_S: Final = 900.0
TRIES: Final = {"pair": 5, "address": 20, "name": 30}
"""In a quarter of an hour: of one name from one address, from one address, and of one name from anywhere. A name has
more, lest a stranger lock an operator out."""


class Passwords:
    """Makes and verifies hashes; called in threads, never on the event loop."""

    def __init__(self, hasher: PasswordHasher | None = None) -> None:
        self._hasher = hasher or PasswordHasher()
        self._room = threading.BoundedSemaphore(AT_ONCE)
        self._nobodys = self._hasher.hash(secrets.token_urlsafe(16))

    def hashed(self, password: str) -> str:
        """RequestError: it is too short or too long."""
        if not LEAST_LETTERS <= len(password) <= MOST_LETTERS:
            what = f"has {len(password)} letters"
            remedy = f"choose {LEAST_LETTERS} to {MOST_LETTERS}; several words are good"
            raise RequestError("password", what, remedy=remedy)
        with self._room:
            return self._hasher.hash(password)

    def right(self, kept: str | None, password: str) -> bool:
        """Whether it is the password of this hash; a person without one takes as long."""
        with self._room:
            try:
                self._hasher.verify(kept or self._nobodys, password[: 2 * MOST_LETTERS])
            except (VerificationError, InvalidHashError):
                return False
        return kept is not None


@dataclass(slots=True)
class Tries:
    """Failed tries of the last quarter of an hour."""

    clock: Callable[[], float]
    """Seconds that only grow."""
    _failed: dict[tuple[str, ...], deque[float]] = field(default_factory=lambda: defaultdict(deque))
    _guard: threading.Lock = field(default_factory=threading.Lock)
    _turns: WeakValueDictionary[tuple[str, str], asyncio.Lock] = field(default_factory=WeakValueDictionary)

    @asynccontextmanager
    async def in_turn(self, name: str, address: str) -> AsyncIterator[None]:
        """One try of an address, and one of a name, at a time: whoever is next knows whether the last one failed."""
        keys = ("address", address), ("name", name.casefold()[:200])
        locks = [self._turns.setdefault(key, asyncio.Lock()) for key in keys]
        async with locks[0], locks[1]:
            yield

    def wait_s(self, name: str, address: str) -> float:
        """How long nothing more is tried; 0: go on."""
        now = self.clock()
        with self._guard:
            waits = [
                self._failed[key][0] + WINDOW_S - now
                for key, most in self._keys(name, address)
                if len(self._recent(key, now)) >= most
            ]
            return max(waits, default=0.0)

    def failed(self, name: str, address: str) -> None:
        """One more; successes are not counted."""
        now = self.clock()
        with self._guard:
            for key, _ in self._keys(name, address):
                self._recent(key, now).append(now)

    def passed(self, name: str, address: str) -> None:
        """It was right: what failed of this name from this address before is forgotten."""
        with self._guard:
            self._failed.pop(("pair", name.casefold(), address), None)

    def _recent(self, key: tuple[str, ...], now: float) -> deque[float]:
        found = self._failed[key]
        while found and found[0] <= now - WINDOW_S:
            found.popleft()
        return found

    def _keys(self, name: str, address: str) -> list[tuple[tuple[str, ...], int]]:
        if len(self._failed) > 10_000:  # names that nobody has cost memory
            self._failed = defaultdict(deque, {key: tries for key, tries in self._failed.items() if tries})
        name = name.casefold()[:200]
        return [
            (("pair", name, address), TRIES["pair"]),
            (("address", address), TRIES["address"]),
            (("name", name), TRIES["name"]),
        ]
