"""Feeder of an office scanner: where it lays its sheets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class FeederPrior:
    """Standard deviations of where a feeder lays its sheets; a press file's ``[scanner]`` may state others.

    Assumed: the greatest that twelve sheets on one office feeder had.
    """

    shift_mm: float = 2.7
    """Displacement of the sheet, across and along."""
    skew_deg: float = 0.3
    stretch_percent: float = 0.8
    """Elongation of the sheet, across and along: rollers slip."""
