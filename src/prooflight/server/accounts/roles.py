"""Who may what: four roles, each of which may all that the one before it may; and scopes of tokens."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Role(StrEnum):
    """Of a person."""

    VIEWER = "viewer"
    """Looks at everything."""
    OPERATOR = "operator"
    """Says what an alarm was."""
    ENGINEER = "engineer"
    """Looks inside: evidence as numbers. Draws zones, and puts them in force."""
    ADMIN = "admin"
    """Says who may; reads the audit."""

    @property
    def rank(self) -> int:
        """The higher, the more."""
        return list(Role).index(self)

    def may(self, asked: Role) -> bool:
        """Whether this role is enough."""
        return self.rank >= asked.rank


class Scope(StrEnum):
    """Of a token: it may no more than its owner, and of that only this."""

    READ = "read"
    """Runs, sheets, incidents, pictures, live events."""
    WORDS = "words"
    """Say what an alarm was."""
    ZONES = "zones"
    """Price zones, and put them in force."""
    AUDIT = "audit"
    """Read the audit."""
    PEOPLE = "people"
    """Add people, change their roles."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Who:
    """Who asks."""

    id: int
    name: str
    role: Role
    csrf: str = ""
    """Of the session; empty: it is a token."""
    session: str = ""
    """Digest of the session, or of the token."""
    scopes: frozenset[Scope] | None = None
    """Of the token; None: it is a person."""
    ends_s: float = 0.0
    """When session or token ends; Unix time. [s]"""
    language: str | None = None
