"""Zones of a page, and the precedence of zones that overlap.

A point may be in zones of several kinds. The stricter one counts: careful over normal, normal over ignore. A
normal zone therefore cuts a hole into an ignored one, and an ignored zone never hides a stricter one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["ignore", "normal", "careful"]
KINDS: Final[tuple[Kind, ...]] = ("ignore", "normal", "careful")
"""Kinds from the lowest precedence to the highest."""
Box = tuple[float, float, float, float]
"""A rectangle: x, y, width and height on the page as printed. [mm]"""
SAMPLE_MM: Final = 0.5
"""Sampling distance of zones for the computation of shares: a tile of the matched-filter detector."""


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A polygon on a page, with the treatment of evidence inside it."""

    name: str
    kind: Kind
    corners_mm: tuple[tuple[float, float], ...]
    """Corners x, y, at least three in order, from the page's top-left corner as printed."""

    @classmethod
    def rectangle(cls, name: str, kind: Kind, box: Box) -> Zone:
        """Return the zone of a rectangle's x, y, width and height."""
        x, y, width, height = box
        corners = ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
        return cls(name=name, kind=kind, corners_mm=corners)

    def turned(self, height_mm: float) -> Zone:
        """Return the zone on its page of this height, turned as ``pages.raster.turned`` does."""
        return replace(self, corners_mm=tuple((height_mm - y, x) for x, y in self.corners_mm))

    @property
    def box(self) -> Box:
        """The smallest rectangle that contains the zone."""
        x, y = zip(*self.corners_mm, strict=True)
        return min(x), min(y), max(x) - min(x), max(y) - min(y)

    @property
    def area_mm2(self) -> float:
        """Area by the shoelace formula."""
        x, y = np.array(self.corners_mm).T
        return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2

    def holds(self, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which points of a grid (n,) x (m,) are inside, (m, n): those whose ray to the right has odd
        crossings.

        The rule is Jordan's. Left and upper edges belong to the zone, right and lower ones do not.
        """
        inside = np.zeros((y_mm.size, x_mm.size), bool)
        for (x0, y0), (x1, y1) in zip(
            self.corners_mm, (*self.corners_mm[1:], self.corners_mm[0]), strict=True
        ):
            if y0 == y1:
                continue
            rows = np.flatnonzero((y_mm >= min(y0, y1)) & (y_mm < max(y0, y1)))
            crossing = x0 + (y_mm[rows] - y0) * (x1 - x0) / (y1 - y0)
            inside[rows] ^= x_mm < crossing[:, None]
        return inside


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Scores of good prints of a job's pages with zones in force, by which the false-alarm rate is kept."""

    page_scores: tuple[float, ...]
    """Scores of pages as a whole, in the detector's units."""
    careful_scores: tuple[float, ...]
    """Scores of their careful areas, from prints other than those of the two below; empty: there are no
    careful zones."""
    careful_mean: tuple[float, ...]
    """Mean, on good prints, of the quantities that the detector uses in careful areas."""
    careful_sd: tuple[float, ...]
    """Standard deviation of these quantities on good prints."""


@dataclass(frozen=True, kw_only=True)
class PageZones:
    """All zones of one page."""

    zones: tuple[Zone, ...]
    careful_share: float
    """Share of the nominal false-alarm rate that careful areas may use. [-]"""
    calibration: Calibration | None = None
    """Calibration; None: it is being measured, and no false-alarm rate is guaranteed yet."""

    @cached_property
    def kinds(self) -> frozenset[Kind]:
        """Kinds of the page's zones."""
        return frozenset(zone.kind for zone in self.zones)

    def holds(self, kind: Kind, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which points of a grid (n,) x (m,) count as of this kind, (m, n); see the module."""
        inside = np.zeros((y_mm.size, x_mm.size), bool)
        for other in KINDS[KINDS.index(kind) :]:
            for zone in self.zones:
                if zone.kind == other:
                    within = zone.holds(x_mm, y_mm)
                    inside = inside | within if other == kind else inside & ~within
        return inside

    def ignores(self, box: Box) -> bool:
        """Return whether all of a rectangle is ignored."""
        x, y, width, height = box
        across = np.linspace(x, x + width, max(int(width / SAMPLE_MM), 2))
        along = np.linspace(y, y + height, max(int(height / SAMPLE_MM), 2))
        return bool(self.holds("ignore", across, along).all())

    def at(self, x_mm: float, y_mm: float) -> Zone | None:
        """Return the zone that counts at a point; None if the point is in no zone."""
        here = [zone for zone in self.zones if zone.holds(np.array([x_mm]), np.array([y_mm]))[0, 0]]
        return max(here, key=lambda zone: KINDS.index(zone.kind), default=None)


def share_ignored(zones: PageZones, width_mm: float, height_mm: float) -> float:
    """Return the share of a page that is ignored. [-]"""
    across, along = (
        np.arange(SAMPLE_MM / 2, width_mm, SAMPLE_MM),
        np.arange(SAMPLE_MM / 2, height_mm, SAMPLE_MM),
    )
    return float(zones.holds("ignore", across, along).mean())


def contested(zones: Sequence[Zone]) -> list[tuple[Zone, Zone]]:
    """Return pairs of a careful zone and an ignored one that overlap; the careful one counts."""
    pairs = []
    for one in zones:
        for other in zones:
            if one.kind == "careful" and other.kind == "ignore" and _overlap(one, other):
                pairs.append((one, other))
    return pairs


def _overlap(one: Zone, other: Zone) -> bool:
    (x, y, width, height), (left, top, wide, high) = one.box, other.box
    first, last = (max(x, left), max(y, top)), (min(x + width, left + wide), min(y + height, top + high))
    if first[0] >= last[0] or first[1] >= last[1]:
        return False
    step = min(SAMPLE_MM, (last[0] - first[0]) / 2, (last[1] - first[1]) / 2)
    across, along = (np.arange(a + step / 2, b, step) for a, b in zip(first, last, strict=True))
    return bool((one.holds(across, along) & other.holds(across, along)).any())
