"""What tests use in place of data made by others, which lies in the folder ``shared`` beside the repository if at all.

A test runs on the stand-in always, and on the others' data where it is there.
"""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from prooflight.inks.built_in import built_in_inks
from prooflight.spectra import lab

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

SHARED = Path(__file__).resolve().parents[1] / ".." / "shared"
OTHERS = {
    "a measured chart": ("data/spectral/APTEC_PC11_CCNB_2023_v1_Spectral.txt",),
    "characterisation data": tuple(f"data/charac/{name}.ti3" for name in ("FOGRA39L", "TR002", "FOGRA28L")),
    "golden pairs": ("data/deeppcb",),
    "ICC profiles": tuple(
        f"data/icc/{name}_mth.icc" for name in ("GRACoL2013coated_320", "PSOcoated_v3_300")
    ),
    "pages": ("data/pages/d000.pdf",),
}
"""What others made, by its kind: files below ``SHARED``."""
D50 = struct.pack(">3i", 63190, 65536, 54061)
"""X, Y, Z of ICC's white, s15Fixed16."""


def others(kind: str) -> list[Path]:
    """The files of that kind, if they are there: what parametrises a test beside its stand-in."""
    paths = [SHARED / place for place in OTHERS[kind]]
    return paths if all(path.exists() for path in paths) else []


@cache
def cmyk_profile(
    *, ink_nodes: int = 9, colour_nodes: int = 33, gamma: float = 1.8, black: float = 0.7
) -> bytes:
    """An output profile (ICC version 2) of the built-in press: what its inks look like, and inks for a colour.

    ink_nodes of each ink, colour_nodes of L*, a* and b*. The way back only goes in the right direction: three inks by
    the encoded (``gamma``) light of three primaries, and of what all three have in common the share ``black`` as black.
    """
    recipes = np.stack(np.meshgrid(*[np.linspace(0, 1, ink_nodes)] * 4, indexing="ij"), axis=-1)
    seen = lab(built_in_inks().reflectance(recipes)).reshape(-1, 3)
    looks = np.stack([seen[:, 0] * 652.8, (seen[:, 1] + 128) * 256, (seen[:, 2] + 128) * 256], axis=1)
    level = np.linspace(0, 65535, colour_nodes)
    colours = np.stack(
        np.meshgrid(level / 652.8, level / 256 - 128, level / 256 - 128, indexing="ij"), axis=-1
    )
    inks = _separated(colours.reshape(-1, 3), gamma, black)
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 6) + b"table\0" + bytes(78),
        b"cprt": b"text" + bytes(4) + b"none\0",
        b"wtpt": b"XYZ " + bytes(4) + D50,
        b"A2B0": _table(4, 3, ink_nodes, looks),
        b"B2A0": _table(3, 4, colour_nodes, 65535 * inks),
    }
    first, index, body = 128 + 4 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        index += name + struct.pack(">II", first + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI4s4s4s", first + len(body), bytes(4), 0x02400000, b"prtr", b"CMYK", b"Lab ")
    head += struct.pack(">6H", 2001, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + D50
    return head + bytes(128 - len(head)) + index + body


def _separated(colours: np.ndarray, gamma: float, black: float) -> np.ndarray:
    """L*, a*, b* (n, 3) -> C, M, Y, K (n, 4), 0 to 1."""
    height = (colours[:, :1] + 16) / 116 + colours[:, 1:] @ np.array([[1 / 500, 0, 0], [0, 0, -1 / 200]])
    xyz = np.where(height > 6 / 29, height**3, 3 * (6 / 29) ** 2 * (height - 4 / 29))
    to_rgb = np.array([[3.02, -1.59, -0.41], [-0.94, 1.92, 0.03], [0.06, -0.19, 1.16]])  # of relative X, Y, Z
    cmy = 1 - np.clip(xyz @ to_rgb.T, 0, 1) ** (1 / gamma)
    common = black * cmy.prod(axis=1, keepdims=True)
    return np.clip(np.concatenate([cmy - 0.8 * common, common], axis=1), 0, 1)


def _table(inputs: int, outputs: int, count: int, nodes: np.ndarray) -> bytes:
    """A lut16Type with straight curves; nodes (count ^ inputs, outputs), 0 to 65535."""
    straight = struct.pack(">2H", 0, 65535)
    identity = struct.pack(">9i", *(65536 * (at % 4 == 0) for at in range(9)))
    head = (
        b"mft2"
        + bytes(4)
        + struct.pack(">4B", inputs, outputs, count, 0)
        + identity
        + struct.pack(">2H", 2, 2)
    )
    return (
        head + inputs * straight + np.rint(nodes).clip(0, 65535).astype(">u2").tobytes() + outputs * straight
    )


def write_jpeg(page: Page, path: Path, *, quality: int = 95) -> None:
    """Write a page as a CMYK JPEG as Adobe stores it (inverted), not subsampled; the resolution is rounded."""
    dpi = round(page.dpi)
    Image.fromarray(page.cmyk, mode="CMYK").save(
        path, format="JPEG", quality=quality, subsampling=0, dpi=(dpi, dpi)
    )
