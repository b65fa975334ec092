"""Header data of a JPEG stream, read before it is decoded (ITU-T T.81, annex B)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

SCANS_MAX: Final = 100
"""Largest number of passes over the image: programs write ten or so, and each takes as long as decoding it
once."""
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_ALONE: Final = frozenset({0x01, 0xD8, *range(0xD0, 0xD8)})  # markers without a length
_END, _SCAN = 0xD9, 0xDA


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Size of a JPEG image."""

    rows: int
    columns: int
    components: int


def frame(data: bytes) -> Frame:
    """Return the frame of a JPEG stream; ValueError if it has none, or more passes than ``SCANS_MAX``."""
    scans = data.count(b"\xff\xda")  # within a pass, FF is always followed by 00 or a restart
    if scans > SCANS_MAX:
        message = f"it is stored in {scans} passes"
        raise ValueError(message)
    place = 0
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            break
        marker = data[place + 1]
        if marker == 0xFF or marker in _ALONE:
            place += 1 if marker == 0xFF else 2
            continue
        if marker in (_END, _SCAN):
            break
        (length,) = struct.unpack_from(">H", data, place + 2)
        if marker in _FRAMES and place + 10 <= len(data):
            rows, columns, components = struct.unpack_from(">HHB", data, place + 5)
            return Frame(rows=rows, columns=columns, components=components)
        place += 2 + length
    message = "it does not say how large it is"
    raise ValueError(message)
