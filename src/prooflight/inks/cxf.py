"""Spot inks as CxF/X-4: spectra of their tints on the substrate, as a PDF's output intent holds them.

The names of elements are those of CxF3 and of its custom resource ``SpotInkCharacterisation`` (ISO 17972-4). Assumed:
the standard is not free, so that attributes are read as programs write them that follow it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from prooflight.errors import ChartError
from prooflight.files.given import shortly
from prooflight.inks.chart import to_grid
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    from numpy.typing import NDArray

REMEDY: Final = "export the PDF again, with the spectra of its inks as CxF/X-4"
MOST_BANDS: Final = 1000
LARGEST: Final = 2.0
"""Greatest reflectance factor that is one, and no percentage: fluorescent inks reach some 1.3."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotInk:
    """One spot ink, measured on its substrate."""

    name: str
    tint: NDArray[np.float64]
    """Tints (n,), rising, 0 to 1; the last is the solid. [-]"""
    measured: NDArray[np.float64]
    """Reflectance factors (n, 36). [-]"""

    @property
    def solid(self) -> NDArray[np.float64]:
        """Return the reflectance factor of the full ink, (36,). [-]"""
        return self.measured[-1]

    def reflectance(self, tint: float) -> NDArray[np.float64]:
        """Return the reflectance factor (36,) of a tint, 0 to 1, interpolated between the measured ones. [-]

        The square root of reflectance is interpolated, as light spreads in paper about its dots (Yule and Nielsen,
        1951, with n = 2). Below the least measured tint, that one holds.
        """
        roots = np.sqrt(self.measured)
        return np.array([np.interp(tint, self.tint, roots[:, band]) for band in range(BANDS)]) ** 2


def read_spot_ink(text: str, name: str) -> SpotInk:
    """Read the tints of one ink on its substrate from CxF/X-4.

    ChartError: it is no CxF, holds no spectra of this ink with its solid, or a value is none. Nothing else is loaded,
    and a document type is refused.
    """
    where = f"CxF of {shortly(name)}"
    if "<!DOCTYPE" in text:
        raise ChartError(where, "declares a document type", remedy=REMEDY)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ChartError(where, f"is no XML ({shortly(str(error))})", remedy=REMEDY) from None
    except ValueError as error:
        raise ChartError(where, f"is no XML ({shortly(str(error))})", remedy=REMEDY) from None
    objects = {each.get("Id"): each for each in _every(root, "Object") if each.get("Id")}
    ranges = {
        each.get("Id"): grid
        for each in _every(root, "ColorSpecification")
        for grid in _every(each, "WavelengthRange")
    }
    tints: dict[float, NDArray[np.float64]] = {}
    for ink in _every(root, "SpotInkCharacterisation"):
        if ink.get("SpotInkName") != name:
            continue
        for measured in _every(ink, "MeasurementSet"):
            if measured.get("Background") not in (None, "Substrate"):
                continue  # on black, which says how much the ink covers
            for one in _every(measured, "Measurement"):
                tint = _number(where, "TintLevel", one.get("TintLevel", "")) / 100
                target = objects.get(one.get("ObjectRef") or one.get("ObjectIDRef"))
                if not 0 <= tint <= 1 or target is None:
                    what = f"has a measurement of {100 * tint:g} % without an object"
                    raise ChartError(where, what, remedy=REMEDY)
                for spectrum in _every(target, "ReflectanceSpectrum"):
                    tints[tint] = _spectrum(where, spectrum, ranges)
                    break
    if 1.0 not in tints:
        raise ChartError(where, "holds no spectrum of the full ink on its substrate", remedy=REMEDY)
    rising = sorted(tints)
    return SpotInk(name=name, tint=np.array(rising), measured=np.array([tints[tint] for tint in rising]))


def _every(element: Element, name: str) -> list[Element]:
    """Return all elements of a name below another, of whatever namespace."""
    return [each for each in element.iter() if each.tag == name or str(each.tag).endswith(f"}}{name}")]


def _spectrum(where: str, spectrum: Element, ranges: dict[str | None, Element]) -> NDArray[np.float64]:
    """Return a spectrum on the package's grid, (36,). [-]"""
    grid = ranges.get(spectrum.get("ColorSpecification"))
    stated = dict(() if grid is None else grid.items()) | dict(spectrum.items())
    first_nm = _number(where, "StartWL", stated.get("StartWL", ""))
    step_nm = _number(where, "Increment", stated.get("Increment", "10"))
    values = [
        _number(where, "a reflectance", text) for text in (spectrum.text or "").split()[: MOST_BANDS + 1]
    ]
    if not 2 <= len(values) <= MOST_BANDS or not 0 < step_nm <= 50 or not 200 <= first_nm <= 800:
        what = f"has a spectrum of {len(values)} values from {first_nm:g} nm by {step_nm:g} nm"
        raise ChartError(where, what, remedy=REMEDY)
    wave_nm = first_nm + step_nm * np.arange(len(values), dtype=np.float64)
    if wave_nm[0] > 420 or wave_nm[-1] < 680:
        what = f"has a spectrum of {wave_nm[0]:g} to {wave_nm[-1]:g} nm, and 420 to 680 nm are needed"
        raise ChartError(where, what, remedy=REMEDY)
    if min(values) < 0 or max(values) > LARGEST:
        raise ChartError(where, "has a reflectance factor that is none", remedy="give factors, 0 to about 1")
    return to_grid(wave_nm.astype(np.float64), np.array(values, np.float64))


def _number(where: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ChartError(where, f"{what} is {shortly(text)!r}", remedy=REMEDY)
    return value
