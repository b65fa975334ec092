"""Reader of bar codes and matrix codes in a picture; the one module that uses the library."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
import zxingcpp

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

LINEAR: Final = frozenset(
    map(str, zxingcpp.barcode_formats_list(zxingcpp.BarcodeFormats(zxingcpp.BarcodeFormat.AllLinear)))
)
"""Symbologies of bars, by the library's names."""
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


def symbols(picture: NDArray[np.uint8], symbology: str | None = None) -> list[Symbol]:
    """Read all codes in a picture (lines, pixels).

    symbology: read that alone, which takes a tenth of the time.
    """
    wanted = {} if symbology is None else {"formats": _format(symbology)}
    return [_symbol(barcode) for barcode in zxingcpp.read_barcodes(np.ascontiguousarray(picture), **wanted)]


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
    turned = picture if along_lines else np.rot90(picture)
    barcodes = zxingcpp.read_barcodes(
        np.ascontiguousarray(turned),
        formats=_format(symbology),
        try_rotate=False,
        try_downscale=False,
        try_invert=False,
    )
    last = picture.shape[1] - 1
    for one in map(_symbol, barcodes):
        yield one if along_lines else replace(one, corners=tuple((last - y, x) for x, y in one.corners))


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
