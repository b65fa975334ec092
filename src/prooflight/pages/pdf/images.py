"""Images of a PDF as the press paints them: in its inks, and with each sample in the right place.

Imported late, by ``device`` and ``shadings`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import ceil, hypot
from typing import Any, Final

import numpy as np
import pymupdf
from numpy.typing import NDArray
from pymupdf import mupdf

from prooflight.pages.pdf.colour_management import Inks, ToInk, address, apply_link

_UNDECODABLE: Final = re.compile(
    r"premature end|treating as end of file|\b(?:jpeg|openjpeg|jbig2dec) error|^zlib error|"
    r"(?i:cannot|failed to) (?i:decode|read|complete)|decode failed|no jbig2 image|missing data|No data for"
)
"""Messages of MuPDF when it continues without decoding an image."""
_LOST: Final = re.compile(
    r"read error; treating as end of file|unknown filter name|in(?:valid code in)? [12]d faxd"
)
"""Messages of MuPDF about any other stream of a page, including inline images and glyphs."""
SHORT: Final = "padding truncated image"
"""Message of MuPDF about a decoded image that has fewer samples than it should."""

IMAGES_CACHED = 8  # converted images kept for the next time they are drawn, as patterns and slices do
_FIXED_POINT = 1 << 14  # steps of MuPDF's sampler between two samples of an image
_OFF_PIXELS_MAX = 0.5  # half a pixel: as much as a pixel's edge is uncertain anyway


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFault:
    """An image of a page that cannot be decoded, or not all of it."""

    image: Any
    """The image, a ``mupdf.FzImage``."""
    box: tuple[float, float, float, float]
    """Bounding box x0, y0, x1, y1 in the page's space. [points]"""
    reason: str
    """Reason in MuPDF's words."""
    only_short: bool
    """Whether it has been decoded, and only lacks its last samples."""


def lost() -> str:
    """Return MuPDF's message about a stream that it could not decode since messages were last read; empty: none."""
    return next(filter(_LOST.search, pymupdf.JM_mupdf_warnings_store), "")


class Decoding:
    """Context that records messages and errors of MuPDF about images that are decoded in it."""

    def __init__(self, image: Any, ctm: Any, faults: list[ImageFault]) -> None:
        """Prepare for ``image`` (low level), drawn by ``ctm``; if it cannot be decoded, it is added to ``faults``."""
        self._image, self._ctm, self._faults = image, ctm, faults

    def __enter__(self) -> None:
        self._before = len(pymupdf.JM_mupdf_warnings_store)

    def __exit__(self, _kind: Any, error: BaseException | None, _trace: Any) -> bool:
        messages = pymupdf.JM_mupdf_warnings_store[self._before :]
        reasons = [line for line in messages if _UNDECODABLE.search(line)]
        raised = isinstance(error, mupdf.FzErrorBase)
        only_short = not (raised or reasons) and SHORT in messages
        if raised or reasons or only_short:
            x, y, ctm = (0, 0, 1, 1), (0, 1, 0, 1), self._ctm
            across = [ctm.a * i + ctm.c * j + ctm.e for i, j in zip(x, y, strict=True)]
            along = [ctm.b * i + ctm.d * j + ctm.f for i, j in zip(x, y, strict=True)]
            box = min(across), min(along), max(across), max(along)
            retained = mupdf.FzImage(mupdf.ll_fz_keep_image(self._image))
            reason = (reasons or [SHORT if only_short else str(error)])[0].strip()
            self._faults.append(ImageFault(image=retained, box=box, reason=reason, only_short=only_short))
        return raised


class ConvertedImages:
    """Images converted to the inks of the press, the last few cached."""

    def __init__(self, inks: Inks) -> None:
        self._inks = inks
        self._kept: dict[tuple[int, int, int], tuple[Any, Any]] = {}

    def get(self, image: Any, space: Any, to_ink: ToInk, parameters: Any) -> Any:
        """Return ``image`` (low level) in ink; ``space`` is its own (low level), or that of its indices or device."""
        key = address(image), parameters.ri, parameters.bp
        if key not in self._kept:
            original = mupdf.FzImage(mupdf.ll_fz_keep_image(image))  # so that the address stays its own
            converted = self._converted(original, space, to_ink, parameters)
            if len(self._kept) >= IMAGES_CACHED:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = original, converted
        return self._kept[key][1].m_internal

    def _converted(self, image: Any, space: Any, to_ink: ToInk, parameters: Any) -> Any:
        pixmap = mupdf.FzPixmap(mupdf.ll_fz_get_pixmap_from_image(image.m_internal, None, None)[0])
        if mupdf.fz_colorspace_is_indexed(pixmap.colorspace()):
            pixmap = mupdf.fz_convert_indexed_pixmap_to_base(pixmap)
        alpha = pixmap.alpha()
        if pixmap.n() - alpha != space.n:
            return image
        samples = pixmap_samples(pixmap)
        colours, opaque = samples[..., : space.n], samples[..., space.n :]
        if alpha and not ((opaque == 0) | (opaque == 255)).all():
            return image  # a JPEG 2000 image with opacity, by which MuPDF has multiplied its colours
        link = None if mupdf.ll_fz_colorspace_is_device_n(space) else self._inks.link(space, parameters)
        inks = converted_samples(colours, to_ink) if link is None else apply_link(link, colours)
        if alpha:  # colour-keyed: each sample is there or not
            inks = np.concatenate([inks * (opaque > 0), opaque], axis=2)
        return _image(inks, self._inks.space, alpha=alpha, interpolate=image.m_internal.interpolate)


