"""Defects of a known size put into scans of good prints, in the words in which sensitivity is told."""

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
"""Of bare paper's light: where a page gives less, defects are of bare paper, else of solid black."""
BLUR_PIXELS: Final = 0.7
"""Of a defect's edges, by the lens. assumed, near the prototype's"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sort:
    """A sort of defect, and how its strength is told."""

    name: str
    within: Range
    unit: str


SORTS: Final = (
    Sort(name="spot", within=Range(low=0.15, high=6.0), unit="mm"),
    Sort(name="streak", within=Range(low=1.0, high=100.0), unit="%"),
    Sort(name="density", within=Range(low=1.0, high=100.0), unit="%"),
)
"""A round spot of solid ink, its diameter; a streak half a millimetre wide through the area, its ink; all inks weaker
all over the area, by what share. Spots and streaks are of solid black, or bare paper where the print gives the camera
less than half of paper's light: what nobody could see is not asked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Area:
    """Where on a page defects are put."""

    name: str
    kind: str
    """ignore, careful or normal; rest: what lies in no zone."""
    holds: Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]
    """Which points of a grid (n,) x (m,) [mm] are of it, (m, n)."""


def areas_of(zones: PageZones) -> list[Area]:
    """All zones of a page as far as they count, and the rest of it."""
    found = [Area(name=zone.name, kind=zone.kind, holds=_counted(zones, zone)) for zone in zones.zones]
    return [*found, Area(name="the rest of the page", kind="rest", holds=lambda x, y: _rest(zones, x, y))]


def _counted(
    zones: PageZones, zone: Zone
) -> Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]:
    return lambda x, y: zone.holds(x, y) & zones.holds(zone.kind, x, y)


def _rest(zones: PageZones, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.bool_]:
    found = np.ones((y.size, x.size), bool)
    for zone in zones.zones:
        found &= ~zone.holds(x, y)
    return found


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
    """A scan (sensors, lines, pixels) [DN] with a defect of a sort of ``SORTS`` somewhere in an area; None: no pixel of
    the scan is of the area. shift_mm: where the page lies less where it should.
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
        apart = np.hypot(x[near[1]] - x[columns[at]], (y[near[0]] - y[rows[at]])[:, None])
        cover[near] = disc(apart, diameter_mm=strength, pixel_mm=geometry.pixel_pitch_mm)
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
    """Whether a scan (sensors, lines, pixels) [DN] shows less than ``DARK`` of paper's light, weighed by ``cover``."""
    seen = [
        (cover * (image - sensor.column_offset_dn) / sensor.column_gain).sum() / sensor.white_dn
        for image, sensor in zip(dn, press.sensors, strict=True)
    ]
    return float(np.mean(seen)) < DARK * float(cover.sum())


def disc(apart_mm: NDArray[np.floating], *, diameter_mm: float, pixel_mm: float) -> NDArray[np.floating]:
    """Which share of pixels a disc covers whose middle lies so far from theirs: an edge one pixel wide, that leaves its
    area as it is (with its edge at the radius itself it would be larger by pi pixel^2 / 12).
    """
    edge_mm = np.sqrt(max(diameter_mm**2 / 4 - pixel_mm**2 / 12, 0.0))
    return np.clip(0.5 + (edge_mm - apart_mm) / pixel_mm, 0, 1)
