"""Smooth random lines, fields and functions of colour: Gaussian, of mean 0 and standard deviation 1 everywhere.

Points a length l apart have the correlation exp(-(d / l)^2): "smooth over l" means that it has fallen to 1/e there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS

WAVES = 64
"""Number of cosines in a function; the sum of so many is Gaussian to a per cent of kurtosis."""
COLOUR_LENGTH = 0.5
"""assumed: tables drift with an ink's tints, not with single patches: smooth over half of an ink's range."""


def smooth_line(
    count: int, *, pitch_mm: float, length_mm: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw values at ``count`` points pitch_mm apart, smooth over length_mm: (count,) [-]."""
    root = _root(count, pitch_mm / length_mm)
    return np.asarray(root @ rng.standard_normal(root.shape[1]))


def smooth_field(
    rows: int, columns: int, *, pitch_mm: float, length_mm: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw values at points pitch_mm apart down and across, smooth over length_mm in both: (rows, columns) [-]."""
    down, across = (_root(count, pitch_mm / length_mm) for count in (rows, columns))
    return np.asarray(down @ rng.standard_normal((down.shape[1], across.shape[1])) @ across.T)


@lru_cache(maxsize=64)
def _root(count: int, step: float) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is the correlation of ``count`` points ``step`` lengths apart.

    Its columns are the few shapes that a smooth line has; those that hold less than 1e-9 of the variance are
    left out.
    """
    place = np.arange(count) * step
    correlation = np.exp(-(np.subtract.outer(place, place) ** 2))
    value, vector = np.linalg.eigh(correlation)
    used = value > 1e-9 * count
    return np.asarray(vector[:, used] * np.sqrt(value[used]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """Smooth random function of d coordinates: a sum of cosines of random direction, wavelength and phase.

    Random Fourier features (Rahimi and Recht 2007) of the correlation above; the same at every call. Over many lengths
    its standard deviation is 1.
    """

    wave: NDArray[np.float64]
    """Wave vectors (waves, d). [radian a unit of each coordinate]"""
    phase: NDArray[np.float64]
    """Phases (waves,). [radian]"""

    @classmethod
    def over(cls, lengths: Sequence[float], rng: np.random.Generator) -> Self:
        """Draw one function that is smooth over these lengths, one a coordinate."""
        return cls(
            wave=rng.standard_normal((WAVES, len(lengths))) * (np.sqrt(2) / np.array(lengths)),
            phase=rng.uniform(0, 2 * np.pi, WAVES),
        )

    def at(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the values at points (..., d) -> (...) [-]."""
        return np.asarray(np.cos(points @ self.wave.T + self.phase).sum(axis=-1) * np.sqrt(2 / WAVES))


class ColourWaves(Waves):
    """Smooth random function of ink areas: a product of functions of two inks each, so that a whole table costs one
    matrix product.
    """

    __slots__ = ()

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw one function."""
        return cls.over((COLOUR_LENGTH,) * INKS, rng)

    def on_grid(self, axis: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at all combinations of the areas ``axis`` (n,) -> (n, n, n, n) [-]."""
        c, m, y, k = (np.exp(1j * np.multiply.outer(axis, wave)) for wave in self.wave.T)
        cm = (c[:, None] * m[None] * np.exp(1j * self.phase)).reshape(-1, WAVES)
        yk = (y[:, None] * k[None]).reshape(-1, WAVES)
        table = (cm @ yk.T).real * np.sqrt(2 / WAVES)
        return np.asarray(table.reshape((axis.size,) * INKS))
