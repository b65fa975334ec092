"""Scans of a printed chart as they come: line cameras' raw digital numbers, flatbeds' RGB pictures.

A press predicts light: a pixel on an edge is the mean of two amounts of light. Pictures whose numbers are encoded for
screens are therefore made linear on reading, by the curves of their ICC profile, or by sRGB's (IEC 61966-2-1) where an
8-bit picture has no profile. Raw numbers and 16-bit pictures without a profile are taken as they are.
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import tifffile
from PIL import Image, ImageCms

from prooflight.acquiring.replay import RecordedScan
from prooflight.errors import RequestError, ScanError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

AUTO, LINEAR, SRGB = "auto", "linear", "srgb"
ENCODINGS: Final = (AUTO, LINEAR, SRGB)
TIFF: Final = (".tif", ".tiff")
TOP_16_BITS: Final = 65535
_USUAL_BITS: Final = (8, 10, 12, 14, 16)
_REMEDY: Final = (
    "give TIFF, PNG or JPEG: raw numbers (sensors, lines, pixels), or grey or RGB of 8 or 16 bits"
)
_SCALES: Final = {"inch": 1.0, "centimetre": 2.54}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChartScan:
    """One scan of one page of a chart, linear in light."""

    path: Path
    dn: NDArray[np.float32]
    """(sensors, lines, pixels) [DN]; encoded pictures on a scale of 16 bits."""
    names: tuple[str, ...]
    """Of the sensors."""
    top_code_dn: int
    """Greatest digital number. [DN]"""
    dpi: tuple[float, float] | None
    """Pixels and lines an inch, if the file says so."""
    encoding: str
    """``linear``, ``srgb`` or ``icc``: what the file's numbers were."""


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
        dn = np.stack([table[plane] for table, plane in zip(light, planes, strict=True)])
        scale = TOP_16_BITS
    names = ("red", "green", "blue") if len(planes) == 3 else ("grey",)
    return ChartScan(path=path, dn=dn, names=names, top_code_dn=scale, dpi=dpi, encoding=named)


def _raw_lines(path: Path) -> ChartScan | None:
    """A line camera's scan, one uint16 image for each sensor; None if the file is something else."""
    if path.suffix.lower() not in TIFF:
        return None
    try:
        with tifffile.TiffFile(path) as file:
            pages = [(page.dtype, page.ndim) for page in file.pages]
            planar = len(pages) == 1 and pages[0] == (np.dtype(np.uint16), 3)
            shape: tuple[int, ...] = file.pages[0].shape if pages else ()
            dpi = _tiff_dpi(file)
    except Exception as error:  # decoders raise whatever damage leads them to
        raise ScanError(path, "is damaged or not a TIFF", remedy=_REMEDY) from error
    if planar and shape[0] < min(shape[1:]):  # one image with the sensors as its planes
        dn = np.asarray(tifffile.imread(path))
    elif pages and all(page == (np.dtype(np.uint16), 2) for page in pages):
        dn = RecordedScan(path=path, first_image=0, sensors=len(pages)).read()
    else:
        return None
    names = {1: ("mono",), 3: ("red", "green", "blue")}.get(
        len(dn), tuple(f"s{n + 1}" for n in range(len(dn)))
    )
    return ChartScan(
        path=path,
        dn=dn.astype(np.float32),
        names=names,
        top_code_dn=_top_code(int(dn.max())),
        dpi=dpi,
        encoding=LINEAR,
    )


def _top_code(greatest: int) -> int:
    """Greatest code of the least usual number of bits that holds ``greatest``; assumed: files do not say it."""
    return next(2**bits - 1 for bits in _USUAL_BITS if greatest < 2**bits)


def _picture(path: Path) -> tuple[NDArray[np.generic], tuple[float, float] | None, bytes | None]:
    """Samples (lines, pixels[, channels]), resolution and ICC profile of a picture."""
    try:
        if path.suffix.lower() in TIFF:
            with tifffile.TiffFile(path) as file:
                page = file.pages[0]
                samples = np.asarray(page.asarray())
                if samples.ndim == 3 and samples.shape[0] in (3, 4) and samples.shape[2] > 4:
                    samples = np.moveaxis(samples, 0, 2)
                tag = page.tags.get("InterColorProfile")
                return samples, _tiff_dpi(file), None if tag is None else bytes(tag.value)
        if path.suffix.lower() == ".png":
            import imagecodecs  # Pillow makes 8 bits of 16

            with Image.open(path) as image:
                dpi, profile = image.info.get("dpi"), image.info.get("icc_profile")
            samples = np.asarray(imagecodecs.png_decode(path.read_bytes()))
        else:
            with Image.open(path) as image:
                dpi, profile, mode = image.info.get("dpi"), image.info.get("icc_profile"), image.mode
                samples = np.asarray(image)
            if mode not in ("L", "RGB", "RGBA"):
                samples = np.empty(0)  # refused for its shape
    except Exception as error:  # as above
        raise ScanError(path, "is damaged or no picture", remedy=_REMEDY) from error
    return samples, _sane(dpi), profile


def _tiff_dpi(file: tifffile.TiffFile) -> tuple[float, float] | None:
    """Resolution in a TIFF's tags."""
    tags = file.pages[0].tags if len(file.pages) else {}
    unit = {2: "inch", 3: "centimetre"}.get(
        int(tags["ResolutionUnit"].value) if "ResolutionUnit" in tags else 0
    )
    if unit is None or "XResolution" not in tags or "YResolution" not in tags:
        return None
    pair = [tags[name].value for name in ("XResolution", "YResolution")]
    return _sane(tuple(_SCALES[unit] * top / max(bottom, 1) for top, bottom in pair))


def _sane(dpi: object) -> tuple[float, float] | None:
    """A resolution that a scanner may have; files often say 72 or 0 where nobody knew."""
    if not isinstance(dpi, tuple) or len(dpi) != 2 or not all(75 < float(value) < 20_000 for value in dpi):
        return None
    return float(dpi[0]), float(dpi[1])


def _curves(
    path: Path, profile: bytes | None, samples: NDArray[np.generic], encoding: str
) -> tuple[list[Curve] | None, str]:
    """The curve from code to light of each channel (None: they are light), and what they are called."""
    channels = samples.shape[2]
    if encoding == LINEAR:
        return None, LINEAR
    if encoding == SRGB:
        return [srgb_light] * channels, SRGB
    if profile is not None:
        found = profile_curves(profile, channels)
        if found is None:
            what = "its ICC profile holds no curves of red, green and blue"
            raise ScanError(path, what, remedy="scan without a profile, or say --encoding")
        return found, "icc"
    return ([srgb_light] * channels, SRGB) if samples.dtype == np.uint8 else (None, LINEAR)


def srgb_light(code: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light of sRGB codes, both 0..1 (IEC 61966-2-1)."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def profile_curves(profile: bytes, channels: int) -> list[Curve] | None:
    """Tone curves of a matrix or grey ICC profile (ICC.1:2022, 10.6 and 10.18); None if it has none."""
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
    """One ``curv`` or ``para`` tag; ValueError if it is neither."""
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