def converted_samples(samples: NDArray[np.uint8], to_ink: ToInk) -> NDArray[np.uint8]:
    """Ink (rows, columns, 4) of the samples (rows, columns, channels) of an image, each colour converted once."""
    rows, columns, channels = samples.shape
    padded = np.zeros((rows * columns, -(-channels // 8) * 8), np.uint8)
    padded[:, :channels] = samples.reshape(-1, channels)
    if padded.shape[1] == 8:
        packed, places = np.unique(padded.view(np.uint64)[:, 0], return_inverse=True)
        colours = packed.view(np.uint8).reshape(-1, 8)
    else:
        colours, places = np.unique(padded, axis=0, return_inverse=True)
    inks = np.rint(255 * to_ink(colours[:, :channels] / 255).clip(0, 1)).astype(np.uint8)
    return inks[places.reshape(rows, columns)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Raster:
    """Map from the page to pixels: pixel = scale * page + shift."""

    rows: int
    columns: int
    scale: float
    """Scale. [pixels/point]"""
    shift: tuple[float, float]
    """Shift of x and y. [pixels]"""


def placed(image: Any, ctm: Any, raster: Raster) -> tuple[Any, Any, bool]:
    """Return image (``mupdf.FzImage``), matrix, and whether samples are blended, as it is best drawn.

    ``ctm`` maps the unit square to the page. Samples larger than pixels are blocks, unless the image requests
    /Interpolate (ISO 32000-2, 8.9.5.3); smaller ones are averaged. MuPDF places samples by 14-bit steps: if
    these would add up to more than half a pixel, and the image is not slanted, it is enlarged here: each
    pixel takes the sample that contains its centre.
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
    enlarged = _image(
        np.take(pixmap_samples(pixmap), x, axis=1), pixmap.colorspace(), y, alpha=pixmap.alpha()
    )
    return enlarged, raster_matrix(raster, left, top, x.size, y.size), False


def _taken(
    start: float, length: float, scale: float, shift: float, samples: int, pixels: int
) -> tuple[int, NDArray[np.intp]]:
    """Return the first pixel whose centre is in an image along one axis, and the samples of it and the next ones."""
    ends = sorted((start * scale + shift, (start + length) * scale + shift))
    first, last = (min(max(ceil(end - 0.5), 0), pixels) for end in ends)
    place = (np.arange(first, last) + 0.5 - shift - start * scale) / (length * scale)
    return first, np.clip(np.floor(place * samples).astype(np.intp), 0, samples - 1)


def raster_matrix(raster: Raster, left: int, top: int, columns: int, rows: int) -> Any:
    """Return the matrix that places an image on these very pixels of the raster."""
    matrix = mupdf.fz_matrix()
    matrix.a, matrix.d, matrix.b, matrix.c = columns / raster.scale, rows / raster.scale, 0.0, 0.0
    matrix.e, matrix.f = ((p - s) / raster.scale for p, s in zip((left, top), raster.shift, strict=True))
    return matrix


def pixmap_samples(pixmap: Any) -> NDArray[np.uint8]:
    """Return a pixmap's own memory as (rows, columns, channels)."""
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
    """Return a ``mupdf.FzImage`` of samples (rows, columns, channels), or of the given rows of them."""
    rows = np.arange(samples.shape[0]) if rows is None else rows
    pixmap = mupdf.fz_new_pixmap(space, samples.shape[1], rows.size, mupdf.FzSeparations(), alpha)
    np.take(samples, rows, axis=0, out=pixmap_samples(pixmap), mode="clip")  # "clip" writes to out at once
    image = mupdf.fz_new_image_from_pixmap(pixmap, mupdf.FzImage())
    image.m_internal.interpolate = interpolate
    return image
