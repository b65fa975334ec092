"""Gaussian noise of one grain on a sheet, which moves with the sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np

from prooflight.simulation.sheets import smooth_field

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

NODES_A_GRAIN: Final = 6
"""Nodes of the field per grain; a cubic through these omits less than 0.1 % of the field's variance."""
REACH_NODES: Final = 2
"""Nodes beyond the page that a cubic needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetTexture:
    """A field over a page, of mean 0 and standard deviation 1 everywhere."""

    nodes: NDArray[np.float32]
    """Values at nodes ``pitch_mm`` apart, (rows, columns); the first is ``REACH_NODES`` beyond the page's corner.
    [-]
    """
    pitch_mm: float

    @classmethod
    def draw(cls, page: Page, grain_mm: float, rng: np.random.Generator) -> Self:
        """Draw a field.

        grain_mm: full width at half maximum of the correlation, exp(-(d / l)^2) at a distance d. [mm]
        """
        pitch_mm = grain_mm / NODES_A_GRAIN
        rows, columns = (
            int(extent / pitch_mm) + 2 + 2 * REACH_NODES for extent in (page.height_mm, page.width_mm)
        )
        length_mm = grain_mm / (2 * np.sqrt(np.log(2)))
        nodes = smooth_field(rows, columns, pitch_mm=pitch_mm, length_mm=length_mm, rng=rng)
        return cls(nodes=nodes.astype(np.float32), pitch_mm=pitch_mm)

    def at(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float32]:
        """Interpolate at points of the page, two arrays (rows, columns) -> (rows, columns).

        The field is mirrored beyond the nodes.
        """
        column, row = ((each / self.pitch_mm + REACH_NODES).astype(np.float32) for each in (x_mm, y_mm))
        values: NDArray[np.float32] = cv2.remap(
            self.nodes, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
        )
        return values
