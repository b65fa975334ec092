"""Tiles of a sheet: the expected page, with the stored parts of the scan at their positions."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import cv2
import numpy as np
from PIL import Image, WebPImagePlugin  # noqa: F401 (else Pillow loads all its formats with the first tile)

from prooflight.reporting.pictures import SATURATION, error_colours
from prooflight.spectra import srgb_encoded
from prooflight_console.pictures.expected import TILE, Pyramid, size_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

Layer = Literal["scan", "expected", "difference"]
LAYERS: Final[tuple[Layer, ...]] = ("scan", "expected", "difference")
GHOST: Final = 0.30
"""Contrast of the expected page where no scan is stored."""
STRONG: Final = 0.25
"""Difference at the end of the colour scale, as a share of bare paper's light."""
MOST_CUTS: Final = 16
REACH: Final = 10
"""Search range in pixels: a millimetre at the prototype's pitch, by which paper distorts."""
FLAT: Final = 0.02
"""Least standard deviation of the page, as a share of paper's light, for a match to be defined."""
QUALITY: Final = 82
_SHOWN: Final = srgb_encoded(np.linspace(0, 1, 4097)).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cut:
    """A stored part of the scan."""

    signal: NDArray[np.float32]
    """(lines, pixels), bare paper 1."""
    box_mm: tuple[float, float, float, float]
    """x, y, width and height on the page as printed."""


def cuts_of(
    evidence: Mapping[str, NDArray[Any]] | None,
    press: Press | None,
    *,
    page_width_mm: float | None,
    shift_mm: tuple[float, float] | None,
) -> tuple[Cut, ...]:
    """Return the stored cuts of the first sensor; without a press the brightest of each counts as paper."""
    cuts = []
    for index in range(MOST_CUTS):
        stored, where = ((evidence or {}).get(f"cut{index}{end}") for end in ("", "_mm"))
        if stored is None or where is None:
            break
        box = np.asarray(where, float).ravel()
        if (
            stored.ndim != 3
            or not stored.size
            or box.size != 4
            or not np.isfinite(box).all()
            or min(box[2:]) <= 0
        ):
            continue
        x, y, width, height = (float(part) for part in box)
        light = stored[0].astype(np.float32)
        signal = signal_of(light, (x, width), press, page_width_mm=page_width_mm, shift_mm=shift_mm)
        cuts.append(Cut(signal=signal, box_mm=(x, y, width, height)))
    return tuple(cuts)


