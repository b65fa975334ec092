"""What is known about the sample job's raster before anything rips it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.simulation.corpus.sample_job.inks import Ink

Box = tuple[float, float, float, float]
"""x, y, width, height from the page's top-left corner. [mm]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPatch:
    """A flat rectangle: every pixel that lies wholly inside it has one CMYK value, at any resolution.

    (0, 0) is the page's top-left corner, x to the right, y down.
    """

    page: int
    """Place in the job, from 1."""
    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float
    cmyk: Ink
    what: str
    """How the flat is made, e.g. ``process``, ``overprint``, ``spot``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownPicture:
    """A picture placed square to the page; its pixels lie on a 0.1 mm grid, so 254 dpi meets each of them."""

    page: int
    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float
    cmyk: NDArray[np.uint8]
    """(rows, columns, 4), C M Y K, 0 = no ink; row 0 is the top."""
    what: str
    """``photograph`` or ``gradient``."""
    covered: tuple[Box, ...] = ()
    """Where type or another picture lies on top, in page coordinates."""
