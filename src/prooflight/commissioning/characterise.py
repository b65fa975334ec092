"""Characterisation of the camera's response to every colour: the two tables of prediction (paper, section 3.4).

Next to the tables: the accuracy of their interpolation, the calibration of columns, and how recipes look to a person.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prooflight import spectra
from prooflight.camera.camera import Camera, expose_flat
from prooflight.camera.sensor import ROUNDING_DN2, FixedPattern, LineSensor
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.kernels.prediction.lookup import NODES
from prooflight.prediction.predict import expected_light
from prooflight.prediction.tables import ClippedShare, SensorModel, node_fractions

if TYPE_CHECKING:
    from prooflight.inks.reflectance import ReflectanceModel

STEPS = 9

XYZ_TO_LINEAR_SRGB = np.array(  # IEC 61966-2-1
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
RANDOM_RECIPES = 20_000
PROTOCOLS: Final = GivenFiles(
    error=RequestError, remedy="give the protocol of a set-up, or delete it to start over", largest_mb=64
)
LEAST_GAIN: Final = 0.02
"""Least gain of a column over the mean of all: one that sees less is dead or covered."""


def signal_dn(sensor: LineSensor, electrons: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light signal above dark of photo-electrons (...), before clipping. [DN]"""
    return electrons * sensor.dn_per_e


