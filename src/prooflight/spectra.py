"""Wavelength grid, illuminants, colour matching functions, and integrals over the spectrum.

Everything spectral in this package is on one grid: 36 bands, 380 to 730 nm in steps of 10 nm (paper, section
3). Band integrals are plain sums times the step, as ISET forms them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Real = TypeVar("Real", np.float32, np.float64)

STEP_NM = 10.0
WAVE_NM: NDArray[np.float64] = np.arange(380.0, 731.0, STEP_NM)
WAVE_NM.setflags(write=False)
BANDS = WAVE_NM.size

PLANCK_J_S = (
    6.626176e-34  # ISETCam's (CODATA 1973), 1.6e-5 above the SI value: kept so that photons compare to 1e-6
)
LIGHT_M_S = 2.99792458e8  # SI, exact
LUMINOUS_EFFICACY_LM_W = 683.0  # lm/W at 555 nm, as ISET rounds it (SI: 683 lm/W at 540 THz)


def on_grid(values: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values`` as a read-only (36,) array; ValueError if the shape is another or a value is not finite."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (BANDS,) or not np.isfinite(array).all():
        message = f"a spectrum has {BANDS} finite values, 380 to 730 nm by 10 nm; got shape {array.shape}"
        raise ValueError(message)
    array.setflags(write=False)
    return array


def resample(wave_nm: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """Resample spectra measured at any increasing wavelengths to the grid by linear interpolation.

    wave_nm (n,) [nm]; values (..., n). Returns (..., 36). ValueError if the data does not cover 380..730 nm.
    """
    wave = np.asarray(wave_nm, dtype=np.float64)
    spectra = np.asarray(values, dtype=np.float64)
    if wave.ndim != 1 or wave.size < 2 or spectra.shape[-1:] != wave.shape or not (np.diff(wave) > 0).all():
        message = "wavelengths must increase and there must be one value for each"
        raise ValueError(message)
    if not (np.isfinite(wave).all() and np.isfinite(spectra).all()):
        message = "wavelengths and values must be finite"
        raise ValueError(message)
    if wave[0] > WAVE_NM[0] or wave[-1] < WAVE_NM[-1]:
        message = f"data covers {wave[0]:g}..{wave[-1]:g} nm, 380..730 nm is needed"
        raise ValueError(message)
    right = np.clip(np.searchsorted(wave, WAVE_NM), 1, wave.size - 1)
    left = right - 1
    weight = (WAVE_NM - wave[left]) / (wave[right] - wave[left])
    return spectra[..., left] * (1.0 - weight) + spectra[..., right] * weight


def to_grid(wave_nm: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bring spectra (..., n) at rising wavelengths (n,) [nm] to the package's grid, (..., 36).

    Data finer than 10 nm is averaged over a triangle of 10 nm half width, the bandpass of an instrument that measures
    every 10 nm; where the triangle sticks out of the data the band takes the value at its centre. Data on the grid
    stays as it is. Coarser or shifted data is interpolated by a natural cubic spline and kept within the patch's own
    range (thinning a 10 nm offset chart to 20 nm and restoring it errs by 0.03 CIEDE2000 this way, by 0.09 with a
    monotone cubic and 0.23 linearly). Outside the measured range the last value holds, as ASTM E308 does by adding its
    weights.
    """
    from scipy.interpolate import CubicSpline  # imported late: few commands read spectra

    if np.array_equal(wave_nm, WAVE_NM):
        return np.array(values, dtype=np.float64)
    if np.median(np.diff(wave_nm)) < 0.9 * STEP_NM:  # 0.9: a 10 nm instrument may round its wavelengths
        return np.asarray(values @ _bandpass(wave_nm).T, dtype=np.float64)
    within = np.clip(WAVE_NM, wave_nm[0], wave_nm[-1])
    smooth = CubicSpline(wave_nm, values, axis=-1, bc_type="natural")(within)
    low, high = values.min(axis=-1, keepdims=True), values.max(axis=-1, keepdims=True)
    return np.asarray(np.clip(smooth, low, high), dtype=np.float64)


