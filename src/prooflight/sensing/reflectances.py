"""Reflectances that a user gives as JSON: ``{"wave_nm": [...], "reflectance": [[...], ...]}``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight import spectra
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from numpy.typing import NDArray

BRIGHTEST = 2.0
"""assumed: fluorescent paper reaches 1.2, a mirror-like patch somewhat more; 85 is a percentage."""
FORM = '{"wave_nm": [380, ..., 730], "reflectance": [[...], ...]}'


def parse_reflectances(text: str, *, where: object) -> NDArray[np.float64]:
    """Reflectance factors (n, 36) of JSON text, by linear interpolation; RequestError names ``where`` and the fault."""
    try:
        given = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise RequestError(where, f"is not JSON ({error})", remedy=f"give {FORM}") from error
    if not isinstance(given, dict) or set(given) != {"wave_nm", "reflectance"}:
        found = ", ".join(map(str, given)) if isinstance(given, dict) and given else type(given).__name__
        raise RequestError(where, f"holds {found}", remedy=f"give {FORM} and nothing else")
    wave = _numbers(given["wave_nm"], 1, where=f"{where}: wave_nm")
    reflectance = _numbers(given["reflectance"], 2, where=f"{where}: reflectance")
    if reflectance.shape[1] != wave.size:
        what = f"reflectance: {reflectance.shape[1]} values a patch, but {wave.size} wavelengths"
        raise RequestError(where, what, remedy="give one value for each of wave_nm")
    if reflectance.min() < 0 or reflectance.max() > BRIGHTEST:
        worst = float(reflectance.min() if reflectance.min() < 0 else reflectance.max())
        remedy = f"give factors from 0 to {BRIGHTEST:g}, a perfect white diffuser being 1"
        raise RequestError(where, f"reflectance: {worst:g} is not a reflectance factor", remedy=remedy)
    try:
        return spectra.resample(wave, reflectance)
    except ValueError as error:
        raise RequestError(
            where, str(error), remedy="give wavelengths that rise from 380 or less to 730 or more"
        ) from error


def _numbers(given: Any, dimensions: int, *, where: str) -> NDArray[np.float64]:
    """A list, or a list of equally long lists, of finite numbers."""
    remedy = "give a list of numbers" if dimensions == 1 else "give a list of lists of numbers, equally long"
    try:
        array = np.array(given)
    except ValueError as error:
        raise RequestError(where, "has lists of different lengths", remedy=remedy) from error
    if array.ndim != dimensions or not array.size or array.dtype.kind not in "iuf":
        raise RequestError(where, f"is not {dimensions}-dimensional and of numbers only", remedy=remedy)
    numbers = array.astype(np.float64)
    if not np.isfinite(numbers).all():
        raise RequestError(where, "holds a value that is not finite", remedy=remedy)
    return numbers
