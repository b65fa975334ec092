"""Pictures of a page and of its inspection for reports, with their positions on the page in millimetres."""

from __future__ import annotations

import io
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from prooflight.detectors.base import BLOCK_PIXELS, Inspection, PlannedPage, PressContext
from prooflight.spectra import srgb_encoded

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Region
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.placement import Placement

SATURATION = 12.0
"""Block mean, in its standard deviations, at which the colour scale ends."""
SCALE = (
    (-12.0, (158, 33, 14)),
    (-9.0, (216, 75, 27)),
    (-6.0, (247, 158, 92)),
    (-3.0, (252, 224, 198)),
    (0.0, (250, 250, 248)),
    (3.0, (214, 231, 243)),
    (6.0, (126, 182, 222)),
    (9.0, (48, 122, 186)),
    (12.0, (11, 61, 133)),
)
"""Colour scale from block means to sRGB. Darker than expected: orange to red; lighter: blue. All common
colour-vision deficiencies distinguish these two hues (Okabe and Ito 2008), and lightness falls evenly to both
ends."""
GHOST = 0.22
"""Darkness of the page's own content under the error map."""
ZOOM_MM = 12.0
"""Least side of the piece of page that a zoom shows."""
ZOOM_MARGIN_MM = 4.0
MOST_ZOOM_MM = 18.0
"""Greatest side; of a larger region only the strongest part is shown."""
LARGE_REGION_SHARE = 0.25
"""Share of the page above which a region is not zoomed."""
LEAST_CONTRAST = 0.1
"""Least range of encoded signal that a zoom's contrast is raised to fill: a smaller one would show noise
alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Part of the page that a picture shows; (0, 0) is the page's top-left corner."""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """A piece of the page at the camera's own pixels, as expected and as measured."""

    frame: Frame
    expected: bytes
    measured: bytes
    contrast: float
    """Factor by which the contrast of both is raised. [-]"""
    columns: int
    """Camera pixels across."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmPictures:
    """Expected image, camera image and error map; all three show the same frame."""

    frame: Frame
    expected: bytes
    measured: bytes
    error: bytes
    zoom: Zoom | None


def page_picture(page: Page, press: Press, *, width_px: int) -> Image.Image:
    """Draw the page as a person would see it, width_px wide; never enlarged."""
    return raster_picture(page, press.appearance_srgb, width_px=width_px)


def raster_picture(page: Page, colours: NDArray[np.uint8], *, width_px: int) -> Image.Image:
    """Draw a page as ``page_picture`` does, by the sRGB of recipes (n, n, n, n, 3)."""
    rows, columns = page.cmyk.shape[:2]
    size = _within(columns, rows, width_px)
    recipes = cv2.resize(page.cmyk, size, interpolation=cv2.INTER_AREA)
    return Image.fromarray(appearance(recipes, colours))


def appearance(cmyk: NDArray[np.uint8], table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the sRGB (rows, columns, 3) of recipes (rows, columns, 4), 4-linear in table (n, n, n, n, 3)."""
    steps = table.shape[0] - 1
    place = cmyk.reshape(-1, 4).astype(np.float32) * np.float32(steps / 255)
    cell = np.minimum(place.astype(np.intp), steps - 1)
    upper = place - cell
    lower = 1 - upper
    strides = (steps + 1) ** np.arange(3, -1, -1)
    first = cell @ strides
    colours = table.reshape(-1, 3).astype(np.float32)
    mixed = np.zeros((len(place), 3), np.float32)
    for corner in product((0, 1), repeat=4):
        weight = np.ones(len(place), np.float32)
        for ink, side in enumerate(corner):
            weight *= upper[:, ink] if side else lower[:, ink]
        mixed += weight[:, None] * colours[first + int(np.dot(corner, strides))]
    return np.rint(mixed).astype(np.uint8).reshape(*cmyk.shape[:2], 3)


def frame_of(inspection: Inspection, planned: PlannedPage) -> Frame:
    """Return the part of its page that the pictures of an inspection show."""
    return _frame(planned.page, planned.press_context, inspection.area, inspection.placement)


def _frame(page: Page, press: Press | PressContext, area: tuple[slice, slice], placement: Placement) -> Frame:
    """Return the part of a page that lines and columns of a scan show at a placement; turn and warp are neglected."""
    geometry = press.geometry
    lines, columns = area
    return Frame(
        x_mm=columns.start * geometry.pixel_pitch_mm
        - geometry.left_mm(page.width_mm)
        - placement.shift_mm[0],
        y_mm=lines.start * geometry.line_pitch_mm - geometry.lead_in_mm - placement.shift_mm[1],
        width_mm=(columns.stop - columns.start) * geometry.pixel_pitch_mm,
        height_mm=(lines.stop - lines.start) * geometry.line_pitch_mm,
    )


