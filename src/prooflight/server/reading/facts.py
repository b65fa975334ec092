"""Runs, sheets and incidents as plain values: what JSON holds."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from prooflight.journal.exporting import page_facts, run_facts

if TYPE_CHECKING:
    from prooflight.journal.following import Written
    from prooflight.journal.records import RunRow
    from prooflight.journal.words import Word
    from prooflight.server.reading.incidents import Told
    from prooflight.server.reading.now import Now


MOST_INCIDENTS = 20
"""Of a state that is told live."""


def run_of(run: RunRow) -> dict[str, Any]:
    """A run, without what it was started with."""
    told = run_facts(run)
    return {name: value for name, value in told.items() if name not in ("settings", "counts")}


def whole_run(run: RunRow) -> dict[str, Any]:
    """A run with all that is known."""
    return run_facts(run)


def sheet_of(row: Written) -> dict[str, Any]:
    """A sheet as programs read it."""
    return {"run": row.run_id, "row": row.row, **page_facts(row.page)}


def live_sheet(row: Written) -> dict[str, Any]:
    """A sheet in as few words as a strip needs."""
    verdict = row.page.verdict
    return {
        "run": row.run_id,
        "sheet": row.page.sheet,
        "page": verdict.page,
        "verdict": verdict.verdict,
        "disposition": row.page.disposition,
        "decided_by": row.page.decided_by,
        "kind": verdict.kind,
        "late": row.page.late,
        "faults": list(row.page.faults),
    }


def word_of(word: Word) -> dict[str, Any]:
    """What somebody said."""
    held = asdict(word)
    del held["run"]
    return held


def incident_of(told: Told) -> dict[str, Any]:
    """An incident with what was said of it."""
    held = _finite(asdict(told.incident))
    return {
        **held,
        "open": told.incident.open,
        "word": told.word,
        "answered": told.answered,
        "seen": told.seen,
        "words": [word_of(word) for word in told.words],
    }


def brief_incident(told: Told) -> dict[str, Any]:
    """An incident in as few words as a list needs."""
    incident = told.incident
    names = ("number", "kind", "where", "count", "first_sheet", "last_sheet", "disposition", "open")
    said = {"word": told.word, "answered": told.answered, "seen": told.seen}
    return {name: getattr(incident, name) for name in names} | said


def now_facts(now: Now) -> dict[str, Any]:
    """The press at this moment; ages in whole seconds, lest every look be news."""
    health = asdict(now.health)
    quiet_s = now.health.quiet_s
    if quiet_s is not None:
        health["quiet_s"] = math.floor(quiet_s) if quiet_s >= 2 else 0
    if (rate := now.health.sheets_per_s) is not None:
        health["sheets_per_s"] = round(rate, 2)
    return {
        "state": now.state,
        "alarm": now.alarm,
        "run": None if now.run is None else run_of(now.run),
        "cause": None if now.cause is None else now.cause.incident.number,
        "incidents": [brief_incident(told) for told in now.incidents[:MOST_INCIDENTS]],
        "overload": None
        if now.overload is None
        else dict(zip(("late", "recent"), now.overload, strict=True)),
        "to_print_again": now.reprints.count,
        "unprinted": now.reprints.unprinted,
        "together": None if now.together is None else now.together.facts,
        "health": _finite(health)
        | {
            "camera": now.health.camera,
            "inspection": now.health.inspection,
            "gate": None if now.gate is None else asdict(now.gate) | {"lamp": now.gate.lamp},
        },
    }


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    return [_finite(part) for part in value] if isinstance(value, list | tuple) else value
