"""Public PDF pages by both engines of the product: how much ink differs, where no edge is near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.cmyk import INKS
from prooflight.errors import InputError
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

PAGES_DPI: Final = 100.0
BEYOND: Final = 8
"""Steps of 255 beyond which a pixel differs: 3 % of ink, what profiles and two decoders leave."""
EVEN: Final = 3
"""Where no ink of either drawing varies by more over 5 x 5 pixels, no edge is near. [of 255]"""
REMARKS: Final = {
    "d000": "DeviceRGB stands for the RGB profile of the page's own output intent, which Ghostscript does not read",
    "d009": "its image has fewer rows than it states: ours prints them as 0, which is black, and says so",
    "d020": "of eight like inline images Ghostscript draws two wrong and four not at all",
    "d025": "the colours of a small JPEG are enlarged otherwise by the two decoders, as both may",
}
"""Why pages differ, by their files and by pictures of both drawings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRow:
    """One page by both engines; empty tuples: one of them refuses it."""

    page: str
    differ_percent: tuple[float, ...]
    """Share of pixels that differ by more than ``BEYOND``, in C, M, Y and K."""
    even_differ_percent: float
    """The same in any ink, of the pixels with no edge near."""
    largest_even: tuple[int, ...]
    """The largest difference with no edge near, in C, M, Y and K. [of 255]"""
    refused: str
    """The engines that refuse it, and why; empty: none does."""
    warnings: int
    """How many our engine gives."""
    remark: str


def page_row(path: Path, profile: Path | None) -> PageRow:
    """Draw the first page of a PDF by both engines, colours that are no ink by one profile, and compare."""
    drawn: list[NDArray[np.uint8]] = []
    refused, warnings = [], 0
    for name in ("mupdf", "ghostscript"):
        try:
            with PdfJob(path, profile=profile, engine=RipEngine(name=name)) as job:
                page = job.page(1, PAGES_DPI)
        except InputError as error:
            refused.append(f"{name}: {error.what}")
            continue
        drawn.append(page.cmyk)
        warnings += len(page.warnings) if name == "mupdf" else 0
    if refused:
        differ: tuple[tuple[float, ...], float, tuple[int, ...]] = ((), 0.0, ())
    else:
        differ = difference(*drawn)
    return PageRow(
        page=path.stem,
        differ_percent=differ[0],
        even_differ_percent=differ[1],
        largest_even=differ[2],
        refused="; ".join(refused),
        warnings=warnings,
        remark=REMARKS.get(path.stem, ""),
    )


def difference(
    own: NDArray[np.uint8], theirs: NDArray[np.uint8]
) -> tuple[tuple[float, ...], float, tuple[int, ...]]:
    """Compare two drawings (rows, columns, 4): ``differ_percent``, ``even_differ_percent`` and ``largest_even``."""
    difference = np.maximum(own, theirs) - np.minimum(own, theirs)
    even = np.maximum(_variation(own), _variation(theirs)) <= EVEN
    inside = difference[even]
    return (
        tuple(float(100 * (difference[..., ink] > BEYOND).mean()) for ink in range(INKS)),
        float(100 * (inside > BEYOND).any(axis=1).mean()) if inside.size else 0.0,
        tuple(int(inside[:, ink].max(initial=0)) for ink in range(INKS)),
    )


def _variation(cmyk: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The largest variation of an ink over 5 x 5 pixels, (rows, columns)."""
    size = (5, 5, 1)
    spread: NDArray[np.uint8] = ndimage.maximum_filter(cmyk, size) - ndimage.minimum_filter(cmyk, size)
    return spread.max(axis=2)
