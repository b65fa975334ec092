"""Images of a PDF as the press paints them: in its inks, and sample by sample in the right place.

Imported late, by ``press_device`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, hypot
from typing import TYPE_CHECKING, Any

import numpy as np
from pymupdf import mupdf

from prooflight.pages.pdf.colour_management import Inks, address, apply_link

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

IMAGES_KEPT = 8  # converted images kept for the next time they are drawn, as patterns and slices do
_FIXED_POINT = 1 << 14  # steps of MuPDF's sampler between two samples of an image
_OFF_PIXELS_MAX = 0.5  # half a pixel: as much as a pixel's edge is uncertain anyway


class ConvertedImages:
    """Images converted to the inks of the press, the last few kept."""

    def __init__(self, inks: Inks, resolved: Callable[[Any], Any]) -> None:
        """``resolved``: what a device colour space stands for."""
        self._inks, self._resolved = inks, resolved
        self._kept: dict[tuple[int, int, int], tuple[Any, Any]] = {}

    def get(self, image: Any, parameters: Any) -> Any:
        """``image`` (low level) in ink, or ``image`` itself where it is to be drawn as it is."""
        key = address(image), parameters.ri, parameters.bp
        if key not in self._kept:
            original = mupdf.FzImage(mupdf.ll_fz_keep_image(image))  # so that the address stays its own
            converted = self._converted(original, parameters)
            if len(self._kept) >= IMAGES_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = original, converted
        return self._kept[key][1].m_internal

    def _converted(self, image: Any, parameters: Any) -> Any:
        space = image.m_internal.colorspace
        if not space:
            return image
        if mupdf.ll_fz_colorspace_is_indexed(space):
            space = mupdf.ll_fz_base_colorspace(space)
        space = self._resolved(space)
        if self._inks.is_native(space) or mupdf.ll_fz_colorspace_is_lab(space):
            return image
        link = self._inks.link(space, parameters)
        if link is None:
            return image
        pixmap = mupdf.FzPixmap(mupdf.ll_fz_get_pixmap_from_image(image.m_internal, None, None)[0])
        if mupdf.fz_colorspace_is_indexed(pixmap.colorspace()):
            pixmap = mupdf.fz_convert_indexed_pixmap_to_base(pixmap)
        if pixmap.alpha() or pixmap.n() != space.n:
            return image  # colour-keyed: MuPDF multiplies its colours with the key
        return _image(
            apply_link(link, _samples(pixmap)), self._inks.space, interpolate=image.m_internal.interpolate
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Raster:
    """Where pixels lie on the page: pixel = scale * page + shift."""

    rows: int
    columns: int
    scale: float
    """[pixels/point]"""
    shift: tuple[float, float]
    """Of x and y. [pixels]"""


def placed(image: Any, ctm: Any, raster: Raster) -> tuple[Any, Any, bool]:
    """The image (``mupdf.FzImage``), its matrix, and whether its samples are to be blended, as it is best drawn.

    ctm: unit square to page. Samples larger than pixels are blocks, unless the image asks for /Interpolate (ISO
    32000-2, 8.9.5.3); smaller ones are averaged. MuPDF places samples by 14-bit steps: where these would add up to
    more than half a pixel, and the image is not slanted, it is enlarged here: each pixel takes the sample that its
    centre lies in.
    """
    same = mupdf.FzImage(mupdf.ll_fz_keep_image(image))
    across, along = (raster.scale * hypot(*side) for side in ((ctm.a, ctm.b), (ctm.c, ctm.d)))
    if (across < image.w and along < image.h) or image.interpolate:  # MuPDF averages when both are smaller
        return same, ctm, True
    off = max(across**2 / image.w, along**2 / image.h) / _FIXED_POINT
    if off <= _OFF_PIXELS_MAX or ctm.b or ctm.c:
        return same, ctm, False
    left, x = _taken(ctm.e, ctm.a, raster.scale, raster.shift[0], image.w, raster.columns)
    top, y = _taken(ctm.f, ctm.d, raster.scale, raster.shift[1], image.h, raster.rows)
    if not (x.size and y.size):
        return same, ctm, False  # thinner than a pixel, or beside the page
    pixmap = mupdf.FzPixmap(mupdf.ll_fz_get_pixmap_from_image(image, None, None)[0])
    enlarged = _image(np.take(_samples(pixmap), x, axis=1), pixmap.colorspace(), y, alpha=pixmap.alpha())
    matrix = mupdf.fz_matrix()
    matrix.a, matrix.d, matrix.b, matrix.c = x.size / raster.scale, y.size / raster.scale, 0.0, 0.0
    matrix.e, matrix.f = ((p - s) / raster.scale for p, s in zip((left, top), raster.shift, strict=True))
    return enlarged, matrix, False


def _taken(
    start: float, length: float, scale: float, shift: float, samples: int, pixels: int
) -> tuple[int, NDArray[np.intp]]:
    """The first pixel whose centre lies in an image along one axis, and the samples that it and the next ones take."""
    ends = sorted((start * scale + shift, (start + length) * scale + shift))
    first, last = (min(max(ceil(end - 0.5), 0), pixels) for end in ends)
    place = (np.arange(first, last) + 0.5 - shift - start * scale) / (length * scale)
    return first, np.clip(np.floor(place * samples).astype(np.intp), 0, samples - 1)


def _samples(pixmap: Any) -> NDArray[np.uint8]:
    """A pixmap's own memory as (rows, columns, channels)."""
    view = mupdf.fz_pixmap_samples_memoryview(pixmap)
    rows = np.frombuffer(view, dtype=np.uint8).reshape(pixmap.h(), pixmap.stride())
    return rows[:, : pixmap.w() * pixmap.n()].reshape(pixmap.h(), pixmap.w(), pixmap.n())


def _image(
    samples: NDArray[np.uint8],
    space: Any,
    rows: NDArray[np.intp] | None = None,
    *,
    alpha: int = 0,
    interpolate: int = 0,
) -> Any:
    """A ``mupdf.FzImage`` of samples (rows, columns, channels), or of those of its rows that are named."""
    rows = np.arange(samples.shape[0]) if rows is None else rows
    pixmap = mupdf.fz_new_pixmap(space, samples.shape[1], rows.size, mupdf.FzSeparations(), alpha)
    np.take(samples, rows, axis=0, out=_samples(pixmap), mode="clip")  # "clip" writes to out at once
    image = mupdf.fz_new_image_from_pixmap(pixmap, mupdf.FzImage())
    image.m_internal.interpolate = interpolate
    return image
