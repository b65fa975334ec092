"""Common cause of misprints on many sheets of a run: one kind at one place, be the sheets copies or not."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Region, Verdict

COLUMN_KINDS: Final = frozenset({"streak"})
"""Kinds of misprint at a column of the web, whatever the line."""
SHEET_KINDS: Final = frozenset(
    {"wrong-page", "density", "plane-register", "missing-plane", "swapped-planes", "banding"}
)
"""Kinds that change the print as a whole; the box says where that is seen best."""
NEAR_MM: Final = 3.0
"""Distance below which two places count as one; boxes differ by a block of pixels and more."""
LEAST_SHEETS: Final = 3
LEAST_SHARE: Final = 0.1
"""Least share of the sheets so far that counts as many. assumed: ten times the usual false-alarm rate."""
MOST_PLACES: Final = 256
"""Greatest number of places that are distinguished in a run; alarms at others count by their kind alone."""


@dataclass(slots=True, kw_only=True)
class CommonCause:
    """Counter of a run's sheets by kind and place of their misprint; its size does not grow."""

    sheets: int = 0
    """Number of sheets that were inspected."""
    kinds: dict[str, int] = field(default_factory=dict)
    places: dict[tuple[str, float, float], int] = field(default_factory=dict)
    """Number of sheets by kind and x, y of the first sheet's place [mm]; for a column y is 0."""

    def add(self, verdict: Verdict) -> None:
        """Count the next sheet; one that was not inspected is left out."""
        if verdict.verdict == "not-inspected":
            return
        self.sheets += 1
        kind = verdict.kind or "unknown"
        if verdict.verdict != "misprint" or kind == "unknown":
            return
        self.kinds[kind] = self.kinds.get(kind, 0) + 1
        region = next((one for one in verdict.regions if one.kind == kind), None)
        if region is not None and kind not in SHEET_KINDS:
            self._add_place(kind, region)

    def _add_place(self, kind: str, region: Region) -> None:
        x = region.x_mm + region.width_mm / 2
        y = 0.0 if kind in COLUMN_KINDS else region.y_mm + region.height_mm / 2
        for other in self.places:
            if other[0] == kind and max(abs(other[1] - x), abs(other[2] - y)) <= NEAR_MM:
                self.places[other] += 1
                return
        if len(self.places) < MOST_PLACES:
            self.places[kind, x, y] = 1

    @property
    def description(self) -> str:
        """Describe what many sheets show, and where; empty: no kind of misprint is that common."""
        place, at_place = max(self.places.items(), key=lambda one: one[1], default=(None, 0))
        if place is not None and self._many(at_place):
            kind, x, y = place
            where = (
                f" at x = {x:.0f} mm" if kind in COLUMN_KINDS else f" around x = {x:.0f} mm, y = {y:.0f} mm"
            )
            return f"many sheets show {kind}{where} ({at_place} of {self.sheets})"
        kind, of_kind = max(self.kinds.items(), key=lambda one: one[1], default=("", 0))
        if not self._many(of_kind):
            return ""
        where = "" if kind in SHEET_KINDS else " at several places"
        return f"many sheets show {kind}{where} ({of_kind} of {self.sheets})"

    def _many(self, count: int) -> bool:
        return count >= max(LEAST_SHEETS, LEAST_SHARE * self.sheets)
