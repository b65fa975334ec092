"""Alignment of sensors that see the same place at different lines or pixels, of one camera or of several.

The lines of a trilinear colour camera are offset along the travel, and so are two cameras on one bar. Whole
lines and pixels are removed where lines come in (``cameras.several``). The remaining fraction is part of the
footprint of the press's sensor, so that prediction accounts for it exactly, and no scan is interpolated,
which would change its noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from prooflight.pages.sampling import Footprint
    from prooflight.scans.geometry import ScanGeometry

FRACTION: Final = 0.02
"""Tolerance between a press's offsets and those in its press file. Offsets are measured to a few hundredths,
and registration places a page as accurately. [lines or pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOffset:
    """Offset of a sensor's lines from those of the press."""

    lines: float = 0.0
    """Number of lines by which the sensor sees a place of the page later."""
    pixels: float = 0.0
    """Number of pixels by which the sensor sees a place of the page further right."""

    @property
    def whole(self) -> tuple[int, int]:
        """Whole lines and pixels, which are removed by counting."""
        return math.floor(self.lines + 0.5), math.floor(self.pixels + 0.5)

    @property
    def fraction(self) -> tuple[float, float]:
        """Remaining lines and pixels, at least -0.5 and below 0.5."""
        lines, pixels = self.whole
        return self.lines - lines, self.pixels - pixels

    def of_fraction(self, footprint: Footprint, geometry: ScanGeometry) -> Footprint:
        """Return the footprint of the sensor's pixels after removal of whole lines and pixels.

        footprint: of a sensor without offset.
        """
        lines, pixels = self.fraction
        return footprint.moved(
            across_mm=-pixels * geometry.pixel_pitch_mm, along_mm=-lines * geometry.line_pitch_mm
        )


def built_fraction(footprint: Footprint, geometry: ScanGeometry) -> tuple[float, float]:
    """Return the lines and pixels of ``SensorOffset.fraction`` for which a press's footprint was made."""
    across_mm, along_mm = footprint.centre_mm
    # Adding 0 turns -0 into 0, which reads better.
    return -along_mm / geometry.line_pitch_mm + 0.0, -across_mm / geometry.pixel_pitch_mm + 0.0


def moved_columns(lines: NDArray[np.uint16], pixels: int) -> NDArray[np.uint16]:
    """Shift lines (..., columns) so that each pixel shows the one so many columns further right.

    The sensor's last pixel is repeated beyond its end.
    """
    if pixels == 0:
        return lines
    columns = lines.shape[-1]
    return lines[..., np.clip(np.arange(columns) + pixels, 0, columns - 1)]


def disagreement(
    footprints: Sequence[Footprint], offsets: Sequence[SensorOffset], geometry: ScanGeometry
) -> tuple[int, float, float] | None:
    """Return the first sensor whose fraction is not the one that the press was built for; None if all agree.

    The result is its index, and the lines (or pixels) as built and as stated.
    """
    for place, (footprint, offset) in enumerate(zip(footprints, offsets, strict=True)):
        for built, stated in zip(built_fraction(footprint, geometry), offset.fraction, strict=True):
            # Half a line more and half a line less are the same fraction, but not the same whole lines.
            if abs(built - stated) > FRACTION:
                return place, built, stated
    return None
