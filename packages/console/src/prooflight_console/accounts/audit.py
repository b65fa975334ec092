"""The audit: who did what, before and after.

Rows are only added, and each holds the digest of the one before it. A chain shows that a row was changed,
removed or inserted. Whoever can write the file can also compute the whole chain again, or cut off its end; so
the head (number and digest of the last row) can be written down elsewhere and given to ``verified``.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import insert, select

from prooflight_console.accounts.database import audit_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

FIRST: Final = "0" * 64
"""Previous digest of the first row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One row of the audit."""

    id: int
    at_s: float
    """Unix time. [s]"""
    who: str
    what: str
    target: str
    before: str | None
    """State before the change, as JSON."""
    after: str | None
    """State after the change, as JSON."""
    previous: str
    digest: str

    def expected(self) -> str:
        """Return the SHA-256 of all other fields, as JSON with sorted names."""
        content = asdict(self)
        del content["digest"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """Result of verifying an audit."""

    entries: int
    head: str
    """Digest of the last row; ``FIRST`` if there is none."""
    broken_at: int | None
    """Number of the first row that is not as it was written; None if all are."""
    why: str = ""

    @property
    def whole(self) -> bool:
        """Whether no row was changed."""
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
    """Add a row, within the transaction of the change that it records; before, after: JSON values."""
    last = connection.execute(
        select(audit_table.c.id, audit_table.c.digest).order_by(audit_table.c.id.desc()).limit(1)
    ).first()
    content: dict[str, Any] = {
        "id": 1 if last is None else last.id + 1,
        "at_s": float(at_s),
        "who": who,
        "what": what,
        "target": target,
        "before": None if before is None else json.dumps(before, sort_keys=True),
        "after": None if after is None else json.dumps(after, sort_keys=True),
        "previous": FIRST if last is None else last.digest,
    }
    entry = Entry(**content, digest="")
    entry = Entry(**content, digest=entry.expected())
    connection.execute(insert(audit_table).values(**asdict(entry)))
    return entry


def entries(connection: Connection, *, before: int | None = None, limit: int = 100) -> list[Entry]:
    """Return entries, the latest first; with ``before``, only those of a lower number."""
    query = select(audit_table).order_by(audit_table.c.id.desc()).limit(limit)
    if before is not None:
        query = query.where(audit_table.c.id < before)
    return [Entry(**row._asdict()) for row in connection.execute(query)]


def verified(connection: Connection, *, expected_head: str | None = None) -> Chain:
    """Verify that every row is as it was written and follows the one before it.

    Parameters
    ----------
    held
        Digest of an earlier row; its absence shows that the chain was cut off or computed again.
    """
    previous, count, seen = FIRST, 0, expected_head is None or expected_head == FIRST
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
        seen = seen or previous == expected_head
    if not seen:
        why = f"no row has the digest {str(expected_head)[:16]}...: the chain was cut off or rebuilt"
        return Chain(entries=count, head=previous, broken_at=count + 1, why=why)
    return Chain(entries=count, head=previous, broken_at=None)


def _by_number(connection: Connection) -> Iterator[Entry]:
    query = select(audit_table).order_by(audit_table.c.id)
    for row in connection.execution_options(yield_per=500).execute(query):
        yield Entry(**row._asdict())
