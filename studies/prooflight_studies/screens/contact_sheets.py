"""Contact sheets: the pictures of one page of the console side by side, in one small file."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from collections.abc import Sequence

SCALE: Final = 0.5
"""Scale of the pictures: text of 16 pixels has eight, which can be read."""
MOST_PX: Final = 1200
"""Pixels of a page that are shown, from its top."""
GAP_PX: Final = 12
GROUND: Final = (128, 136, 144)
MOST_BYTES: Final = 150_000
"""Largest contact sheet. [bytes]"""
COLOURS: Final = (96, 64, 48, 40, 32, 24)
"""Numbers of colours that are tried, until a sheet is small enough."""
EXACT: Final = 14
"""Number of the most common colours that are exact: grounds must not change their hue."""


def contact_sheet(rows: Sequence[Sequence[Image.Image]]) -> Image.Image:
    """Return pictures in rows, each cut at ``MOST_PX`` and scaled by ``SCALE``."""
    strips = [side_by_side([_scaled(picture) for picture in row]) for row in rows]
    size = max(strip.width for strip in strips), sum(strip.height - GAP_PX for strip in strips) + GAP_PX
    sheet, top = Image.new("RGB", size, GROUND), 0
    for strip in strips:
        sheet.paste(strip, (0, top))
        top += strip.height - GAP_PX
    return sheet


def side_by_side(pictures: Sequence[Image.Image]) -> Image.Image:
    """Return pictures side by side, with a gap around each."""
    width = sum(picture.width + GAP_PX for picture in pictures) + GAP_PX
    strip = Image.new("RGB", (width, max(picture.height for picture in pictures) + 2 * GAP_PX), GROUND)
    left = GAP_PX
    for picture in pictures:
        strip.paste(picture, (left, GAP_PX))
        left += picture.width + GAP_PX
    return strip


def as_png(picture: Image.Image, *, most_bytes: int = MOST_BYTES) -> bytes:
    """Return a picture as PNG in as many colours as its size permits, of ``COLOURS``."""
    pixels = np.asarray(picture.convert("RGB"), np.uint32)
    packed = (pixels[..., 0] << 16 | pixels[..., 1] << 8 | pixels[..., 2]).ravel()
    distinct, counts = np.unique(packed, return_counts=True)
    common = distinct[np.argsort(-counts)[:EXACT]]
    for colours in COLOURS:
        result = picture.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        palette, which = np.array(result.getpalette()).reshape(-1, 3), np.asarray(result).ravel()
        for colour in common:
            index = np.bincount(which[packed == colour]).argmax()
            palette[index] = colour >> 16, colour >> 8 & 255, colour & 255
        result.putpalette(palette.ravel().tolist())
        file = io.BytesIO()
        result.save(file, "PNG", optimize=True)
        if len(file.getvalue()) <= most_bytes:
            break
    return file.getvalue()


def _scaled(picture: Image.Image) -> Image.Image:
    cut = picture.convert("RGB").crop((0, 0, picture.width, min(picture.height, MOST_PX)))
    size = round(cut.width * SCALE), round(cut.height * SCALE)
    return cut.resize(size, Image.Resampling.LANCZOS)
