"""Printed page whose ink planes are out of register."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.pages.planes import displaced

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrintedPage:
    """A design and the displacements of its planes; prediction composes its rows as it needs them."""

    page: Page
    planes: NDArray[np.int64]
    """Raster pixels by which each plane, CMYK, lies too far right and too far down, (4, 2); it is bare
    beyond."""

    def composed(self) -> Page:
        """Return the composed raster, where one is needed as a whole."""
        return displaced(self.page, self.planes)
