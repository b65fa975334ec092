"""Layout of the fit's parameter vector: which amounts it has, and their order."""

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
    """Parameter vectors of the fit, or arrays whose last axis is such a vector, by kind of amount.

    The parts are views.
    """

    white: NDArray[np.float64]
    """(..., sensors) light of each sensor."""
    common: NDArray[np.float64]
    """(..., 1) light common to all sensors."""
    lamp: NDArray[np.float64]
    """(..., LAMP_WAVES) waves of the lamp's profile."""
    shape: NDArray[np.float64]
    """(..., sensors, colours) weights of smooth functions of the page's colours."""
    gain: NDArray[np.float64]
    """(..., 4, 3) gain of each ink at the centre, and its increase at the right and at the lower edge."""
    dot: NDArray[np.float64]
    """(..., 4) dot gain of each ink."""
    planes: NDArray[np.float64]
    """(..., 4, 2) displacement of each ink's plane, to the right and down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitLayout:
    """Number and order of the amounts of a fit."""

    sensors: int
    colours: int
    """Number of smooth functions of colour that the page has."""

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the parts of one vector, in their order."""
        of_colours = self.sensors, self.colours
        return (self.sensors,), (1,), (LAMP_WAVES,), of_colours, (INKS, 3), (INKS,), (INKS, 2)

    @property
    def size(self) -> int:
        """Number of amounts."""
        return sum(prod(shape) for shape in self.shapes)

    def parts(self, vectors: NDArray[np.float64]) -> FitParts:
        """Return views of vectors (..., size) by kind of amount."""
        ends = list(accumulate(prod(shape) for shape in self.shapes))
        pieces = (
            vectors[..., end - prod(shape) : end].reshape(*vectors.shape[:-1], *shape)
            for end, shape in zip(ends, self.shapes, strict=True)
        )
        return FitParts(*pieces)
