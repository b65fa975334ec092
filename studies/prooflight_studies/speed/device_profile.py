"""A CMYK profile made in memory, so that lcms2 can look up the same table as prediction."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import ImageCms

if TYPE_CHECKING:
    from numpy.typing import NDArray

WHITE_D50: Final = (0.9642, 1.0, 0.8249)
LAB_WHITE: Final = 0xFF00
"""L* = 100 in a 16-bit table (ICC.1:2001-04, 6.5.9: ``lut16Type``, legacy encoding)."""


def cmyk_to_lab(lightness: NDArray[np.floating]) -> ImageCms.ImageCmsTransform:
    """Return Pillow's transform of CMYK to L*a*b* whose L* is a table (n, n, n, n) of 0..1 over the four inks."""
    profile = ImageCms.ImageCmsProfile(io.BytesIO(profile_bytes(lightness)))
    return ImageCms.buildTransform(profile, ImageCms.createProfile("LAB"), "CMYK", "LAB")


def profile_bytes(lightness: NDArray[np.floating]) -> bytes:
    """Return a minimal output profile (ICC.1:2001-04, 6.3.3): description, copyright, white, one table."""
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 6) + b"table\0" + bytes(78),
        b"cprt": b"text" + bytes(4) + b"none\0",
        b"wtpt": b"XYZ " + bytes(4) + _fixed(*WHITE_D50),
        b"A2B0": _table(lightness),
    }
    first, index, body = 128 + 4 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        index += name + struct.pack(">II", first + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI4s4s4s", first + len(body), bytes(4), 0x02400000, b"prtr", b"CMYK", b"Lab ")
    head += struct.pack(">6H", 2001, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + _fixed(*WHITE_D50)
    return head + bytes(128 - len(head)) + index + body


def _fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))


def _table(lightness: NDArray[np.floating]) -> bytes:
    nodes = np.full((*lightness.shape, 3), 0x8000, ">u2")
    nodes[..., 0] = np.rint(np.clip(lightness, 0, 1) * LAB_WHITE)
    straight = struct.pack(">2H", 0, 65535)
    head = (
        b"mft2" + bytes(4) + struct.pack(">4B", 4, 3, len(lightness), 0) + _fixed(1, 0, 0, 0, 1, 0, 0, 0, 1)
    )
    return head + struct.pack(">2H", 2, 2) + 4 * straight + nodes.tobytes() + 3 * straight
