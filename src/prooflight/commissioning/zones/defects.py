"""Defects of a known size in scans of good prints, in the terms in which sensitivity is reported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.commissioning.zones.caught import Range

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones, Zone
    from prooflight.press.artefact import Press

STREAK_MM: Final = 0.5
DARK: Final = 0.5
"""Share of bare paper's light below which defects are of bare paper, else of solid black."""
BLUR_PIXELS: Final = 0.7
"""Blur of a defect's edges, by the lens. assumed, near the prototype's"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sort:
    """Sort of defect, with the range and unit of its strength."""

    name: str
    within: Range
    unit: str


SORTS: Final = (
    Sort(name="spot", within=Range(low=0.15, high=6.0), unit="mm"),
    Sort(name="streak", within=Range(low=1.0, high=100.0), unit="%"),
    Sort(name="density", within=Range(low=1.0, high=100.0), unit="%"),
)
"""Sorts of defect.

Spot: a round spot of solid ink; its strength is the diameter. Streak: half a millimetre wide through the
area; its strength is the ink. Density: all inks weaker all over the area; its strength is the share. Spots
and streaks are of solid black, or bare paper where the print gives the camera less than half of paper's
light, so that they are visible.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Area:
    """Area of a page in which defects are put."""

    name: str
    kind: str
    """Kind of zone: ignore, careful or normal; rest: the page outside all zones."""
    holds: Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]
    """Function that returns which points of a grid (n,) x (m,) [mm] are in the area, (m, n)."""


def areas_of(zones: PageZones) -> list[Area]:
    """Return all zones of a page as far as they count, and the rest of it."""
    areas = [Area(name=zone.name, kind=zone.kind, holds=_counted(zones, zone)) for zone in zones.zones]
    return [*areas, Area(name="the rest of the page", kind="rest", holds=lambda x, y: _rest(zones, x, y))]


def _counted(
    zones: PageZones, zone: Zone
) -> Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]:
    return lambda x, y: zone.holds(x, y) & zones.holds(zone.kind, x, y)


def _rest(zones: PageZones, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.bool_]:
    outside = np.ones((y.size, x.size), bool)
    for zone in zones.zones:
        outside &= ~zone.holds(x, y)
    return outside


def with_defect(
    dn: NDArray[np.uint16],
    sort: str,
    strength: float,
    area: Area,
    *,
    page: Page,
    press: Press,
    shift_mm: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.uint16] | None:
    """Return a scan (sensors, lines, pixels) [DN] with a defect of a sort of ``SORTS`` somewhere in an area.

    None: no pixel of the scan is in the area. shift_mm: displacement of the page.
    """
    geometry = press.geometry
    x = geometry.centres_x_mm(page.width_mm, shift_mm=shift_mm[0])
    y = geometry.centres_y_mm(dn.shape[1], shift_mm=shift_mm[1])
    on_page = (y > 0)[:, None] & (y < page.height_mm)[:, None] & (x > 0) & (x < page.width_mm)
    of_area = area.holds(x, y) & on_page
    rows, columns = np.nonzero(of_area)
    if not rows.size:
        return None
    at = int(rng.integers(rows.size))
    cover = np.zeros(of_area.shape, np.float32)
    if sort == "spot":
        reach = max(int(strength / geometry.pixel_pitch_mm) + 4, 4)
        near = tuple(slice(max(one[at] - reach, 0), one[at] + reach + 1) for one in (rows, columns))
        distance_mm = np.hypot(x[near[1]] - x[columns[at]], (y[near[0]] - y[rows[at]])[:, None])
        cover[near] = disc(distance_mm, diameter_mm=strength, pixel_mm=geometry.pixel_pitch_mm)
    elif sort == "streak":
        across = np.clip(0.5 + (STREAK_MM / 2 - np.abs(x - x[columns[at]])) / geometry.pixel_pitch_mm, 0, 1)
        cover[...] = of_area * across * (strength / 100)
    else:
        cover[...] = of_area
    cover = cv2.GaussianBlur(cover, (0, 0), BLUR_PIXELS)
    changed = dn.astype(np.float32)
    dark = sort != "density" and _dark(changed, cover, press)
    for image, sensor in zip(changed, press.sensors, strict=True):
        offset, gain = sensor.column_offset_dn, sensor.column_gain
        if sort == "density":
            light = np.maximum((image - offset) / gain, 1.0)
            paper = np.maximum(light, np.float32(sensor.white_dn))
            image[...] = light * (paper / light) ** (cover * np.float32(strength / 100)) * gain + offset
        else:
            there = np.float32(sensor.white_dn if dark else sensor.mean_dn[0, 0, 0, -1]) * gain + offset
            image += cover * (there - image)
    top = np.array([sensor.top_code_dn for sensor in press.sensors], np.float32)[:, None, None]
    return np.clip(np.rint(changed), 0, top).astype(np.uint16)


def _dark(dn: NDArray[np.float32], cover: NDArray[np.float32], press: Press) -> bool:
    """Return whether a scan (sensors, lines, pixels) [DN] shows less than ``DARK`` of paper's light under ``cover``."""
    seen = [
        (cover * (image - sensor.column_offset_dn) / sensor.column_gain).sum() / sensor.white_dn
        for image, sensor in zip(dn, press.sensors, strict=True)
    ]
    return float(np.mean(seen)) < DARK * float(cover.sum())


def disc(distance_mm: NDArray[np.floating], *, diameter_mm: float, pixel_mm: float) -> NDArray[np.floating]:
    """Return the share of each pixel that a disc covers, from the distances of its centre to theirs.

    The edge is one pixel wide and leaves the disc's area as it is (with its edge at the radius itself it
    would be larger by pi pixel^2 / 12).
    """
    edge_mm = np.sqrt(max(diameter_mm**2 / 4 - pixel_mm**2 / 12, 0.0))
    return np.clip(0.5 + (edge_mm - distance_mm) / pixel_mm, 0, 1)
