"""Tone of a scan: conversion of a file's numbers to linear light, and which of them are clipped.

A scanner stores numbers for the eye or for a screen. The curve is that of the file's ICC profile where it has one,
else sRGB's (IEC 61966-2-1), unless the user states another.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from PIL import Image, ImageCms

from prooflight.errors import RequestError, ScanError
from prooflight.spectra import srgb_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAST_GAMMA, MOST_GAMMA = 0.2, 5.0
BAND_ROWS: Final = 256
"""Rows that are converted at a time."""
EIGHT_BITS: Final = 255
_REMEDY: Final = "give srgb, linear or a gamma such as 2.2, and where needed black and white, as 2.2:3:98"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tone:
    """Curve from a file's numbers to light, as a user states it."""

    gamma: float | None = None
    """Exponent of the curve; None: sRGB's curve. [-]"""
    black: float = 0.0
    """Number that stands for no light, as a share of the greatest. [-]"""
    white: float = 1.0
    """Number that stands for full light, likewise; what is at it or above is clipped. [-]"""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``srgb``, ``linear`` or a gamma, then optionally ``:BLACK:WHITE`` in per cent of the greatest number.

        RequestError: the text is nothing of the kind.
        """
        curve, *points = text.strip().lower().split(":")
        try:
            black, white = (float(point) / 100 for point in points) if points else (0.0, 1.0)
            gamma = {"srgb": None, "linear": 1.0}[curve] if curve in ("srgb", "linear") else float(curve)
        except ValueError:
            raise RequestError("--tone", f"there is no tone {text!r}", remedy=_REMEDY) from None
        if gamma is not None and not LEAST_GAMMA <= gamma <= MOST_GAMMA:
            remedy = f"give a gamma of {LEAST_GAMMA} to {MOST_GAMMA}, srgb or linear"
            raise RequestError("--tone", f"{curve} is not a gamma of a scan", remedy=remedy)
        if not (0 <= black < white <= 1 and math.isfinite(white)):
            raise RequestError("--tone", f"{text!r} has no black below its white", remedy=_REMEDY)
        return cls(gamma=gamma, black=black, white=white)

    def light(self, numbers: NDArray[np.float32], full: float) -> NDArray[np.float32]:
        """Return the light of a file's numbers up to ``full``, 0 to 1 of its white point, as a new array."""
        shares = (numbers / np.float32(full) - np.float32(self.black)) / np.float32(self.white - self.black)
        shares = np.clip(shares, 0, 1, dtype=np.float32)
        if self.gamma is None:
            return srgb_light(shares)
        return shares if self.gamma == 1 else np.power(shares, np.float32(self.gamma))

    def clipped(self, numbers: NDArray[np.float32], full: float) -> NDArray[np.bool_]:
        """Return which samples are at the greatest number or at the white point: of their light the least is known."""
        return np.asarray(numbers >= np.float32(full * self.white))


SRGB: Final = Tone()


def by_profile(
    where: object, numbers: NDArray[np.float32], full: float, profile: bytes
) -> NDArray[np.float32]:
    """Return the light of a file's numbers (channels, lines, pixels) by its ICC profile, 0 to 1 of sRGB's white.

    The profile is applied to 8 bits. ScanError: it is broken, or of other colours than the file.
    """
    grey = len(numbers) == 1
    remedy = "save the scan without its profile, or state its curve by --tone srgb"
    try:
        source = ImageCms.getOpenProfile(io.BytesIO(profile))
        space = source.profile.xcolor_space.strip()
        if space != ("GRAY" if grey else "RGB"):
            what = f"its ICC profile is of {space}, the scan is {'grey' if grey else 'RGB'}"
            raise ScanError(where, what, remedy=remedy)
        link = ImageCms.buildTransform(source, ImageCms.createProfile("sRGB"), "L" if grey else "RGB", "RGB")
        light = np.empty_like(numbers)
        for top in range(0, numbers.shape[1], BAND_ROWS):
            band = numbers[:, top : top + BAND_ROWS]
            eight = np.rint(band * np.float32(EIGHT_BITS / full)).clip(0, EIGHT_BITS).astype(np.uint8)
            seen = Image.fromarray(eight[0] if grey else np.ascontiguousarray(np.moveaxis(eight, 0, -1)))
            srgb = ImageCms.applyTransform(seen, link)
            assert srgb is not None
            samples = np.moveaxis(np.asarray(srgb), -1, 0)[: len(numbers)]
            light[:, top : top + BAND_ROWS] = srgb_light(samples.astype(np.float32) / np.float32(EIGHT_BITS))
    except (ImageCms.PyCMSError, OSError) as error:
        raise ScanError(where, f"its ICC profile cannot be used ({error})", remedy=remedy) from None
    return light
