"""Characterisation charts: measured patches of known recipes, read from and written to CGATS text.

Spectra come to the package's wavelength grid by one rule, ``spectra.to_grid``.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.errors import ChartError
from prooflight.files.given import shortly
from prooflight.inks.cgats import Table, number, read_tables
from prooflight.spectra import WAVE_NM, delta_e00, lab, to_grid

_SPECTRAL: Final = re.compile(
    r"(?P<family>SPECTRAL_NM_?|SPECTRAL_?|SPEC_?|REFLECTANCE_?|REFL_?|NM_?|R_?|D_?|)(?P<nm>\d{3}(\.\d+)?)(NM)?",
    re.I,
)
_FEWEST_BANDS = 8  # assumed: 420 to 680 nm in 40 nm steps, the coarsest spectrum worth the name
_MUST_COVER_NM = (
    420.0,
    680.0,
)  # beyond, D50 and the observer leave 0.1 CIEDE2000 to be lost on a coated board
_LEAST_NORM, _GREATEST_NORM = 0.01, 1e6
_EXPORT_SPECTRA = (
    "export the measurement with spectral reflectance, e.g. columns SPECTRAL_NM380 to SPECTRAL_NM730"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recipes:
    """Distinct recipes of a chart, with repeated patches averaged."""

    cmyk: NDArray[np.float64]
    """Ink fractions (n, 4) of C, M, Y, K, in rising order. [-]"""
    reflectance: NDArray[np.float64]
    """Mean reflectance factor (n, 36) of each recipe's patches. [-]"""
    count: NDArray[np.int64]
    """Number of patches (n,) of each recipe."""
    of_patch: NDArray[np.int64]
    """Index (patches,) of the recipe of each patch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Scatter of repeated patches about their recipe's mean."""

    recipes: int
    """Number of recipes that have more than one patch."""
    patches: int
    """Number of patches of those recipes."""
    median_delta_e00: float
    max_delta_e00: float
    rms_reflectance: float
    """Standard deviation of one patch, pooled over recipes and bands. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """Measured chart, with the inks and the spectrum of every patch as they stand in its file."""

    where: str
    """File that it came from, for messages."""
    keywords: tuple[tuple[str, str], ...]
    cmyk_percent: NDArray[np.float64]
    """Ink (patches, 4) of C, M, Y, K. [%]"""
    wave_nm: NDArray[np.float64]
    """Wavelengths (bands,) as measured, rising. [nm]"""
    measured: NDArray[np.float64]
    """Reflectance factor (patches, bands) times ``scale``, as it stands in the file."""
    scale: float
    """1 for reflectance factors, 100 for per cent."""

    def __len__(self) -> int:
        """Return the number of measured patches."""
        return len(self.cmyk_percent)

    @property
    def reflectance(self) -> NDArray[np.float64]:
        """Return the reflectance factor of every patch on the package's grid, (patches, 36). [-]"""
        return to_grid(self.wave_nm, self.measured / self.scale)

    @property
    def digest(self) -> str:
        """Return the SHA-256 of recipes, wavelengths and spectra: charts of equal content have equal digests."""
        sha = hashlib.sha256()
        for array in (self.cmyk_percent, self.wave_nm, self.measured / self.scale):
            sha.update(np.array(array.shape, dtype="<i8").tobytes())
            sha.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return sha.hexdigest()

    def recipes(self) -> Recipes:
        """Return the distinct recipes with their mean spectra; recipes within 1e-6 of full ink are one."""
        cmyk, of_patch, count = np.unique(
            np.round(self.cmyk_percent / 100.0, 6), axis=0, return_inverse=True, return_counts=True
        )
        of_patch = of_patch.reshape(-1)
        reflectance = np.zeros((len(cmyk), WAVE_NM.size))
        np.add.at(reflectance, of_patch, self.reflectance)
        return Recipes(cmyk=cmyk, reflectance=reflectance / count[:, None], count=count, of_patch=of_patch)

    def scatter(self) -> Scatter | None:
        """Return the scatter of repeated patches about their means (D50, 2 degrees).

        Return None if no recipe is repeated.
        """
        recipes = self.recipes()
        repeated = recipes.count[recipes.of_patch] > 1
        if not repeated.any():
            return None
        each = self.reflectance[repeated]
        mean = recipes.reflectance[recipes.of_patch[repeated]]
        difference = delta_e00(lab(each), lab(mean))
        kinds = int((recipes.count > 1).sum())
        freedom = (len(each) - kinds) * WAVE_NM.size
        return Scatter(
            recipes=kinds,
            patches=len(each),
            median_delta_e00=float(np.median(difference)),
            max_delta_e00=float(difference.max()),
            rms_reflectance=float(np.sqrt(((each - mean) ** 2).sum() / freedom)),
        )

    def paper(self) -> NDArray[np.float64]:
        """Return the mean reflectance factor of the substrate patches, (36,).

        ChartError if the chart has none.
        """
        bare = (self.cmyk_percent == 0).all(axis=1)
        if not bare.any():
            what = "there is no substrate patch (C, M, Y and K all 0)"
            raise ChartError(self.where, what, remedy="print and measure one patch without ink")
        return np.asarray(self.reflectance[bare].mean(axis=0), dtype=np.float64)


