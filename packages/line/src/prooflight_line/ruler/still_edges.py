"""Sharpness across from still objects under a line camera: every line shows the same edges.

No edge moves over the pixels then, so none can be sampled finely (``slanted_edge``). Edges of many places
show each another part of the same step: a box of one pixel, the effect of any pixel, blurred by a Gaussian,
whose width is fitted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ndtr

from prooflight.scans.lines import runs
from prooflight_line.ruler.places import LEAST_CONTRAST
from prooflight_line.ruler.slanted_edge import mean_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.commissioning.camera.fixed_pattern import Measured

WIDEST: Final = 6.0
"""Greatest sigma of a blur that can be measured. [pixels]"""
FEWEST: Final = 4
"""Least number of edges at different places within a pixel for a standard error."""
_PLATEAU: Final = 3
"""Number of pixels that show an edge's level on either side."""
_MOST: Final = 64


def still_sharpness(profile: NDArray[np.floating]) -> Measured | None:
    """Measure MTF50 [cycles/pixel] from a profile across (pixels,), the mean of lines that are alike.

    None: no edges.
    """
    sigmas = [sigma for edge in _edges(profile.astype(np.float64)) if (sigma := _sigma(edge)) is not None]
    if len(sigmas) < FEWEST:
        return None
    return mean_of([mtf50_of(sigma) for sigma in sigmas])


def mtf50_of(sigma: float) -> float:
    """Return the frequency where |sinc(f)| exp(-2 pi^2 sigma^2 f^2) is a half. [cycles/pixel]

    It is the MTF of a pixel blurred by a Gaussian.
    """
    return float(brentq(lambda f: np.sinc(f) * math.exp(-2 * (math.pi * sigma * f) ** 2) - 0.5, 0.0, 1.0))


def _edges(profile: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return stretches of the profile that hold one step each, rising, from 0 to 1."""
    step = np.diff(profile)
    white = float(np.percentile(profile, 97))
    noise = 1.4826 * float(np.median(np.abs(step - np.median(step))))
    edges = []
    for sign in (-1.0, 1.0):
        steep = sign * step > max(4 * noise, 0.01 * abs(white))
        for first, end in runs(steep):
            low, high = first - _PLATEAU - 1, end + _PLATEAU + 2
            if low < 0 or high > profile.size:
                continue
            piece = sign * profile[low:high]
            dark, bright = float(piece[:_PLATEAU].mean()), float(piece[-_PLATEAU:].mean())
            flat = max(np.ptp(piece[:_PLATEAU]), np.ptp(piece[-_PLATEAU:])) < 0.1 * (bright - dark)
            if bright - dark > LEAST_CONTRAST * abs(white) and flat:
                edges.append((piece - dark) / (bright - dark))
    return edges[:: max(len(edges) // _MOST, 1)]


def _sigma(level: NDArray[np.float64]) -> float | None:
    """Fit the blur of one step; its place is where a sharp one would have the same area."""
    place = level.size - 0.5 - float(level.sum())
    offset = np.arange(level.size, dtype=np.float64) - place

    def misfit(sigma: float) -> float:
        return float(np.square(level - _step(offset, sigma)).sum())

    fit = minimize_scalar(misfit, bounds=(0.02, WIDEST), method="bounded")
    return float(fit.x) if fit.fun / level.size < 0.05**2 else None


def _step(offset: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Return a step seen by pixels one wide through a Gaussian."""
    u, v = (offset + 0.5) / sigma, (offset - 0.5) / sigma
    norm = 1 / math.sqrt(2 * math.pi)
    return np.asarray(
        sigma * (u * ndtr(u) + norm * np.exp(-0.5 * u * u) - v * ndtr(v) - norm * np.exp(-0.5 * v * v))
    )
