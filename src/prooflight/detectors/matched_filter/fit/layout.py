"""The fit's vector: which amount stands where in it, so that nobody counts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from math import prod
from typing import TYPE_CHECKING, NamedTuple

from prooflight.cmyk import INKS
from prooflight.detectors.base import LAMP_WAVES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class FitParts(NamedTuple):
    """A vector of the fit by what its amounts are of, or arrays whose last axis is such a vector: views of it."""

    white: NDArray[np.float64]
    """(..., sensors) each sensor's light by itself."""
    common: NDArray[np.float64]
    """(..., 1) light of all sensors alike."""
    lamp: NDArray[np.float64]
    """(..., LAMP_WAVES) waves of the lamp's profile."""
    shape: NDArray[np.float64]
    """(..., sensors, colours) smooth functions of the page's colours."""
    gain: NDArray[np.float64]
    """(..., 4, 3) of each ink at the centre, and what is added at the right and lower edges."""
    dot: NDArray[np.float64]
    """(..., 4) dot gain of each ink."""
    planes: NDArray[np.float64]
    """(..., 4, 2) of each ink's plane, to the right and down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitLayout:
    """Which amounts a fit has, and in which order."""

    sensors: int
    colours: int
    """Smooth functions of colour that the page has."""

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Of the parts of one vector, in their order."""
        of_colours = self.sensors, self.colours
        return (self.sensors,), (1,), (LAMP_WAVES,), of_colours, (INKS, 3), (INKS,), (INKS, 2)

    @property
    def size(self) -> int:
        """Amounts altogether."""
        return sum(prod(shape) for shape in self.shapes)

    def parts(self, vectors: NDArray[np.float64]) -> FitParts:
        """Views of vectors (..., size)."""
        ends = list(accumulate(prod(shape) for shape in self.shapes))
        pieces = (
            vectors[..., end - prod(shape) : end].reshape(*vectors.shape[:-1], *shape)
            for end, shape in zip(ends, self.shapes, strict=True)
        )
        return FitParts(*pieces)
