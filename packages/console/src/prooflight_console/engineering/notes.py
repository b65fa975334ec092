"""Dated notes on the history of a press: a new lamp, other paper, a change of the press that a chart shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import insert, select, update

from prooflight.errors import RequestError
from prooflight_console.accounts import audit
from prooflight_console.accounts.database import chart_notes_table, writing

if TYPE_CHECKING:
    from prooflight_console.accounts.account_store import Accounts

MOST_LETTERS: Final = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartNote:
    """A note."""

    id: int
    at_s: float
    """Unix time that it is about. [s]"""
    written_s: float
    by: str
    text: str


class ChartNotes:
    """Notes of one console; thread-safe, and the audit records each change."""

    def __init__(self, accounts: Accounts) -> None:
        self._engine, self._clock = accounts.engine, accounts.clock

    def listed(self) -> list[ChartNote]:
        """Return the notes that were not removed, the latest first."""
        column = chart_notes_table.c
        query = select(chart_notes_table).where(column.removed_by.is_(None)).order_by(column.at_s.desc())
        names = ChartNote.__slots__
        with self._engine.begin() as connection:
            return [
                ChartNote(**{name: getattr(row, name) for name in names}) for row in connection.execute(query)
            ]

    def write(self, text: str, *, at_s: float, by: str) -> ChartNote:
        """Add a note; raises RequestError if it is empty or too long."""
        text = " ".join(text.split())
        if not 0 < len(text) <= MOST_LETTERS:
            remedy = f"write 1 to {MOST_LETTERS} letters"
            raise RequestError("note", f"it has {len(text)} letters", remedy=remedy)
        now_s = self._clock()
        values = {"at_s": at_s, "written_s": now_s, "by": by, "text": text, "removed_by": None}
        with writing(self._engine).begin() as connection:
            added = connection.execute(insert(chart_notes_table).values(**values))
            number = int(added.inserted_primary_key[0])  # type: ignore[index]
            after = {"text": text, "at_s": at_s}
            target = f"note {number}"
            audit.append(connection, at_s=now_s, who=by, what="history.note", target=target, after=after)
        return ChartNote(id=number, at_s=at_s, written_s=now_s, by=by, text=text)

    def remove(self, number: int, *, by: str) -> None:
        """Remove a note from the charts; it stays in the file. Raises RequestError if there is none."""
        column = chart_notes_table.c
        with writing(self._engine).begin() as connection:
            standing = (column.id == number) & column.removed_by.is_(None)
            if not connection.execute(
                update(chart_notes_table).where(standing).values(removed_by=by)
            ).rowcount:
                raise RequestError("note", f"there is no note {number}", remedy="reload the list")
            target = f"note {number}"
            audit.append(connection, at_s=self._clock(), who=by, what="history.remove", target=target)