def read_chart(path: Path) -> Chart:
    """Read CGATS.17 / ISO 28178 text or an ArgyllCMS .ti3: CMYK in per cent, spectra as factors or per cent.

    Of several tables the first with inks and spectra is taken. Spectral columns may be called SPECTRAL_NM380,
    SPECTRAL_380, SPEC_380, nm380, R_380, D_380 and the like; per cent is known by SPECTRAL_NORM, else by its size.
    ChartError: no such table, cut off, not a number, columns twice, CMYK not in per cent, spectra not reflectance.
    """
    tables = read_tables(path)
    for table in tables:
        inks, bands = _ink_columns(table), _spectral_columns(table)
        if inks and bands:
            _refuse_empty(path, table)
            return _chart(path, table, inks, bands)
    fullest = next((table for table in tables if _ink_columns(table)), tables[0])
    _refuse_empty(path, fullest)
    if not _ink_columns(fullest):
        names = ", ".join(map(shortly, fullest.fields[:6]))
        what = f"columns CMYK_C, CMYK_M, CMYK_Y, CMYK_K are missing (it has {names}, ...)"
        raise ChartError(path, what, remedy="export recipes and measurement together")
    colours = [
        name for name in ("LAB", "XYZ") if any(field.upper().startswith(name) for field in fullest.fields)
    ]
    what = f"spectra are missing: it holds CMYK and {' and '.join(colours) or 'nothing measured'} only"
    raise ChartError(path, what, remedy=_EXPORT_SPECTRA)


def _ink_columns(table: Table) -> tuple[str, str, str, str] | None:
    by_name = {name.upper(): name for name in table.fields}
    for prefix in ("CMYK_", ""):
        columns = [by_name.get(prefix + ink) for ink in INK_LETTERS]
        if all(columns):
            cyan, magenta, yellow, black = (str(name) for name in columns)
            return cyan, magenta, yellow, black
    return None


def _spectral_columns(table: Table) -> dict[float, str]:
    """Return the largest family of columns named alike by wavelength, {nm: column} by rising wavelength."""
    families: dict[str, dict[float, str]] = {}
    for name in table.fields:
        match = _SPECTRAL.fullmatch(name)
        if match and 300.0 <= float(match["nm"]) <= 900.0:
            families.setdefault(match["family"].upper().rstrip("_"), {})[float(match["nm"])] = name
    largest = max(families.values(), key=len, default={})
    return dict(sorted(largest.items())) if len(largest) >= _FEWEST_BANDS else {}


def _refuse_empty(path: Path, table: Table) -> None:
    if not table.rows:
        what = "the chart has no patches"
        raise ChartError(path, what, remedy="export the measurement, not the empty form")