def signals(
    inspection: Inspection, press: Press | PressContext
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return expected and measured signal of the first sensor (lines, pixels), columns corrected; paper is 1. [-]"""
    sensor, (_, columns) = press.sensors[0], inspection.area
    offset = sensor.column_offset_dn[columns]
    scale = (1 / (sensor.column_gain[columns] * sensor.white_dn)).astype(np.float32)
    expected = (inspection.expect().expected_dn[0] - offset) * scale
    measured = (inspection.measured_dn[0].astype(np.float32) - offset) * scale
    return expected, measured


def grey_picture(signal: NDArray[np.float32], frame: Frame, *, width_px: int) -> Image.Image:
    """Draw a linear signal (lines, pixels), paper 1, for a screen; never enlarged."""
    return Image.fromarray(_bytes(srgb_encoded(_shrunk(signal, frame, width_px))))


def error_colours(z: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sRGB (..., 3), 0..255, of block means of any shape, by ``SCALE``."""
    steps = [step for step, _ in SCALE]
    colours = np.array([colour for _, colour in SCALE], np.float32)
    return np.stack([np.interp(z, steps, colours[:, channel]) for channel in range(3)], axis=-1).astype(
        np.float32
    )


def error_picture(
    block_z: NDArray[np.float32],
    expected: NDArray[np.float32],
    frame: Frame,
    *,
    width_px: int,
) -> Image.Image:
    """Draw where the page is darker (orange) or lighter (blue) than expected, over a faint image of the page itself.

    block_z (sensors, block rows, block columns): of several sensors the largest deviation is shown. expected
    (lines, pixels): signal, paper 1. frame: of ``expected``.
    """
    each = max(round(width_px * BLOCK_PIXELS / expected.shape[1]), 1)  # a whole number of pixels to a block
    ghost = srgb_encoded(_shrunk(expected, frame, round(expected.shape[1] * each / BLOCK_PIXELS)))
    full = np.zeros(ghost.shape, np.float32)
    strongest = np.take_along_axis(block_z, np.abs(block_z).argmax(axis=0)[None], axis=0)[0]
    rows, columns = (
        round(blocks * BLOCK_PIXELS / pixels * extent)
        for blocks, pixels, extent in zip(strongest.shape, expected.shape, ghost.shape, strict=True)
    )
    if rows and columns:
        full[:rows, :columns] = cv2.resize(strongest, (columns, rows), interpolation=cv2.INTER_NEAREST)
    colours = error_colours(full)
    # The page's image fades where there is an error, so that ink under it cannot change the colour's meaning.
    clear = np.maximum(1 - np.abs(full) / SATURATION, 0)
    colours *= (1 - GHOST * clear * (1 - ghost))[..., None]
    return Image.fromarray(np.rint(colours).astype(np.uint8))


def alarm_pictures(
    page: Page, inspection: Inspection, press: Press, *, place: Region | None, width_px: int = 720
) -> AlarmPictures:
    """Draw all pictures of one inspection that a person should see. place: region to enlarge."""
    frame = _frame(page, press, inspection.area, inspection.placement)
    return pictures_of(*signals(inspection, press), inspection.block_z, frame, place=place, width_px=width_px)


def pictures_of(
    expected: NDArray[np.float32],
    measured: NDArray[np.float32],
    block_z: NDArray[np.float32],
    frame: Frame,
    *,
    place: Region | None,
    width_px: int = 720,
) -> AlarmPictures:
    """Draw expected and measured signal (lines, pixels), paper 1, and block means as ``error_picture``."""
    return AlarmPictures(
        frame=frame,
        expected=encoded(grey_picture(expected, frame, width_px=width_px)),
        measured=encoded(grey_picture(measured, frame, width_px=width_px)),
        error=encoded(error_picture(block_z, expected, frame, width_px=width_px)),
        zoom=None if place is None else zoom(place, block_z, expected, measured, frame),
    )


def zoom(
    region: Region,
    block_z: NDArray[np.float32],
    expected: NDArray[np.float32],
    measured: NDArray[np.float32],
    frame: Frame,
) -> Zoom | None:
    """Draw the region's strongest block at the camera's own pixels; None if the region is a large part of the page."""
    if region.width_mm * region.height_mm > LARGE_REGION_SHARE * frame.width_mm * frame.height_mm:
        return None
    lines, pixels = expected.shape
    pitch_x, pitch_y = frame.width_mm / pixels, frame.height_mm / lines
    x_mm, y_mm = _strongest_place(region, block_z, frame, pitch_x, pitch_y)
    sides = [max(extent + 2 * ZOOM_MARGIN_MM, ZOOM_MM) for extent in (region.width_mm, region.height_mm)]
    most = min(*sides, MOST_ZOOM_MM) if max(sides) > MOST_ZOOM_MM else MOST_ZOOM_MM
    middle_x = region.x_mm - frame.x_mm + region.width_mm / 2 if sides[0] <= most else x_mm
    middle_y = region.y_mm - frame.y_mm + region.height_mm / 2 if sides[1] <= most else y_mm
    across = _window(middle_x, min(sides[0], most), pitch_x, pixels)
    along = _window(middle_y, min(sides[1], most), pitch_y, lines)
    pair = [srgb_encoded(image[along, across]) for image in (expected, measured)]
    calm = [cv2.GaussianBlur(image, (0, 0), 1.0) for image in pair]
    low, high = float(np.min(calm)), float(np.max(calm))
    spread = min(max(high - low, LEAST_CONTRAST), 1.0)
    low = min(max((low + high - spread) / 2, 0.0), 1.0 - spread)
    expected_bytes, measured_bytes = (
        encoded(Image.fromarray(_bytes((image - low) / spread)), lossless=True) for image in pair
    )
    return Zoom(
        frame=Frame(
            x_mm=frame.x_mm + across.start * pitch_x,
            y_mm=frame.y_mm + along.start * pitch_y,
            width_mm=(across.stop - across.start) * pitch_x,
            height_mm=(along.stop - along.start) * pitch_y,
        ),
        expected=expected_bytes,
        measured=measured_bytes,
        contrast=1 / spread,
        columns=across.stop - across.start,
    )


def encoded(image: Image.Image, *, lossless: bool = False, quality: int = 78) -> bytes:
    """Encode an image as WebP."""
    file = io.BytesIO()
    image.save(file, "WEBP", lossless=lossless, quality=quality, method=4)
    return file.getvalue()


def _strongest_place(
    region: Region, block_z: NDArray[np.float32], frame: Frame, pitch_x: float, pitch_y: float
) -> tuple[float, float]:
    """Return the centre of the region's block with the largest deviation, from the frame's corner. [mm]"""
    block_x, block_y = BLOCK_PIXELS * pitch_x, BLOCK_PIXELS * pitch_y
    _, rows, columns = block_z.shape
    if not rows or not columns:
        return frame.width_mm / 2, frame.height_mm / 2
    left = min(max(round((region.x_mm - frame.x_mm) / block_x), 0), columns - 1)
    top = min(max(round((region.y_mm - frame.y_mm) / block_y), 0), rows - 1)
    width, height = max(round(region.width_mm / block_x), 1), max(round(region.height_mm / block_y), 1)
    inside = np.abs(block_z[:, top : top + height, left : left + width]).max(axis=0)
    row, column = np.unravel_index(inside.argmax(), inside.shape)
    return (left + column + 0.5) * block_x, (top + row + 0.5) * block_y


def _window(centre_mm: float, side_mm: float, pitch_mm: float, pixels: int) -> slice:
    """Return the pixels of a zoom along one axis, moved into the frame where it would extend beyond."""
    count = min(max(round(side_mm / pitch_mm), 1), pixels)
    first = min(max(round(centre_mm / pitch_mm - count / 2), 0), pixels - count)
    return slice(first, first + count)


def _within(columns: int, rows: int, width_px: int) -> tuple[int, int]:
    width = max(min(width_px, columns), 1)
    return width, max(round(rows * width / columns), 1)


def _shrunk(signal: NDArray[np.float32], frame: Frame, width_px: int) -> NDArray[np.float32]:
    """Reduce a signal to width_px, with square pixels on paper; never enlarged across."""
    width = max(min(width_px, signal.shape[1]), 1)
    height = max(round(width * frame.height_mm / frame.width_mm), 1)
    shrunk: NDArray[Any] = cv2.resize(signal, (width, height), interpolation=cv2.INTER_AREA)
    return shrunk


def _bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
