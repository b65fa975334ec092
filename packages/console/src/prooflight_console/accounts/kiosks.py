"""Kiosks: devices at a press on which people sign in by badge or by PIN, for short, and as operators at most.

An administrator enrols a device, which then has a secret of its own in a cookie. Only there a PIN or a badge is taken.
A PIN is hashed as passwords are; a badge number, which must be found by its number, with scrypt and one salt for the
file. Decision 72 has the threats.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import delete, func, insert, select, update

from prooflight.errors import RequestError
from prooflight_console.accounts import audit
from prooflight_console.accounts.database import (
    kiosk_keys_table,
    kiosk_salt_table,
    kiosk_sessions_table,
    kiosks_table,
    people_table,
    sessions_table,
    writing,
)
from prooflight_console.accounts.names import MOST_NAME

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection, Engine

    from prooflight_console.accounts.passwords import Passwords
    from prooflight_console.accounts.roles import Who

KIOSK_S: Final = 365 * 86_400.0
"""Lifetime of the cookie of a device. [s]"""
IDLE_S: Final = 120.0
"""Time without an action after which a session by badge or PIN ends. [s] assumed: people walk away from a kiosk."""
FULL_IDLE_S: Final = 600.0
"""The same of a session by password on such a device. [s] assumed"""
LEAST_DIGITS, MOST_DIGITS = 6, 12
"""Length of a PIN: with six digits, five attempts guess one in 200,000."""
MOST_FAILED: Final = 5
"""Number of wrong PINs in a row after which a PIN is taken no more, until another is set."""
LEAST_BADGE, MOST_BADGE = 6, 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Kiosk:
    """A device that was enrolled."""

    id: int
    name: str
    by: str
    enrolled_s: float
    """Unix time. [s]"""
    revoked_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class KioskKeys:
    """What a person may use at a kiosk."""

    person: str
    pin: bool
    badge: bool
    locked: bool
    """Whether the PIN is taken no more after too many wrong ones."""


class Kiosks:
    """Kiosks of one console; thread-safe, and the audit records each change."""

    def __init__(
        self,
        engine: Engine,
        passwords: Passwords,
        *,
        clock: Callable[[], float],
        person: Callable[[str], Any],
        begin: Callable[..., str],
    ) -> None:
        """Manage the kiosks in the console's file; the functions are those of ``account_store.Accounts``."""
        self._engine, self._passwords = engine, passwords
        self._clock, self._person, self._begin = clock, person, begin

    # --- devices ---

    def enrol(self, name: str, *, by: str) -> str:
        """Enrol a device and return its secret; raises RequestError if the name cannot be used."""
        name = " ".join(name.split())
        if not 0 < len(name) <= MOST_NAME or not name.isprintable():
            raise RequestError("kiosk", f"{name[:20]!r} is not a name", remedy="write where the device is")
        secret, now_s = secrets.token_urlsafe(32), self._clock()
        values = {"digest": _digest(secret), "name": name, "by": by, "enrolled_s": now_s, "revoked_s": None}
        with writing(self._engine).begin() as connection:
            connection.execute(insert(kiosks_table).values(**values))
            self._record(connection, by, "kiosk.enrol", name)
        return secret

    def listed(self) -> list[Kiosk]:
        """Return all devices, the latest first."""
        query = select(kiosks_table).order_by(kiosks_table.c.id.desc())
        with self._engine.begin() as connection:
            return [_kiosk(row) for row in connection.execute(query)]

    def one(self, secret: str) -> Kiosk | None:
        """Return the device that has this secret; None: it is unknown, or was revoked."""
        column = kiosks_table.c
        query = select(kiosks_table).where(column.digest == _digest(secret), column.revoked_s.is_(None))
        with self._engine.begin() as connection:
            row = connection.execute(query).first()
        return None if row is None else _kiosk(row)

    def revoke(self, number: int, *, by: str) -> None:
        """Take no more badge or PIN on a device, and end its sessions; raises RequestError if there is none."""
        column = kiosks_table.c
        with writing(self._engine).begin() as connection:
            standing = (column.id == number) & column.revoked_s.is_(None)
            name = connection.execute(select(column.name).where(standing)).scalar()
            if name is None:
                raise RequestError("kiosk", f"there is no kiosk {number}", remedy="reload the list")
            connection.execute(update(kiosks_table).where(standing).values(revoked_s=self._clock()))
            own = select(kiosk_sessions_table.c.digest).where(kiosk_sessions_table.c.kiosk_id == number)
            connection.execute(delete(sessions_table).where(sessions_table.c.digest.in_(own)))
            self._record(connection, by, "kiosk.revoke", name)

    # --- keys of people ---

    def keys(self) -> list[KioskKeys]:
        """Return what people may use, by name."""
        key = kiosk_keys_table.c
        query = (
            select(people_table.c.name, key.pin, key.badge, key.failed)
            .join(kiosk_keys_table, key.person_id == people_table.c.id)
            .order_by(func.lower(people_table.c.name))
        )
        with self._engine.begin() as connection:
            return [
                KioskKeys(
                    person=row.name,
                    pin=row.pin is not None,
                    badge=row.badge is not None,
                    locked=row.failed >= MOST_FAILED,
                )
                for row in connection.execute(query)
            ]

    def set_pin(self, person: str, pin: str, *, by: str) -> None:
        """Set a person's PIN, which unlocks it; raises RequestError if it is no PIN, or is easily guessed."""
        if not re.fullmatch(rf"[0-9]{{{LEAST_DIGITS},{MOST_DIGITS}}}", pin) or _guessable(pin):
            remedy = f"choose {LEAST_DIGITS} to {MOST_DIGITS} digits, not all equal and not consecutive"
            raise RequestError("PIN", "it cannot be used", remedy=remedy)
        self._set(person, "kiosk.pin", by, pin=self._passwords.hashed_pin(pin), failed=0)

    def set_badge(self, person: str, badge: str, *, by: str) -> None:
        """Set a person's badge; raises RequestError if it is too short, or another person's."""
        hashed = self._badge(badge)
        with self._engine.begin() as connection:
            own = kiosk_keys_table.c.badge == hashed
            other = connection.execute(select(people_table.c.name).join(kiosk_keys_table).where(own)).scalar()
        if other is not None and other.lower() != person.lower():
            raise RequestError("badge", f"it belongs to {other}", remedy="remove it there first")
        self._set(person, "kiosk.badge", by, badge=hashed)

    def remove(self, person: str, *, by: str) -> None:
        """Remove a person's PIN and badge, and end their sessions at kiosks."""
        owner = self._person(person)
        with writing(self._engine).begin() as connection:
            connection.execute(delete(kiosk_keys_table).where(kiosk_keys_table.c.person_id == owner.id))
            at_kiosks = select(kiosk_sessions_table.c.digest)
            connection.execute(
                delete(sessions_table).where(
                    sessions_table.c.person_id == owner.id, sessions_table.c.digest.in_(at_kiosks)
                )
            )
            self._record(connection, by, "kiosk.remove", owner.name)

    # --- sessions ---

    def by_badge(self, kiosk: Kiosk, badge: str) -> str | None:
        """Return the secret of a session; None: the badge is nobody's, or their account is locked.

        The call blocks while the number is hashed, so call it in a thread.
        """
        try:
            hashed = self._badge(badge)
        except RequestError:
            return None
        with self._engine.begin() as connection:
            own = kiosk_keys_table.c.badge == hashed
            row = connection.execute(select(people_table).join(kiosk_keys_table).where(own)).first()
        if row is None or row.locked:
            self._refused(kiosk, "badge" if row is None else row.name)
            return None
        return self._begun(kiosk, row.name, "badge")

    def by_pin(self, kiosk: Kiosk, name: str, pin: str) -> str | None:
        """Return the secret of a session; None: name or PIN is wrong, or the PIN is locked, which takes as long.

        The call blocks while the PIN is hashed, so call it in a thread.
        """
        key = kiosk_keys_table.c
        with self._engine.begin() as connection:
            wanted = func.lower(people_table.c.name) == name.lower()[: 2 * MOST_NAME]
            row = connection.execute(
                select(people_table, key.pin, key.failed).join(kiosk_keys_table).where(wanted)
            ).first()
        right = self._passwords.right(None if row is None else row.pin, pin)
        if row is None or not right or row.locked or row.failed >= MOST_FAILED:
            if row is not None and not right:
                self._failed(row.id, row.name)
            self._refused(kiosk, name[:MOST_NAME] if row is None else row.name)
            return None
        with writing(self._engine).begin() as connection:
            connection.execute(update(kiosk_keys_table).where(key.person_id == row.id).values(failed=0))
        return self._begun(kiosk, row.name, "PIN")

    def bound(self, kiosk: Kiosk, secret: str, *, full: bool) -> None:
        """Bind a session to a device, so that it ends when nobody acts. full: it was begun by password."""
        ends_s = self._clock() + (FULL_IDLE_S if full else IDLE_S)
        digest = _digest(secret)
        with writing(self._engine).begin() as connection:
            own = sessions_table.c.digest == digest
            connection.execute(update(sessions_table).where(own).values(ends_s=ends_s))
            values = {"digest": digest, "kiosk_id": kiosk.id, "full": full}
            connection.execute(insert(kiosk_sessions_table).values(**values))

    def acted(self, who: Who) -> None:
        """Note an action in a session that ends when nobody acts."""
        ends_s = self._clock() + who.idle_s
        if ends_s - who.ends_s < 1:
            return
        with writing(self._engine).begin() as connection:
            own = sessions_table.c.digest == who.session
            connection.execute(update(sessions_table).where(own).values(ends_s=ends_s))

    # --- parts ---

    def _begun(self, kiosk: Kiosk, name: str, how: str) -> str:
        secret = self._begin(name, how=f"{how} at {kiosk.name}")
        self.bound(kiosk, secret, full=False)
        return secret

    def _set(self, person: str, what: str, by: str, **values: Any) -> None:
        owner = self._person(person)
        key = kiosk_keys_table.c.person_id
        with writing(self._engine).begin() as connection:
            if not connection.execute(
                update(kiosk_keys_table).where(key == owner.id).values(**values)
            ).rowcount:
                connection.execute(
                    insert(kiosk_keys_table).values(**{"person_id": owner.id, "failed": 0} | values)
                )
            self._record(connection, by, what, owner.name)

    def _failed(self, person_id: int, name: str) -> None:
        key = kiosk_keys_table.c
        with writing(self._engine).begin() as connection:
            own = key.person_id == person_id
            connection.execute(update(kiosk_keys_table).where(own).values(failed=key.failed + 1))
            if connection.execute(select(key.failed).where(own)).scalar() == MOST_FAILED:
                self._record(connection, "console", "kiosk.locked", name)

    def _refused(self, kiosk: Kiosk, name: str) -> None:
        with writing(self._engine).begin() as connection:
            self._record(connection, name, "session.refused", kiosk.name)

    def _badge(self, badge: str) -> str:
        badge = badge.strip()
        if not LEAST_BADGE <= len(badge) <= MOST_BADGE or not badge.isprintable():
            what = f"a number of {len(badge)} letters"
            raise RequestError("badge", what, remedy=f"give {LEAST_BADGE} to {MOST_BADGE}")
        with writing(self._engine).begin() as connection:
            salt = connection.execute(select(kiosk_salt_table.c.salt)).scalar()
            if salt is None:
                salt = secrets.token_hex(16)
                connection.execute(insert(kiosk_salt_table).values(salt=salt))
        return hashlib.scrypt(badge.encode(), salt=bytes.fromhex(salt), n=2**14, r=8, p=1).hex()

    def _record(self, connection: Connection, who: str, what: str, target: str) -> None:
        audit.append(connection, at_s=self._clock(), who=who, what=what, target=target)


def _kiosk(row: Any) -> Kiosk:
    return Kiosk(**{name: getattr(row, name) for name in Kiosk.__slots__})


def _guessable(pin: str) -> bool:
    """Return whether the digits of a PIN are all alike, or follow each other."""
    steps = {(int(after) - int(before)) % 10 for before, after in pairwise(pin)}
    return len(steps) == 1 and steps <= {0, 1, 9}


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
