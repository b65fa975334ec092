"""Tiles of a sheet: the stored parts of its scan and nothing else, the expected page, and the difference of both."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

import cv2
import numpy as np
from PIL import Image, WebPImagePlugin  # noqa: F401 (else Pillow loads all its formats with the first tile)

from prooflight.reporting.pictures import SATURATION, error_colours
from prooflight_console.pictures.expected import FULL, TILE, Pyramid, size_at
from prooflight_line.journal.cuts import inside, shown, stretched

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Region
    from prooflight_line.journal.cuts import Cut

Layer = Literal["scan", "expected", "difference"]
LAYERS: Final[tuple[Layer, ...]] = ("scan", "expected", "difference")
UNSEEN: Final = 65_535 / FULL
"""Signal that stands for no scan; ink and paper give less."""
UNSEEN_GREY: Final = 150
"""Grey of the screen where no scan is stored: darker than the ground of the viewer, lighter than ink."""
STRONG: Final = 0.25
"""Difference at the end of the colour scale, as a share of bare paper's light."""
REACH: Final = 10
"""Search range in pixels: a millimetre at the prototype's pitch, by which paper distorts."""
FLAT: Final = 0.02
"""Least standard deviation of the page, as a share of paper's light, for a match to be defined."""
AROUND_DEFECT_MM: Final = 0.5
"""Margin of a defect that is left out of a match: its edges are soft."""
LEAST_SOUND: Final = 0.1
"""Least share of a cut, without its defect, that is matched: of less, the place of the verdict is kept."""
QUALITY: Final = 82


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

    def moved_mm(self, regions: int) -> list[tuple[float, float]]:
        """Return by how much each of the verdict's regions moves with its cut. [mm]"""
        moved = {cut.region: cut.moved_mm for cut in self.cuts}
        return [moved.get(index, (0.0, 0.0)) for index in range(regions)]

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
        else:
            seen = np.full(expected.shape, UNSEEN, np.float32)
            for cut in self.cuts:
                self._lay(cut, seen, (left, top), 2.0 ** (level - self.levels + 1))
        return encoded(drawn(layer, seen, expected))

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


def drawn(layer: Layer, seen: NDArray[np.float32], expected: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Draw a layer: (lines, pixels) grey, or (lines, pixels, 3); ``UNSEEN_GREY`` where ``seen`` is ``UNSEEN``."""
    if layer == "expected":
        return grey(expected)
    there = seen < (1 + UNSEEN) / 2
    if layer == "scan":
        return np.where(there, grey(seen), np.uint8(UNSEEN_GREY))
    off = cv2.GaussianBlur(np.where(there, seen - expected, np.float32(0)), (0, 0), 0.8)
    colours = error_colours(np.asarray(off * (SATURATION / STRONG), np.float32))
    return np.where(there[..., None], np.rint(colours), UNSEEN_GREY).astype(np.uint8)


def aligned(cut: Cut, expected: Pyramid, region: Region | None = None) -> Cut:
    """Return the cut where it matches the page best, within ``REACH`` pixels.

    The verdict gives the position of the page as a whole; paper stretches and turns besides. What is around the defect
    decides: a spot would be matched with a letter. region: the defect; None: the cut has none.
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
    sound = np.ones((lines, pixels), np.float32)
    if region is not None:
        sound[inside(cut, region, margin_mm=AROUND_DEFECT_MM)] = 0
    there = sound > 0
    if there.mean() < LEAST_SOUND or float(cut.signal[there].std()) < FLAT:
        return cut
    off = cv2.matchTemplate(around, np.minimum(cut.signal, 1), cv2.TM_SQDIFF, mask=sound)
    row, column = np.unravel_index(int(off.argmin()), off.shape)
    x = begin[0] + column + valley(off[row], int(column))
    y = begin[1] + row + valley(off[:, column], int(row))
    corner = x / scale[0], y / scale[1]
    moved = corner[0] - cut.box_mm[0], corner[1] - cut.box_mm[1]
    return replace(cut, box_mm=(*corner, *cut.box_mm[2:]), moved_mm=moved)


def valley(values: NDArray[np.float32], at: int) -> float:
    """Return the minimum of the parabola through three values, relative to the middle one."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, here, after = (float(value) for value in values[at - 1 : at + 2])
    bend = before - 2 * here + after
    return 0.0 if bend <= 0 else 0.5 * (before - after) / bend


def thumbnail(cuts: Sequence[Cut], regions: Sequence[Region], *, side: int) -> bytes | None:
    """Return the first cut as a square picture, stretched to its defect's contrast; None if there is no cut."""
    if not cuts:
        return None
    cut = cuts[0]
    region = regions[cut.region] if cut.region is not None and cut.region < len(regions) else None
    signal = stretched(cut, region)
    lines, pixels = signal.shape
    scale = side / min(lines, pixels)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    size = max(round(pixels * scale), side), max(round(lines * scale), side)
    resized = cv2.resize(signal, size, interpolation=how).reshape(size[1], size[0])
    top, left = (size[1] - side) // 2, (size[0] - side) // 2
    part = np.clip(resized[top : top + side, left : left + side], 0, 1)
    return encoded(np.asarray(np.rint(255 * part).astype(np.uint8)))


def grey(signal: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a signal as grey values for a screen."""
    return np.asarray(np.rint(255 * shown(signal)).astype(np.uint8))


def encoded(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture as WebP."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()
