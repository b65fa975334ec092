"""Shelved alarms and notes of hand-over, in the console's own file.

Whoever shelves an alarm says why and until when. A shelving ends by itself, and hides its alarm only as long as the
alarm is not of a higher priority than the one that was shelved (ISA-18.2, clause 11: shelving is of limited time,
listed, and under control of access).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import insert, select, update

from prooflight.errors import RequestError
from prooflight_console.accounts import audit
from prooflight_console.accounts.database import handovers_table, shelvings_table, writing
from prooflight_console.alarms.priority import Priority

if TYPE_CHECKING:
    from prooflight_console.accounts.account_store import Accounts

MOST_SHELVED_S: Final = 12 * 3600.0
"""Longest time for which an alarm is shelved: a shift, so that the next one decides for itself. [s]"""
LEAST_SHELVED_S: Final = 60.0
HANDOVER_S: Final = 12 * 3600.0
"""Time for which the page Now shows a note of hand-over: a shift. [s]"""
MOST_REASON: Final = 300
MOST_NOTE: Final = 4000
CONSOLE: Final = "console"
"""Name under which a shelving that another one replaced was ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shelving:
    """A shelving of one alarm."""

    id: int
    run: str
    """Key of the run, by ``journal.labels.run_key``."""
    incident: int
    priority: Priority
    """Priority of the alarm when it was shelved."""
    reason: str
    by: str
    at_s: float
    """Unix time. [s]"""
    ends_s: float
    """Unix time. [s]"""
    ended_by: str | None
    """Person who ended it before its time; None: nobody did."""
    ended_s: float | None

    def in_force(self, now_s: float) -> bool:
        """Return whether it has not ended. now_s: Unix time. [s]"""
        return self.ended_s is None and now_s < self.ends_s

    def hides(self, priority: Priority) -> bool:
        """Return whether it hides its alarm: not where that is of a higher priority than the one shelved."""
        return priority.rank >= self.priority.rank


@dataclass(frozen=True, slots=True, kw_only=True)
class Handover:
    """A note for the next shift."""

    id: int
    at_s: float
    """Unix time. [s]"""
    by: str
    text: str
    summary: dict[str, Any]
    """State of the alarms when the note was written."""


