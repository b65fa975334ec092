"""Channels of a run's monitoring: the values measured on every page, and their tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.base import LAMP_WAVES

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

STREAK_TOLERANCE: Final = 0.012
"""Tolerance of a column's light, as a share of the light: below worlds.toml's gate a streak is no
misprint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A quantity that is measured on every page."""

    name: str
    what: str
    """Display name."""
    unit: str
    scale: float
    """Factor from the value to the unit shown."""
    tolerance: float
    """Deviation from the expected value beyond which a page is a misprint."""
    x_mm: float | None = None
    """Position across the page, for a column; None: it is no column."""


def drift_channels(sensors: Sequence[str]) -> tuple[Channel, ...]:
    """Return the channels of any press; their tolerances are where worlds.toml's misprints begin."""
    gains = [
        Channel(name=f"gain-{ink}", what=f"density of {ink}", unit="%", scale=100, tolerance=0.07)
        for ink in INK_NAMES
    ]
    planes = [
        Channel(
            name=f"register-{ink}-{axis}",
            what=f"register of {ink} {way}",
            unit="mm",
            scale=1,
            tolerance=0.20,
        )
        for ink in INK_NAMES
        for axis, way in (("x", "across"), ("y", "along"))
    ]
    shifts = [
        Channel(name=f"shift-{axis}", what=f"place of the page {way}", unit="mm", scale=1, tolerance=1.8)
        for axis, way in (("x", "across"), ("y", "along"))
    ]
    lights = [  # assumed: no misprint; beyond it the lamp or the paper differs from that of the tables
        Channel(name=f"light-{name}", what=f"light on {name}", unit="%", scale=100, tolerance=0.05)
        for name in sensors
    ]
    waves = [
        Channel(name=f"lamp-{k}", what=f"lamp across, wave {k}", unit="%", scale=100, tolerance=0.05)
        for k in range(1, LAMP_WAVES + 1)
    ]
    return (*gains, *planes, *shifts, *lights, *waves)


def column_channels(columns_mm: Sequence[float] | NDArray[np.float64]) -> tuple[Channel, ...]:
    """Return the channels of the light of narrow columns at ``columns_mm`` across the page."""
    return tuple(
        Channel(
            name=f"streak-{x_mm:.1f}",
            what=f"streak at x = {x_mm:.1f} mm",
            unit="% of the light",
            scale=100,
            tolerance=STREAK_TOLERANCE,
            x_mm=float(x_mm),
        )
        for x_mm in columns_mm
    )
