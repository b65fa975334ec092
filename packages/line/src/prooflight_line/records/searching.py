"""Search over the sheets of all presses, the latest first, page by page."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

from prooflight_line.journal.defect_conditions import DefectConditions

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime

    import psycopg

_COLUMNS: Final = (
    "s.at, p.name AS press, p.plant, r.key AS run, r.job, s.sheet, s.page, s.verdict, s.kind, s.disposition, s.score, "
    "s.threshold, s.late, s.run_id"
)

_BOX: Final = (
    *("(d.value ->> 'x_mm')::float8", "(d.value ->> 'y_mm')::float8"),
    *("(d.value ->> 'width_mm')::float8", "(d.value ->> 'height_mm')::float8"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetQuery:
    """Conditions on sheets; None: no condition."""

    press: str | None = None
    plant: str | None = None
    job: str | None = None
    """The job's name, or the beginning of the name."""
    verdict: str | None = None
    kind: str | None = None
    page: str | None = None
    """The page's name in the job, or its beginning."""
    defect: DefectConditions = field(default_factory=DefectConditions)
    """Conditions on one defect besides its kind, of which sheets that are not good store all."""
    since: datetime | None = None
    until: datetime | None = None
    """Time before which the sheet was seen."""

    def sql(self, *, before: tuple[datetime, int, int] | None = None, limit: int) -> tuple[str, list[Any]]:
        """Return the query and its values; before: time, run and sheet of the last hit of the page before.

        The latest of each press, or of each run of a job, are read by an index, and merged: how long that takes does
        not depend on how far back they lie. Over all sheets at once the planner would read from the latest on, and
        pass millions where what is sought is rare or old.
        """
        of_press = {"name": self.press, "plant": self.plant}
        parts = [f"{name} = %s" for name, value in of_press.items() if value is not None]
        values: list[Any] = [value for value in of_press.values() if value is not None]
        groups = f"(SELECT id FROM presses WHERE {' AND '.join(parts) or 'true'}) AS one"
        conditions = ["s.press_id = one.id"]
        if self.job is not None:
            groups = f"(SELECT runs.id FROM runs JOIN {groups} ON one.id = press_id WHERE job LIKE %s) AS one"
            values.append(_begins(self.job))
            conditions = ["s.run_id = one.id"]
        texts = {
            "verdict": "s.verdict = %s",
            "kind": "s.kind = %s",
            "since": "s.at >= %s",
            "until": "s.at < %s",
        }
        for name, text in texts.items():
            if (value := getattr(self, name)) is not None:
                conditions.append(text)
                values.append(value)
        if self.page is not None:
            conditions.append("s.page LIKE %s")
            values.append(_begins(self.page))
        if not self.defect.any_defect:
            defect, more = self.defect.sql(
                kind="d.value ->> 'kind'", ink="d.value ->> 'ink'", box=_BOX, mark="%s", greatest="greatest"
            )
            conditions.append(
                f"EXISTS (SELECT 1 FROM jsonb_array_elements(s.details -> 'regions') AS d WHERE {defect})"
            )
            values += more
        if self.verdict not in (None, "good") or (
            self.verdict is None and (self.kind is not None or not self.defect.any_defect)
        ):
            conditions.append("s.verdict <> 'good'")  # by an index of few rows; a good sheet has no kind
        if before is not None:
            conditions.append("s.at <= %s AND (s.at < %s OR (s.run_id, s.sheet) > (%s, %s))")
            values += [before[0], *before]
        latest = f"SELECT * FROM sheets s WHERE {' AND '.join(conditions)} {_order('s')}"
        merged = f"SELECT latest.* FROM {groups} CROSS JOIN LATERAL ({latest}) AS latest {_order('latest')}"
        joined = "JOIN runs r ON r.id = s.run_id JOIN presses p ON p.id = s.press_id"
        return f"SELECT {_COLUMNS} FROM ({merged}) AS s {joined} {_order('s')}", [
            *values,
            limit,
            limit,
            limit,
        ]


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
    """Time at which its shipper was last heard of, with something to ship or without."""
    running: str | None
    """Job of its latest run, if that has not ended."""
    last_at: datetime | None
    """Time of its latest sheet, however long ago; None: it has none."""
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
    text, values = query.sql(before=before, limit=limit)
    names = [field.name for field in fields(Hit)]
    # Never prepared: a plan for any values would not use the indexes of few rows.
    rows = connection.execute(text, values, prepare=False)
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
               (SELECT max(s.at) FROM sheets s WHERE s.press_id = p.id),
               c.sheets, c.misprints, c.uninspected, c.late
           FROM presses p CROSS JOIN LATERAL (
               SELECT count(*) AS sheets, count(*) FILTER (WHERE verdict = 'misprint') AS misprints,
                   count(*) FILTER (WHERE verdict = 'not-inspected') AS uninspected,
                   count(*) FILTER (WHERE late) AS late
               FROM sheets s WHERE s.press_id = p.id AND s.at >= %s) AS c
           ORDER BY p.plant, p.name""",
        (since,),
    )
    names = [field.name for field in fields(PressState)]
    return [PressState(**dict(zip(names, row, strict=True))) for row in rows]


def _order(table: str) -> str:
    return f"ORDER BY {table}.at DESC, {table}.run_id, {table}.sheet LIMIT %s"


def _begins(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace("%", r"\%").replace("_", r"\_")
    return f"{escaped}%"
