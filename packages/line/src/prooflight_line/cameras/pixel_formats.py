"""Conversion of a camera's bytes to raw digital numbers, for the pixel formats of line cameras.

Names are those of the Pixel Format Naming Convention (EMVA PFNC 2.4): an ending ``p`` packs pixels without a
gap, the least bit first; ``Packed`` is GigE Vision's older way, two pixels in three bytes with the low bits
of both in the middle one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Numbers = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelFormat:
    """Encoding of pixels in a block's bytes."""

    name: str
    bits: int
    """Bits of a pixel's number."""
    sensors: int = 1
    """Numbers at one place on the line: 3 of a colour camera."""
    group: tuple[int, int] = (1, 1)
    """Numbers and bytes of the smallest group that can be decoded by itself."""
    unpacked: Callable[[Bytes], Numbers]
    """Function that decodes whole groups of bytes to their numbers, in order."""

    @property
    def top_code_dn(self) -> int:
        """Greatest digital number. [DN]"""
        return (1 << self.bits) - 1

    def block_bits(self, *, lines: int, pixels: int) -> int:
        """Return the number of bits of so many lines without padding."""
        numbers, size = self.group
        return lines * pixels * self.sensors * 8 * size // numbers


def _bytes(data: Bytes) -> Numbers:
    return data


def _uint16_codes(data: Bytes) -> Numbers:
    return data.view("<u2")


def _ten_p(data: Bytes) -> Numbers:
    five = data.reshape(-1, 5).astype(np.uint16)
    codes = np.empty((len(five), 4), np.uint16)
    for at in range(4):
        codes[:, at] = (five[:, at] >> (2 * at)) | (five[:, at + 1] << (8 - 2 * at) & 0x3FF)
    return codes.ravel()


def _twelve_p(data: Bytes) -> Numbers:
    three = data.reshape(-1, 3).astype(np.uint16)
    codes = np.empty((len(three), 2), np.uint16)
    codes[:, 0] = three[:, 0] | (three[:, 1] & 0xF) << 8
    codes[:, 1] = three[:, 1] >> 4 | three[:, 2] << 4
    return codes.ravel()


def _ten_packed(data: Bytes) -> Numbers:
    three = data.reshape(-1, 3).astype(np.uint16)
    codes = np.empty((len(three), 2), np.uint16)
    codes[:, 0] = three[:, 0] << 2 | (three[:, 1] & 0x3)
    codes[:, 1] = three[:, 2] << 2 | (three[:, 1] >> 4 & 0x3)
    return codes.ravel()


def _twelve_packed(data: Bytes) -> Numbers:
    three = data.reshape(-1, 3).astype(np.uint16)
    codes = np.empty((len(three), 2), np.uint16)
    codes[:, 0] = three[:, 0] << 4 | (three[:, 1] & 0xF)
    codes[:, 1] = three[:, 2] << 4 | three[:, 1] >> 4
    return codes.ravel()


PIXEL_FORMATS: Final = {
    one.name: one
    for one in (
        PixelFormat(name="Mono8", bits=8, unpacked=_bytes),
        PixelFormat(name="Mono10", bits=10, group=(1, 2), unpacked=_uint16_codes),
        PixelFormat(name="Mono12", bits=12, group=(1, 2), unpacked=_uint16_codes),
        PixelFormat(name="Mono16", bits=16, group=(1, 2), unpacked=_uint16_codes),
        PixelFormat(name="Mono10p", bits=10, group=(4, 5), unpacked=_ten_p),
        PixelFormat(name="Mono12p", bits=12, group=(2, 3), unpacked=_twelve_p),
        PixelFormat(name="Mono10Packed", bits=10, group=(2, 3), unpacked=_ten_packed),
        PixelFormat(name="Mono12Packed", bits=12, group=(2, 3), unpacked=_twelve_packed),
        PixelFormat(name="RGB8", bits=8, sensors=3, unpacked=_bytes),
        PixelFormat(name="RGB10", bits=10, sensors=3, group=(1, 2), unpacked=_uint16_codes),
        PixelFormat(name="RGB12", bits=12, sensors=3, group=(1, 2), unpacked=_uint16_codes),
        PixelFormat(name="RGB16", bits=16, sensors=3, group=(1, 2), unpacked=_uint16_codes),
    )
}

OLDER: Final = {f"RGB{bits}Packed": f"RGB{bits}" for bits in (8, 10, 12, 16)}
"""Names in GigE Vision 1 that differ from the naming convention."""


def pixel_format(name: str, *, where: str) -> PixelFormat:
    """Return the format of that name; ScanError names those that can be read. where: the camera, in errors."""
    name = OLDER.get(name, name)
    if name not in PIXEL_FORMATS:
        choices = ", ".join(PIXEL_FORMATS)
        raise ScanError(
            where, f"sends pixel format {shortly(name)}", remedy=f"set its PixelFormat to one of {choices}"
        )
    return PIXEL_FORMATS[name]


def unpacked(
    data: Bytes, form: PixelFormat, *, lines: int, pixels: int, padding: int = 0, where: str = "the camera"
) -> NDArray[np.uint16]:
    """Decode a block to numbers, (sensors, lines, pixels) [DN]; the array is new.

    data: bytes as they came, (n,) uint8. padding: bytes after each line that are no pixels; lines of packed
    pixels that end within a byte continue in it, and then cannot be padded. ScanError: there are too few
    bytes.
    """
    line_bits = form.block_bits(lines=1, pixels=pixels)
    if line_bits % 8 and padding:
        what = f"pads lines of {pixels} {form.name} pixels, which end within a byte"
        raise ScanError(where, what, remedy="set a Width that is a multiple of 8")
    needed = lines * (line_bits // 8 + padding) - padding if padding else -(-lines * line_bits // 8)
    if data.size < needed:
        what = f"sent {data.size} bytes where {lines} lines of {pixels} {form.name} pixels take {needed}"
        raise ScanError(where, what, remedy="read its Width, Height and PixelFormat again")
    if padding:
        stride = line_bits // 8 + padding
        whole = np.zeros(lines * stride, np.uint8)
        whole[:needed] = data[:needed]
        data = whole.reshape(lines, stride)[:, :-padding].ravel()
    else:
        data = data[:needed]
    if short := -data.size % form.group[1]:
        data = np.concatenate([data, np.zeros(short, np.uint8)])
    codes = form.unpacked(np.ascontiguousarray(data))[: lines * pixels * form.sensors]
    return codes.reshape(lines, pixels, form.sensors).transpose(2, 0, 1).astype(np.uint16, order="C")
