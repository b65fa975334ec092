"""Feeder of an office scanner: where it lays its sheets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from prooflight.files.fields import NO_OTHER_FIELDS


@dataclass(frozen=True, slots=True, kw_only=True)
class FeederPrior:
    """Standard deviations of where a feeder lays its sheets, as ``[geometry]`` of a press file states them."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    shift_mm: Annotated[float, Field(strict=True, ge=0, le=12)]
    """Displacement of the sheet, across and along."""
    skew_deg: Annotated[float, Field(strict=True, ge=0, le=1)]
    stretch_percent: Annotated[float, Field(strict=True, ge=0, le=3)]
    """Elongation of the sheet, across and along: rollers slip."""
    back: FeederPrior | None = None
    """Prior of back sides, where the device scans both at once, the back further along the path; None: as fronts."""

    def __post_init__(self) -> None:
        """Refuse a back of a back, which no sheet has."""
        if self.back is not None and self.back.back is not None:
            raise ValueError("back has no back of its own")

    def of_scan(self, turn: int) -> FeederPrior:
        """Return the feeder of a scan by its turn from 0: front and back sides follow one another."""
        return self.back if self.back is not None and turn % 2 else self