def signal_of(
    light: NDArray[np.float32],
    across_mm: tuple[float, float],
    press: Press | None,
    *,
    page_width_mm: float | None,
    shift_mm: tuple[float, float] | None,
) -> NDArray[np.float32]:
    """Return a part of the first sensor's scan (lines, pixels) [DN] as signal, bare paper 1.

    across_mm: x on the page as printed, and width. Without press or page the brightest is taken for paper.
    """
    if press is None or page_width_mm is None:
        return np.asarray(light / max(float(np.percentile(light, 99.5)), 1.0), np.float32)
    sensor, geometry = press.sensors[0], press.geometry
    off_mm = geometry.left_mm(page_width_mm) + (shift_mm or (0.0, 0.0))[0]
    first = round((across_mm[0] + off_mm) / geometry.pixel_pitch_mm)
    step = max(round(across_mm[1] / geometry.pixel_pitch_mm / light.shape[1]), 1)  # halved: 2
    columns = np.clip(first + step * np.arange(light.shape[1]), 0, geometry.pixels - 1)
    scale = sensor.column_gain[columns] * sensor.white_dn
    return np.asarray((light - sensor.column_offset_dn[columns]) / scale, np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetPicture:
    """Data from which the pictures of one sheet are drawn."""

    width: int
    """Pixels of the highest level across."""
    height: int
    width_mm: float
    height_mm: float
    levels: int
    cuts: tuple[Cut, ...]
    expected: Pyramid | None
    """Expected image; None if the page is unknown, and the cuts are drawn on an empty one."""
    seen: Pyramid | None = None
    """The whole scan on the grid of ``expected``, where all of it was kept."""
    coming: bool = False
    """Whether ``expected`` or ``seen`` is being made."""

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Layers that exist."""
        if self.expected is None:
            return ("scan",) if self.cuts else ()
        return LAYERS if self.cuts or self.seen is not None else ("expected",)

    def tile(self, layer: Layer, level: int, column: int, row: int) -> bytes | None:
        """Return a tile as WebP; None if there is none at that position."""
        if not 0 <= level < self.levels or layer not in self.layers:
            return None
        width, height = (size_at(extent, level, self.levels) for extent in (self.width, self.height))
        left, top = column * TILE, row * TILE
        if left >= width or top >= height:
            return None
        shape = min(TILE, height - top), min(TILE, width - left)
        pyramid = self.expected
        expected = np.ones(shape, np.float32) if pyramid is None else pyramid.part(level, left, top, TILE)
        if self.seen is not None and layer != "expected":
            seen = self.seen.part(level, left, top, TILE)
            return encoded(grey(seen) if layer == "scan" else difference(seen, expected))
        return encoded(self._drawn(layer, expected, (left, top), 2.0 ** (level - self.levels + 1)))

    def _drawn(
        self, layer: Layer, expected: NDArray[np.float32], corner: tuple[int, int], scale: float
    ) -> NDArray[np.uint8]:
        """Draw a layer: (lines, pixels) grey, or (lines, pixels, 3). corner: left and top [pixels]."""
        if layer == "expected":
            return grey(expected)
        ghost = 1 - GHOST * (1 - shown(expected))
        seen = np.full(expected.shape, np.nan, np.float32)
        for cut in self.cuts:
            self._lay(cut, seen, corner, scale)
        there = np.isfinite(seen)
        if layer == "scan":
            light = np.where(there, shown(np.nan_to_num(seen)), ghost)
            return np.asarray(np.rint(255 * light).astype(np.uint8))
        off = np.where(there, cv2.GaussianBlur(np.where(there, seen - expected, 0), (0, 0), 0.8), 0)
        colours = error_colours(np.asarray(off * (SATURATION / STRONG), np.float32))
        colours *= np.where(there, 1.0, ghost)[..., None]
        return np.asarray(np.rint(colours).astype(np.uint8))

    def _lay(self, cut: Cut, into: NDArray[np.float32], corner: tuple[int, int], scale: float) -> None:
        """Draw a cut into a tile at its position."""
        across, down = self.width / self.width_mm * scale, self.height / self.height_mm * scale
        lines, pixels = cut.signal.shape
        x, y, width, height = cut.box_mm
        left, top = x * across - corner[0], y * down - corner[1]
        first = max(int(np.floor(left)), 0), max(int(np.floor(top)), 0)
        last = (
            min(int(np.ceil(left + width * across)), into.shape[1]),
            min(int(np.ceil(top + height * down)), into.shape[0]),
        )
        if first[0] >= last[0] or first[1] >= last[1]:
            return
        source = cut.signal
        step = width * across / pixels
        if step < 0.75:  # average before resampling, against aliasing
            source = cv2.resize(
                source,
                (max(round(pixels * step), 1), max(round(lines * step), 1)),
                interpolation=cv2.INTER_AREA,
            ).reshape(max(round(lines * step), 1), max(round(pixels * step), 1))
        stretch_x, stretch_y = source.shape[1] / (width * across), source.shape[0] / (height * down)
        columns = (np.arange(first[0], last[0]) + 0.5 - left) * stretch_x - 0.5
        rows = (np.arange(first[1], last[1]) + 0.5 - top) * stretch_y - 0.5
        grid = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
        drawn = cv2.remap(source, grid[0], grid[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        into[first[1] : last[1], first[0] : last[0]] = drawn


def difference(seen: NDArray[np.float32], expected: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the difference in colour, (lines, pixels, 3), where both signals are known everywhere."""
    off = cv2.GaussianBlur(seen - expected, (0, 0), 0.8)
    return np.asarray(
        np.rint(error_colours(np.asarray(off * (SATURATION / STRONG), np.float32))).astype(np.uint8)
    )


def aligned(cut: Cut, expected: Pyramid) -> Cut:
    """Return the cut where it matches the page best, within ``REACH`` pixels.

    The verdict gives the position of the page as a whole; paper stretches and turns besides.
    """
    scale = expected.width / expected.width_mm, expected.height / expected.height_mm
    left, top = (cut.box_mm[axis] * scale[axis] for axis in (0, 1))
    first = round(left) - REACH, round(top) - REACH
    lines, pixels = cut.signal.shape
    begin = max(first[0], 0), max(first[1], 0)
    side = max(lines, pixels) + 2 * REACH + 1
    around = expected.part(expected.levels - 1, *begin, side)[: lines + 2 * REACH, : pixels + 2 * REACH]
    if around.shape[0] < lines or around.shape[1] < pixels or float(around.std()) < FLAT:
        return cut
    off = cv2.matchTemplate(around, np.minimum(cut.signal, 1), cv2.TM_SQDIFF)
    row, column = np.unravel_index(int(off.argmin()), off.shape)
    x = begin[0] + column + valley(off[row], int(column))
    y = begin[1] + row + valley(off[:, column], int(row))
    return Cut(signal=cut.signal, box_mm=(x / scale[0], y / scale[1], *cut.box_mm[2:]))


def valley(values: NDArray[np.float32], at: int) -> float:
    """Return the minimum of the parabola through three values, relative to the middle one."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, here, after = (float(value) for value in values[at - 1 : at + 2])
    bend = before - 2 * here + after
    return 0.0 if bend <= 0 else 0.5 * (before - after) / bend


def thumbnail(cuts: Sequence[Cut], *, side: int) -> bytes | None:
    """Return the first cut as a square picture; None if there is none."""
    if not cuts:
        return None
    signal = cuts[0].signal
    lines, pixels = signal.shape
    scale = side / min(lines, pixels)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    size = max(round(pixels * scale), side), max(round(lines * scale), side)
    drawn = cv2.resize(signal, size, interpolation=how).reshape(size[1], size[0])
    top, left = (size[1] - side) // 2, (size[0] - side) // 2
    return encoded(grey(drawn[top : top + side, left : left + side]))


def grey(signal: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a signal as grey values for a screen."""
    return np.asarray(np.rint(255 * shown(signal)).astype(np.uint8))


def shown(signal: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``srgb_encoded`` of 0..1 by a table: a tile has a quarter of a million pixels."""
    return np.asarray(_SHOWN[(np.clip(signal, 0, 1) * (_SHOWN.size - 1)).astype(np.intp)])


def encoded(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as WebP."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()
