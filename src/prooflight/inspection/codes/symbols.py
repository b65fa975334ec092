"""Codes in a picture: their reader, the one that uses the library, and scan lines across bar codes.

A code reader takes one picture, paper light, of all the camera's lines. Scan lines are cut into elements as in
ISO/IEC 15416, 5.2 to 5.4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
import zxingcpp
from numpy.typing import NDArray

from prooflight.kernels.scan_lines import cut_lines

if TYPE_CHECKING:
    from prooflight.prediction.tables import SensorModel

LINEAR: Final = frozenset(
    map(str, zxingcpp.barcode_formats_list(zxingcpp.BarcodeFormats(zxingcpp.BarcodeFormat.AllLinear)))
)
"""Symbologies of bars, by the library's names."""
STRIPED: Final = (zxingcpp.BarcodeFormat.AllLinear, zxingcpp.BarcodeFormat.PDF417)
"""Symbologies of bars, and of bars in stacks, which are read along the bars' row alone."""
TURNED: Final = (zxingcpp.BarcodeFormat.DataMatrix,)
"""Symbologies for which the library has to be asked to search in four directions."""
STILL: Final = tuple(
    one
    for one in zxingcpp.barcode_formats_list(zxingcpp.BarcodeFormats(zxingcpp.BarcodeFormat.AllReadable))
    if one not in TURNED
)
"""All others, of which matrix codes are read whichever way they lie."""
TWICE: Final = 2
BLUR_PIXELS: Final = 0.8
"""assumed: noise of the camera is smoothed, bars two pixels wide are not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Symbol:
    """Code that was read from a picture."""

    symbology: str
    """Name of the symbology, such as QR Code, Code 128 or EAN-13."""
    text: str
    corners: tuple[tuple[float, float], ...]
    """Four corners (x, y) in the code's own order: top left, top right, bottom right, bottom left. [pixel]"""
    modules: tuple[int, int] | None = None
    """Rows and columns of squares of a QR code or a Data Matrix; None: it is neither, or they are unknown."""
    unused_correction: float | None = None
    """Share of its error correction that reading left unused (ISO/IEC 15415); None: unknown."""

    @property
    def linear(self) -> bool:
        """Return whether it is made of bars."""
        return self.symbology in LINEAR

    @property
    def along_lines(self) -> bool:
        """Return whether it runs along the picture's lines, rather than across them."""
        (left, top), (right, bottom) = self.corners[:2]
        return abs(right - left) >= abs(bottom - top)


def symbols(picture: NDArray[np.uint8], symbology: str) -> list[Symbol]:
    """Read all codes of a symbology in a picture (lines, pixels)."""
    return _read(picture, formats=_format(symbology))


def symbols_of_page(picture: NDArray[np.uint8]) -> list[Symbol]:
    """Read all codes in a picture (lines, pixels) of a whole page.

    Bars that run across the lines are searched for in a turned picture: the library's own search reads the picture
    along its columns, which takes twice as long.
    """
    turned = cv2.rotate(picture, cv2.ROTATE_90_COUNTERCLOCKWISE)
    return [
        *_read(picture, formats=STILL, try_rotate=False),
        *_read(picture, formats=TURNED),
        *_turned_back(_read(turned, formats=STRIPED, try_rotate=False), picture),
    ]


def tried(picture: NDArray[np.uint8], symbology: str, *, along_lines: bool | None = None) -> Iterator[Symbol]:
    """Yield the codes that each way of reading finds in a picture.

    The ways are: as it is, at twice its size, smoothed, in plain black and white. A camera that sees a bar in
    three pixels is coarse for a reader; a caller that stops at the right code tries no more ways.
    along_lines: direction of a bar code, where that is known: it is first looked for in that direction alone,
    which takes a third of the time.
    """
    if along_lines is not None and symbology in LINEAR:
        yield from _running(picture, symbology, along_lines=along_lines)
    yield from symbols(picture, symbology)
    size = picture.shape[1] * TWICE, picture.shape[0] * TWICE
    double = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC)
    yield from _halved(symbols(double, symbology))
    smooth = cv2.GaussianBlur(double, (0, 0), BLUR_PIXELS * TWICE)
    yield from _halved(symbols(smooth, symbology))
    _, plain = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    yield from _halved(symbols(plain.astype(np.uint8), symbology))


def _running(picture: NDArray[np.uint8], symbology: str, *, along_lines: bool) -> Iterator[Symbol]:
    """Yield bar codes that run along the lines or across them, in dark bars, at the picture's own size."""
    plainly = {"try_rotate": False, "try_downscale": False, "try_invert": False}
    turned = picture if along_lines else cv2.rotate(picture, cv2.ROTATE_90_COUNTERCLOCKWISE)
    symbols_read = _read(turned, formats=_format(symbology), **plainly)
    yield from symbols_read if along_lines else _turned_back(symbols_read, picture)


def _turned_back(symbols_read: list[Symbol], picture: NDArray[np.uint8]) -> Iterator[Symbol]:
    """Yield codes of a picture that was turned left, at their places in the picture itself."""
    last = picture.shape[1] - 1
    for one in symbols_read:
        yield replace(one, corners=tuple((last - y, x) for x, y in one.corners))


def _read(picture: NDArray[np.uint8], **how: Any) -> list[Symbol]:
    return [_symbol(barcode) for barcode in zxingcpp.read_barcodes(np.ascontiguousarray(picture), **how)]


def _halved(doubled: list[Symbol]) -> Iterator[Symbol]:
    for one in doubled:
        yield replace(one, corners=tuple((x / TWICE, y / TWICE) for x, y in one.corners))


def _format(symbology: str) -> Any:
    return zxingcpp.barcode_format_from_str(symbology)


