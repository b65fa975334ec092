"""Defects in a reader's language: of an incident, and of one sheet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.reporting.defect_text import DefectText, SheetSpan, describe
from prooflight_line.run.incidents import NO_MISPRINT

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict
    from prooflight.reporting.defect_text import Size
    from prooflight_console.pages.language import Language
    from prooflight_line.run.incidents import Incident


def sheet_text(t: Language, verdict: Verdict, size_mm: Size | None = None) -> DefectText:
    """Describe the defect of one sheet; without a heading if it is no misprint."""
    return describe(verdict, size_mm=size_mm, language=t.code)


def incident_text(
    t: Language,
    incident: Incident,
    *,
    verdict: Verdict | None = None,
    sheet: int | None = None,
    size_mm: Size | None = None,
) -> DefectText:
    """Describe an incident by one of its sheets; without ``verdict`` and ``sheet`` by its last one."""
    if incident.kind in NO_MISPRINT:
        title = t.named("kind", incident.kind)
        return DefectText(title=title, what=t.sentence(incident.reason), where="", sheets="", certainty="")
    span = SheetSpan(
        first=incident.first_sheet,
        last=incident.last_sheet,
        count=incident.count,
        shown=incident.last_sheet if sheet is None else sheet,
    )
    shown = incident.last_verdict if verdict is None or verdict.verdict != "misprint" else verdict
    return describe(shown, size_mm=size_mm, sheets=span, language=t.code)
