"""Scans of a printed chart: line cameras' raw digital numbers, flatbeds' RGB pictures.

A press predicts light: a pixel on an edge is the mean of two amounts of light. Pictures whose numbers are
encoded for screens are therefore made linear on reading, by the curves of their ICC profile, or by sRGB's
(IEC 61966-2-1) where an 8-bit picture has no profile. Raw numbers and 16-bit pictures without a profile are
taken as they are.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import ImageCms

from prooflight.errors import RequestError, ScanError
from prooflight.pages.picture_files import opened_picture
from prooflight.pages.tiff_images import BAND_ROWS, TiffImages, decode_into, opened_tiff
from prooflight.scans.recorded import RecordedScan
from prooflight.spectra import srgb_light

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

AUTO, LINEAR, SRGB = "auto", "linear", "srgb"
ENCODINGS: Final = (AUTO, LINEAR, SRGB)
COLOUR: Final = ("red", "green", "blue")
TIFF: Final = (".tif", ".tiff")
TOP_16_BITS: Final = 65535
_USUAL_BITS: Final = (8, 10, 12, 14, 16)
_REMEDY: Final = (
    "give TIFF, PNG or JPEG: raw numbers (sensors, lines, pixels), or grey or RGB of 8 or 16 bits"
)
_BYTES_PER_SAMPLE: Final = 8.0
"""Memory while a picture is read: 4 bytes for its light, 2 for its numbers, and as many for the decoder's."""
_ICC_PROFILE: Final = 34675


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChartScan:
    """Scan of one page of a chart, linear in light."""

    path: Path
    dn: NDArray[np.float32]
    """Digital numbers (sensors, lines, pixels); encoded pictures on a scale of 16 bits. [DN]"""
    names: tuple[str, ...]
    """Names of the sensors."""
    top_code_dn: int
    """Greatest digital number. [DN]"""
    dpi: tuple[float, float] | None
    """Number of pixels and lines an inch, if the file states it."""
    encoding: str
    """Encoding of the file's numbers: ``linear``, ``srgb`` or ``icc``."""


def read_chart_scan(path: Path, *, encoding: str = AUTO) -> ChartScan:
    """Read a scan of a chart; ``encoding``: one of ``ENCODINGS``.

    ScanError: no such file, damaged, or not of such a form. RequestError: no such encoding.
    """
    if encoding not in ENCODINGS:
        what = f"there is no encoding {encoding!r}"
        raise RequestError("--encoding", what, remedy=f"take {', '.join(ENCODINGS)}")
    if not path.is_file():
        raise ScanError(path, "there is no such file", remedy=_REMEDY)
    raw = _raw_lines(path)
    if raw is not None:
        return raw
    samples, dpi, profile = _picture(path)
    samples = samples[..., None] if samples.ndim == 2 else samples
    if samples.ndim != 3 or samples.shape[2] not in (1, 3, 4) or samples.dtype not in (np.uint8, np.uint16):
        raise ScanError(path, f"holds {samples.dtype} {samples.shape}", remedy=_REMEDY)
    samples = samples[..., :3] if samples.shape[2] == 4 else samples
    top = TOP_16_BITS if samples.dtype == np.uint16 else 255
    curves, named = _curves(path, profile, samples, encoding)
    planes = np.moveaxis(samples, 2, 0)
    if curves is None:
        dn, scale = planes.astype(np.float32), top
    else:
        codes = np.arange(top + 1) / top
        light = [np.float32(TOP_16_BITS) * curve(codes).astype(np.float32) for curve in curves]
        dn = np.empty(planes.shape, np.float32)
        for table, plane, out in zip(light, planes, dn, strict=True):
            for start in range(0, len(plane), BAND_ROWS):  # indices are widened to eight bytes
                out[start : start + BAND_ROWS] = table[plane[start : start + BAND_ROWS]]
        scale = TOP_16_BITS
    names = COLOUR if len(planes) == 3 else ("grey",)
    return ChartScan(path=path, dn=dn, names=names, top_code_dn=scale, dpi=dpi, encoding=named)


def _raw_lines(path: Path) -> ChartScan | None:
    """Read a line camera's scan, one uint16 image for each sensor; None if the file is something else."""
    if path.suffix.lower() not in TIFF:
        return None
    with opened_tiff(path, ScanError, remedy=_REMEDY) as images:
        count = len(images)
        pages = [(page.dtype, page.shape) for page in (images[place] for place in range(count))]
        planar = count == 1 and pages[0][0] == np.uint16 and len(pages[0][1]) == 3
        dpi = _tiff_dpi(images[0]) if count else None
        if planar and pages[0][1][0] < min(pages[0][1][1:]):  # one image with the sensors as its planes
            dn = np.moveaxis(_decoded(images, path), -1, 0)
        elif pages and all(dtype == np.uint16 and len(shape) == 2 for dtype, shape in pages):
            dn = RecordedScan(path=path, first_image=0, sensors=count).read()
        else:
            return None
    names = {1: ("mono",), 3: COLOUR}.get(len(dn), tuple(f"s{n + 1}" for n in range(len(dn))))
    return ChartScan(
        path=path,
        dn=dn.astype(np.float32),
        names=names,
        top_code_dn=_top_code(int(dn.max())),
        dpi=dpi,
        encoding=LINEAR,
    )


def _top_code(greatest: int) -> int:
    """Return the greatest code of the least usual number of bits that holds ``greatest``.

    assumed: files do not state it.
    """
    return next(2**bits - 1 for bits in _USUAL_BITS if greatest < 2**bits)


