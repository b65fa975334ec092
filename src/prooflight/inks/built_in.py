"""Built-in press: offset inks on coated paper, for use where no chart has been measured.

The spectra are constructed, not measured: sums of a few smooth absorption bands per ink, placed where such
pigments absorb (copper phthalocyanine about 600 and 690 nm, lithol rubine about 540 and 570 nm, a diarylide
yellow below 500 nm, a nearly grey carbon black). Their coefficients were fitted so that the colours of paper,
solids and two-ink overprints meet the aims of offset on coated paper; ``fit_built_in`` in
``prooflight_studies.ink.built_in_fit`` does the fit again and gets these numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.inks.reflectance import LogLinear
from prooflight.spectra import WAVE_NM

# Tone value increase at 50 %: ISO 12647-2 curves A (C, M, Y) and B (K) for coated paper, about, in whole per
# cent.
TONE_VALUE_INCREASE: Final = (0.14, 0.14, 0.14, 0.16)

# Fitted, four digits. ``density`` is of the natural logarithm [-]; ``nm`` and ``width`` are a band's centre
# and its standard deviation (or a step's scale) [nm]; tilt and curve are per 175 nm from 555 nm.
COEFFICIENTS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "paper.level": 0.8552,
        "paper.tilt": -0.01094,
        "paper.edge.density": 0.4979,
        "paper.edge.nm": 397.0,
        "paper.edge.width": 9.742,
        "paper.glow": 0.03334,
        "cyan.main.density": 2.675,
        "cyan.main.nm": 600.6,
        "cyan.main.width": 34.95,
        "cyan.far.density": 1.471,
        "cyan.far.nm": 693.7,
        "cyan.far.width": 39.66,
        "cyan.shoulder.density": 0.5484,
        "cyan.shoulder.nm": 566.0,
        "cyan.shoulder.width": 24.71,
        "cyan.violet.density": 1.047,
        "cyan.violet.nm": 373.7,
        "cyan.violet.width": 37.65,
        "cyan.base": 0.1208,
        "magenta.main.density": 3.167,
        "magenta.main.nm": 540.5,
        "magenta.main.width": 27.56,
        "magenta.red.density": 2.368,
        "magenta.red.nm": 568.7,
        "magenta.red.width": 17.59,
        "magenta.blue.density": 1.339,
        "magenta.blue.nm": 441.3,
        "magenta.blue.width": 39.16,
        "magenta.violet.density": 0.9307,
        "magenta.violet.nm": 381.0,
        "magenta.violet.width": 36.5,
        "magenta.base": 0.03486,
        "yellow.edge.density": 2.829,
        "yellow.edge.nm": 488.8,
        "yellow.edge.width": 11.92,
        "yellow.violet.density": -0.3999,
        "yellow.violet.nm": 375.6,
        "yellow.violet.width": 28.14,
        "yellow.base": 0.02023,
        "black.base": 3.705,
        "black.tilt": -0.0225,
        "black.curve": 0.03954,
    }
)


def built_in_spectra(coefficients: Mapping[str, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the paper's reflectance factor (36,) and the inks' natural densities (4, 36), from named coefficients."""
    x = (WAVE_NM - 555.0) / 175.0

    def band(name: str) -> NDArray[np.float64]:
        """Return a Gaussian absorption band."""
        distance = (WAVE_NM - coefficients[f"{name}.nm"]) / coefficients[f"{name}.width"]
        return coefficients[f"{name}.density"] * np.exp(-0.5 * distance**2)

    def step(name: str) -> NDArray[np.float64]:
        """Return a logistic step that falls towards long wavelengths."""
        distance = (WAVE_NM - coefficients[f"{name}.nm"]) / coefficients[f"{name}.width"]
        return coefficients[f"{name}.density"] / (1.0 + np.exp(distance))

    brightener = coefficients["paper.glow"] * np.exp(-0.5 * ((WAVE_NM - 440.0) / 25.0) ** 2)
    paper = (
        coefficients["paper.level"] * (1 + coefficients["paper.tilt"] * x) * (1 - step("paper.edge"))
        + brightener
    )
    cyan = coefficients["cyan.base"] + sum(band(f"cyan.{n}") for n in ("main", "far", "shoulder", "violet"))
    magenta = coefficients["magenta.base"] + sum(
        band(f"magenta.{n}") for n in ("main", "red", "blue", "violet")
    )
    yellow = coefficients["yellow.base"] + step("yellow.edge") + band("yellow.violet")
    black = coefficients["black.base"] + coefficients["black.tilt"] * x + coefficients["black.curve"] * x**2
    return paper, np.array([cyan, magenta, yellow, black])


def built_in_inks() -> LogLinear:
    """Return the inks of the built-in press: overprints multiply (equation 1), tints carry ISO tone value increase.

    Its colours lie within 4 CIEDE2000 of every aim of ISO 12647-2:2004/Amd 1:2007, paper types 1 and 2; a
    test says so.
    """
    paper, density = built_in_spectra(COEFFICIENTS)
    return LogLinear(paper=paper, density=density, tvi=TONE_VALUE_INCREASE, name="built-in")
