"""Misprints that leave marks: streaks along the travel, spots and voids, scum."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.simulation.misprints.drawing import (
    ALL_INKS,
    FULL,
    Box,
    Drawn,
    Mishap,
    inks_named,
    plateau,
    rewrite,
)
from prooflight.simulation.misprints.planes import span

FULL_HEIGHT_SHARE = 0.5
"""assumed: share of streaks that run from the page's top to its end."""
STREAK_ENDS_MM = 6.0
"""assumed: distance over which other streaks begin and end."""
STREAK_FLANK = 0.5
"""assumed: width of each flank of a streak, as a share of its width, which is between the half heights."""
SUBPIXELS = 16
SCATTER_MM = (15.0, 150.0)
"""assumed: side of the area over which the spots of one print are scattered."""
SPOT_EDGE_MM = 0.15
"""assumed: distance over which a spot's edge rises; ink spreads and paper scatters light by about this."""
SPOT_WAVES = (2, 3, 4)
SPOT_UNEVEN = 0.12
"""assumed: deviation of a spot's outline from a circle, as a share of its radius."""
HICKEY_CORE = 0.5
"""assumed: diameter of the printed core of a doughnut hickey, as a share of its halo's."""
CLOUD_NODES = 96
CLOUD_EDGE = 0.6
"""assumed: distance over which a cloud thins out, as a share of its radius."""
CLOUD_GRAIN = 1 / 8
"""assumed: size of the patches in a cloud of scum, as a share of the cloud's."""
CLOUD_FLOOR = 0.4
"""assumed: ink between the patches, as a share of that in them."""


def streak(mishap: Mishap) -> Drawn:
    """Draw a soft-edged line along the travel.

    Too much of an ink (not wiped clean): of the bare paper under it the share ``ink_percent`` gets that ink
    as well. Too little: an ink (a starved nozzle) or all (a scratched blanket) lose that share.
    """
    share = mishap.amount("ink_percent") / 100
    width_mm = mishap.amount("width_mm")
    way = int(mishap.rng.integers(3))
    inks = ALL_INKS if way == 2 else mishap.one_ink()
    _, column = mishap.anywhere() if way == 0 else mishap.content(inks)
    box, profile = _line(mishap, column + float(mishap.rng.random()), width_mm)
    top, strength = _lengthwise(mishap)
    box = Box(top=top, left=box.left, bottom=top + len(strength), right=box.right)
    weight = np.float32(share) * strength[:, None] * profile
    cmyk = mishap.page.cmyk.copy()
    lay(cmyk, box, inks, weight, FULL if way == 0 else 0.0, mishap.rounding)
    what = (
        f"{share:.0%} more {inks_named(inks)}",
        f"{share:.0%} less {inks_named(inks)}, a starved nozzle",
        f"{share:.0%} less of all inks, a scratch",
    )[way]
    return mishap.drawn(f"streak {width_mm:.2f} mm wide: {what}", cmyk=cmyk, boxes=[box])


def spots_voids(mishap: Mishap) -> Drawn:
    """Draw roundish spots of one ink, voids in one ink or in all, or hickeys: voids whose core printed."""
    contrast = mishap.amount("contrast_percent") / 100
    diameter_mm = mishap.amount("diameter_mm")
    count = round(mishap.between("count"))
    way = int(mishap.rng.integers(3))
    inks = mishap.one_ink() if way == 0 else mishap.one_or_all_inks()
    side_mm = mishap.by_octaves(*SCATTER_MM)
    first = mishap.anywhere() if way == 0 else mishap.content(inks)
    area = Box.around(mishap.page, first, width_mm=side_mm, height_mm=side_mm)
    cmyk, boxes = mishap.page.cmyk.copy(), []
    for place in range(count):
        row, column = (
            first
            if place == 0
            else (
                area.top + int(mishap.rng.integers(area.shape[0])),
                area.left + int(mishap.rng.integers(area.shape[1])),
            )
        )
        size_mm = diameter_mm * (1 if place == 0 else mishap.rng.uniform(0.5, 1))
        box, mask = _spot(mishap, row, column, size_mm, core=HICKEY_CORE if way == 2 else 0.0)
        lay(cmyk, box, inks, np.float32(contrast) * mask, FULL if way == 0 else 0.0, mishap.rounding)
        boxes.append(box)
    what = ("spot", "void", "hickey")[way] + ("s" if count > 1 else "")
    detail = f"{count} {what} up to {diameter_mm:.1f} mm, {contrast:.0%} of {inks_named(inks)}"
    return mishap.drawn(detail, cmyk=cmyk, boxes=boxes)


