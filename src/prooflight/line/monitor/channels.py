"""The numbers that every page adds to its run, and how far off each makes a page a misprint."""

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
"""Of the light: worlds.toml's gate, below which a streak is no misprint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One number that every page gives."""

    name: str
    what: str
    """For people."""
    unit: str
    scale: float
    """From the value to the unit shown."""
    tolerance: float
    """How far off what was expected makes a page a misprint."""
    x_mm: float | None = None
    """Where across the page, of a column."""


def drift_channels(sensors: Sequence[str]) -> tuple[Channel, ...]:
    """Channels of any press; tolerances are where worlds.toml's misprints begin."""
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
    lights = [  # assumed: no misprint; beyond it a lamp or the paper is another than the tables know
        Channel(name=f"light-{name}", what=f"light on {name}", unit="%", scale=100, tolerance=0.05)
        for name in sensors
    ]
    waves = [
        Channel(name=f"lamp-{k}", what=f"lamp across, wave {k}", unit="%", scale=100, tolerance=0.05)
        for k in range(1, LAMP_WAVES + 1)
    ]
    return (*gains, *planes, *shifts, *lights, *waves)


def column_channels(columns_mm: Sequence[float] | NDArray[np.float64]) -> tuple[Channel, ...]:
    """The light of narrow columns, which lie at ``columns_mm`` across the page."""
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
