"""Parameters of one sensor for prediction: two tables over CMYK, its footprint, its columns."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from prooflight.files.fields import NO_OTHER_FIELDS
from prooflight.files.schema import Share
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.pages.lens_correction import LensCorrection

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.sampling import Footprint

STRAIGHT = 1e-3
"""Relative deviation of a variance from a straight line that is neglected: 0.05 % of sigma."""
EVERY = 2
SLOPE_NODES = (NODES - 1) // EVERY + 1
"""Number of nodes an ink: byte values 0, 16, ..., 256."""


def node_fractions() -> NDArray[np.float64]:
    """Return ink fractions at the nodes of one axis, (33,): 0, 8/255, ..., 256/255, the last just beyond full ink."""
    return np.arange(NODES, dtype=np.float64) * (NODE_STEP / 255)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClippedShare:
    """Shares of a sensor's table nodes whose noise is clipped, so that it is not Gaussian; 0..1 each."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    black: Share
    """Share of the nodes within four sigma of 0 DN."""
    saturation: Share
    """Share of the nodes within four sigma of the top code."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorModel:
    """Model of one sensor for prediction.

    Expected DN of a column = offset + gain x mean(CMYK); its temporal variance = dark variance + gain x
    (variance(CMYK) - dark variance), which is exact for shot noise.
    """

    name: str
    mean_dn: NDArray[np.float32]
    """Light signal at each node, above dark, column gain 1, (33, 33, 33, 33). [DN]"""
    variance_dn2: NDArray[np.float32]
    """Temporal variance at each node, rounding included, column gain 1, (33, 33, 33, 33). [DN^2]"""
    footprint: Footprint
    column_offset_dn: NDArray[np.float32]
    """Signal of each column without light: dark, DSNU, black level, (pixels,). [DN]"""
    column_gain: NDArray[np.float32]
    """Gain of each column: lamp, cos^4 and PRNU, 1 where the tables were measured, (pixels,). [-]"""
    dark_variance_dn2: float
    """Temporal variance without light, rounding included. [DN^2]"""
    backing_dn: float
    """Light signal of the backing beyond the page. [DN]"""
    backing_variance_dn2: float
    top_code_dn: int
    """Greatest digital number. [DN]"""
    correction: LensCorrection = field(default_factory=LensCorrection.none)
    """Part of the lens's point spread function that the footprint lacks."""

    def shot_slope(self) -> float:
        """Return the slope of variance over mean [DN] if that is linear, as for shot noise, backing included; else 0.

        Variance then need not be filtered, since it follows from the mean.
        """
        low, high = (
            np.unravel_index(find(self.mean_dn), self.mean_dn.shape) for find in (np.argmin, np.argmax)
        )
        rise = float(self.mean_dn[high]) - float(self.mean_dn[low])
        slope = (float(self.variance_dn2[high]) - float(self.variance_dn2[low])) / rise if rise > 0 else 0.0
        start = self.variance_dn2[low] - slope * self.mean_dn[low]
        nodes = np.abs(start + np.float32(slope) * self.mean_dn - self.variance_dn2)
        backing = abs(start + slope * self.backing_dn - self.backing_variance_dn2)
        straight = (
            nodes <= STRAIGHT * self.variance_dn2
        ).all() and backing <= STRAIGHT * self.backing_variance_dn2
        return slope if straight and slope > 0 else 0.0

    @property
    def white_dn(self) -> float:
        """Light signal of bare paper. [DN]"""
        return float(self.mean_dn[0, 0, 0, 0])


@lru_cache(maxsize=128)
def shot_slope(sensor: SensorModel) -> float:
    """Return ``SensorModel.shot_slope``, computed once, since it searches both tables."""
    return sensor.shot_slope()


class SameArray:
    """A key of an array by identity, not by equality."""

    def __init__(self, array: NDArray[np.float32]) -> None:
        self.array = array

    def __hash__(self) -> int:
        return id(self.array)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SameArray) and other.array is self.array


def mean_slopes(mean_dn: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return slopes of a mean by each ink at 17 nodes an ink, (17, 17, 17, 17, 4) [DN per whole ink], at column gain 1.

    They are the response of the expected signal to a little more of one ink (paper, section 3.4). Central
    differences over two steps of the mean table, 16 byte values; at an axis's ends the one-sided parabola
    through three nodes. Not stored: slopes at all 33^4 nodes would be 19 MB a sensor, and the table gives
    these 1.3 MB in a fraction of a second.
    """
    step = NODE_STEP / 255
    slopes = np.empty((*(SLOPE_NODES,) * 4, 4), np.float32)
    coarse = slice(None, None, EVERY)
    for ink in range(4):
        along = np.moveaxis(mean_dn, ink, 0)
        other = np.moveaxis(slopes[..., ink], ink, 0)
        thin = along[:, coarse, coarse, coarse].astype(np.float64)
        other[1:-1] = (thin[EVERY + 1 :: EVERY] - thin[EVERY - 1 : -EVERY : EVERY]) / (2 * step)
        other[0] = (4 * thin[1] - thin[2] - 3 * thin[0]) / (2 * step)
        other[-1] = (3 * thin[-1] + thin[-3] - 4 * thin[-2]) / (2 * step)
    return slopes