def variance_dn2(sensor: LineSensor, electrons: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the temporal variance of a digital number in closed form: shot, dark, read and rounding. (...) [DN^2]"""
    return sensor.variance_temporal_e2(electrons) * sensor.dn_per_e**2 + ROUNDING_DN2


def recipe_grid(*axes: ArrayLike) -> NDArray[np.float64]:
    """Return every combination of ink fractions, an axis (n,) for each of the four inks: (n, n, n, n, 4)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def tables(camera: Camera, inks: ReflectanceModel) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Return the mean and variance tables of every sensor in closed form, each (33, 33, 33, 33), on the lens's axis.

    Units: [DN] and [DN^2].
    """
    axis = node_fractions()
    electrons = np.empty((len(camera.sensors), *(NODES,) * 4))
    for index, cyan in enumerate(axis):  # a slab at a time: the spectra of all nodes are 340 MB
        slab = recipe_grid([cyan], axis, axis, axis)[0]
        irradiance = camera.irradiance_photons(inks.reflectance(slab))
        for number, sensor in enumerate(camera.sensors):
            electrons[number, index] = sensor.electrons(irradiance)
    return [
        (
            unbiased_nodes(signal_dn(sensor, of_sensor)),
            unbiased_nodes(variance_dn2(sensor, of_sensor)),
        )
        for sensor, of_sensor in zip(camera.sensors, electrons, strict=True)
    ]


def unbiased_nodes(exact: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return node values whose linear interpolation errs evenly to both sides, from the exact values at the nodes.

    A chord of a function errs by f'' h^2 / 12 on average over its cell, always to the same side; taking a
    twelfth of the second difference off each node, axis by axis, removes that and makes the rms error 2.4
    times smaller (from 1 / sqrt(120) to sqrt(1 / 120 - 1 / 144) of f'' h^2). Nodes without an ink are left
    alone along its axis: pages are full of colours that lack one, paper first.
    """
    moved = exact.copy()
    for axis in range(exact.ndim):
        values, result = np.moveaxis(exact, axis, 0), np.moveaxis(moved, axis, 0)
        second = np.diff(values, 2, axis=0)
        result[1:-1] -= second / 12
        result[-1] -= second[-1] / 12
    return moved.astype(np.float32)


CLEAR_SIGMA = 4.0
"""A Gaussian has 3e-5 of its weight beyond four sigma: clipping it there changes its variance by 0.03 %."""


def near_the_ends(
    sensor: LineSensor, electrons: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether the noise of photo-electrons (...) is clipped at 0 DN, and at the top code; two (...) arrays.

    Closed form: the digital number's mean with dark signal and black level lies within ``CLEAR_SIGMA``
    temporal sigma of that end, in a column of gain 1 without DSNU. Everywhere else temporal noise is Gaussian
    (paper, section 3.4).
    """
    mean = signal_dn(sensor, electrons + sensor.dark_e) + sensor.black_level_dn
    reach = CLEAR_SIGMA * np.sqrt(variance_dn2(sensor, electrons) - ROUNDING_DN2)
    return mean < reach, mean > sensor.top_code_dn - reach


def clipped_share(sensor: LineSensor, mean_dn: NDArray[np.float32]) -> ClippedShare:
    """Return the shares of the nodes of a mean table (33, 33, 33, 33) [DN above dark] whose noise is clipped."""
    electrons = mean_dn.astype(np.float64) / sensor.dn_per_e
    black, saturation = near_the_ends(sensor, electrons)
    return ClippedShare(black=float(black.mean()), saturation=float(saturation.mean()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ColumnCalibration:
    """Offset and gain of each column, from a dark and a white exposure."""

    offset_dn: NDArray[np.float32]
    """Digital number (pixels,) without light, as lit columns have it. [DN]"""
    gain: NDArray[np.float32]
    """Signal (pixels,) over that on the axis of the lens. [-]"""


DARK_TILE = 0.05
"""assumed: a black ceramic tile, for sensors whose noise without light is clipped at 0 DN."""


def clips_in_the_dark(sensor: LineSensor) -> bool:
    """Return whether noise reaches 0 DN without light, four sigma from the mean.

    A dark exposure's mean is then too high.
    """
    mean = sensor.dark_e * sensor.dn_per_e + sensor.black_level_dn
    spread_e = np.sqrt(sensor.variance_temporal_e2(np.zeros(())) + sensor.dsnu_e**2)
    return bool(mean < 4 * spread_e * sensor.dn_per_e)


def calibrate_columns(
    camera: Camera,
    *,
    patterns: Sequence[FixedPattern],
    white_reflectance: NDArray[np.float64],
    lines: int,
    rng: np.random.Generator,
) -> list[ColumnCalibration]:
    """Measure offset and gain of each column from a dark exposure and a white tile of known reflectance (36,).

    Dark is a covered lens, or a black tile where a covered lens would clip (``black_level_dn`` 0): a line
    through both signals gives offset and gain. The gain is relative to the closed-form signal on the axis, so
    it combines lamp, cos^4 and PRNU. Its standard error is the temporal sigma over sqrt(lines).
    """

    def exposed(reflectance: NDArray[np.float64]) -> NDArray[np.float64]:
        frames = expose_flat(camera, reflectance, lines=lines, patterns=patterns, rng=rng)
        return np.asarray(frames.mean(axis=1))

    darkness = {False: np.zeros_like(white_reflectance), True: np.full_like(white_reflectance, DARK_TILE)}
    needed = {clips_in_the_dark(sensor) for sensor in camera.sensors}
    dark = {clips: exposed(darkness[clips]) for clips in sorted(needed)}
    white = exposed(white_reflectance)
    calibrations = []
    for index, sensor in enumerate(camera.sensors):
        clips = clips_in_the_dark(sensor)
        low, high = (
            float(signal_dn(sensor, sensor.electrons(camera.irradiance_photons(reflectance))))
            for reflectance in (darkness[clips], white_reflectance)
        )
        gain = (white[index] - dark[clips][index]) / (high - low)
        offset = dark[clips][index] - gain * low
        calibrations.append(
            ColumnCalibration(offset_dn=offset.astype(np.float32), gain=gain.astype(np.float32))
        )
    return calibrations


def appearance_srgb(inks: ReflectanceModel) -> NDArray[np.uint8]:
    """Return sRGB (IEC 61966-2-1) of recipes at 9 even steps of each ink, (9, 9, 9, 9, 3).

    Bare paper is shown white.
    """
    axis = np.linspace(0, 1, STEPS)
    tristimulus = spectra.xyz(inks.reflectance(recipe_grid(axis, axis, axis, axis)), "D65")
    relative = tristimulus / tristimulus[0, 0, 0, 0] * spectra.white_xyz("D65")
    return srgb_bytes(relative @ XYZ_TO_LINEAR_SRGB.T)


def srgb_bytes(light: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB (IEC 61966-2-1) of light over white's, bounded to 0..1."""
    return np.round(spectra.srgb_encoded(light) * 255).astype(np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableAccuracy:
    """Errors of one sensor's tables, the mean's in standard deviations of the temporal noise."""

    sensor: str
    mean_rms_sigma: float
    mean_max_sigma: float
    white_sigma: float
    """Error at bare paper."""
    sigma_rms_percent: float


def trial_recipes(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Draw recipes (n, 4) as pages have them: paper, ramps of one and of two inks, and random ones."""
    ramp = np.arange(256)
    recipes = [np.zeros((1, 4), np.int64), rng.integers(0, 256, (RANDOM_RECIPES, 4))]
    for first in range(4):
        single = np.zeros((256, 4), np.int64)
        single[:, first] = ramp
        recipes.append(single)
        for second in range(first + 1, 4):
            pair = single.copy()
            pair[:, second] = rng.permutation(ramp)
            recipes.append(pair)
    return np.concatenate(recipes).astype(np.uint8)


def table_accuracy(
    camera: Camera, inks: ReflectanceModel, sensors: tuple[SensorModel, ...], rng: np.random.Generator
) -> list[TableAccuracy]:
    """Compare interpolated mean and sigma with the exact closed form, over ``trial_recipes``."""
    recipes = trial_recipes(rng)
    irradiance = camera.irradiance_photons(inks.reflectance(recipes / 255))
    results = []
    for sensor, model in zip(camera.sensors, sensors, strict=True):
        electrons = sensor.electrons(irradiance)
        exact, sigma = signal_dn(sensor, electrons), np.sqrt(variance_dn2(sensor, electrons))
        mean, variance = expected_light(recipes, model)
        error, of_sigma = (mean - exact) / sigma, np.sqrt(variance) / sigma - 1
        results.append(
            TableAccuracy(
                sensor=model.name,
                mean_rms_sigma=round(float(np.sqrt(np.mean(error**2))), 4),
                mean_max_sigma=round(float(np.abs(error).max()), 4),
                white_sigma=round(float(abs(error[0])), 4),
                sigma_rms_percent=round(float(np.sqrt(np.mean(of_sigma**2))) * 100, 4),
            )
        )
    return results


def measured_columns(path: Path, camera: Camera) -> list[ColumnCalibration]:
    """Read the columns of a real camera from the protocol of its set-up; RequestError: it holds none.

    A press counts its light on the lens's axis: all columns combined see as much of it as cos^4 leaves.
    """
    try:
        records = json.loads(PROTOCOLS.read_text(path))["columns"]
        columns = [
            (np.array(one["offset_dn"], np.float32), np.array(one["gain"], np.float64)) for one in records
        ]
        fit = bool(columns) and all(
            offset.ndim == gain.ndim == 1
            and offset.size == gain.size
            and np.isfinite(offset).all()
            and ((gain > LEAST_GAIN) & (gain < 1 / LEAST_GAIN)).all()
            for offset, gain in columns
        )
    except (ValueError, TypeError, KeyError) as error:
        raise RequestError(path, "is no protocol of a set-up", remedy=PROTOCOLS.remedy) from error
    if not fit:
        what = "holds no columns of a camera, or columns without signal"
        raise RequestError(path, what, remedy="repeat the steps dark and flat of `prooflight camera set-up`")
    shade = float(camera.column_light().mean())
    return [
        ColumnCalibration(offset_dn=offset, gain=(shade * gain).astype(np.float32))
        for offset, gain in columns
    ]
