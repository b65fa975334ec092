"""A page as a print shows it, whose ink planes lie apart."""

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
    """A design, and where its planes came to lie: prediction composes its rows as it comes to them."""

    page: Page
    planes: NDArray[np.int64]
    """(4, 2) how many raster pixels each plane, CMYK, lies too far right and too far down; bare beyond."""

    def composed(self) -> Page:
        """The raster written out, where one is needed as a whole."""
        return displaced(self.page, self.planes)