def _picture(path: Path) -> tuple[NDArray[np.generic], tuple[float, float] | None, bytes | None]:
    """Read samples (lines, pixels, channels), resolution and ICC profile of a picture."""
    if path.suffix.lower() in TIFF:
        with opened_tiff(path, ScanError, remedy=_REMEDY) as images:
            if not len(images):
                raise ScanError(path, "holds no image", remedy=_REMEDY)
            profile = images[0].tags.valueof(_ICC_PROFILE)
            return _decoded(images, path), _tiff_dpi(images[0]), None if profile is None else bytes(profile)
    with opened_picture(path, ScanError, bytes_per_sample=_BYTES_PER_SAMPLE, remedy=_REMEDY) as image:
        dpi, profile = image.info.get("dpi"), image.info.get("icc_profile")
        if image.format == "PNG":
            import imagecodecs  # Pillow makes 8 bits of 16

            image.verify()  # of what is damaged, the other would speak on stderr
            samples = np.asarray(imagecodecs.png_decode(path.read_bytes()))
        elif image.mode in ("L", "RGB"):
            samples = np.asarray(image)
        else:
            raise ScanError(path, f"is {image.mode}", remedy=_REMEDY)
    return samples, _sane(dpi), profile


def _decoded(images: TiffImages, path: Path) -> NDArray[np.generic]:
    """Decode the first image of a TIFF, (lines, pixels, channels)."""
    page = images[0]
    shape = page.imagelength, page.imagewidth, page.samplesperpixel
    if page.dtype is None:
        raise ScanError(path, f"holds {page.bitspersample} bits", remedy=_REMEDY)
    images.check(path, page, result_bytes=_BYTES_PER_SAMPLE * prod(shape))
    samples = np.empty(shape, page.dtype)
    decode_into(page, samples)
    return samples


def _tiff_dpi(page: Any) -> tuple[float, float] | None:
    """Return the resolution in a TIFF's tags (TIFF 6.0)."""
    unit = {2: 1.0, 3: 2.54}.get(int(page.tags.valueof(296) or 0))
    pair = [page.tags.valueof(code) for code in (282, 283)]
    if unit is None or None in pair:
        return None
    return _sane(tuple(unit * top / max(bottom, 1) for top, bottom in pair))


def _sane(dpi: object) -> tuple[float, float] | None:
    """Return a resolution if a scanner may have it; files often state 72 or 0 where it is unknown."""
    if not isinstance(dpi, tuple) or len(dpi) != 2 or not all(75 < float(value) < 20_000 for value in dpi):
        return None
    return float(dpi[0]), float(dpi[1])


def _curves(
    path: Path, profile: bytes | None, samples: NDArray[np.generic], encoding: str
) -> tuple[list[Curve] | None, str]:
    """Return the curve from code to light of each channel (None: they are light), and the curves' name."""
    channels = samples.shape[2]
    if encoding == LINEAR:
        return None, LINEAR
    if encoding == SRGB:
        return [srgb_light] * channels, SRGB
    if profile is not None:
        curves = profile_curves(profile, channels)
        if curves is None:
            what = "its ICC profile holds no curves of red, green and blue"
            raise ScanError(path, what, remedy="scan without a profile, or give --encoding")
        return curves, "icc"
    return ([srgb_light] * channels, SRGB) if samples.dtype == np.uint8 else (None, LINEAR)


def profile_curves(profile: bytes, channels: int) -> list[Curve] | None:
    """Return the tone curves of a matrix or grey ICC profile (ICC.1:2022, 10.6 and 10.18).

    Return None if the profile has none.
    """
    try:
        ImageCms.getOpenProfile(io.BytesIO(profile))
        count = struct.unpack_from(">I", profile, 128)[0]
        entries = [struct.unpack_from(">4sII", profile, 132 + 12 * at) for at in range(count)]
        tags = {name.decode("latin-1"): profile[at : at + size] for name, at, size in entries}
        wanted = ("rTRC", "gTRC", "bTRC") if channels == 3 else ("kTRC",)
        return [_tone_curve(tags[name]) for name in wanted]
    except (ImageCms.PyCMSError, OSError, struct.error, KeyError, ValueError, IndexError):
        return None


def _tone_curve(tag: bytes) -> Curve:
    """Parse one ``curv`` or ``para`` tag; ValueError if it is neither."""
    if tag[:4] == b"curv":
        count = struct.unpack_from(">I", tag, 8)[0]
        values = np.array(struct.unpack_from(f">{count}H", tag, 12), dtype=np.float64)
        if count == 0:
            return lambda code: code
        if count == 1:
            return lambda code: code ** (values[0] / 256)
        return lambda code: np.interp(code, np.linspace(0, 1, count), values / 65535)
    if tag[:4] != b"para":
        message = "neither curv nor para"
        raise ValueError(message)
    kind = struct.unpack_from(">H", tag, 8)[0]
    number = (1, 3, 4, 5, 7)[kind]
    given = [value / 65536 for value in struct.unpack_from(f">{number}i", tag, 12)]
    g, a, b, c, d, e, f = given + [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0][number:]
    if kind in (1, 2):
        # Below -b/a these two are constant: c of kind 2, else 0.
        return lambda code: (
            np.where(code >= -b / a, np.maximum(a * code + b, 0) ** g, 0.0) + (c if kind == 2 else 0)
        )
    if kind == 0:
        return lambda code: code**g
    return lambda code: np.where(code >= d, np.maximum(a * code + b, 0) ** g + e, c * code + f)
