"""Runs and pages as plain values, for programs and spreadsheets."""

from __future__ import annotations

import csv
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from prooflight.pages.check import in_line
from prooflight_line.journal.columns import QUERY_COLUMNS
from prooflight_line.journal.records import COUNTED
from prooflight_line.journal.schema import finite, json_text

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TextIO

    from prooflight_line.journal.records import PageRecord, RunRow

CSV_COLUMNS: Final = (
    *("sheet", "job_page", *QUERY_COLUMNS, "disposition", "decided_by"),
    *("detector", "family", "reason", "regions", "x_mm", "y_mm", "width_mm", "height_mm"),
    *("shift_x_mm", "shift_y_mm", "late", "milliseconds"),
    *("first_line", "time_s", "faults", "notes", "nuisance", "widened", "promise_suspended"),
    "asked",
)
"""Columns of the CSV; x_mm to height_mm are of the strongest of ``regions``, faults and notes are one a line,
nuisance is JSON."""


def run_facts(run: RunRow) -> dict[str, Any]:
    """Return one run as an object of JSON; times in UTC."""
    facts = asdict(run.facts)
    settings = facts.pop("settings")
    started = _time(facts.pop("started_s"))
    end = run.end
    return finite(
        {
            "id": run.id,
            "state": run.state,
            "started": started,
            "ended": None if end is None else _time(end.ended_s),
            **facts,
            **{name: getattr(run, name) for name in COUNTED},
            "dropped_pages": run.dropped_pages,
            "dropped_evidence": run.dropped_evidence,
            "promise_suspended_from": run.promise_suspended_from,
            "detail": "" if end is None else end.detail,
            "settings": settings,
            "counts": {} if end is None else end.counts,
        }
    )


def job_warnings(run: RunRow) -> tuple[str, ...]:
    """Return the warnings of a run's job that were reported before its first sheet, a line each."""
    stored = run.facts.settings.get("warnings")
    warnings = [one for one in (stored if isinstance(stored, list) else []) if isinstance(one, dict)]
    return tuple(
        in_line({"page": page if isinstance(page, int) else None, "message": message})
        for page, message in ((one.get("page"), one.get("message")) for one in warnings)
        if isinstance(message, str)
    )


def page_facts(page: PageRecord) -> dict[str, Any]:
    """Return one page as an object of JSON: its verdict as `prooflight inspect` prints it, and the run's data."""
    return finite(
        {
            **asdict(page.verdict),
            "disposition": page.disposition,
            "decided_by": page.decided_by,
            "late": page.late,
            "sheet": page.sheet,
            "job_page": page.job_page,
            "first_line": page.first_line,
            "time_s": page.time_s,
            "faults": page.faults,
            "notes": page.notes,
            "nuisance": dict(page.nuisance),
            "asked": page.asked,
        }
    )


def write_csv(pages: Iterable[PageRecord], file: TextIO) -> None:
    """Write one row a page, with a header; empty where a page has no such value."""
    writer = csv.DictWriter(file, CSV_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(map(csv_row, pages))


def csv_row(page: PageRecord) -> dict[str, Any]:
    """Return the ``CSV_COLUMNS`` of one page."""
    facts = page_facts(page)
    regions = facts["regions"]
    strongest = {name: regions[0][name] for name in CSV_COLUMNS if name in regions[0]} if regions else {}
    strongest.pop("kind", None)
    strongest.pop("score", None)
    x, y = facts["shift_mm"] or (None, None)
    row = (
        facts
        | strongest
        | {"regions": len(regions), "shift_x_mm": x, "shift_y_mm": y}
        | {name: "\n".join(facts[name]) for name in ("faults", "notes")}
        | {"nuisance": json_text(facts["nuisance"])}
    )
    return {name: row.get(name) for name in CSV_COLUMNS}


def _time(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s, UTC).isoformat(timespec="seconds")
