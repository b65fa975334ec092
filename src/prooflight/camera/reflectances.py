"""Reflectances that a user gives as JSON: ``{"wave_nm": [...], "reflectance": [[...], ...]}``."""

from __future__ import annotations

import json
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight import spectra
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles, shortly

BRIGHTEST = 2.0
"""Greatest reflectance factor that is accepted.

assumed: fluorescent paper reaches 1.2, a mirror-like patch somewhat more; 85 is a percentage.
"""
MOST_COLOURS: Final = 100_000
_LONGEST_NM: Final = 1e6
FORM: Final = '{"wave_nm": [380, ..., 730], "reflectance": [[...], ...]}'

REFLECTANCE_FILES: Final = GivenFiles(error=RequestError, remedy=f"give JSON (UTF-8), {FORM}", largest_mb=8)


def parse_reflectances(text: str, *, where: object) -> NDArray[np.float64]:
    """Read reflectance factors (n, 36) from JSON text, by linear interpolation.

    RequestError names ``where`` and the fault.
    """
    try:
        given = json.loads(text, parse_int=float, object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        raise RequestError(where, f"is not JSON ({error})", remedy=f"give {FORM}") from error
    if not isinstance(given, dict) or set(given) != {"wave_nm", "reflectance"}:
        fields = shortly(", ".join(given)) if isinstance(given, dict) and given else type(given).__name__
        raise RequestError(where, f"holds {fields}", remedy=f"give {FORM} and nothing else")
    if isinstance(given["reflectance"], list) and len(given["reflectance"]) > MOST_COLOURS:
        what = f"reflectance: {len(given['reflectance'])} colours"
        raise RequestError(where, what, remedy=f"give at most {MOST_COLOURS} at a time")
    wave = _numbers(given["wave_nm"], 1, where=f"{where}: wave_nm")
    if wave.min() <= 0 or wave.max() > _LONGEST_NM:
        what = f"wave_nm: {float(wave.min() if wave.min() <= 0 else wave.max()):g} nm is not a wavelength"
        raise RequestError(where, what, remedy="give wavelengths in nanometres")
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


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        message = "a name appears twice"
        raise ValueError(message)
    return members


def _numbers(given: Any, dimensions: int, *, where: str) -> NDArray[np.float64]:
    """Return a list, or a list of equally long lists, of finite numbers as an array."""
    remedy = "give a list of numbers" if dimensions == 1 else "give a list of lists of numbers, equally long"
    rows = [given] if dimensions == 1 else given
    lists = isinstance(rows, list) and rows and all(isinstance(row, list) and row for row in rows)
    if not lists or not all(type(value) is float for row in rows for value in row):
        raise RequestError(where, f"is not {dimensions}-dimensional and of numbers only", remedy=remedy)
    if len({len(row) for row in rows}) > 1:
        raise RequestError(where, "has lists of different lengths", remedy=remedy)
    if not all(math.isfinite(value) for row in rows for value in row):
        raise RequestError(where, "holds a value that is not finite", remedy=remedy)
    return np.array(given, dtype=np.float64)
