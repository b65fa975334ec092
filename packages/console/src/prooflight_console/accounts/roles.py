"""Access rights: four roles, each with all rights of the one before it, and scopes of tokens."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Role(StrEnum):
    """Role of a person."""

    VIEWER = "viewer"
    """Role that reads everything but evidence as numbers, people and the audit."""
    OPERATOR = "operator"
    """Role that labels alarms."""
    ENGINEER = "engineer"
    """Role that reads evidence as numbers, draws zones, and puts them in force."""
    ADMIN = "admin"
    """Role that manages people and reads the audit."""

    @property
    def rank(self) -> int:
        """Position in the order of rights; a higher rank has more."""
        return list(Role).index(self)

    def may(self, required: Role) -> bool:
        """Return whether this role includes the rights of another."""
        return self.rank >= required.rank


class Scope(StrEnum):
    """Scope of a token, which limits it to a part of its owner's rights."""

    READ = "read"
    """Scope for reading runs, sheets, incidents, pictures and live events."""
    LABELS = "labels"
    """Scope for labelling alarms."""
    ZONES = "zones"
    """Scope for pricing zones and putting them in force."""
    JOBS = "jobs"
    """Scope for sending jobs into the queue, for changing their order, and for starting and stopping runs."""
    AUDIT = "audit"
    """Scope for reading the audit."""
    PEOPLE = "people"
    """Scope for adding people and changing their roles."""

    @classmethod
    def _missing_(cls, value: object) -> Scope | None:
        """Return the scope that had another name when a token was made."""
        return cls.LABELS if value == "words" else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Who:
    """Person or token that sends a request."""

    id: int
    name: str
    role: Role
    csrf: str = ""
    """CSRF token of the session; empty for a token."""
    session: str = ""
    """Digest of the session's or the token's secret."""
    scopes: frozenset[Scope] | None = None
    """Scopes of the token; None for a person."""
    by_key: bool = False
    """Whether they signed in by badge or PIN."""
    idle_s: float = 0.0
    """Time without an action after which the session ends, at a kiosk; 0: it ends at ``ends_s``. [s]"""
    ends_s: float = 0.0
    """Unix time at which the session or token ends. [s]"""
    language: str | None = None
