"""Page being drawn: lengths in millimetres from its top-left corner, ink straight into the CMYK raster.

A pixel is ink or paper: nothing is anti-aliased. Lines thinner than a pixel are drawn one pixel wide, as a
RIP does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from prooflight.pages.raster import MM_PER_INCH
from prooflight.simulation.corpus.designs.inks import BLACK, Ink

if TYPE_CHECKING:
    from prooflight.simulation.corpus.designs.faces import Face

MM_PER_PT = MM_PER_INCH / 72
_SUBPIXEL_BITS = 4
_LARGEST_COORDINATE = 2**26  # OpenCV's fixed point holds 32 bits


class Sheet:
    """Raster with its drawing operations."""

    def __init__(self, *, width_mm: float, height_mm: float, dpi: float) -> None:
        self.width_mm, self.height_mm = width_mm, height_mm
        self.per_mm = dpi / MM_PER_INCH
        shape = (round(height_mm * self.per_mm), round(width_mm * self.per_mm), 4)
        self.cmyk = np.zeros(shape, np.uint8)
        self._packed = self.cmyk.view(np.uint32)[..., 0]  # four inks in one assignment

    def _px(self, mm: float) -> int:
        return round(mm * self.per_mm)

    def _box(self, x: float, y: float, width: float, height: float) -> tuple[slice, slice]:
        """Return rows and columns on the page of a box; at least one pixel of a box that is not empty."""
        top, left = self._px(y), self._px(x)
        bottom, right = max(self._px(y + height), top + 1), max(self._px(x + width), left + 1)
        rows, columns = self.cmyk.shape[:2]
        return slice(max(top, 0), min(max(bottom, 0), rows)), slice(max(left, 0), min(max(right, 0), columns))

    def rect(self, x: float, y: float, width: float, height: float, ink: Ink) -> None:
        """Draw a filled rectangle."""
        self._packed[self._box(x, y, width, height)] = _pack(ink)

    def frame(self, x: float, y: float, width: float, height: float, ink: Ink, line_pt: float = 0.5) -> None:
        """Draw the outline of a rectangle, the line's middle on its edges."""
        line = line_pt * MM_PER_PT
        for top in (y, y + height):
            self.rect(x - line / 2, top - line / 2, width + line, line, ink)
        for left in (x, x + width):
            self.upright(left, y, height, ink, line_pt)

    def rule(self, x: float, y: float, length: float, ink: Ink = BLACK, line_pt: float = 0.5) -> None:
        """Draw a level line to the right of (x, y)."""
        line = line_pt * MM_PER_PT
        self.rect(x, y - line / 2, length, line, ink)

    def upright(self, x: float, y: float, length: float, ink: Ink = BLACK, line_pt: float = 0.5) -> None:
        """Draw a line down from (x, y)."""
        line = line_pt * MM_PER_PT
        self.rect(x - line / 2, y, line, length, ink)

    def polygon(self, points_mm: ArrayLike, ink: Ink) -> None:
        """Draw a filled polygon, points (n, 2)."""
        cv2.fillPoly(self.cmyk, [self._fixed(points_mm)], ink, cv2.LINE_8, _SUBPIXEL_BITS)

    def line(
        self, points_mm: ArrayLike, ink: Ink = BLACK, line_pt: float = 0.5, *, closed: bool = False
    ) -> None:
        """Draw a line through points (n, 2), with round joints."""
        weight = max(round(line_pt * MM_PER_PT * self.per_mm), 1)
        cv2.polylines(self.cmyk, [self._fixed(points_mm)], closed, ink, weight, cv2.LINE_8, _SUBPIXEL_BITS)

    def ellipse(
        self,
        x: float,
        y: float,
        across: float,
        down: float,
        ink: Ink,
        *,
        line_pt: float = 0.0,
        turn_deg: float = 0.0,
        from_deg: float = 0.0,
        to_deg: float = 360.0,
    ) -> None:
        """Draw an ellipse of half axes ``across`` and ``down`` about (x, y), or a sector of it.

        line_pt 0: filled.
        """
        angle = np.deg2rad(np.linspace(from_deg, to_deg, 73))
        ring = np.stack([across * np.cos(angle), down * np.sin(angle)], axis=1)
        turn = np.deg2rad(turn_deg)
        points = ring @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + (x, y)
        whole = to_deg - from_deg >= 360.0
        if line_pt:
            self.line(points, ink, line_pt, closed=whole)
        else:
            self.polygon(points if whole else [*points.tolist(), (x, y)], ink)

    def disc(self, x: float, y: float, radius: float, ink: Ink) -> None:
        """Draw a filled disc."""
        self.ellipse(x, y, radius, radius, ink)

    def _fixed(self, points_mm: ArrayLike) -> NDArray[np.int32]:
        points = (np.asarray(points_mm, np.float64) * self.per_mm - 0.5) * 2**_SUBPIXEL_BITS
        return np.rint(np.clip(points, -_LARGEST_COORDINATE, _LARGEST_COORDINATE)).astype(np.int32)

    def picture(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        cmyk: NDArray[np.uint8],
        *,
        round_: bool = False,
    ) -> None:
        """Draw an image (rows, columns, 4) stretched over a box: averaged where it shrinks, else interpolated."""
        top, left = self._px(y), self._px(x)
        tall, wide = max(self._px(y + height) - top, 1), max(self._px(x + width) - left, 1)
        how = cv2.INTER_AREA if wide < cmyk.shape[1] else cv2.INTER_LINEAR
        seen = cv2.resize(cmyk, (wide, tall), interpolation=how)
        rows, columns = self._box(x, y, width, height)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        part = seen[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
        if not round_:
            self.cmyk[rows, columns] = part
            return
        disc = np.zeros((tall, wide), np.uint8)
        cv2.ellipse(disc, (wide // 2, tall // 2), (wide // 2, tall // 2), 0, 0, 360, 1, -1)
        inside = disc[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] > 0
        self.cmyk[rows, columns][inside] = part[inside]

    def blend(
        self, x: float, y: float, width: float, height: float, start: Ink, end: Ink, *, turn_deg: float = 90.0
    ) -> None:
        """Draw a gradient over a box; turn_deg 0 runs to the right, 90 down."""
        turn = np.deg2rad(turn_deg)
        down, across = np.mgrid[0:65, 0:65].astype(np.float32) / 64 - 0.5
        share = across * np.cos(turn) + down * np.sin(turn)
        share = (share - share.min()) / (share.max() - share.min())
        cmyk = (
            np.array(start, np.float32) * (1 - share[..., None])
            + np.array(end, np.float32) * share[..., None]
        )
        top, left = self._px(y), self._px(x)
        size = max(self._px(x + width) - left, 1), max(self._px(y + height) - top, 1)
        smooth = cv2.resize(cmyk, size, interpolation=cv2.INTER_LINEAR)
        self.picture(x, y, width, height, np.rint(smooth).astype(np.uint8))

    def draw_text(
        self,
        x: float,
        y: float,
        text: str,
        face: Face,
        size_pt: float,
        ink: Ink = BLACK,
        *,
        align: str = "left",
        spread_em: float = 0.0,
    ) -> float:
        """Draw one line of type with its baseline at y and return its length. [mm]

        align: position of x, ``left``, ``centre`` or ``right``. Type in black alone is printed over what lies
        below.
        """
        size_mm = size_pt * MM_PER_PT
        length = size_mm * (sum(map(face.advance, text)) + spread_em * max(len(text) - 1, 0))
        pen = x - {"left": 0.0, "centre": length / 2, "right": length}[align]
        size_px, baseline, packed = size_mm * self.per_mm, self._px(y), _pack(ink)
        over = ink == BLACK
        for letter in text:
            glyph = face.glyph(self._set(letter, size_pt), size_px)
            self._stamp(glyph.mask, self._px(pen) + glyph.left, baseline + glyph.top, packed, over=over)
            pen += size_mm * (face.advance(letter) + spread_em)
        return length

    def turned_text(
        self, x: float, y: float, text: str, face: Face, size_pt: float, ink: Ink = BLACK
    ) -> None:
        """Draw one line of type running up from (x, y), its baseline on the right."""
        size_mm = size_pt * MM_PER_PT
        size_px, packed, pen = size_mm * self.per_mm, _pack(ink), 0.0
        for letter in text:
            glyph = face.glyph(self._set(letter, size_pt), size_px)
            left, top = self._px(x) + glyph.top, self._px(y - pen) - glyph.left - glyph.mask.shape[1]
            self._stamp(np.rot90(glyph.mask), left, top, packed, over=ink == BLACK)
            pen += size_mm * face.advance(letter)

    def _set(self, letter: str, size_pt: float) -> str:
        """Return the letter whose glyph is drawn in place of one of the text.

        A subclass that simulates a typo returns another.
        """
        return letter

    def modules(self, x: float, y: float, side: float, dark: NDArray[np.bool_], ink: Ink = BLACK) -> None:
        """Draw a pattern of squares (rows, columns), each ``side`` wide.

        The light ones are left as they are.
        """
        rows, columns = dark.shape
        edges_y = [self._px(y + row * side) for row in range(rows + 1)]
        edges_x = [self._px(x + column * side) for column in range(columns + 1)]
        mask = np.repeat(np.repeat(dark, np.diff(edges_y), axis=0), np.diff(edges_x), axis=1)
        self._stamp(mask, edges_x[0], edges_y[0], _pack(ink), over=False)

    def _stamp(self, mask: NDArray[np.bool_], left: int, top: int, packed: np.uint32, *, over: bool) -> None:
        mask = mask[max(-top, 0) :, max(-left, 0) :]
        left, top = max(left, 0), max(top, 0)
        part = self._packed[top : top + mask.shape[0], left : left + mask.shape[1]]
        mask = mask[: part.shape[0], : part.shape[1]]
        if over:
            np.bitwise_or(part, packed, out=part, where=mask)
        else:
            np.copyto(part, packed, where=mask)

    def dots(self, points_mm: NDArray[np.float64], radius: float, ink: Ink) -> None:
        """Draw equal discs about points (n, 2)."""
        for x, y in points_mm.tolist():
            self.disc(x, y, radius, ink)


def cells(
    columns: int, rows: int, left: float, top: float, step_x: float, step_y: float
) -> Iterator[tuple[float, float]]:
    """Yield the top-left corners of the cells of a grid, row by row. [mm]"""
    for place in range(columns * rows):
        yield left + place % columns * step_x, top + place // columns * step_y


def _pack(ink: Sequence[int]) -> np.uint32:
    return np.uint32(np.array(ink, np.uint8).view(np.uint32)[0])
