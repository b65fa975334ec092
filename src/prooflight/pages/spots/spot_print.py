"""What a press with a unit of its own for a spot ink prints of it, in the four inks of prediction's tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.pages.warnings import WHOLE_FILE, PageWarning

STEPS: Final = 17
"""Even steps of tint at which a mixture is computed, paper first; between them it is interpolated."""
KIND: Final = "spot-print"
"""Kind of the warning that a spot ink may look otherwise than predicted."""

Recipe = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotPrint:
    """One spot ink that a press prints by a unit of its own; small, hashable and picklable."""

    name: str
    """Name of the colorant in PDFs."""
    mixture: tuple[Recipe, ...] = ()
    """Shares 0 to 1 of C, M, Y and K, at ``STEPS`` even tints, that give the camera the light of the ink.

    Empty: its spectrum is not known, and the file's tint transform predicts it."""
    light_off: float = 0.0
    """Greatest difference of that light from the ink's, over sensors and tints, as a share of paper white."""
    warnings: tuple[str, ...] = ()
    """What may print otherwise than predicted, as sentences."""

    def cmyk(self, tints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shares (n, 4) of process inks of tints (n,)."""
        curves, even = np.array(self.mixture), np.linspace(0, 1, len(self.mixture))
        return np.stack([np.interp(tints, even, curve) for curve in curves.T], axis=1)

    @property
    def page_warnings(self) -> tuple[PageWarning, ...]:
        """Return the warnings as those of a whole job."""
        return tuple(
            PageWarning(
                page=WHOLE_FILE, kind=KIND, message=f"spot ink {self.name}: {text}", object_name=self.name
            )
            for text in self.warnings
        )
