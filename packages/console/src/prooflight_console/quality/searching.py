"""Search for sheets of all runs, by the index; and the sheets that need no review, which only the journal lists."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from prooflight_line.journal.defect_conditions import DefectConditions
from prooflight_line.journal.following import PageQuery, RunSpan
from prooflight_line.journal.labels import OF_GOOD

if TYPE_CHECKING:
    from prooflight_console.quality.index import SearchIndex
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.following import Written

TO_REVIEW: Final = "look"
"""Choice of verdict that selects all sheets that need review."""
VERDICTS: Final = (TO_REVIEW, "misprint", "not-inspected", "good", "any")
LABELS: Final = ("none", "any", "misprint", "good", "unknown")
"""Choices of label; good: false alarms and sheets that a person released, none: no label."""
COLUMNS: Final = {
    "time": "s.at_s",
    "kind": "s.kind",
    "size": "s.size_mm",
    "sheet": "s.sheet",
    "page": "s.page",
    "job": "r.job",
    "press": "r.press",
    "label": "s.label",
}
"""Columns by which results are sorted, and their SQL."""
DEFECT_BOX: Final = ("d.x_mm", "d.y_mm", "d.width_mm", "d.height_mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetSearch:
    """Conditions on sheets; None or empty: no condition."""

    verdict: str = TO_REVIEW
    """One of ``VERDICTS``."""
    defect: DefectConditions = field(default_factory=DefectConditions)
    page: str = ""
    """The page's name in the job, or its beginning."""
    job: str = ""
    """The job's name; a part of it, where no job has exactly this name."""
    press: str = ""
    customer: str = ""
    label: str | None = None
    """One of ``LABELS``."""
    runs: tuple[int, ...] = ()
    since_s: float | None = None
    until_s: float | None = None
    """Time before which the sheet passed the camera; Unix time, like ``since_s``. [s]"""

    @property
    def of_journal(self) -> bool:
        """Whether sheets are among the results that only the journal lists: good ones, without label or defect."""
        return self.verdict in ("good", "any") and self.label is None and self.defect == DefectConditions()

    def run_condition(self, index: SearchIndex) -> tuple[str, list[Any]]:
        """Return the condition on ``runs r`` as SQL, and its values."""
        parts, values = [], list[Any]()
        for column in ("job", "press", "customer"):
            if text := getattr(self, column):
                exact = index.query(f"SELECT 1 FROM runs WHERE {column} = ? LIMIT 1", (text,))
                parts.append(f"r.{column} = ?" if exact else f"r.{column} LIKE ? ESCAPE '\\'")
                values.append(text if exact else f"%{_escaped(text)}%")
        if self.runs:
            parts.append(f"r.id IN ({', '.join(map(str, self.runs))})")
        return " AND ".join(parts) or "1 = 1", values

    def condition(self, index: SearchIndex) -> tuple[str, list[Any]]:
        """Return the condition on ``sheets s JOIN runs r`` as SQL, and its values."""
        text, values = self.run_condition(index)
        parts = [] if text == "1 = 1" else [f"s.run_id IN (SELECT r.id FROM runs r WHERE {text})"]
        if self.verdict == TO_REVIEW:
            parts.append("s.to_review")
        elif self.verdict != "any":
            parts.append("s.verdict = ?")
            values.append(self.verdict)
        if self.page:
            parts.append("substr(s.page, 1, ?) = ?")
            values += [len(self.page), self.page]
        for time_s, sign in ((self.since_s, ">="), (self.until_s, "<")):
            if time_s is not None:
                parts.append(f"s.at_s {sign} ?")
                values.append(time_s)
        if self.label is not None:
            of_good = ", ".join(f"'{label}'" for label in sorted(OF_GOOD))
            of_label = {
                "none": "s.label IS NULL",
                "any": "s.label NOT NULL",
                "good": f"s.label IN ({of_good})",
            }
            parts.append(of_label.get(self.label, f"s.label = '{self.label}'"))
        if self.defect.any_defect:
            if self.defect.kind is not None:
                parts.append("s.kind = ?")
                values.append(self.defect.kind)
        else:
            text, more = self.defect.sql(kind="d.kind", ink="d.ink", box=DEFECT_BOX)
            parts.append(f"(s.run_id, s.sheet) IN (SELECT d.run_id, d.sheet FROM defects d WHERE {text})")
            values += more
        return " AND ".join(parts) or "1 = 1", values


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """A sheet that a search returned."""

    written: Written
    at_s: float
    """Time at which the sheet passed the camera; Unix time. [s]"""
    label: str | None
    size_mm: float | None
    """Longer side of its largest defect. [mm]"""


def sheet_numbers(
    index: SearchIndex, search: SheetSearch, *, order: str = "-time", skip: int = 0, limit: int, upto_row: int
) -> list[tuple[int, int, float, str | None, float | None]]:
    """Return run, number, time, label and size of the sheets that a search selects in the index.

    order: one of ``COLUMNS``, with - from the greatest on; upto_row: row of the journal after which nothing is
    returned, so that later sheets do not shift the pages of a list.
    """
    text, values = search.condition(index)
    column = COLUMNS[order.removeprefix("-")]
    way = "DESC" if order.startswith("-") else "ASC"
    # Sheets without a value come last in either order. By time, the index is read and nothing is sorted.
    by = f"s.at_s {way}" if column == "s.at_s" else f"{column} IS NULL, {column} {way}, s.at_s DESC"
    joined = "JOIN runs r ON r.id = s.run_id" if column.startswith("r.") else ""
    sql = (
        f"SELECT s.run_id, s.sheet, s.at_s, s.label, s.size_mm FROM sheets s {joined} WHERE {text} AND s.row <= ?"
        f" ORDER BY {by}, s.run_id, s.sheet LIMIT ? OFFSET ?"
    )
    return index.query(sql, [*values, upto_row, limit, skip])


