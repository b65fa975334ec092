"""Search over the sheets of all presses, the latest first, page by page."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime

    import psycopg

_COLUMNS: Final = (
    *(
        "s.at",
        "p.name AS press",
        "p.plant",
        "r.key AS run",
        "r.job",
        "s.sheet",
        "s.page",
        "s.verdict",
        "s.kind",
    ),
    *("s.disposition", "s.score", "s.threshold", "s.late", "s.run_id"),
)
_TABLES: Final = "sheets s JOIN runs r ON r.id = s.run_id JOIN presses p ON p.id = s.press_id"
_QUERY: Final = f"SELECT {', '.join(_COLUMNS)} FROM {_TABLES}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetQuery:
    """Conditions on sheets; None: no condition."""

    press: str | None = None
    plant: str | None = None
    job: str | None = None
    """The job's name, or the beginning of the name."""
    verdict: str | None = None
    kind: str | None = None
    since: datetime | None = None
    until: datetime | None = None
    """Time before which the sheet was seen."""

    def sql(self, before: tuple[datetime, int, int] | None) -> tuple[str, list[Any]]:
        """Return the conditions and their values; before: time, run and sheet of the last hit of the page before."""
        conditions, values = [], []
        texts = {
            "press": "s.press_id = (SELECT id FROM presses WHERE name = %s)",
            "plant": "s.press_id IN (SELECT id FROM presses WHERE plant = %s)",
            "verdict": "s.verdict = %s",
            "kind": "s.kind = %s",
            "since": "s.at >= %s",
            "until": "s.at < %s",
        }
        for name, text in texts.items():
            if (value := getattr(self, name)) is not None:
                conditions.append(text)
                values.append(value)
        if self.job is not None:
            # A list, not a join, so that the sheets of few runs are read by their own index.
            conditions.append("s.run_id = ANY(ARRAY(SELECT id FROM runs WHERE job LIKE %s))")
            values.append(_begins(self.job))
        if self.kind is not None and self.verdict is None:
            conditions.append("s.verdict <> 'good'")  # a good sheet has no kind: the index of kinds has none
        if before is not None:
            conditions.append("s.at <= %s AND (s.at < %s OR (s.run_id, s.sheet) > (%s, %s))")
            values += [before[0], *before]
        return " AND ".join(conditions) or "true", values


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """A sheet."""

    at: datetime
    press: str
    plant: str
    run: str
    job: str
    sheet: int
    page: str
    verdict: str
    kind: str | None
    disposition: str
    score: float | None
    threshold: float | None
    late: bool
    run_id: int

    @property
    def position(self) -> tuple[datetime, int, int]:
        """Return the position after which the next page begins."""
        return self.at, self.run_id, self.sheet


@dataclass(frozen=True, slots=True, kw_only=True)
class PressState:
    """A press, and what it did since a time."""

    press: str
    plant: str
    shipped_at: datetime | None
    """Time at which its journal was last shipped."""
    running: str | None
    """Job of its latest run, if that has not ended."""
    sheets: int
    misprints: int
    not_inspected: int
    late: int


def find(
    connection: psycopg.Connection[Any],
    query: SheetQuery,
    *,
    before: tuple[datetime, int, int] | None = None,
    limit: int = 100,
) -> list[Hit]:
    """Return the sheets that meet the conditions, the latest first; before: ``position`` of the last hit so far."""
    where, values = query.sql(before)
    order = "ORDER BY s.at DESC, s.run_id, s.sheet LIMIT %s"
    names = [field.name for field in fields(Hit)]
    rows = connection.execute(f"{_QUERY} WHERE {where} {order}", [*values, limit])
    return [Hit(**dict(zip(names, row, strict=True))) for row in rows]


def find_all(connection: psycopg.Connection[Any], query: SheetQuery) -> Iterator[Hit]:
    """Yield all sheets that meet the conditions, the latest first, without holding them in memory."""
    before = None
    while hits := find(connection, query, before=before, limit=2000):
        yield from hits
        before = hits[-1].position


def presses(connection: psycopg.Connection[Any], *, since: datetime) -> list[PressState]:
    """Return all presses that this role may see, by plant and name, with their counts since a time."""
    rows = connection.execute(
        """SELECT p.name, p.plant, p.shipped_at,
               (SELECT CASE WHEN r.ended IS NULL THEN r.job END FROM runs r WHERE r.press_id = p.id
                ORDER BY r.started DESC LIMIT 1),
               coalesce(c.sheets, 0), coalesce(c.misprints, 0), coalesce(c.uninspected, 0), coalesce(c.late, 0)
           FROM presses p LEFT JOIN (
               SELECT press_id, count(*) AS sheets, count(*) FILTER (WHERE verdict = 'misprint') AS misprints,
                   count(*) FILTER (WHERE verdict = 'not-inspected') AS uninspected,
                   count(*) FILTER (WHERE late) AS late
               FROM sheets WHERE at >= %s GROUP BY press_id) c ON c.press_id = p.id
           ORDER BY p.plant, p.name""",
        (since,),
    )
    names = [field.name for field in fields(PressState)]
    return [PressState(**dict(zip(names, row, strict=True))) for row in rows]


def _begins(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace("%", r"\%").replace("_", r"\_")
    return f"{escaped}%"
