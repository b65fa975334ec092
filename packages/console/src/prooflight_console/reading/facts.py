"""Runs, sheets and incidents as plain values for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from prooflight_line.journal.exporting import page_facts, run_facts
from prooflight_line.journal.schema import finite

if TYPE_CHECKING:
    from prooflight_console.reading.incidents import LabelledIncident
    from prooflight_console.reading.now import Now
    from prooflight_line.journal.following import Written
    from prooflight_line.journal.labels import Label
    from prooflight_line.journal.records import PageRecord, RunRow


MOST_INCIDENTS = 20
"""Incidents in a state that is sent live."""


API_NAMES = {
    "asked": "sample_probability",
    "promise_suspended": "guarantee_suspended",
    "promise_suspended_from": "guarantee_suspended_from",
}
"""Fields that have another name in the API than in exports of the journal, whose format is older."""


def run_of(run: RunRow) -> dict[str, Any]:
    """Return a run, without the settings that it was started with."""
    fields = whole_run(run)
    return {name: value for name, value in fields.items() if name not in ("settings", "counts")}


def whole_run(run: RunRow) -> dict[str, Any]:
    """Return a run with all its fields."""
    return _renamed(run_facts(run))


def sheet_of(row: Written) -> dict[str, Any]:
    """Return a sheet as programs read it."""
    return {"run": row.run_id, "row": row.row, **_renamed(page_facts(row.page))}


def live_sheet(row: Written) -> dict[str, Any]:
    """Return the fields of a sheet that the strip of live sheets needs."""
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
        "pictured": pictured(row.page),
    }


def pictured(page: PageRecord) -> bool:
    """Return whether a camera image of a sheet is stored where the run stores evidence: of misprints and samples."""
    return page.verdict.verdict == "misprint" or page.asked is not None


def label_of(label: Label) -> dict[str, Any]:
    """Return a label."""
    fields = asdict(label)
    del fields["run"]
    fields["label"] = fields.pop("word")
    return fields


def incident_of(labelled: LabelledIncident) -> dict[str, Any]:
    """Return an incident with its labels."""
    fields = asdict(labelled.incident)
    del fields["last_verdict"]  # a sheet's, not the incident's
    fields["recurrences"] = fields.pop("returned")
    return {
        **finite(fields),
        "open": labelled.incident.open,
        "priority": labelled.priority.value,
        "shelved_until_s": labelled.shelving.ends_s if labelled.shelving and labelled.shelved else None,
        "label": labelled.word,
        "labelled": labelled.answered,
        "seen": labelled.seen,
        "labels": [label_of(label) for label in labelled.labels],
    }


def brief_incident(labelled: LabelledIncident) -> dict[str, Any]:
    """Return the fields of an incident that a list needs."""
    incident = labelled.incident
    names = ("number", "kind", "where", "count", "first_sheet", "last_sheet", "disposition", "open")
    labels = {
        "priority": labelled.priority.value,
        "label": labelled.word,
        "labelled": labelled.answered,
        "seen": labelled.seen,
    }
    return {name: getattr(incident, name) for name in names} | labels


def _renamed(fields: dict[str, Any]) -> dict[str, Any]:
    return {API_NAMES.get(name, name): value for name, value in fields.items()}


def now_facts(now: Now) -> dict[str, Any]:
    """Return the current state of the press, with ages in whole seconds, lest every poll bring a change."""
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
        "incidents": [brief_incident(labelled) for labelled in now.incidents[:MOST_INCIDENTS]],
        "pending": len(now.incidents),
        "unseen": now.unseen,
        "shelved": len(now.shelved),
        "flood": now.flood,
        "start": None if now.start is None else asdict(now.start),
        "stopping": now.stopping or None,
        "starter": None if now.starter is None else asdict(now.starter),
        "overload": None
        if now.overload is None
        else dict(zip(("late", "recent"), now.overload, strict=True)),
        "to_print_again": now.reprints.count,
        "unprinted": now.reprints.unprinted,
        "layout_counts": None if now.layout_counts is None else now.layout_counts.facts,
        "health": finite(health)
        | {
            "camera": now.health.camera,
            "inspection": now.health.inspection,
            "gate": None if now.gate is None else asdict(now.gate) | {"lamp": now.gate.lamp},
        },
    }
