"""Correction of short separable footprints to a round lens: small weights at the pixels' own resolution, and
their fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.prediction.lens_correction import FAR_BLOCK, FARTHER_BLOCK, NEAR_REACH

FAR_REACH: Final = 2
FARTHER_REACH: Final = 3
"""Blocks to each side; beyond 3.5 x 16 pixels is 0.02 % of an edge."""
_PERIOD: Final = 256  # pixels; frequencies are a cycle in so many apart
# of the mean square: keeps blocks' weights small, whose own aliasing the fit does not see
_RIDGE: Final = 1e-3
_EVEN_LIGHT: Final = 100.0  # weight of frequency 0 over that of its neighbours


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LensCorrection:
    """Correction of light through a short separable footprint to light through the lens, at the camera's pixels.

    A pixel is the sum of its neighbours by ``near``; plus block means by ``far`` and ``farther``, each
    bilinear between the blocks' centres. All weights are symmetric and sum to 1 in total, so uniform light
    does not change.
    """

    near: NDArray[np.float32]
    """Weights (7, 7) of the lines and pixels around."""
    far: NDArray[np.float32]
    """Weights (n, n) of means over 4 x 4 pixels."""
    farther: NDArray[np.float32]
    """Weights (m, m) of means over 16 x 16 pixels."""

    @classmethod
    def none(cls) -> Self:
        """Return the identity, for exact footprints and for those without a known correction."""
        near = np.zeros((2 * NEAR_REACH + 1,) * 2, np.float32)
        near[NEAR_REACH, NEAR_REACH] = 1
        zero = np.zeros((1, 1), np.float32)
        return cls(near=near, far=zero, farther=zero)

    @property
    def is_identity(self) -> bool:
        """Whether the correction changes nothing."""
        others = np.count_nonzero(self.near) + np.count_nonzero(self.far) + np.count_nonzero(self.farther)
        return bool(others == 1 and self.near[NEAR_REACH, NEAR_REACH] == 1)

    def transfer(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the transfer function (along, across) at frequencies (n,) of either axis [cycles/pixel]."""
        parts = ((self.near, 1), (self.far, FAR_BLOCK), (self.farther, FARTHER_BLOCK))
        total = np.zeros((frequency.size,) * 2)
        for weights, block in parts:
            reach = len(weights) // 2
            total += np.tensordot(weights[reach:, reach:], _cosines(reach, block, frequency), axes=2)
        return total


def correction_frequencies() -> NDArray[np.float64]:
    """Return the frequencies (n,) at which ``correction_to`` needs transfer functions. [cycles/pixel]"""
    return np.arange(_PERIOD // 2 + 1) / _PERIOD


def correction_to(exact: NDArray[np.float64], separable: NDArray[np.float64]) -> LensCorrection:
    """Fit the correction that makes a footprint's transfer function the exact one, by least squares.

    Errors are weighted by 1 / f, which is the spectrum of edges. Both functions are (along, across) at
    ``correction_frequencies``.
    """
    frequency = correction_frequencies()
    radius = np.hypot(frequency, frequency[:, None])
    weight = 1 / np.maximum(radius, 1 / _PERIOD)
    weight /= weight.mean()
    weight[0, 0] *= _EVEN_LIGHT
    parts = [_cosines(NEAR_REACH, 1, frequency), _cosines(FAR_REACH, FAR_BLOCK, frequency)]
    parts.append(_cosines(FARTHER_REACH, FARTHER_BLOCK, frequency))
    basis = np.concatenate([part.reshape(-1, exact.size) for part in parts]) * (separable * weight).ravel()
    sizes = np.concatenate([_multiplicity(part.shape[0]).ravel() for part in parts])
    normal = basis @ basis.T + np.diag(_RIDGE * exact.size * sizes)
    weights = np.linalg.solve(normal, basis @ ((exact - separable) * weight).ravel())
    ends = np.cumsum([part.shape[0] ** 2 for part in parts])[:-1]
    near, far, farther = (
        _unfolded(quadrant.reshape((round(quadrant.size**0.5),) * 2)) for quadrant in np.split(weights, ends)
    )
    near[NEAR_REACH, NEAR_REACH] -= near.sum() + far.sum() + farther.sum() - 1
    return LensCorrection(
        near=near.astype(np.float32), far=far.astype(np.float32), farther=farther.astype(np.float32)
    )


def _cosines(reach: int, block: int, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return transfer functions of symmetric weights of blocks: (reach + 1, reach + 1, frequencies, frequencies)."""
    centred = np.arange(block) - (block - 1) / 2
    mean = np.cos(2 * np.pi * frequency[:, None] * centred).mean(axis=1)
    places = np.arange(reach + 1)[:, None]
    # A block's mean is one box, linear interpolation between blocks two more.
    one = (2 - (places == 0)) * np.cos(2 * np.pi * places * block * frequency) * mean**3
    return np.asarray(one[:, None, :, None] * one[None, :, None, :])


def _multiplicity(count: int) -> NDArray[np.float64]:
    """Return the number of weights that each weight of a quadrant represents."""
    sides = np.where(np.arange(count) == 0, 1.0, 2.0)
    return np.outer(sides, sides)


def _unfolded(quadrant: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mirror a quadrant to the full kernel: (n + 1, n + 1) -> (2 n + 1, 2 n + 1)."""
    half = np.concatenate([quadrant[:0:-1], quadrant])
    return np.concatenate([half[:, :0:-1], half], axis=1)
