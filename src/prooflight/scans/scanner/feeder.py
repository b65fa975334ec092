"""Feeder of an office scanner: where it lays its sheets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True, slots=True, kw_only=True)
class FeederPrior:
    """Standard deviations of where a feeder lays its sheets, as ``[geometry]`` of a press file states them."""

    shift_mm: float
    """Displacement of the sheet, across and along."""
    skew_deg: float
    stretch_percent: float
    """Elongation of the sheet, across and along: rollers slip."""
    back: Self | None = None
    """Of back sides, where the device scans both sides at once, the back further along the path; None: as fronts."""

    def of_scan(self, turn: int) -> FeederPrior:
        """Return the feeder of a scan by its turn from 0: front and back sides follow one another."""
        return self.back if self.back is not None and turn % 2 else self