def _chart(path: Path, table: Table, inks: tuple[str, str, str, str], bands: dict[float, str]) -> Chart:
    cmyk = _numbers(path, table, inks)
    _check_percent(path, table, cmyk)
    wave_nm = np.array(list(bands))
    if wave_nm[0] > _MUST_COVER_NM[0] or wave_nm[-1] < _MUST_COVER_NM[1]:
        what = f"spectra cover {wave_nm[0]:g} to {wave_nm[-1]:g} nm"
        raise ChartError(path, what, remedy="at least 420 to 680 nm are needed")
    measured = _numbers(path, table, tuple(bands.values()))
    scale = _scale(path, table, measured)
    _check_reflectance(path, table, cmyk, measured / scale)
    return Chart(
        where=str(path),
        keywords=table.keywords,
        cmyk_percent=cmyk,
        wave_nm=wave_nm,
        measured=measured,
        scale=scale,
    )


def _numbers(path: Path, table: Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    values = table.numbers(names)
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = bad[0]
        cell = table.rows[row][table.fields.index(names[column])] or "empty"
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        what = f"{table.line(row)}, column {shortly(names[column])}: {shortly(cell)} is not a number{more}"
        raise ChartError(path, what, remedy="measure that patch again or take it out")
    return values


def _check_percent(path: Path, table: Table, cmyk: NDArray[np.float64]) -> None:
    row = int(np.unravel_index(np.argmax(cmyk), cmyk.shape)[0])
    if cmyk.min() < 0:
        row = int(np.unravel_index(np.argmin(cmyk), cmyk.shape)[0])
        what = f"{table.line(row)}: ink of {cmyk.min():g} %"
        raise ChartError(path, what, remedy="ink goes from 0 to 100 %")
    if cmyk.max() > 100.01:
        what = f"{table.line(row)}: ink of {cmyk.max():g} %; the recipes look like 0..255"
        raise ChartError(path, what, remedy="CMYK must be in per cent, 0..100")
    if cmyk.max() <= 1.0:
        what = f"no ink goes beyond {cmyk.max():g} %; the recipes look like 0..1"
        raise ChartError(path, what, remedy="CMYK must be in per cent, 0..100")


def _scale(path: Path, table: Table, measured: NDArray[np.float64]) -> float:
    """Return 1 or 100, by ArgyllCMS's keyword, else by size: no print reflects twice the incident light."""
    norm = table.keyword("SPECTRAL_NORM")
    if norm is not None:
        if not _LEAST_NORM <= number(norm) <= _GREATEST_NORM:
            what = f"SPECTRAL_NORM is {shortly(norm) or 'nothing'}"
            raise ChartError(path, what, remedy="it is what a perfect white has: 1, or 100 for per cent")
        return number(norm)
    if measured.max() > 150.0:
        what = f"reflectance goes up to {measured.max():g}; it looks like 0..255"
        raise ChartError(path, what, remedy="spectra must be factors, 0..1, or per cent, 0..100")
    return 100.0 if measured.max() > 2.0 else 1.0


def _check_reflectance(
    path: Path, table: Table, cmyk: NDArray[np.float64], reflectance: NDArray[np.float64]
) -> None:
    for row in (int(reflectance.min(axis=1).argmin()), int(reflectance.max(axis=1).argmax())):
        low, high = reflectance[row].min(), reflectance[row].max()
        if (
            low < -0.02 or high > 1.5
        ):  # assumed: noise about zero; a strong brightener under M1 stays below 1.3
            what = f"{table.line(row)}: reflectance runs from {low:.3g} to {high:.3g}"
            raise ChartError(path, what, remedy="spectra must be factors, 0..1, or per cent, 0..100")
    ink, light = cmyk.sum(axis=1), reflectance.mean(axis=1)
    if len(cmyk) > 2 and ((ink - ink.mean()) * (light - light.mean())).sum() > 0:
        what = "patches with more ink have higher values: these are densities, not reflectance"
        raise ChartError(path, what, remedy=_EXPORT_SPECTRA)