def _bandpass(wave_nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (36, n) of fine data in each band; each row sums to 1."""
    triangle = np.maximum(1.0 - np.abs(WAVE_NM[:, None] - wave_nm) / STEP_NM, 0.0) * np.gradient(wave_nm)
    inside = (wave_nm[0] <= WAVE_NM - STEP_NM) & (wave_nm[-1] >= WAVE_NM + STEP_NM)
    right = np.clip(np.searchsorted(wave_nm, WAVE_NM), 1, wave_nm.size - 1)
    share = np.clip((WAVE_NM - wave_nm[right - 1]) / (wave_nm[right] - wave_nm[right - 1]), 0.0, 1.0)
    centre = np.zeros((BANDS, wave_nm.size))
    centre[np.arange(BANDS), right] = share
    centre[np.arange(BANDS), right - 1] = 1.0 - share
    weights = np.where(inside[:, None], triangle, centre)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float64)


@cache
def _cie() -> dict[str, Any]:
    """Return the tables of CIE 015:2018 as colour-science has them, resampled on the grid: loading it takes seconds."""
    tables: dict[str, Any] = json.loads(Path(__file__).with_name("cie.json").read_text(encoding="utf-8"))
    return tables


@cache
def illuminant(name: str) -> NDArray[np.float64]:
    """Return the relative power of a CIE illuminant on the grid (36,), e.g. D65, D50, A, FL2.

    KeyError if there is no such illuminant.
    """
    return on_grid(_cie()["illuminants"][name])


@cache
def luminous_efficiency() -> NDArray[np.float64]:
    """Return V(lambda), CIE 1924 photopic, on the grid (36,)."""
    return on_grid(_cie()["photopic"])


@cache
def colour_matching() -> NDArray[np.float64]:
    """Return the CIE 1931 2-degree colour matching functions on the grid (36, 3)."""
    return np.array(_cie()["observer"])


def photons_per_joule() -> NDArray[np.float64]:
    """Return the number of photons in one joule at each band (36,): lambda / (h c)."""
    return WAVE_NM * 1e-9 / (PLANCK_J_S * LIGHT_M_S)


def xyz(reflectance: NDArray[np.floating], light: str = "D50") -> NDArray[np.float64]:
    """Return the XYZ of reflectances (..., 36) -> (..., 3); Y = 1 for a perfect diffuser (CIE 015, 2 deg.)."""
    weights = illuminant(light)[:, None] * colour_matching()
    return np.asarray(reflectance @ (weights / weights[:, 1].sum()), dtype=np.float64)


def white_xyz(light: str = "D50") -> NDArray[np.float64]:
    """Return tristimulus values of the perfect diffuser under ``light`` (3,), by the same sums as ``xyz``."""
    return xyz(np.ones(BANDS), light)


def lab(reflectance: NDArray[np.floating], light: str = "D50") -> NDArray[np.float64]:
    """Return CIELAB of reflectances (..., 36) -> (..., 3) under ``light`` for the 2-degree observer (CIE 015)."""
    ratio = xyz(reflectance, light) / white_xyz(light)
    root = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def delta_e00(lab_a: ArrayLike, lab_b: ArrayLike) -> NDArray[np.float64]:
    """Return the CIEDE2000 difference of CIELAB values (..., 3) -> (...) (CIE 142; colour-science's implementation)."""
    import colour  # imported late: it takes seconds

    return np.asarray(
        colour.delta_E(np.asarray(lab_a), np.asarray(lab_b), method="CIE 2000"), dtype=np.float64
    )


def srgb_encoded(light: NDArray[Real]) -> NDArray[Real]:
    """Encode light relative to white, clipped to 0..1, as sRGB codes 0..1 (IEC 61966-2-1)."""
    linear = np.clip(light, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def srgb_light(code: NDArray[Real]) -> NDArray[Real]:
    """Decode sRGB codes 0..1 to light relative to white, the inverse of ``srgb_encoded``."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
