"""All data that the console stores about people: one object that the server and the command line share."""

from __future__ import annotations

import hashlib
import secrets
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import delete, func, insert, select, update

from prooflight.errors import RequestError
from prooflight_console.accounts import audit
from prooflight_console.accounts.database import (
    identities_table,
    kiosk_sessions_table,
    links_table,
    open_file,
    people_table,
    sessions_table,
    tokens_table,
    writing,
)
from prooflight_console.accounts.kiosks import FULL_IDLE_S, IDLE_S, Kiosks
from prooflight_console.accounts.names import MOST_NAME, appearance, checked_name, readable
from prooflight_console.accounts.passwords import Passwords
from prooflight_console.accounts.roles import Role, Scope, Who

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from pathlib import Path

    from sqlalchemy import Connection, Engine, Select

    from prooflight_console.accounts.provider import Identity

SESSION_S: Final = 12 * 3600.0
"""Lifetime of a session: a shift, so that a person who signs in at its beginning is not asked again. [s]"""
LINK_S: Final = 24 * 3600.0
TOKEN_DAYS: Final = 365.0
TOKEN_MARK: Final = "plt_"
"""Prefix of every token, so that a leaked one is recognised as such."""
LANGUAGES: Final = ("en", "de")


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """A user account."""

    id: int
    name: str
    role: Role
    locked: bool
    ready: bool
    """Whether a password was set, or none is needed."""
    created_s: float
    issuer: str | None = None
    """Provider at which they sign in, which determines their role; None if they have a password here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Token:
    """Access token of a program."""

    id: int
    name: str
    owner: str
    scopes: tuple[Scope, ...]
    created_s: float
    ends_s: float
    revoked_s: float | None


class Accounts:
    """The console's open database file. Its methods are thread-safe, and the audit records each change."""

    def __init__(
        self, path: Path, *, clock: Callable[[], float] = time.time, passwords: Passwords | None = None
    ) -> None:
        """Open the file; raises ConsoleFileError if it cannot be used. clock: Unix time. [s]"""
        self.path, self.clock = path, clock
        self._engine = open_file(path)
        self._passwords = passwords or Passwords()
        self.kiosks = Kiosks(self._engine, self._passwords, clock=clock, person=self.person, begin=self.begin)

    def close(self) -> None:
        """Close the file."""
        self._engine.dispose()

    @property
    def engine(self) -> Engine:
        """Engine of the file, for what the console stores beside people."""
        return self._engine

    # --- people ---

    def people(self) -> list[Person]:
        """Return everybody, by name."""
        with self._engine.begin() as connection:
            rows = connection.execute(_people().order_by(func.lower(people_table.c.name)))
            return [_person(row) for row in rows]

    def person(self, name: str) -> Person:
        """Return the person of this name; raises RequestError if there is none."""
        with self._engine.begin() as connection:
            return _person(self._row(connection, name))

    def add(self, name: str, role: Role, *, by: str) -> str:
        """Add a person and return the secret of the link by which they choose a password.

        Raises RequestError if the name cannot be used.
        """
        name = checked_name(name)
        with writing(self._engine).begin() as connection:
            if (taken := self._like(connection, name)) is not None:
                alike = "already" if taken.lower() == name.lower() else f"already, and {name!r} looks like it"
                raise RequestError("user", f"there is a {taken!r} {alike}", remedy="choose another name")
            values = {"name": name, "role": role.value, "locked": False, "created_s": self.clock()}
            added = connection.execute(insert(people_table).values(**values))
            self._record(connection, by, "user.add", name, after={"role": role.value})
            return self._link(connection, int(added.inserted_primary_key[0]))  # type: ignore[index]

    def link(self, name: str, *, by: str) -> str:
        """Return the secret of a new link for a person who lost theirs or their password; earlier links end.

        Raises RequestError if there is no such person, or if they sign in at a provider.
        """
        with writing(self._engine).begin() as connection:
            row = self._row(connection, name)
            if row.issuer is not None:
                what = f"{row.name} signs in at {row.issuer}, and has no password here"
                raise RequestError("user", what, remedy="lock the user out, or end that lock")
            self._record(connection, by, "user.link", row.name)
            return self._link(connection, row.id)

    def change(self, name: str, *, by: str, role: Role | None = None, locked: bool | None = None) -> Person:
        """Change a person's role, or lock them out; their sessions end at once.

        Raises RequestError if there is no such person, if their provider determines the role, or if no admin
        would be left.
        """
        with writing(self._engine).begin() as connection:
            row = self._row(connection, name)
            if row.issuer is not None and role not in (None, Role(row.role)):
                what = f"the groups of {row.name} at {row.issuer} determine the role"
                raise RequestError("user", what, remedy="change the groups there, or [oidc.roles]")
            self._change(connection, row, by=by, role=role, locked=locked)
            return _person(self._row(connection, row.name))

    def speak(self, who: Who, language: str) -> None:
        """Set the language in which a person reads; raises RequestError if there is no such language."""
        if language not in LANGUAGES:
            raise RequestError("language", f"there is no {language[:20]!r}", remedy="choose en or de")
        with writing(self._engine).begin() as connection:
            changed = update(people_table).where(people_table.c.id == who.id)
            connection.execute(changed.values(language=language))

    def first_link(self) -> str | None:
        """Return the secret of a link for a first admin; None if somebody can sign in already."""
        with writing(self._engine).begin() as connection:
            ready = people_table.c.password.is_not(None)
            if connection.execute(select(people_table.c.id).where(ready)).first() is not None:
                return None
            own = identities_table.c.issuer.is_(None)
            row = connection.execute(_people().where(people_table.c.role == Role.ADMIN, own)).first()
            if row is None:
                name = self._free_name(connection, "admin")
                values = {
                    "name": name,
                    "role": Role.ADMIN.value,
                    "locked": False,
                    "created_s": self.clock(),
                }
                added = connection.execute(insert(people_table).values(**values))
                self._record(connection, "console", "user.add", name, after={"role": "admin"})
                return self._link(connection, int(added.inserted_primary_key[0]))  # type: ignore[index]
            return self._link(connection, row.id)

    def linked(self, secret: str) -> Person | None:
        """Return the person whom a link is for; None if it is unknown, used, or too old."""
        with self._engine.begin() as connection:
            row = connection.execute(
                _people()
                .join(links_table, links_table.c.person_id == people_table.c.id)
                .where(links_table.c.digest == _digest(secret), links_table.c.ends_s > self.clock())
            ).first()
            return None if row is None or row.locked else _person(row)

    def choose(self, secret: str, password: str) -> Person | None:
        """Set a password by a link, which is then used up; None if the link is not valid.

        Raises RequestError if the password is too short or too long.
        """
        if self.linked(secret) is None:
            return None
        hashed = self._passwords.hashed(password)
        with writing(self._engine).begin() as connection:
            link = connection.execute(
                delete(links_table)
                .where(links_table.c.digest == _digest(secret), links_table.c.ends_s > self.clock())
                .returning(links_table.c.person_id)
            ).first()
            if link is None:
                return None
            who = people_table.c.id == link.person_id
            connection.execute(update(people_table).where(who).values(password=hashed))
            connection.execute(delete(sessions_table).where(sessions_table.c.person_id == link.person_id))
            row = connection.execute(_people().where(who)).one()
            self._record(connection, row.name, "user.password", row.name)
            return _person(row)

    # --- people of a provider ---

    def begin_as(self, identity: Identity) -> str | None:
        """Begin a session for a person whom a provider vouches for and return its secret.

        Returns None if the person has no role or is locked out. A person is added at the first sign-in, with
        a name that nobody else has, and has the role that the provider's groups give today. A person who no
        longer has a role loses sessions and tokens. The audit records all of it.
        """
        with writing(self._engine).begin() as connection:
            row = connection.execute(
                _people().where(
                    identities_table.c.issuer == identity.issuer,
                    identities_table.c.subject == identity.subject,
                )
            ).first()
            if identity.role is None or (row is not None and row.locked):
                self._refuse(connection, identity, row)
                return None
            if row is None:
                row = self._add_identity(connection, identity, identity.role)
            else:
                self._change(connection, row, by=identity.issuer, role=identity.role)
            name = str(row.name)
        return self.begin(name, how=identity.issuer)

    def issuer_of(self, who: Who) -> str | None:
        """Return the issuer of the provider at which a person signs in; None if they have a password here."""
        with self._engine.begin() as connection:
            mine = identities_table.c.person_id == who.id
            issuer: str | None = connection.execute(select(identities_table.c.issuer).where(mine)).scalar()
            return issuer

    def _add_identity(self, connection: Connection, identity: Identity, role: Role) -> Any:
        name = self._free_name(connection, identity.name)
        values = {"name": name, "role": role.value, "locked": False, "created_s": self.clock()}
        added = connection.execute(insert(people_table).values(**values))
        identified = {"issuer": identity.issuer, "subject": identity.subject}
        person = int(added.inserted_primary_key[0])  # type: ignore[index]
        connection.execute(insert(identities_table).values(**identified, person_id=person))
        self._record(connection, identity.issuer, "user.add", name, after={"role": role.value, **identified})
        return self._row(connection, name)

    def _free_name(self, connection: Connection, wanted: str) -> str:
        """Return a name like the wanted one that nobody here has, with a number appended where needed."""
        base = readable(wanted)[: MOST_NAME - 8].strip() or "somebody"
        count = 1
        while True:
            name = base if count == 1 else f"{base} ({count})"
            if self._like(connection, name) is None:
                return name
            count += 1

    def _like(self, connection: Connection, name: str) -> str | None:
        """Return the name of a person here that looks like this one; None if there is none."""
        names = connection.execute(select(people_table.c.name)).scalars()
        return next((one for one in names if appearance(one) == appearance(name)), None)

    def _refuse(self, connection: Connection, identity: Identity, row: Any) -> None:
        name = identity.name[:MOST_NAME] if row is None else row.name
        why = (
            "locked out"
            if row is not None and row.locked
            else "none of the user's groups is mapped to a role"
        )
        refusal = {"by": identity.issuer, "subject": identity.subject, "why": why}
        self._record(connection, name, "session.refused", name, after=refusal)
        if row is None:
            return
        now = self.clock()
        connection.execute(delete(sessions_table).where(sessions_table.c.person_id == row.id))
        living = (tokens_table.c.person_id == row.id) & tokens_table.c.revoked_s.is_(None)
        connection.execute(update(tokens_table).where(living).values(revoked_s=now))

    # --- sessions ---

    def sign_in(self, name: str, password: str) -> str | None:
        """Return the secret of a new session; None if name or password is wrong, which takes as long.

        The call blocks while the password is hashed, so call it in a thread.
        """
        with self._engine.begin() as connection:
            wanted = func.lower(people_table.c.name) == name.lower()[: 2 * MOST_NAME]
            row = connection.execute(select(people_table).where(wanted)).first()
        right = self._passwords.right(None if row is None else row.password, password)
        if row is None or not right or row.locked:
            with writing(self._engine).begin() as connection:
                who = name[:MOST_NAME] if row is None else row.name
                self._record(connection, who, "session.refused", who)
            return None
        return self.begin(row.name)

    def begin(self, name: str, *, how: str = "password") -> str:
        """Begin a session for a known person and return its secret; raises RequestError if there is none."""
        secret, now = secrets.token_urlsafe(32), self.clock()
        with writing(self._engine).begin() as connection:
            row = self._row(connection, name)
            connection.execute(delete(sessions_table).where(sessions_table.c.ends_s <= now))
            values = {"person_id": row.id, "csrf": secrets.token_urlsafe(24)}
            values |= {"digest": _digest(secret), "began_s": now, "ends_s": now + SESSION_S}
            connection.execute(insert(sessions_table).values(**values))
            self._record(connection, row.name, "session.begin", row.name, after={"by": how})
        return secret

    def of_session(self, secret: str) -> Who | None:
        """Return the requester whose session this is; None if it is unknown or has ended."""
        with self._engine.begin() as connection:
            row = connection.execute(
                select(
                    people_table,
                    sessions_table.c.csrf,
                    sessions_table.c.ends_s,
                    sessions_table.c.digest,
                    kiosk_sessions_table.c.full,
                )
                .join(sessions_table, sessions_table.c.person_id == people_table.c.id)
                .outerjoin(kiosk_sessions_table, kiosk_sessions_table.c.digest == sessions_table.c.digest)
                .where(sessions_table.c.digest == _digest(secret), sessions_table.c.ends_s > self.clock())
            ).first()
        if row is None or row.locked:
            return None
        role, by_key = Role(row.role), row.full is not None and not row.full
        return Who(
            id=row.id,
            name=row.name,
            # By badge or PIN nobody is more than an operator.
            role=Role.OPERATOR if by_key and role.may(Role.OPERATOR) else role,
            csrf=row.csrf,
            session=row.digest,
            by_key=by_key,
            idle_s=0.0 if row.full is None else FULL_IDLE_S if row.full else IDLE_S,
            ends_s=row.ends_s,
            language=row.language,
        )

    def over(self, who: Who) -> bool:
        """Return whether an access has ended: signed out, locked, of another role, revoked, or expired."""
        with self._engine.begin() as connection:
            if who.scopes is None:
                session = sessions_table.c
                query = select(session.digest).where(
                    session.digest == who.session, session.ends_s > self.clock()
                )
            else:
                token, person = tokens_table.c, people_table.c
                query = (
                    select(token.digest)
                    .join(people_table, person.id == token.person_id)
                    .where(
                        token.digest == who.session,
                        token.ends_s > self.clock(),
                        token.revoked_s.is_(None),
                        ~person.locked,
                    )
                )
            return connection.execute(query).first() is None

    def end(self, who: Who) -> None:
        """End the session of a person."""
        with writing(self._engine).begin() as connection:
            connection.execute(delete(sessions_table).where(sessions_table.c.digest == who.session))
            self._record(connection, who.name, "session.end", who.name)

    # --- tokens ---

    def new_token(
        self, owner: str, name: str, scopes: Collection[Scope], *, by: str, days: float = TOKEN_DAYS
    ) -> tuple[Token, str]:
        """Add a token and return it with its secret, which is shown this once; raises RequestError."""
        secret, now = TOKEN_MARK + secrets.token_urlsafe(32), self.clock()
        wanted = sorted({Scope(scope).value for scope in scopes})
        if not wanted:
            raise RequestError("token", "has no scope", remedy=f"give some of {', '.join(Scope)}")
        with writing(self._engine).begin() as connection:
            row = self._row(connection, owner)
            values = {
                "person_id": row.id,
                "name": checked_name(name),
                "digest": _digest(secret),
                "scopes": wanted,
            }
            values |= {"created_s": now, "ends_s": now + days * 86_400}
            added = connection.execute(insert(tokens_table).values(**values))
            number = int(added.inserted_primary_key[0])  # type: ignore[index]
            recorded = {"name": values["name"], "scopes": wanted, "days": days}
            self._record(connection, by, "token.add", f"{row.name}/{number}", after=recorded)
        return next(token for token in self.tokens() if token.id == number), secret

    def tokens(self, owner: str | None = None) -> list[Token]:
        """Return the tokens of everybody or of one owner, oldest first."""
        query = (
            select(tokens_table, people_table.c.name.label("owner"))
            .join(people_table, people_table.c.id == tokens_table.c.person_id)
            .order_by(tokens_table.c.id)
        )
        if owner is not None:
            query = query.where(people_table.c.name == owner)
        with self._engine.begin() as connection:
            return [
                Token(
                    id=row.id,
                    name=row.name,
                    owner=row.owner,
                    scopes=tuple(Scope(scope) for scope in row.scopes),
                    created_s=row.created_s,
                    ends_s=row.ends_s,
                    revoked_s=row.revoked_s,
                )
                for row in connection.execute(query)
            ]

    def revoke(self, number: int, *, by: str, owner: str | None = None) -> None:
        """Revoke a token, with ``owner`` only if it is theirs; raises RequestError if none is in force."""
        tokens = [token for token in self.tokens(owner) if token.id == number and token.revoked_s is None]
        if not tokens:
            raise RequestError("token", f"there is no {number} in force", remedy="see the list of tokens")
        with writing(self._engine).begin() as connection:
            ended = update(tokens_table).where(tokens_table.c.id == number)
            connection.execute(ended.values(revoked_s=self.clock()))
            self._record(connection, by, "token.revoke", f"{tokens[0].owner}/{number}")

    def of_token(self, secret: str) -> Who | None:
        """Return the requester whose token this is; None if it is unknown, revoked or expired."""
        with self._engine.begin() as connection:
            row = connection.execute(
                select(people_table, tokens_table.c.scopes, tokens_table.c.ends_s)
                .join(tokens_table, tokens_table.c.person_id == people_table.c.id)
                .where(
                    tokens_table.c.digest == _digest(secret),
                    tokens_table.c.ends_s > self.clock(),
                    tokens_table.c.revoked_s.is_(None),
                )
            ).first()
        if row is None or row.locked:
            return None
        scopes = frozenset(Scope(scope) for scope in row.scopes)
        return Who(
            id=row.id,
            name=row.name,
            role=Role(row.role),
            session=_digest(secret),
            scopes=scopes,
            ends_s=row.ends_s,
        )

    # --- audit ---

    def note(self, who: str, what: str, target: str, **told: Any) -> None:
        """Record a change that is stored elsewhere. told: ``before`` and ``after``, as JSON values."""
        with writing(self._engine).begin() as connection:
            self._record(connection, who, what, target, **told)

    def audited(self, *, before: int | None = None, limit: int = 100) -> list[audit.Entry]:
        """Return entries of the audit, the latest first."""
        with self._engine.begin() as connection:
            return audit.entries(connection, before=before, limit=limit)

    def verified(self, *, expected_head: str | None = None) -> audit.Chain:
        """Verify the audit; see ``audit.verified``."""
        with self._engine.begin() as connection:
            return audit.verified(connection, expected_head=expected_head)

    # --- parts ---

    def _change(
        self,
        connection: Connection,
        row: Any,
        *,
        by: str,
        role: Role | None = None,
        locked: bool | None = None,
    ) -> None:
        before = {"role": row.role, "locked": bool(row.locked)}
        after = {
            "role": before["role"] if role is None else role.value,
            "locked": before["locked"] if locked is None else locked,
        }
        if before == after:
            return
        connection.execute(update(people_table).where(people_table.c.id == row.id).values(**after))
        if row.issuer is None and before == {"role": Role.ADMIN.value, "locked": False}:
            self._need_admin(connection)
        connection.execute(delete(sessions_table).where(sessions_table.c.person_id == row.id))
        self._record(connection, by, "user.change", row.name, before=before, after=after)

    def _row(self, connection: Connection, name: str) -> Any:
        wanted = func.lower(people_table.c.name) == name.lower()
        row = connection.execute(_people().where(wanted)).first()
        if row is None:
            raise RequestError("user", f"there is no {name[:MOST_NAME]!r}", remedy="see `serve user list`")
        return row

    def _link(self, connection: Connection, person: int) -> str:
        secret = secrets.token_urlsafe(32)
        connection.execute(delete(links_table).where(links_table.c.person_id == person))
        values = {"digest": _digest(secret), "person_id": person, "ends_s": self.clock() + LINK_S}
        connection.execute(insert(links_table).values(**values))
        return secret

    def _need_admin(self, connection: Connection) -> None:
        """Raise RequestError unless an unlocked admin with a password here is left.

        A provider may be down, or take the role from all its admins.
        """
        chosen = people_table.c.password.is_not(None)
        free = (people_table.c.role == Role.ADMIN) & ~people_table.c.locked & chosen
        own = people_table.c.id.not_in(select(identities_table.c.person_id))
        if connection.execute(select(people_table.c.id).where(free, own)).first() is None:
            what = "the last admin who can sign in must remain an admin"
            raise RequestError("user", what, remedy="let another admin choose a password first")

    def _record(self, connection: Connection, who: str, what: str, target: str, **told: Any) -> None:
        audit.append(connection, at_s=self.clock(), who=who, what=what, target=target, **told)


def _people() -> Select[Any]:
    """Select people with the provider that vouches for them, if there is one."""
    joined = people_table.outerjoin(identities_table, identities_table.c.person_id == people_table.c.id)
    return select(people_table, identities_table.c.issuer).select_from(joined)


def _person(row: Any) -> Person:
    return Person(
        id=row.id,
        name=row.name,
        role=Role(row.role),
        locked=bool(row.locked),
        ready=row.password is not None or row.issuer is not None,
        created_s=row.created_s,
        issuer=row.issuer,
    )


def _digest(secret: str) -> str:
    """Return the digest of a secret: with 256 random bits, SHA-256 needs no salt and no cost."""
    return hashlib.sha256(secret.encode()).hexdigest()
