"""Feeder of an office scanner: where it lays its sheets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class FeederPrior:
    """Standard deviations of where a feeder lays its sheets, as ``[geometry]`` of a press file states them."""

    shift_mm: float
    """Displacement of the sheet, across and along."""
    skew_deg: float
    stretch_percent: float
    """Elongation of the sheet, across and along: rollers slip."""
