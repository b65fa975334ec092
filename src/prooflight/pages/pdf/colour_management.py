"""Colours that are not ink yet, converted to the inks of the press by Little CMS.

MuPDF converts with Little CMS as well, but through a coarse device link and with truncation: up to 11 of 255 away
from what the profiles say. Here: a fine link (cmsFLAGS_HIGHRESPRECALC), 1 of 255 away with the profiles tried.

Imported late, by ``drawing`` and what it uses only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms
from pymupdf import _mupdf, mupdf

ToInk = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Conversion of colours (colours, components) of some space to ink amounts 0..1 (colours, 4)."""
_INTENT_BITS = 3  # MuPDF keeps a flag of its own above the rendering intent
_LAB_SCALE = (2.55, 1.0, 1.0)  # Pillow's LAB: L* as 255 L*/100, a* and b* as signed bytes


def address(pointer: Any) -> int:
    """Return the memory address of a MuPDF object; 0 for none."""
    return int(pointer.this) if pointer else 0


def profile_of(space: Any) -> bytes | None:
    """Return the ICC profile of a MuPDF colour space (``mupdf.FzColorspace``); None if it has none."""
    # A PSD is the one thing MuPDF writes with the profile in it; it cannot write one into memory.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one-pixel.psd"
        mupdf.fz_save_pixmap_as_psd(mupdf.fz_new_pixmap(space, 1, 1, mupdf.FzSeparations(), 0), str(path))
        with Image.open(path) as image:
            profile: bytes | None = image.info.get("icc_profile")
            return profile


@lru_cache(maxsize=16)
def fine_link(
    source: bytes | None, target: bytes, *, mode: str, intent: int, black_point: bool
) -> ImageCms.ImageCmsTransform:
    """Return a conversion to CMYK ``target``; ``source`` None is CIELAB.

    ``mode`` is Pillow's name of the source's colours. ``intent`` is 0 perceptual, 1 relative colorimetric, 2
    saturation, 3 absolute colorimetric (ICC.1:2022, 7.2.15). PyCMSError: a profile is broken, or not for
    these colours.
    """
    opened = ImageCms.createProfile("LAB") if source is None else ImageCms.getOpenProfile(io.BytesIO(source))
    flags = ImageCms.Flags.HIGHRESPRECALC
    if black_point:
        flags |= ImageCms.Flags.BLACKPOINTCOMPENSATION
    return ImageCms.buildTransform(
        opened, ImageCms.getOpenProfile(io.BytesIO(target)), mode, "CMYK", ImageCms.Intent(intent), flags
    )


def apply_link(link: ImageCms.ImageCmsTransform, samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert (rows, columns, channels) to (rows, columns, 4), 0 = no ink."""
    rows, columns = samples.shape[:2]
    image = Image.frombuffer(link.input_mode, (columns, rows), np.ascontiguousarray(samples), "raw")
    cmyk = Image.new("CMYK", image.size)
    # Not apply(): it copies the target profile into every result, which takes 20 ms even for a single colour.
    link.transform.apply(image.getim(), cmyk.getim())
    return np.asarray(cmyk)


class Inks:
    """Target of all conversions: a CMYK colour space of MuPDF with its profile."""

    def __init__(self, space: Any) -> None:
        """Take ``space``, a ``mupdf.FzColorspace``."""
        self.space = space
        self.troubles: list[str] = []
        """Messages about profiles that could not be used."""
        self._profile = profile_of(space)
        self._profiles: dict[int, tuple[Any, bytes | None]] = {}

    def is_native(self, space: Any) -> bool:
        """Return whether a colour of ``space`` (low level) is printed as it is, as ICC-based CMYK of the same
        profile is too.
        """
        return bool(
            address(space) == address(self.space.m_internal)
            or mupdf.ll_fz_colorspace_is_device_cmyk(space)
            or mupdf.ll_fz_colorspace_is_device_gray(space)
            or (
                space.n == 4 and mupdf.ll_fz_colorspace_is_icc(space) and self._source(space) == self._profile
            )
        )

    def link(self, space: Any, parameters: Any) -> ImageCms.ImageCmsTransform | None:
        """Return the conversion from ``space`` (low level), which is not native; None if MuPDF must do it.

        ``parameters`` are MuPDF's, with rendering intent and black point compensation.
        """
        if self._profile is None:
            return None
        if mupdf.ll_fz_colorspace_is_lab(space):
            mode, source = "LAB", None
        else:
            mode = {1: "L", 3: "RGB", 4: "CMYK"}.get(space.n, "")
            source = self._source(space) if mode and mupdf.ll_fz_colorspace_is_icc(space) else None
            if source is None:
                return None
        try:
            return fine_link(
                source,
                self._profile,
                mode=mode,
                intent=parameters.ri & _INTENT_BITS,
                black_point=bool(parameters.bp),
            )
        except ImageCms.PyCMSError as error:
            self.troubles.append(f"an ICC profile cannot be used: {error}")
            return None

    def convert(
        self, space: Any, colours: Sequence[Sequence[float]] | NDArray[np.float64], parameters: Any
    ) -> NDArray[np.float64] | None:
        """Return ink amounts 0..1 (colours, 4) of colours of ``space``; None if only MuPDF can convert them."""
        amounts = np.asarray(colours, dtype=np.float64)
        if mupdf.ll_fz_colorspace_is_device_gray(space):
            inks = np.zeros((len(amounts), 4))  # not np.pad: pages of many drawn lines ask ten thousand times
            inks[:, 3:] = 1.0 - amounts
            return inks
        if self.is_native(space):
            return amounts
        link = self.link(space, parameters)
        if link is None:
            return None
        scale = _LAB_SCALE if link.input_mode == "LAB" else (255.0,) * space.n
        samples = np.rint(amounts * scale).astype(np.int64).astype(np.uint8)
        return apply_link(link, samples[None])[0] / 255

    def amounts(
        self, space: Any, colours: Sequence[Sequence[float]] | NDArray[np.float64], parameters: Any
    ) -> NDArray[np.float64]:
        """Return ink amounts as ``convert``, computed by MuPDF where only MuPDF can."""
        converted = self.convert(space, colours, parameters)
        if converted is not None:
            return converted
        colour, out = mupdf.new_floats(space.n), mupdf.new_floats(4)
        converted = np.empty((len(colours), 4))
        for row, amounts in zip(converted, colours, strict=True):
            for i, amount in enumerate(amounts):
                mupdf.floats_setitem(colour, i, float(amount))
            _mupdf.ll_fz_convert_color(space, colour, self.space.m_internal, out, None, parameters)
            row[:] = [mupdf.floats_getitem(out, i) for i in range(4)]
        mupdf.delete_floats(colour)
        mupdf.delete_floats(out)
        return converted

    def _source(self, space: Any) -> bytes | None:
        key = address(space)
        if key not in self._profiles:
            retained = mupdf.FzColorspace(
                mupdf.ll_fz_keep_colorspace(space)
            )  # so that the address stays its own
            self._profiles[key] = retained, profile_of(retained)
        return self._profiles[key][1]