def scum(mishap: Mishap) -> Drawn:
    """Draw a soft-edged cloud of one ink.

    The share ``ink_percent`` of the bare paper under its densest place gets it.
    """
    share = mishap.amount("ink_percent") / 100
    size_mm = mishap.between("size_mm")
    slim = 2 ** mishap.rng.uniform(-0.5, 0.5)
    inks = mishap.one_ink()
    box = Box.around(mishap.page, mishap.paper(), width_mm=size_mm * slim, height_mm=size_mm / slim)
    cloud = cv2.resize(_cloud(mishap.rng), box.shape[::-1], interpolation=cv2.INTER_LINEAR)
    cmyk = mishap.page.cmyk.copy()
    lay(cmyk, box, inks, np.float32(share) * cloud, FULL, mishap.rounding)
    detail = f"scum of {inks_named(inks)}, up to {share:.1%}, over {size_mm:.0f} mm"
    return mishap.drawn(detail, cmyk=cmyk, boxes=[box])


def lay(
    cmyk: NDArray[np.uint8],
    box: Box,
    inks: slice,
    weight: NDArray[np.float32],
    towards: float,
    rng: np.random.Generator,
) -> None:
    """Move inks by the share ``weight`` (rows, columns of the box) of the way to full ink or to none, in place."""

    def move(values: NDArray[np.float32], rows: slice) -> None:
        values += (np.float32(towards) - values) * weight[rows, :, None]

    rewrite(cmyk, box, inks, move, rng)


def _line(mishap: Mishap, centre: float, width_mm: float) -> tuple[Box, NDArray[np.float32]]:
    """Return the columns that a streak about ``centre`` [pixels] touches, and its cover of each, 0..1."""
    width = width_mm / mishap.page.pixel_mm
    half = width * (1 + STREAK_FLANK) / 2
    columns = mishap.page.cmyk.shape[1]
    left = min(max(int(np.floor(centre - half)), 0), columns - 1)
    right = max(min(int(np.ceil(centre + half)), columns), left + 1)
    at = left + (np.arange((right - left) * SUBPIXELS) + 0.5) / SUBPIXELS
    inwards = np.clip((half - np.abs(at - centre)) / (width * STREAK_FLANK), 0, 1)
    profile = (0.5 - 0.5 * np.cos(np.pi * inwards)).reshape(-1, SUBPIXELS).mean(axis=1)
    return Box(top=0, left=left, bottom=mishap.page.cmyk.shape[0], right=right), profile.astype(np.float32)


def _lengthwise(mishap: Mishap) -> tuple[int, NDArray[np.float32]]:
    """Draw the first row of a streak and its strength from there on, 0..1."""
    rows = mishap.page.cmyk.shape[0]
    if mishap.rng.random() < FULL_HEIGHT_SHARE:
        return 0, np.ones(rows, np.float32)
    top, bottom = span(mishap.rng, rows)
    return top, plateau(bottom - top, STREAK_ENDS_MM / mishap.page.pixel_mm)


def _spot(
    mishap: Mishap, row: int, column: int, diameter_mm: float, *, core: float
) -> tuple[Box, NDArray[np.float32]]:
    """Return the box of an uneven disc and its cover of each pixel, 0..1, without its core."""
    pixel, radius = mishap.page.pixel_mm, diameter_mm / 2
    reach = int(np.ceil((radius * (1 + SPOT_UNEVEN) + SPOT_EDGE_MM) / pixel)) + 1
    rows, columns = mishap.page.cmyk.shape[:2]
    box = Box(
        top=max(row - reach, 0),
        left=max(column - reach, 0),
        bottom=min(row + reach + 1, rows),
        right=min(column + reach + 1, columns),
    )
    y, x = np.ogrid[box.top - row : box.bottom - row, box.left - column : box.right - column]
    away, angle = np.hypot(x, y) * pixel, np.arctan2(y, x)
    heights = mishap.rng.dirichlet(np.ones(len(SPOT_WAVES))) * SPOT_UNEVEN
    phases = mishap.rng.uniform(0, 2 * np.pi, len(SPOT_WAVES))
    outline = radius * (
        1 + sum(h * np.cos(n * angle + p) for n, h, p in zip(SPOT_WAVES, heights, phases, strict=True))
    )
    edge = max(SPOT_EDGE_MM, pixel)
    mask = np.clip((outline - away) / edge + 0.5, 0, 1)
    if core:
        mask -= np.clip((core * outline - away) / edge + 0.5, 0, 1)
    return box, mask.astype(np.float32)


def _cloud(rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw uneven ink (nodes, nodes) that falls to 0 towards the edges; its densest place is 1."""
    grain = cv2.GaussianBlur(
        rng.standard_normal((CLOUD_NODES, CLOUD_NODES)), (0, 0), CLOUD_NODES * CLOUD_GRAIN / 2
    )
    grain = (grain - grain.min()) / np.ptp(grain)
    at = np.linspace(-1, 1, CLOUD_NODES) ** 2
    inwards = np.clip((1 - np.sqrt(at[:, None] + at)) / CLOUD_EDGE, 0, 1)
    window = 0.5 - 0.5 * np.cos(np.pi * inwards)
    cloud = window * (CLOUD_FLOOR + (1 - CLOUD_FLOOR) * grain)
    scaled: NDArray[np.float32] = (cloud / cloud.max()).astype(np.float32)
    return scaled
