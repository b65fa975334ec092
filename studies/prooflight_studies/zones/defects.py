"""Defects drawn into the page's raster, before press and camera, where the zones' price model adds them to scans."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.zones.defects import DARK, STREAK_MM, disc
from prooflight.prediction.predict import expected_light

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.commissioning.zones.defects import Area
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel


def printed_with(
    page: Page,
    sort: str,
    strength: float,
    area: Area,
    *,
    sensors: Sequence[SensorModel],
    rng: np.random.Generator,
) -> Page | None:
    """Return a page with a defect of ``SORTS`` somewhere in an area; None: the area has no pixel on the page.

    sensors: of the camera, whose signal decides where a print is dark.
    """
    rows, columns = page.cmyk.shape[:2]
    x, y = ((np.arange(count) + 0.5) * page.pixel_mm for count in (columns, rows))
    of_area = area.holds(x, y)
    down, across = np.nonzero(of_area)
    if not down.size:
        return None
    at = int(rng.integers(down.size))
    x0, y0 = np.array([x[across[at]], y[down[at]]]) + rng.uniform(-0.5, 0.5, 2) * page.pixel_mm
    if sort == "density":
        share = of_area * (strength / 100)
    elif sort == "spot":
        distance = np.hypot(x - x0, (y - y0)[:, None])
        share = disc(distance, diameter_mm=strength, pixel_mm=page.pixel_mm)
    else:
        share = of_area * (np.abs(x - x0) <= STREAK_MM / 2) * (strength / 100)
    ink = page.cmyk.astype(np.float64)
    if sort == "density" or _dark(page.cmyk[share > 0], sensors):
        ink *= 1 - share[..., None]
    elif sort == "spot":
        here = share > 0
        ink[here, 3] = _black(page.cmyk[here], share[here], sensors[0])
    else:  # on top of the other inks: a hole in them would show white beside it where planes are out of register
        ink[..., 3] += share * (255 - ink[..., 3])
    # Tints keep their mean: a loss of 1 % of a tint is less than a step.
    cmyk = np.floor(ink + rng.random(ink.shape)).clip(0, 255).astype(np.uint8)
    cmyk[share == 0] = page.cmyk[share == 0]
    return replace(page, cmyk=cmyk)


def _black(cmyk: NDArray[np.uint8], share: NDArray[np.floating], sensor: SensorModel) -> NDArray[np.float64]:
    """Return the black ink for a share of the darkening by solid black on each pixel.

    cmyk (pixels, 4); share and the result (pixels,).
    """
    black = np.repeat(cmyk[:, None], 256, axis=1)
    black[..., 3] = np.arange(256)
    light = expected_light(black.reshape(-1, 4), sensor)[0].reshape(-1, 256)
    bare = expected_light(cmyk, sensor)[0]
    wanted = bare + share * (light[:, -1] - bare)
    return np.abs(light - wanted[:, None]).argmin(axis=1).astype(np.float64)


def _dark(cmyk: NDArray[np.uint8], sensors: Sequence[SensorModel]) -> bool:
    """Return whether pixels (pixels, 4) give the camera less than ``DARK`` of the paper's signal."""
    seen = [expected_light(cmyk, sensor)[0].mean() / sensor.white_dn for sensor in sensors]
    return bool(np.mean(seen) < DARK)