def _symbol(barcode: Any) -> Symbol:
    at, extra = barcode.position, barcode.extra or {}
    corners = (at.top_left, at.top_right, at.bottom_right, at.bottom_left)
    unused = extra.get("UEC")
    return Symbol(
        symbology=str(barcode.format),
        text=barcode.text,
        corners=tuple((float(point.x), float(point.y)) for point in corners),
        modules=_modules(str(barcode.format), str(extra.get("Version", ""))),
        unused_correction=None if unused is None else float(unused),
    )


def _modules(symbology: str, version: str) -> tuple[int, int] | None:
    """Return the modules of a code from its version.

    A QR code of version v has 4 v + 17 modules a side (ISO/IEC 18004, 5.3.1); a Data Matrix is named by its
    size.
    """
    if symbology == "QR Code" and version.isdigit():
        side = 4 * int(version) + 17
        return side, side
    rows, cross, columns = version.partition("x")
    if symbology == "Data Matrix" and cross and rows.isdigit() and columns.isdigit():
        return int(rows), int(columns)
    return None


PROFILES: Final = 10
"""Number of scan lines across a bar code (ISO/IEC 15416, 5.2.4)."""
INNER: Final = 0.1, 0.9
"""Part of a bar code's height that scan lines are taken from (the inspection band)."""
SAMPLES_A_PIXEL: Final = 4
QUIET_PIXELS: Final = 6.0
"""Width of paper on either side that a profile holds."""
LEAST_EDGES: Final = 4
"""Least number of edges, of two bars: a code with fewer is no bar code."""
PAPER: Final = 220
"""Grey value of bare paper: gloss and a brighter lamp still have room above it."""

LEAST_GAIN_DN: Final = np.float32(1e-3)
"""Least gain of a column: a dead one then shows as black instead of as no number."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """Scan line across a bar code, cut into elements."""

    edges: NDArray[np.float64]
    """Edges between elements [pixel]; the first bar begins at edges[0]."""
    peaks: NDArray[np.float64]
    """Light (elements,) of elements in order: paper, bar, space, ..., bar, paper."""
    defects: NDArray[np.float64]
    """Greatest non-monotony (elements,) within each of them."""


def cut_elements(lines: NDArray[np.float64], step: float) -> tuple[Profile | None, ...]:
    """Cut scan lines (lines, samples) into elements; samples are ``step`` pixels apart. None: a line has no bars.

    Elements lie above or below the global threshold, (greatest + least) / 2; an edge lies where light first
    passes halfway between its two elements (ISO/IEC 15416, 5.3). Non-monotony is that of 5.4.5.
    """
    edges, peaks, defects = np.empty((3, *lines.shape))
    counts = np.empty(len(lines), np.int64)
    cut_lines(lines, edges, peaks, defects, counts)
    return tuple(
        Profile(
            edges=edges[line, : count - 1] * step, peaks=peaks[line, :count], defects=defects[line, :count]
        )
        if count > LEAST_EDGES
        else None
        for line, count in enumerate(counts.tolist())
    )


def profiles(light: NDArray[np.float32], symbol: Symbol) -> tuple[Profile | None, ...]:
    """Return the scan lines across a code as the camera must see it.

    A code that is not made of bars has none.
    """
    if not symbol.linear:
        return ()
    return cut_elements(scan_lines(light, symbol), 1 / SAMPLES_A_PIXEL)


def scan_lines(light: NDArray[np.float32], symbol: Symbol) -> NDArray[np.float64]:
    """Sample scan lines across a bar code, (``PROFILES``, samples), all as long as the longest.

    Each has ``SAMPLES_A_PIXEL`` samples a pixel.
    """
    top_left, top_right, bottom_right, bottom_left = np.array(symbol.corners)
    part = np.linspace(*INNER, PROFILES)[:, None]
    begin, end = top_left + part * (bottom_left - top_left), top_right + part * (bottom_right - top_right)
    length = np.hypot(*(end - begin).T)
    way = (end - begin) / np.maximum(length, 1.0)[:, None]
    at = np.arange(-QUIET_PIXELS, float(length.max()) + QUIET_PIXELS, 1 / SAMPLES_A_PIXEL)
    x, y = (begin[:, axis, None] + at * way[:, axis, None] for axis in (0, 1))
    return sampled(light, x, y)


def sampled(
    light: NDArray[np.float32], x: NDArray[np.floating], y: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the light at points (rows, columns) [pixel], cubic between pixels; (rows, columns)."""
    x, y = (np.ascontiguousarray(axis, np.float32) for axis in (x, y))
    values = cv2.remap(light, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return values.astype(np.float64)


def paper_light(
    dn: NDArray[np.generic], sensors: Sequence[SensorModel], columns: slice
) -> NDArray[np.float32]:
    """Return the mean light over the sensors of a cut of a scan (sensors, lines, columns) [DN]: (lines, columns).

    Bare paper is 1. columns: of the scan, which the cut holds. A code reader sees red light alone; the
    camera's own light is the best approximation that is available here, and the grades state this.
    """
    total: NDArray[np.float32] | None = None
    for lines, sensor in zip(dn, sensors, strict=True):
        gain = sensor.column_gain[columns] * np.float32(sensor.white_dn * len(sensors))
        per_dn = (1 / np.maximum(gain, LEAST_GAIN_DN)).astype(np.float32)
        light = lines * per_dn
        total = light if total is None else np.add(total, light, out=total)
        total -= sensor.column_offset_dn[columns] * per_dn
    assert total is not None  # a press has a sensor
    return total


def grey(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return light, bare paper 1, as a picture that code readers take."""
    # OpenCV's sum of two images, the second without weight, rounds and clips in one pass, and twice as fast.
    return np.asarray(cv2.addWeighted(light, PAPER, light, 0, 0, dtype=cv2.CV_8U), np.uint8)
