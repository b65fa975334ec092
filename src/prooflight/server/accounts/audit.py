"""The audit: who did what, before and after. Rows are only added, and each holds the digest of the one before it.

A chain shows that a row was changed, taken out or put in between. Whoever can write the file can also make the whole
chain anew, or cut off its end; so the head (number and digest of the last row) can be written down elsewhere and
given to ``verified``.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import insert, select

from prooflight.server.accounts.database import audit_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

FIRST: Final = "0" * 64
"""Stands before the first row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One row."""

    id: int
    at_s: float
    """Unix time. [s]"""
    who: str
    what: str
    target: str
    before: str | None
    """JSON."""
    after: str | None
    """JSON."""
    previous: str
    digest: str

    def expected(self) -> str:
        """SHA-256 of all else in it, as JSON with sorted names."""
        held = asdict(self)
        del held["digest"]
        return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """What an audit comes to."""

    entries: int
    head: str
    """Digest of the last row; ``FIRST`` where there is none."""
    broken_at: int | None
    """The first row that is not as it was written; None: all are."""
    why: str = ""

    @property
    def whole(self) -> bool:
        """Whether nothing was changed."""
        return self.broken_at is None


def append(
    connection: Connection,
    *,
    at_s: float,
    who: str,
    what: str,
    target: str = "",
    before: Any = None,
    after: Any = None,
) -> Entry:
    """Add a row, within the transaction of what it tells of. before, after: what JSON can hold."""
    last = connection.execute(
        select(audit_table.c.id, audit_table.c.digest).order_by(audit_table.c.id.desc()).limit(1)
    ).first()
    held: dict[str, Any] = {
        "id": 1 if last is None else last.id + 1,
        "at_s": float(at_s),
        "who": who,
        "what": what,
        "target": target,
        "before": None if before is None else json.dumps(before, sort_keys=True),
        "after": None if after is None else json.dumps(after, sort_keys=True),
        "previous": FIRST if last is None else last.digest,
    }
    entry = Entry(**held, digest="")
    entry = Entry(**held, digest=entry.expected())
    connection.execute(insert(audit_table).values(**asdict(entry)))
    return entry


def entries(connection: Connection, *, before: int | None = None, limit: int = 100) -> list[Entry]:
    """The latest first; before: only those of a lower number."""
    query = select(audit_table).order_by(audit_table.c.id.desc()).limit(limit)
    if before is not None:
        query = query.where(audit_table.c.id < before)
    return [Entry(**row._asdict()) for row in connection.execute(query)]


def verified(connection: Connection, *, held: str | None = None) -> Chain:
    """Whether every row is as it was written and follows the one before it.

    held: a digest that some row had once; its absence says that the chain was cut off or made anew.
    """
    previous, count, seen = FIRST, 0, held is None or held == FIRST
    for row in _by_number(connection):
        count += 1
        why = ""
        if row.id != count:
            why = f"row {count} is missing"
        elif row.previous != previous:
            why = f"row {row.id} does not follow the row before it"
        elif row.digest != row.expected():
            why = f"row {row.id} was changed"
        if why:
            return Chain(entries=count, head=previous, broken_at=count, why=why)
        previous = row.digest
        seen = seen or previous == held
    if not seen:
        why = f"no row has the digest {str(held)[:16]}...: the chain was cut off or made anew"
        return Chain(entries=count, head=previous, broken_at=count + 1, why=why)
    return Chain(entries=count, head=previous, broken_at=None)


def _by_number(connection: Connection) -> Iterator[Entry]:
    query = select(audit_table).order_by(audit_table.c.id)
    for row in connection.execution_options(yield_per=500).execute(query):
        yield Entry(**row._asdict())
