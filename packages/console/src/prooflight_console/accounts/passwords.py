"""Passwords: argon2 in threads, a few at a time, with a limit on failed attempts."""

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
"""Shortest password. NIST SP 800-63B requires at least 8 letters, and no rules about kinds of letters."""
MOST_LETTERS: Final = 200
AT_ONCE: Final = 2
"""Passwords that are verified at one time: each takes 64 MiB and, on a small machine, 0.6 s."""
WINDOW_S: Final = 900.0
TRIES: Final = {"pair": 5, "address": 20, "name": 30}
"""Failed attempts that are allowed in a quarter of an hour.

They count for one name from one address, for one address, and for one name from anywhere. A name has more,
lest a third party lock an operator out.
"""


class Passwords:
    """Hashes and verifies passwords; called in threads, never on the event loop."""

    def __init__(self, hasher: PasswordHasher | None = None) -> None:
        self._hasher = hasher or PasswordHasher()
        self._room = threading.BoundedSemaphore(AT_ONCE)
        self._nobodys = self._hasher.hash(secrets.token_urlsafe(16))

    def hashed(self, password: str) -> str:
        """Return the hash of a password; raises RequestError if it is too short or too long."""
        if not LEAST_LETTERS <= len(password) <= MOST_LETTERS:
            what = f"has {len(password)} letters"
            remedy = f"choose {LEAST_LETTERS} to {MOST_LETTERS}; several words are good"
            raise RequestError("password", what, remedy=remedy)
        with self._room:
            return self._hasher.hash(password)

    def hashed_pin(self, pin: str) -> str:
        """Return the hash of a PIN, whose form was checked."""
        with self._room:
            return self._hasher.hash(pin)

    def right(self, stored: str | None, password: str) -> bool:
        """Return whether the password matches the hash; without a hash the check takes as long."""
        with self._room:
            try:
                self._hasher.verify(stored or self._nobodys, password[: 2 * MOST_LETTERS])
            except (VerificationError, InvalidHashError):
                return False
        return stored is not None


@dataclass(slots=True)
class Tries:
    """Failed attempts of the last quarter of an hour."""

    clock: Callable[[], float]
    """Monotonic time. [s]"""
    _failed: dict[tuple[str, ...], deque[float]] = field(default_factory=lambda: defaultdict(deque))
    _guard: threading.Lock = field(default_factory=threading.Lock)
    _turns: WeakValueDictionary[tuple[str, str], asyncio.Lock] = field(default_factory=WeakValueDictionary)

    @asynccontextmanager
    async def in_turn(self, name: str, address: str) -> AsyncIterator[None]:
        """Allow one attempt of an address and of a name at a time: each knows whether the last failed."""
        keys = ("address", address), ("name", name.casefold()[:200])
        locks = [self._turns.setdefault(key, asyncio.Lock()) for key in keys]
        async with locks[0], locks[1]:
            yield

    def wait_s(self, name: str, address: str) -> float:
        """Return the time until the next attempt is allowed; 0 if it is allowed now. [s]"""
        now = self.clock()
        with self._guard:
            waits = [
                self._failed[key][0] + WINDOW_S - now
                for key, most in self._keys(name, address)
                if len(self._recent(key, now)) >= most
            ]
            return max(waits, default=0.0)

    def failed(self, name: str, address: str) -> None:
        """Count a failed attempt; successful ones are not counted."""
        now = self.clock()
        with self._guard:
            for key, _ in self._keys(name, address):
                self._recent(key, now).append(now)

    def passed(self, name: str, address: str) -> None:
        """Forget the failed attempts of this name from this address after a successful one."""
        with self._guard:
            self._failed.pop(("pair", name.casefold(), address), None)

    def _recent(self, key: tuple[str, ...], now: float) -> deque[float]:
        times = self._failed[key]
        while times and times[0] <= now - WINDOW_S:
            times.popleft()
        return times

    def _keys(self, name: str, address: str) -> list[tuple[tuple[str, ...], int]]:
        if len(self._failed) > 10_000:  # bounds the memory for attempts with unknown names
            self._failed = defaultdict(deque, {key: tries for key, tries in self._failed.items() if tries})
        name = name.casefold()[:200]
        return [
            (("pair", name, address), TRIES["pair"]),
            (("address", address), TRIES["address"]),
            (("name", name), TRIES["name"]),
        ]