class AlarmStore:
    """Shelvings and notes of hand-over; thread-safe, and the audit records each change."""

    def __init__(self, accounts: Accounts) -> None:
        self._engine, self.clock = accounts.engine, accounts.clock
        self.version = 0
        """Number of changes since the console started."""

    def shelve(
        self, *, run: str, incident: int, priority: Priority, seconds: float, reason: str, by: str
    ) -> Shelving:
        """Shelve an alarm, in place of an earlier shelving of it.

        Raises RequestError if the time is not allowed, or no reason is given.
        """
        reason = " ".join(reason.split())
        if not reason or len(reason) > MOST_REASON:
            remedy = f"state in 1 to {MOST_REASON} letters why the alarm needs no action until then"
            raise RequestError("reason", f"{len(reason)} letters are given", remedy=remedy)
        if not LEAST_SHELVED_S <= seconds <= MOST_SHELVED_S:
            remedy = f"choose {LEAST_SHELVED_S / 60:.0f} to {MOST_SHELVED_S / 60:.0f} minutes"
            raise RequestError(
                "time", f"an alarm cannot be shelved for {seconds / 60:g} minutes", remedy=remedy
            )
        now_s = self.clock()
        values = {
            "run": run, "incident": incident, "priority": priority.value, "reason": reason, "by": by,
            "at_s": now_s, "ends_s": now_s + seconds, "ended_by": None, "ended_s": None,
        }  # fmt: skip
        column = shelvings_table.c
        with writing(self._engine).begin() as connection:
            standing = (column.run == run) & (column.incident == incident) & column.ended_s.is_(None)
            connection.execute(
                update(shelvings_table)
                .where(standing, column.ends_s > now_s)
                .values(ended_by=CONSOLE, ended_s=now_s)
            )
            added = connection.execute(insert(shelvings_table).values(**values))
            after = {"priority": priority.value, "minutes": round(seconds / 60, 1), "note": reason}
            target = f"run {run}, incident {incident}"
            audit.append(connection, at_s=now_s, who=by, what="alarms.shelve", target=target, after=after)
            number = int(added.inserted_primary_key[0])  # type: ignore[index]
        self.version += 1
        return _shelving({"id": number, **values})

    def unshelve(self, number: int, *, run: str, by: str) -> Shelving:
        """End a shelving before its time; raises RequestError if no such shelving of the run is in force."""
        now_s = self.clock()
        with writing(self._engine).begin() as connection:
            row = connection.execute(
                select(shelvings_table).where(shelvings_table.c.id == number, shelvings_table.c.run == run)
            ).first()
            if row is None or not _shelving(row._asdict()).in_force(now_s):
                remedy = "see which alarms are shelved"
                raise RequestError("shelving", f"no shelving {number} of the run is in force", remedy=remedy)
            ended = {"ended_by": by, "ended_s": now_s}
            connection.execute(update(shelvings_table).where(shelvings_table.c.id == number).values(**ended))
            target = f"run {run}, incident {row.incident}"
            audit.append(connection, at_s=now_s, who=by, what="alarms.unshelve", target=target)
        self.version += 1
        return _shelving(row._asdict() | ended)

    def shelvings(self, run: str) -> list[Shelving]:
        """Return all shelvings of a run, the latest first, ended ones included."""
        query = (
            select(shelvings_table).where(shelvings_table.c.run == run).order_by(shelvings_table.c.id.desc())
        )
        with self._engine.begin() as connection:
            return [_shelving(row._asdict()) for row in connection.execute(query)]

    def in_force(self, run: str) -> dict[int, Shelving]:
        """Return the shelvings of a run that have not ended, by incident."""
        now_s = self.clock()
        column = shelvings_table.c
        query = select(shelvings_table).where(
            column.run == run, column.ended_s.is_(None), column.ends_s > now_s
        )
        with self._engine.begin() as connection:
            return {row.incident: _shelving(row._asdict()) for row in connection.execute(query)}

    def hand_over(self, text: str, *, summary: dict[str, Any], by: str) -> Handover:
        """Add a note for the next shift; raises RequestError if it is empty or too long."""
        text = text.strip()
        if not 0 < len(text) <= MOST_NOTE:
            remedy = f"write 1 to {MOST_NOTE} letters"
            raise RequestError("note", f"it has {len(text)} letters", remedy=remedy)
        now_s = self.clock()
        values = {"at_s": now_s, "by": by, "text": text, "summary": summary}
        with writing(self._engine).begin() as connection:
            added = connection.execute(insert(handovers_table).values(**values))
            number = int(added.inserted_primary_key[0])  # type: ignore[index]
            audit.append(connection, at_s=now_s, who=by, what="alarms.hand-over", target=f"note {number}")
        self.version += 1
        return Handover(id=number, at_s=now_s, by=by, text=text, summary=summary)

    def handovers(self, *, before: int | None = None, limit: int = 20) -> list[Handover]:
        """Return notes, the latest first. before: only those of lower numbers."""
        query = select(handovers_table).order_by(handovers_table.c.id.desc()).limit(limit)
        if before is not None:
            query = query.where(handovers_table.c.id < before)
        with self._engine.begin() as connection:
            return [Handover(**row._asdict()) for row in connection.execute(query)]

    def last_handover(self) -> Handover | None:
        """Return the last note, if it was written within ``HANDOVER_S``; else None."""
        notes = self.handovers(limit=1)
        return notes[0] if notes and self.clock() - notes[0].at_s < HANDOVER_S else None


def _shelving(values: dict[str, Any]) -> Shelving:
    return Shelving(**values | {"priority": Priority(values["priority"])})
