"""Signal, noise, sharpness and speed of a camera as functions of any field of its press file."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

from prooflight.camera.sharpness import nyquist_per_mm, sharpness
from prooflight.commissioning.characterise import recipe_grid, signal_dn, variance_dn2
from prooflight.errors import PressFileError, RequestError
from prooflight.files.given import shortly
from prooflight.prediction.tables import node_fractions
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor

A4_LENGTH_MM = 297.0  # ISO 216; the long side lies along the travel
PATCHES = np.array([[0, 0, 0, 0], [0, 0, 0, 0.5], [0, 0, 0, 1]], dtype=np.float64)
"""Recipes C, M, Y, K of paper white, half black and solid black. [-]"""
TABLE_STRIDE = 4
"""Step over the nodes of the tables along each ink.

Every fourth is few enough to explore with, and inks are darkest and lightest at the ends, which are among
them.
"""
MOST_DESIGNS = 1000
"""Greatest number of designs of one command; all are checked before the first is computed."""
_DEEPEST_FIELD = 5
SATURATION_SIGMAS = 4.0
"""assumed: one column in some ten thousand lies further out, and `press build` refuses if a single one saturates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """Values of one field of a press file."""

    field: str
    values: tuple[int | float | str, ...]

    @classmethod
    def parse(cls, text: str) -> Variation:
        """Parse ``lens.f_number=2.8,4,5.6``; RequestError for anything else."""
        field, equals, values = text.partition("=")
        items = [item.strip() for item in values.split(",")]
        if not equals or not field.strip() or not all(items):
            remedy = "give FIELD=a,b,c, e.g. lens.f_number=2.8,4"
            raise RequestError(
                "--vary", f"{shortly(text)!r} does not name a field and its values", remedy=remedy
            )
        return cls(field=field.strip(), values=tuple(_number_or_text(item) for item in items))


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorDesign:
    """One sensor of a design, on the axis of the lens.

    Noise is temporal and in closed form, as the press's tables hold it: shot, dark, read and rounding, before clipping.
    Signal-to-noise ratios are of the signal above dark.
    """

    name: str
    white_dn: float
    """Digital number of paper white after clipping, with dark and black level. [DN]"""
    saturates: bool
    """Whether the brightest colour, or a column 4 total standard deviations above, passes the top code."""
    white_snr: float
    tint_snr: float
    """Signal-to-noise ratio at 50 % black. [-]"""
    solid_snr: float
    """Signal-to-noise ratio at 100 % black. [-]"""
    white_sigma_dn: float
    tint_sigma_dn: float
    solid_sigma_dn: float
    table_sigma_min_dn: float
    """Least standard deviation over the nodes of the CMYK table. [DN]"""
    table_sigma_max_dn: float
    mtf_nyquist_across: float
    """System MTF of white paper's light at half a cycle a pixel. [-]"""
    mtf_nyquist_along: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """One combination of values and its results."""

    vary: dict[str, int | float | str]
    field_mm: float
    pixel_pitch_mm: float
    """Pixel pitch on the page. [mm]"""
    line_pitch_mm: float
    """Line pitch on the page, after binning. [mm]"""
    a4_pages_per_s: float
    """Number of A4 sheets, short edge first, without gaps. [1/s]"""
    sensors: tuple[SensorDesign, ...]


def varied(press_file: PressFile, values: Mapping[str, int | float | str]) -> PressFile:
    """Return the same press with other values in fields named by dots, checked again.

    ``sensor.read_noise_e`` is of every sensor, ``sensor.2.read_noise_e`` of the second. PressFileError, as of
    a file with that value in it, if there is no such field or the value is wrong.
    """
    tree = tomllib.loads(press_file.text)
    for field, value in values.items():
        _set(press_file, tree, field, value)
    return PressFile(press_file.path, tomlkit.dumps(tree))


def designs(press_file: PressFile, variations: Sequence[Variation]) -> Iterator[Design]:
    """Yield one design for each combination of values, the last variation running fastest.

    PressFileError before the first design if any combination cannot be used.
    """
    fields = [variation.field for variation in variations]
    if len(set(fields)) < len(fields):
        raise RequestError("--vary", "names a field twice", remedy="give all values of a field at once")
    refuse_many(math.prod(len(variation.values) for variation in variations))
    combinations = [
        dict(zip(fields, values, strict=True))
        for values in itertools.product(*(variation.values for variation in variations))
    ]
    candidates = [varied(press_file, values) for values in combinations]
    cameras = [candidate.camera() for candidate in candidates]
    return _designs(combinations, candidates, cameras)


