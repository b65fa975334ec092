"""Spectrum of a printed recipe: the protocol of every ink model, and the paper's log-linear model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.spectra import BANDS, on_grid

DARKEST = 1e-4  # log r needs r > 0; spectrophotometers resolve about 1e-3, so this lies below any measurement
BRIGHTEST = 1.2  # assumed: no brightened paper passes it; a prediction beyond is extrapolation gone wrong
_CHUNK = 4096  # recipes at a time: what a model needs for them then stays within a processor's cache


class ReflectanceModel(Protocol):
    """Model from CMYK recipes to spectral reflectance; the same recipe always gives the same spectrum."""

    @property
    def name(self) -> str:
        """Return the name by which users select this kind of model, e.g. ``log-linear``."""
        ...

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes.

        cmyk : (..., 4) ink fractions C, M, Y, K, 0..1 [-]; models stay well behaved up to 256/255, a table's
        last node. Returns (..., 36) on the wavelength grid [-]. The input is not changed.
        """
        ...


class ChartModel(ReflectanceModel, Protocol):
    """Model that is fitted to a chart and can be stored in a file."""

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Fit the model to distinct recipes (n, 4) [-], their mean spectra (n, 36) and numbers of patches (n,).

        ValueError, with a sentence for the user, if the recipes do not determine the model.
        """
        ...

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return all arrays that ``from_arrays`` needs to rebuild the same model."""
        ...

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        ...


def in_chunks(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    cmyk: NDArray[np.floating],
    bands: int,
    chunk: int = _CHUNK,
) -> NDArray[np.float64]:
    """Apply ``function``, (m, 4) -> (m, bands), to recipes (..., 4) a chunk at a time -> (..., bands)."""
    recipes = np.asarray(cmyk, dtype=np.float64).reshape(-1, INKS)
    result = np.empty((len(recipes), bands))
    for start in range(0, len(recipes), chunk):
        result[start : start + chunk] = function(recipes[start : start + chunk])
    return result.reshape(*np.shape(cmyk)[:-1], bands)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogLinear:
    """Equation 1 of the paper: log r(lambda) = a . v(lambda), each band by itself.

    a = (1, amounts of C, M, Y, K) and v = (log paper, minus the four inks' densities). Reading chosen: the
    paper as printed fits r to log((a . v)^2), while the sentence around it says log-linear; we minimise sum
    (log r - a . v)^2 per band.

    Without tone curve the amount of ink is its nominal dot area. With ``tvi`` the amount of ink i at dot area a is

        amount_i(a) = -ln(1 - a_eff (1 - T_i)) / D_i,  a_eff = a + 4 tvi_i a (1 - a),  T_i = exp(-D_i),

    D_i being the ink's greatest band density. In its densest band a tint then follows Murray-Davies with that
    tone value increase (the parabola of ISO 12647-2, tvi at 50 %); amount(1) = 1, and the slope at 0 is
    finite, where a power law would make highlights vanish. Beyond a = 1 the amount goes on along its tangent.
    """

    paper: NDArray[np.float64]
    """Reflectance factor (36,) of the bare substrate, above 0. [-]"""
    density: NDArray[np.float64]
    """Natural-logarithm density (4, 36) of each full solid over paper, rows C, M, Y, K. [-]"""
    tvi: tuple[float, float, float, float] | None = None
    """Tone value increase at 50 % of C, M, Y, K, each in [0, 0.25) so that curves rise; None: no tone curve. [-]"""
    name: str = "log-linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "paper", on_grid(self.paper))
        density = np.array([on_grid(row) for row in self.density])
        density.setflags(write=False)
        object.__setattr__(self, "density", density)
        if density.shape != (INKS, BANDS) or not (self.paper > 0).all():
            message = f"paper must be above 0 and density (4, 36), got {density.shape}"
            raise ValueError(message)
        if self.tvi is None:
            return
        if len(self.tvi) != INKS or not all(0 <= value < 0.25 for value in self.tvi):
            message = f"tvi needs four values in [0, 0.25), got {self.tvi}"
            raise ValueError(message)
        if not (density.max(axis=1) > 0).all():
            message = "a tone curve needs a positive density in every ink"
            raise ValueError(message)

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.floating],
        reflectance: NDArray[np.floating],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Fit log r per band over all patches by least squares (equation 1), no tone curve; r is floored at 1e-4.

        cmyk (n, 4) ink fractions, reflectance (n, 36), count (n,) patches of each recipe, 1 if absent.
        ValueError if the recipes do not distinguish the inks.
        """
        weight = np.sqrt(np.ones(len(cmyk)) if count is None else count)[:, None]
        design = weight * np.concatenate(
            [np.ones((len(cmyk), 1)), -np.asarray(cmyk, dtype=np.float64)], axis=1
        )
        logarithm = weight * np.log(np.maximum(reflectance, DARKEST))
        v, _, rank, _ = np.linalg.lstsq(design, logarithm, rcond=None)
        if rank < design.shape[1]:
            message = "its recipes do not vary every ink on its own"
            raise ValueError(message)
        return cls(paper=np.exp(v[0]), density=v[1:])

    def amount(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the amount of each ink, 0 on paper and 1 on the full solid: (..., 4) dot areas -> (..., 4) [-]."""
        area = np.asarray(cmyk, dtype=np.float64)
        if self.tvi is None:
            return area
        tvi = np.array(self.tvi)
        greatest = self.density.max(axis=1)
        transmittance = np.exp(-greatest)
        within = np.minimum(area, 1.0)
        effective = within + 4 * tvi * within * (1 - within)
        amount = -np.log1p(-effective * (1 - transmittance)) / greatest
        slope_at_solid = (1 - 4 * tvi) * (1 / transmittance - 1) / greatest
        return np.asarray(amount + slope_at_solid * (area - within), dtype=np.float64)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""
        exponent = self.amount(cmyk) @ -self.density
        np.exp(exponent, out=exponent)
        exponent *= self.paper
        return exponent

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that ``from_arrays`` needs."""
        curves = {} if self.tvi is None else {"tvi": np.array(self.tvi)}
        return {"paper": self.paper, "density": self.density, **curves}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        tvi = None
        if "tvi" in arrays:
            cyan, magenta, yellow, black = arrays["tvi"].tolist()
            tvi = (cyan, magenta, yellow, black)
        return cls(paper=arrays["paper"], density=arrays["density"], tvi=tvi)
