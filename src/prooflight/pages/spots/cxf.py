"""Spot inks as CxF: spectra of their tints, as a PDF's output intent or a file beside a job or a press holds them.

The names of elements are those of CxF3 (ISO 17972-1) and of its custom resource ``SpotInkCharacterisation`` of CxF/X-4
(ISO 17972-4). Assumed: the standard is not free, so that attributes are read as programs write them that follow it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import ChartError
from prooflight.files.given import GivenFiles, shortly
from prooflight.pages.spots.spot_ink import SpotInk
from prooflight.spectra import to_grid

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


REMEDY: Final = "export the PDF again, with the spectra of its inks as CxF/X-4"
MOST_BANDS: Final = 1000
LARGEST: Final = 2.0
"""Greatest reflectance factor that is one, and no percentage: fluorescent inks reach some 1.3."""


CXF_FILES: Final = GivenFiles(error=ChartError, remedy="give spectra as CxF 3 or CxF/X-4", largest_mb=16)
BLACK: Final = "Black"


def read_cxf(path: Path) -> str:
    """Return the text of a CxF file; ChartError: it cannot be read."""
    try:
        return CXF_FILES.read_text(path)
    except OSError as error:
        raise ChartError(path, "cannot be read", remedy=CXF_FILES.remedy) from error


def spot_names(text: str, where: str) -> tuple[str, ...]:
    """Return the names of the inks that a CxF/X-4 characterises; ChartError: it is no CxF."""
    inks = _every(_root(text, where), "SpotInkCharacterisation")
    return tuple(dict.fromkeys(name for ink in inks if (name := ink.get("SpotInkName"))))


def read_spot_ink(text: str, name: str, *, file: str = "") -> SpotInk:
    """Read the tints of one ink on its substrate, and its solid on black, from CxF; file: that it came from, if any.

    A CxF that characterises no ink of this name, but holds one object of it, such as a library of colours, gives the
    solid. ChartError: it is no CxF, holds no spectrum of the full ink, or a value is none. Nothing else is loaded, and
    a document type is refused.
    """
    where = f"CxF of {shortly(name)}"
    where = f"{file}: {where}" if file else where
    root = _root(text, where)
    specifications = {each.get("Id"): each for each in _every(root, "ColorSpecification")}
    tints: dict[float, NDArray[np.float64]] = {}
    on_black, condition = None, ""
    for background, tint, spectrum in _measurements(root, name, where):
        stated = specifications.get(spectrum.get("ColorSpecification"))
        factors = _spectrum(where, spectrum, stated)
        if background != BLACK:
            tints[tint] = factors
            condition = _condition(where, stated) or condition
        elif tint == 1:
            on_black = factors
    if 1.0 not in tints:
        raise ChartError(where, "holds no spectrum of the full ink on its substrate", remedy=REMEDY)
    rising = sorted(tints)
    measured = np.array([tints[tint] for tint in rising])
    return SpotInk(
        name=name, tint=np.array(rising), measured=measured, on_black=on_black, condition=condition
    )


def _root(text: str, where: str) -> Element:
    if "<!DOCTYPE" in text:
        raise ChartError(where, "declares a document type", remedy=REMEDY)
    try:
        return ElementTree.fromstring(text)
    except (
        ElementTree.ParseError,
        ValueError,
    ) as error:  # ValueError: it names an encoding that text has not
        raise ChartError(where, f"is not XML ({shortly(str(error))})", remedy=REMEDY) from None


def _measurements(root: Element, name: str, where: str) -> Iterator[tuple[str, float, Element]]:
    """Yield background, tint 0 to 1 and spectrum of each measurement of an ink, those on other backgrounds left out."""
    inks = [ink for ink in _every(root, "SpotInkCharacterisation") if ink.get("SpotInkName") == name]
    if not inks:
        named = [each for each in _every(root, "Object") if each.get("Name") == name]
        spectra = [spectrum for each in named[:1] for spectrum in _every(each, "ReflectanceSpectrum")]
        if len(named) == 1 and spectra:
            yield "Substrate", 1.0, spectra[0]
        return
    objects = {each.get("Id"): each for each in _every(root, "Object") if each.get("Id")}
    for measured in (one for ink in inks for one in _every(ink, "MeasurementSet")):
        background = measured.get("Background") or "Substrate"
        if background not in ("Substrate", BLACK):
            continue
        for one in _every(measured, "Measurement"):
            tint = _number(where, "TintLevel", one.get("TintLevel", "")) / 100
            target = objects.get(one.get("ObjectRef") or one.get("ObjectIDRef"))
            if not 0 <= tint <= 1 or target is None:
                what = f"has a measurement of {100 * tint:g} % without an object"
                raise ChartError(where, what, remedy=REMEDY)
            # An object may hold one spectrum a measurement condition: the one that is named, else the first.
            wanted, spectra = one.get("ReflectanceSpectrumNameRef"), _every(target, "ReflectanceSpectrum")
            spectra.sort(key=lambda each: wanted is None or each.get("Name") != wanted)
            yield from ((background, tint, spectrum) for spectrum in spectra[:1])


def _condition(where: str, specification: Element | None) -> str:
    """Return measurement condition and geometry as a specification states them; empty: it does not."""
    if specification is None:
        return ""
    light = next((_text(each)[:2] for each in _every(specification, "DeviceIllumination")), "")
    parts = [light] if light in ("M0", "M1", "M2", "M3") else []
    for single in _every(specification, "SingleAngle"):
        angles = [
            f"{_number(where, kind, _text(angle)):g}"
            for kind in ("IlluminationAngle", "MeasurementAngle")
            for angle in _every(single, kind)[:1]
        ]
        parts += [":".join(angles)] if len(angles) == 2 else []
    parts += ["sphere" for _ in _every(specification, "SphereGeometry")]
    return ", ".join(dict.fromkeys(parts))


def _text(element: Element) -> str:
    return (element.text or "").strip()


def _every(element: Element, name: str) -> list[Element]:
    """Return all elements of a name below another, of whatever namespace."""
    return [each for each in element.iter() if each.tag == name or str(each.tag).endswith(f"}}{name}")]


def _spectrum(where: str, spectrum: Element, specification: Element | None) -> NDArray[np.float64]:
    """Return a spectrum on the package's grid, (36,). [-]"""
    grids = [] if specification is None else _every(specification, "WavelengthRange")
    stated = dict(grids[-1].items() if grids else ()) | dict(spectrum.items())
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
        raise ChartError(
            where, "has a value that is not a reflectance factor", remedy="give factors, 0 to about 1"
        )
    return to_grid(wave_nm.astype(np.float64), np.array(values, np.float64))


def _number(where: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ChartError(where, f"{what} is {shortly(text)!r}", remedy=REMEDY)
    return value
