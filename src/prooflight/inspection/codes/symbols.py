"""What reads bar codes and matrix codes from a picture; the one place that knows the library."""

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
"""Symbologies of bars, as the library calls them."""
TWICE: Final = 2
BLUR_PIXELS: Final = 0.8
"""assumed: noise of the camera is evened out, bars two pixels wide are not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Symbol:
    """A code that was read from a picture."""

    symbology: str
    """Its name: QR Code, Code 128, EAN-13, ..."""
    text: str
    corners: tuple[tuple[float, float], ...]
    """Four (x, y), as the code itself runs: top left, top right, bottom right, bottom left. [pixel]"""
    modules: tuple[int, int] | None = None
    """Rows and columns of squares of a QR code or a Data Matrix; None: it is none, or nobody said."""
    unused_correction: float | None = None
    """Share of its error correction that reading left unused (ISO/IEC 15415); None: nobody said."""

    @property
    def linear(self) -> bool:
        """Whether it is made of bars."""
        return self.symbology in LINEAR

    @property
    def along_lines(self) -> bool:
        """Whether it runs along the picture's lines, rather than across them."""
        (left, top), (right, bottom) = self.corners[:2]
        return abs(right - left) >= abs(bottom - top)


def symbols(picture: NDArray[np.uint8], symbology: str | None = None) -> list[Symbol]:
    """All codes in a picture (lines, pixels); symbology: of that alone, which takes a tenth of the time."""
    wanted = {} if symbology is None else {"formats": _format(symbology)}
    return [_symbol(found) for found in zxingcpp.read_barcodes(np.ascontiguousarray(picture), **wanted)]


def tried(picture: NDArray[np.uint8], symbology: str, *, along_lines: bool | None = None) -> Iterator[Symbol]:
    """What each way of reading finds in a picture: as it is, at twice its size, evened out, in plain black and white.

    A camera that sees a bar in three pixels is coarse for a reader; whoever stops at the right one tries no more.
    along_lines: how a bar code runs, where that is known: it is first looked for that way alone, which takes a third of
    the time.
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
    """Bar codes that run along the lines or across them, in dark bars, at the picture's own size."""
    turned = picture if along_lines else np.rot90(picture)
    found = zxingcpp.read_barcodes(
        np.ascontiguousarray(turned),
        formats=_format(symbology),
        try_rotate=False,
        try_downscale=False,
        try_invert=False,
    )
    last = picture.shape[1] - 1
    for one in map(_symbol, found):
        yield one if along_lines else replace(one, corners=tuple((last - y, x) for x, y in one.corners))


def _halved(found: list[Symbol]) -> Iterator[Symbol]:
    for one in found:
        yield replace(one, corners=tuple((x / TWICE, y / TWICE) for x, y in one.corners))


def _format(symbology: str) -> Any:
    return zxingcpp.barcode_format_from_str(symbology)


def _symbol(found: Any) -> Symbol:
    at, extra = found.position, found.extra or {}
    corners = (at.top_left, at.top_right, at.bottom_right, at.bottom_left)
    unused = extra.get("UEC")
    return Symbol(
        symbology=str(found.format),
        text=found.text,
        corners=tuple((float(point.x), float(point.y)) for point in corners),
        modules=_modules(str(found.format), str(extra.get("Version", ""))),
        unused_correction=None if unused is None else float(unused),
    )


def _modules(symbology: str, version: str) -> tuple[int, int] | None:
    """A QR code of version v has 4 v + 17 modules a side (ISO/IEC 18004, 5.3.1); a Data Matrix is named by its size."""
    if symbology == "QR Code" and version.isdigit():
        side = 4 * int(version) + 17
        return side, side
    rows, cross, columns = version.partition("x")
    if symbology == "Data Matrix" and cross and rows.isdigit() and columns.isdigit():
        return int(rows), int(columns)
    return None