def refuse_many(designs: int) -> None:
    """Raise RequestError if there are more than one command can compute."""
    if designs > MOST_DESIGNS:
        what = f"{designs} designs" if designs < 10**9 else "more than a thousand million designs"
        raise RequestError(
            "--vary", what, remedy=f"give at most {MOST_DESIGNS}: fewer values, or fewer fields at once"
        )


def _designs(
    combinations: Sequence[dict[str, int | float | str]],
    candidates: Sequence[PressFile],
    cameras: Sequence[Camera],
) -> Iterator[Design]:
    inks_block, patches, nodes = None, np.empty(0), np.empty(0)
    for values, candidate, camera in zip(combinations, candidates, cameras, strict=True):
        block = tomllib.loads(candidate.text).get("inks", {})
        if block != inks_block:  # the inks' spectra take longer than all the rest
            inks = candidate.inks()
            inks_block, patches, nodes = block, inks.reflectance(PATCHES), inks.reflectance(_nodes())
        yield Design(
            vary=values,
            field_mm=camera.field_mm,
            pixel_pitch_mm=camera.pixel_pitch_mm,
            line_pitch_mm=camera.line_pitch_mm,
            a4_pages_per_s=camera.line_travel_mm * camera.sensors[0].line_rate_hz / A4_LENGTH_MM,
            sensors=tuple(_sensor_design(camera, sensor, patches, nodes) for sensor in camera.sensors),
        )


def _nodes() -> NDArray[np.float64]:
    """Return the recipes (9, 9, 9, 9, 4) of every fourth of the tables' nodes along each ink."""
    axis = node_fractions()[::TABLE_STRIDE]
    return recipe_grid(axis, axis, axis, axis)


def _sensor_design(
    camera: Camera, sensor: LineSensor, patches: NDArray[np.float64], nodes: NDArray[np.float64]
) -> SensorDesign:
    electrons = sensor.electrons(camera.irradiance_photons(patches))
    over_nodes = sensor.electrons(camera.irradiance_photons(nodes))
    extremes = np.array([over_nodes.min(), over_nodes.max()])
    sigma = np.sqrt(variance_dn2(sensor, electrons))
    # Noise rises with light, so light's ends are its ends.
    table_sigma = np.sqrt(variance_dn2(sensor, extremes))
    snr = signal_dn(sensor, electrons) / sigma
    white_dn, _ = sensor.dn_moments(electrons[0], sensor.variance_temporal_e2(electrons[0]))
    total_e = np.sqrt(sensor.variance_total_e2(extremes[1]))
    brightest_e = extremes[1] + sensor.dark_e + SATURATION_SIGMAS * total_e
    mtf = sharpness(camera, sensor, nyquist_per_mm(sensor))
    return SensorDesign(
        name=sensor.name,
        white_dn=float(white_dn),
        saturates=bool(brightest_e * sensor.dn_per_e + sensor.black_level_dn > sensor.top_code_dn),
        white_snr=float(snr[0]),
        tint_snr=float(snr[1]),
        solid_snr=float(snr[2]),
        white_sigma_dn=float(sigma[0]),
        tint_sigma_dn=float(sigma[1]),
        solid_sigma_dn=float(sigma[2]),
        table_sigma_min_dn=float(table_sigma[0]),
        table_sigma_max_dn=float(table_sigma[1]),
        mtf_nyquist_across=float(mtf.across),
        mtf_nyquist_along=float(mtf.along),
    )


def _number_or_text(item: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(item)
        except ValueError:
            continue
    return item


def _set(press_file: PressFile, tree: dict[str, Any], field: str, value: int | float | str) -> None:
    """Set ``field`` to ``value``; blocks that are not there yet are created, and checked with the rest."""
    names = field.split(".")
    if len(names) > _DEEPEST_FIELD:
        what = f"{shortly(field)} is not a field"
        raise PressFileError(press_file.path, what, remedy="name one field, e.g. lens.f_number")
    places: list[dict[str, Any]] = [tree]
    if names[0] == "sensor":
        places, names = tree["sensor"], names[1:]
        if names and names[0].isdecimal():
            number = int(names[0][:9])
            if not 1 <= number <= len(places):
                what = f"{shortly(field)}: there is no sensor {shortly(names[0])}"
                raise PressFileError(press_file.path, what, remedy=f"choose 1 to {len(places)}")
            places, names = [places[number - 1]], names[1:]
    for place in places:
        for name in names[:-1]:
            place = place.setdefault(name, {}) if isinstance(place, dict) else place
        if not names or not isinstance(place, dict) or isinstance(place.get(names[-1]), dict | list):
            what = f"{shortly(field)} is not a single value"
            raise PressFileError(press_file.path, what, remedy="name one field, e.g. lens.f_number")
        place[names[-1]] = value
