"""Origin of the built-in press's numbers: a fit of smooth absorption bands to the aims of coated offset."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import least_squares

from prooflight.inks.built_in import built_in_spectra
from prooflight.spectra import delta_e00, lab

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

# (recipe, CIELAB under D50, 2 degrees): ISO 12647-2:2004/Amd 1:2007, tables 1 and 2, paper types 1 and 2,
# white backing, as they stand in the characterisation data FOGRA39L (Fogra, December 2006), ISO 13655
# geometry 45/0.
COATED_AIMS: Final[Mapping[str, tuple[tuple[int, int, int, int], tuple[float, float, float]]]] = (
    MappingProxyType(
        {
            "paper": ((0, 0, 0, 0), (95.0, 0.0, -2.0)),
            "cyan": ((1, 0, 0, 0), (55.0, -37.0, -50.0)),
            "magenta": ((0, 1, 0, 0), (48.0, 74.0, -3.0)),
            "yellow": ((0, 0, 1, 0), (89.0, -5.0, 93.0)),
            "black": ((0, 0, 0, 1), (16.0, 0.0, 0.0)),
            "red": ((0, 1, 1, 0), (47.0, 68.0, 48.0)),
            "green": ((1, 0, 1, 0), (50.0, -65.0, 27.0)),
            "blue": ((1, 1, 0, 0), (24.0, 22.0, -46.0)),
        }
    )
)

# Start and one standard deviation of the belief in it. Assumed: shapes drawn by hand after what is generally
# known of these pigments (phthalocyanine's double band, lithol rubine's shoulder, a steep yellow edge, a grey
# black).
BELIEF: Final[dict[str, tuple[float, float]]] = {
    "paper.level": (0.86, 0.02),
    "paper.tilt": (0.01, 0.02),
    "paper.edge.density": (0.45, 0.1),
    "paper.edge.nm": (395.0, 4.0),
    "paper.edge.width": (9.0, 1.5),
    "paper.glow": (0.04, 0.02),
    "cyan.main.density": (2.6, 0.4),
    "cyan.main.nm": (608.0, 8.0),
    "cyan.main.width": (38.0, 5.0),
    "cyan.far.density": (1.7, 0.4),
    "cyan.far.nm": (690.0, 8.0),
    "cyan.far.width": (42.0, 6.0),
    "cyan.shoulder.density": (0.5, 0.2),
    "cyan.shoulder.nm": (560.0, 8.0),
    "cyan.shoulder.width": (28.0, 5.0),
    "cyan.violet.density": (0.9, 0.3),
    "cyan.violet.nm": (370.0, 8.0),
    "cyan.violet.width": (35.0, 6.0),
    "cyan.base": (0.10, 0.04),
    "magenta.main.density": (3.0, 0.4),
    "magenta.main.nm": (538.0, 5.0),
    "magenta.main.width": (28.0, 4.0),
    "magenta.red.density": (2.0, 0.5),
    "magenta.red.nm": (567.0, 4.0),
    "magenta.red.width": (16.0, 3.0),
    "magenta.blue.density": (1.1, 0.3),
    "magenta.blue.nm": (452.0, 10.0),
    "magenta.blue.width": (38.0, 6.0),
    "magenta.violet.density": (0.7, 0.3),
    "magenta.violet.nm": (375.0, 8.0),
    "magenta.violet.width": (32.0, 6.0),
    "magenta.base": (0.03, 0.02),
    "yellow.edge.density": (2.6, 0.4),
    "yellow.edge.nm": (490.0, 5.0),
    "yellow.edge.width": (12.0, 2.0),
    "yellow.violet.density": (-0.5, 0.3),
    "yellow.violet.nm": (378.0, 8.0),
    "yellow.violet.width": (30.0, 6.0),
    "yellow.base": (0.02, 0.01),
    "black.base": (3.75, 0.2),
    "black.tilt": (-0.1, 0.2),
    "black.curve": (0.0, 0.2),
}
GREATEST_DENSITY = 4.5  # assumed: what surface reflection leaves of a gloss solid is about 1 % of the light
BELIEF_WEIGHT = 0.1  # one standard deviation off the belief weighs as much as 0.1 CIEDE2000 off an aim
FARTHEST = 2.5  # standard deviations a coefficient may leave its belief by


def aim_differences(coefficients: dict[str, float]) -> dict[str, float]:
    """Return CIEDE2000 (D50, 2 degrees) between the constructed inks' solids and overprints and each coated aim."""
    paper, density = built_in_spectra(coefficients)
    recipes = np.array([recipe for recipe, _ in COATED_AIMS.values()], dtype=np.float64)
    aims = np.array([aim for _, aim in COATED_AIMS.values()])
    difference = delta_e00(lab(paper * np.exp(-recipes @ density)), aims)
    return dict(zip(COATED_AIMS, difference.tolist(), strict=True))


def fit_built_in() -> dict[str, float]:
    """Fit the built-in press to the coated aims; returns its coefficients to four digits. Takes some seconds.

    Minimises the squared CIEDE2000 of eight aims plus squared distances from ``BELIEF``, which keeps the bands where
    pigments have them: 42 coefficients against 24 tristimulus numbers would otherwise be underdetermined.
    """
    names = list(BELIEF)
    start, sigma = np.array(list(BELIEF.values())).T
    least = np.where([name.endswith("base") for name in names], 0.005, -np.inf)

    def residual(values: NDArray[np.float64]) -> NDArray[np.float64]:
        coefficients = dict(zip(names, values.tolist(), strict=True))
        _, density = built_in_spectra(coefficients)
        excess = 2.0 * np.maximum(density.max(axis=1) - GREATEST_DENSITY, 0.0)
        difference = list(aim_differences(coefficients).values())
        return np.concatenate([difference, BELIEF_WEIGHT * (values - start) / sigma, excess])

    bounds = (np.maximum(start - FARTHEST * sigma, least), start + FARTHEST * sigma)
    solution = least_squares(residual, start, bounds=bounds, x_scale=sigma, diff_step=1e-4, max_nfev=60)
    return {name: float(f"{value:.4g}") for name, value in zip(names, solution.x, strict=True)}
