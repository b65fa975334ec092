"""A zone of a page, and which of several counts where they overlap.

A place may lie in zones of several kinds. The stricter one counts: careful over normal, normal over ignore. So a normal
zone cuts a hole into one that is ignored, and nothing that somebody wants watched is ever hidden.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Kind = Literal["ignore", "normal", "careful"]
KINDS: Final[tuple[Kind, ...]] = ("ignore", "normal", "careful")
"""From the one that gives way to all others to the one that gives way to none."""
Box = tuple[float, float, float, float]
"""x, y, width and height on the page as printed. [mm]"""
SAMPLE_MM: Final = 0.5
"""At which zones are sampled where only shares are asked for: a tile of our detector."""


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A polygon on a page, with what becomes of evidence that lies in it."""

    name: str
    kind: Kind
    corners_mm: tuple[tuple[float, float], ...]
    """x, y of at least three corners in order, from the page's top-left corner as printed."""

    @classmethod
    def rectangle(cls, name: str, kind: Kind, box: Box) -> Zone:
        """From its x, y, width and height."""
        x, y, width, height = box
        corners = ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
        return cls(name=name, kind=kind, corners_mm=corners)

    def turned(self, height_mm: float) -> Zone:
        """The same on its page of this height, turned as ``pages.raster.turned`` does."""
        return replace(self, corners_mm=tuple((height_mm - y, x) for x, y in self.corners_mm))

    @property
    def box(self) -> Box:
        """The smallest rectangle that holds it."""
        x, y = zip(*self.corners_mm, strict=True)
        return min(x), min(y), max(x) - min(x), max(y) - min(y)

    @property
    def area_mm2(self) -> float:
        """By the shoelace formula."""
        x, y = np.array(self.corners_mm).T
        return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2

    def holds(self, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which points of a grid (n,) x (m,) lie in it, (m, n): those whose ray to the right crosses its edges oddly
        often (Jordan). Left and upper edges belong to it, right and lower ones do not.
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
    """What good prints of a job's pages with zones in force said, by which their promise is kept."""

    page_scores: tuple[float, ...]
    """Of pages as a whole, in the detector's score."""
    careful_scores: tuple[float, ...]
    """Of their careful areas, from prints other than those of the two below; none: there are no careful zones."""
    careful_mean: tuple[float, ...]
    """Of what the detector looks at there, on good prints ..."""
    careful_sd: tuple[float, ...]
    """... and how that scatters."""


@dataclass(frozen=True, kw_only=True)
class PageZones:
    """All zones of one page."""

    zones: tuple[Zone, ...]
    careful_share: float
    """Of the promised rate of false alarms, that careful areas may use. [-]"""
    calibration: Calibration | None = None
    """None: they are being priced, and nothing is promised yet."""

    @cached_property
    def kinds(self) -> frozenset[Kind]:
        """That it has."""
        return frozenset(zone.kind for zone in self.zones)

    def holds(self, kind: Kind, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Which points of a grid (n,) x (m,) count as of this kind, (m, n); see the module."""
        found = np.zeros((y_mm.size, x_mm.size), bool)
        for other in KINDS[KINDS.index(kind) :]:
            for zone in self.zones:
                if zone.kind == other:
                    held = zone.holds(x_mm, y_mm)
                    found = found | held if other == kind else found & ~held
        return found

    def ignores(self, box: Box) -> bool:
        """Whether all of a rectangle is ignored."""
        x, y, width, height = box
        across = np.linspace(x, x + width, max(int(width / SAMPLE_MM), 2))
        along = np.linspace(y, y + height, max(int(height / SAMPLE_MM), 2))
        return bool(self.holds("ignore", across, along).all())

    def at(self, x_mm: float, y_mm: float) -> Zone | None:
        """The zone that counts at a place; None: it is as any other place of the page."""
        here = [zone for zone in self.zones if zone.holds(np.array([x_mm]), np.array([y_mm]))[0, 0]]
        return max(here, key=lambda zone: KINDS.index(zone.kind), default=None)


def share_ignored(zones: PageZones, width_mm: float, height_mm: float) -> float:
    """Of a page. [-]"""
    across, along = (
        np.arange(SAMPLE_MM / 2, width_mm, SAMPLE_MM),
        np.arange(SAMPLE_MM / 2, height_mm, SAMPLE_MM),
    )
    return float(zones.holds("ignore", across, along).mean())


def contested(zones: Sequence[Zone]) -> list[tuple[Zone, Zone]]:
    """Pairs of a careful zone and an ignored one that overlap; the careful one counts."""
    found = []
    for one in zones:
        for other in zones:
            if one.kind == "careful" and other.kind == "ignore" and _overlap(one, other):
                found.append((one, other))
    return found


def _overlap(one: Zone, other: Zone) -> bool:
    (x, y, width, height), (left, top, wide, high) = one.box, other.box
    first, last = (max(x, left), max(y, top)), (min(x + width, left + wide), min(y + height, top + high))
    if first[0] >= last[0] or first[1] >= last[1]:
        return False
    step = min(SAMPLE_MM, (last[0] - first[0]) / 2, (last[1] - first[1]) / 2)
    across, along = (np.arange(a + step / 2, b, step) for a, b in zip(first, last, strict=True))
    return bool((one.holds(across, along) & other.holds(across, along)).any())
