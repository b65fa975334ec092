"""Sampling of a raster by camera pixels: footprints, and the weights that they give to raster pixels.

A footprint is the camera's blur on the page: lens, square pixel aperture, and along the travel the motion
during one line. It is treated as separable (across x along), which is exact for the aperture and the motion.
The lens is round and its light reaches far: the part that a short separable footprint misses is smooth, so
camera pixels can be corrected from their neighbours (``LensCorrection``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

ROUNDING: Final = 1e-6
"""Tolerance [pixels] of a footprint's centre of mass, for rounding errors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Footprint:
    """Cumulative line-spread functions of one camera pixel on the page, across the web and along the travel.

    ``across`` and ``along`` are (2 n + 1,) values rising from 0 to 1 over offsets -reach_mm .. reach_mm from
    the pixel's centre; beyond the reach the pixel sees nothing.
    """

    reach_mm: float
    across: NDArray[np.float64]
    along: NDArray[np.float64]

    @property
    def centre_mm(self) -> tuple[float, float]:
        """Offset of its centre of mass from the pixel's own centre, across and along; 0 for a pixel that is
        not displaced.
        """
        places = np.linspace(-self.reach_mm, self.reach_mm, self.across.size)
        middles = (places[1:] + places[:-1]) / 2
        across, along = (float(np.diff(of) @ middles) for of in (self.across, self.along))
        return across, along

    def steps_in(self, length_mm: float) -> float:
        """Return a length on the page in steps of the functions."""
        return float((self.across.size - 1) / (2 * self.reach_mm) * length_mm)

    def moved(self, *, across_mm: float, along_mm: float) -> Footprint:
        """Return the footprint of a pixel that is displaced to the right and down from its nominal position
        in the scan.

        Exact but for linear interpolation between the table's offsets, as in every use of a footprint. The
        reach grows by the greater of both.
        """
        if across_mm == 0 and along_mm == 0:
            return self
        step = 2 * self.reach_mm / (self.across.size - 1)
        more = int(np.ceil(max(abs(across_mm), abs(along_mm)) / step))
        reach_mm = self.reach_mm + more * step
        places = np.linspace(-self.reach_mm, self.reach_mm, self.across.size)
        wide = np.linspace(-reach_mm, reach_mm, self.across.size + 2 * more)
        across, along = (
            np.interp(wide - by_mm, places, of, left=0.0, right=1.0)
            for of, by_mm in ((self.across, across_mm), (self.along, along_mm))
        )
        return Footprint(reach_mm=reach_mm, across=across, along=along)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Taps:
    """Weights of raster pixels in camera pixels along one axis.

    Camera pixel i sees raster pixels first[i] .. first[i] + taps - 1 with weights[i]; the rest of the weight,
    up to 1, is backing.
    """

    first: NDArray[np.int32]
    """Index (camera pixels,) of the first raster pixel, always inside the raster."""
    weights: NDArray[np.float32]
    """Weights (camera pixels, taps)."""

    def apply(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return weighted sums along the first axis: (raster pixels, others) -> (camera pixels, others)."""
        count, width = self.weights.shape
        columns = (self.first[:, None] + np.arange(width, dtype=np.int32)).ravel()
        starts = np.arange(0, count * width + 1, width)
        matrix = sparse.csr_array((self.weights.ravel(), columns, starts), shape=(count, image.shape[0]))
        return np.asarray(matrix @ image, dtype=np.float32)


def taps(
    cumulative: NDArray[np.float64],
    *,
    reach_mm: float,
    centres_mm: NDArray[np.float64],
    raster_pixel_mm: float,
    raster_pixels: int,
) -> Taps:
    """Return exact integrals of a footprint over raster pixels along one axis.

    ``cumulative`` is one of the footprint's two functions; ``centres_mm`` (camera pixels,) are the positions
    of the camera pixels' centres from the page's edge. Raster pixel k covers k .. k + 1 times
    ``raster_pixel_mm``. Any ratio of pitches is allowed.
    """
    count = int(np.ceil(2 * reach_mm / raster_pixel_mm)) + 1
    first = np.floor((centres_mm - reach_mm) / raster_pixel_mm).astype(np.int64)
    edges = (first[:, None] + np.arange(count + 1)) * raster_pixel_mm - centres_mm[:, None]
    offsets = np.linspace(-reach_mm, reach_mm, cumulative.size)
    weights = np.diff(np.interp(edges, offsets, cumulative, left=0.0, right=1.0), axis=1)
    return _clipped(first, weights, raster_pixels)


def transfer(
    cumulative: NDArray[np.float64], reach_pixels: float, frequency: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the transfer function of a symmetric footprint along one axis at frequencies (n,) [cycles/pixel]
    -> (n,).

    For a moved footprint (``Footprint.moved``) it is that of the footprint before the move.
    """
    weights = np.diff(cumulative)
    offsets = (np.arange(weights.size) + 0.5 - weights.size / 2) * (2 * reach_pixels / weights.size)
    centre = float(weights @ offsets)
    if abs(centre) > ROUNDING:
        offsets -= centre
    return np.asarray(np.cos(2 * np.pi * frequency[:, None] * offsets) @ weights, dtype=np.float64)


def _clipped(first: NDArray[np.int64], weights: NDArray[np.float64], raster_pixels: int) -> Taps:
    """Move every window into the raster, with weight 0 for what is off the page."""
    count = min(weights.shape[1], raster_pixels)
    start = np.clip(first, 0, raster_pixels - count)
    source = start[:, None] + np.arange(count) - first[:, None]
    valid = (source >= 0) & (source < weights.shape[1])
    inside = np.take_along_axis(weights, np.clip(source, 0, weights.shape[1] - 1), axis=1)
    return Taps(first=start.astype(np.int32), weights=np.where(valid, inside, 0.0).astype(np.float32))
