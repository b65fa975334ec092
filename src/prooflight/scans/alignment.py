"""Sensors that do not look at the same place at the same time, put in step: of one camera, or of several.

A trilinear colour camera has its lines apart along the travel, and so have two cameras on one bar. Whole lines and
pixels are counted off where lines come in (``cameras.in_step``). The fraction that is left stands in the footprint of
the press's sensor: prediction looks that much further, exactly, and no scan is interpolated, so that noise stays what
the camera made it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.pages.sampling import Footprint
    from prooflight.scans.geometry import ScanGeometry

FRACTION: Final = 0.02
"""Lines or pixels by which a press may lie off what its press file says. Offsets are found to a few hundredths, and
registration finds a page to as much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOffset:
    """How far a sensor's lines lie from those of the press."""

    lines: float = 0.0
    """So many lines later it sees a place of the page."""
    pixels: float = 0.0
    """So many pixels further right it sees a place of the page."""

    @property
    def whole(self) -> tuple[int, int]:
        """Lines and pixels that are counted off."""
        return math.floor(self.lines + 0.5), math.floor(self.pixels + 0.5)

    @property
    def fraction(self) -> tuple[float, float]:
        """Lines and pixels that are left, at least -0.5 and below 0.5."""
        lines, pixels = self.whole
        return self.lines - lines, self.pixels - pixels

    def of_fraction(self, footprint: Footprint, geometry: ScanGeometry) -> Footprint:
        """What the sensor's pixels see once whole lines and pixels are counted off; footprint: of one in its place."""
        lines, pixels = self.fraction
        return footprint.moved(
            across_mm=-pixels * geometry.pixel_pitch_mm, along_mm=-lines * geometry.line_pitch_mm
        )


def built_fraction(footprint: Footprint, geometry: ScanGeometry) -> tuple[float, float]:
    """Lines and pixels of ``SensorOffset.fraction`` for which a press's footprint was made."""
    across_mm, along_mm = footprint.centre_mm
    # Adding 0 makes no -0 of them, which nobody wants to read.
    return -along_mm / geometry.line_pitch_mm + 0.0, -across_mm / geometry.pixel_pitch_mm + 0.0


def moved_columns(lines: NDArray[np.uint16], pixels: int) -> NDArray[np.uint16]:
    """Lines (..., columns) of which each pixel shows what the one so many further right did.

    What lies beyond the sensor's end shows its last pixel.
    """
    if pixels == 0:
        return lines
    columns = lines.shape[-1]
    return lines[..., np.clip(np.arange(columns) + pixels, 0, columns - 1)]


def disagreement(
    footprints: Sequence[Footprint], offsets: Sequence[SensorOffset], geometry: ScanGeometry
) -> tuple[int, float, float] | None:
    """The sensor whose fraction along the travel or across is not the one that the press was built for; None: all are.

    Its place, and lines (or pixels) as built and as stated.
    """
    for place, (footprint, offset) in enumerate(zip(footprints, offsets, strict=True)):
        for built, stated in zip(built_fraction(footprint, geometry), offset.fraction, strict=True):
            # Half a line more and half a line less are the same fraction, but not the same whole lines.
            if abs(built - stated) > FRACTION:
                return place, built, stated
    return None
