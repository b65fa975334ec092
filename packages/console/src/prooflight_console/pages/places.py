"""Position of an incident, in a reader's language."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prooflight_console.pages.language import Language
    from prooflight_line.run.incidents import Incident


def place(t: Language, incident: Incident) -> str:
    """Return the position as text; empty if it is nowhere on the sheet."""
    if incident.scope == "run":
        return ""
    if incident.box_mm is None:
        return t("where.all")
    x_mm, y_mm, width_mm, height_mm = incident.box_mm
    across, down = (t.number(value) for value in (x_mm + width_mm / 2, y_mm + height_mm / 2))
    if incident.scope == "column":
        return t("where.column", x=across)
    digits = 1 if min(width_mm, height_mm) < 10 else 0
    size = f"{t.number(width_mm, digits)} × {t.number(height_mm, digits)} mm".replace(
        " ", "\N{NO-BREAK SPACE}"
    )
    return t("where.place", x=across, y=down, size=size)