def count(index: SearchIndex, search: SheetSearch, *, upto_row: int) -> int | None:
    """Return the number of sheets that a search selects; None where good ones are sought by page, which takes long."""
    if search.of_journal:
        return None if search.page else _tallied(index, search)
    text, values = search.condition(index)
    rows = index.query(f"SELECT count(*) FROM sheets s WHERE {text} AND s.row <= ?", [*values, upto_row])
    return int(rows[0][0]) if rows else 0


def find(
    reading: Reading,
    index: SearchIndex,
    search: SheetSearch,
    *,
    order: str = "-time",
    skip: int = 0,
    limit: int,
    upto_row: int,
) -> list[Hit]:
    """Return the sheets that a search selects; damaged ones are left out. As ``sheet_numbers``."""
    numbers = sheet_numbers(index, search, order=order, skip=skip, limit=limit, upto_row=upto_row)
    of_run: dict[int, list[int]] = {}
    for run_id, sheet, *_ in numbers:
        of_run.setdefault(run_id, []).append(sheet)
    written = {
        (run_id, row.page.sheet): row
        for run_id, sheets in of_run.items()
        for row in reading.sheets(
            PageQuery(run_id=run_id, sheets=tuple(sheets)),
            after=-1,
            limit=len(sheets),
            damaged=lambda _: None,
        )
    }
    return [
        Hit(written=written[run_id, sheet], at_s=at_s, label=label, size_mm=size_mm)
        for run_id, sheet, at_s, label, size_mm in numbers
        if (run_id, sheet) in written
    ]


def find_in_journal(
    reading: Reading, index: SearchIndex, search: SheetSearch, *, before: int | None, limit: int
) -> list[Hit]:
    """Return sheets of the journal itself, the latest first; before: only those of lower rows."""
    starts = dict(index.query("SELECT id, start_s FROM runs WHERE start_s NOT NULL"))
    query = PageQuery(
        verdict=None if search.verdict == "any" else search.verdict,
        page=search.page or None,
        spans=spans(index, search),
    )
    rows = reading.search(query, before=before, limit=limit, damaged=lambda _: None)
    keys = [(row.run_id, row.page.sheet) for row in rows]
    marks = ", ".join("(?, ?)" for _ in keys)
    labels = {
        (run_id, sheet): label
        for run_id, sheet, label in (
            index.query(
                f"SELECT run_id, sheet, label FROM sheets WHERE (run_id, sheet) IN (VALUES {marks})",
                [number for key in keys for number in key],
            )
            if keys
            else []
        )
    }
    return [
        Hit(
            written=row,
            at_s=starts.get(row.run_id, 0.0) + row.page.time_s,
            label=labels.get((row.run_id, row.page.sheet)),
            size_mm=max((max(one.width_mm, one.height_mm) for one in row.page.verdict.regions), default=None),
        )
        for row in rows
    ]


def spans(index: SearchIndex, search: SheetSearch) -> tuple[RunSpan, ...] | None:
    """Return the parts of runs that meet a search's conditions on run and time; None: it has none."""
    text, values = search.run_condition(index)
    if text == "1 = 1" and search.since_s is None and search.until_s is None:
        return None
    rows = index.query(
        "SELECT r.id, r.start_s, min(c.quarter) * 900.0, max(c.quarter + 1) * 900.0 FROM runs r"
        f" JOIN counts c ON c.run_id = r.id WHERE {text} AND r.start_s NOT NULL GROUP BY r.id",
        values,
    )
    parts = []
    for run_id, start_s, first_s, last_s in rows:
        since_s, until_s = search.since_s, search.until_s
        if (since_s is not None and last_s <= since_s) or (until_s is not None and first_s >= until_s):
            continue
        cut_since = None if since_s is None or since_s <= first_s else since_s - start_s
        cut_until = None if until_s is None or until_s >= last_s else until_s - start_s
        parts.append(RunSpan(run_id=run_id, since_s=cut_since, until_s=cut_until))
    return tuple(parts)


def _tallied(index: SearchIndex, search: SheetSearch) -> int | None:
    """Return the number of all or all good sheets, by quarters of an hour, in which days begin and end."""
    text, values = search.run_condition(index)
    counted = "sheets - misprints - not_inspected" if search.verdict == "good" else "sheets"
    sql = f"SELECT coalesce(sum({counted}), 0) FROM counts c JOIN runs r ON r.id = c.run_id WHERE {text}"
    for time_s, sign in ((search.since_s, ">="), (search.until_s, "<")):
        if time_s is not None:
            sql += f" AND c.quarter {sign} ?"
            values.append(time_s // 900)
    rows = index.query(sql, values)
    return int(rows[0][0]) if rows else 0


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("%", r"\%").replace("_", r"\_")
